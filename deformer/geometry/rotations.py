"""Rotations: polar decomposition, exponential and logarithm with their derivative, Procrustes.

A rotation vector r = θω turns by θ = ‖r‖ radians about the unit axis ω (right-handed); vectors
longer than π are rotations by more than half a turn. Functions that end in an underscore are
compiled scalar kernels that other compiled modules call; they write into their last arguments.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer.checks import LARGEST, checked_array, rounded, shortened
from deformer.compilation import called_with, njit
from deformer.errors import InputError
from deformer.geometry.mesh import FloatArray

# Quaternions and matrices are rounded in files: they may be off a rotation by this much.
_ROUNDING, _EXACT = 0.01, 1e-12
# Below this angle (radians) series replace the closed forms.
_SMALL = 1e-3


@njit(nogil=True, error_model="numpy")
def exp_(r, R):
    """R (3,3) = exp([r]×) for r (3,): Rodrigues' formula."""
    x, y, z = r[0], r[1], r[2]
    t2 = x * x + y * y + z * z
    if t2 < _SMALL * _SMALL:
        a = 1.0 - t2 / 6.0 * (1.0 - t2 / 20.0)
        b = 0.5 - t2 / 24.0 * (1.0 - t2 / 30.0)
    else:
        t = math.sqrt(t2)
        a = math.sin(t) / t
        b = 2.0 * math.sin(0.5 * t) ** 2 / t2
    R[0, 0] = 1.0 - b * (y * y + z * z)
    R[0, 1] = b * x * y - a * z
    R[0, 2] = b * x * z + a * y
    R[1, 0] = b * x * y + a * z
    R[1, 1] = 1.0 - b * (x * x + z * z)
    R[1, 2] = b * y * z - a * x
    R[2, 0] = b * x * z - a * y
    R[2, 1] = b * y * z + a * x
    R[2, 2] = 1.0 - b * (x * x + y * y)


@njit(nogil=True, error_model="numpy")
def right_jacobian_(r, J):
    """J (3,3) with exp(r + δ) = exp(r) exp(J δ) to first order in δ."""
    x, y, z = r[0], r[1], r[2]
    t2 = x * x + y * y + z * z
    if t2 < _SMALL * _SMALL:
        b = 0.5 - t2 / 24.0 * (1.0 - t2 / 30.0)
        c = 1.0 / 6.0 - t2 / 120.0 * (1.0 - t2 / 42.0)
    else:
        t = math.sqrt(t2)
        b = 2.0 * math.sin(0.5 * t) ** 2 / t2
        c = (t - math.sin(t)) / (t2 * t)
    J[0, 0] = 1.0 - c * (y * y + z * z)
    J[0, 1] = c * x * y + b * z
    J[0, 2] = c * x * z - b * y
    J[1, 0] = c * x * y - b * z
    J[1, 1] = 1.0 - c * (x * x + z * z)
    J[1, 2] = c * y * z + b * x
    J[2, 0] = c * x * z + b * y
    J[2, 1] = c * y * z - b * x
    J[2, 2] = 1.0 - c * (x * x + y * y)


@njit(nogil=True, error_model="numpy")
def log_(R, r):
    """r (3,) with exp([r]×) = R (3,3) and ‖r‖ ≤ π, through the quaternion of R (Shepperd)."""
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > 0.0:
        w = 1.0 + trace
        x = R[2, 1] - R[1, 2]
        y = R[0, 2] - R[2, 0]
        z = R[1, 0] - R[0, 1]
    elif R[0, 0] >= R[1, 1] and R[0, 0] >= R[2, 2]:
        w = R[2, 1] - R[1, 2]
        x = 1.0 + R[0, 0] - R[1, 1] - R[2, 2]
        y = R[0, 1] + R[1, 0]
        z = R[0, 2] + R[2, 0]
    elif R[1, 1] >= R[2, 2]:
        w = R[0, 2] - R[2, 0]
        x = R[0, 1] + R[1, 0]
        y = 1.0 + R[1, 1] - R[0, 0] - R[2, 2]
        z = R[1, 2] + R[2, 1]
    else:
        w = R[1, 0] - R[0, 1]
        x = R[0, 2] + R[2, 0]
        y = R[1, 2] + R[2, 1]
        z = 1.0 + R[2, 2] - R[0, 0] - R[1, 1]
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    n = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(n, w) / n if n > 1e-30 else 0.0
    r[0] = scale * x
    r[1] = scale * y
    r[2] = scale * z


@njit(nogil=True, error_model="numpy")
def _closest_rotation_by_quaternion_(T, R):
    """R maximises tr(Rᵀ T) over rotations, by Horn's method; T may be singular or mirrored."""
    N = np.empty((4, 4))
    N[0, 0] = T[0, 0] + T[1, 1] + T[2, 2]
    N[1, 1] = T[0, 0] - T[1, 1] - T[2, 2]
    N[2, 2] = T[1, 1] - T[0, 0] - T[2, 2]
    N[3, 3] = T[2, 2] - T[0, 0] - T[1, 1]
    N[0, 1] = N[1, 0] = T[2, 1] - T[1, 2]
    N[0, 2] = N[2, 0] = T[0, 2] - T[2, 0]
    N[0, 3] = N[3, 0] = T[1, 0] - T[0, 1]
    N[1, 2] = N[2, 1] = T[0, 1] + T[1, 0]
    N[1, 3] = N[3, 1] = T[0, 2] + T[2, 0]
    N[2, 3] = N[3, 2] = T[1, 2] + T[2, 1]
    Q = np.eye(4)
    for _ in range(30):  # cyclic Jacobi; converges quadratically, 6 sweeps in practice
        off = 0.0
        total = 0.0
        for a in range(4):
            total += N[a, a] * N[a, a]
            for b in range(a + 1, 4):
                off += N[a, b] * N[a, b]
        if off <= 1e-32 * (total + off):
            break
        for a in range(3):
            for b in range(a + 1, 4):
                if N[a, b] == 0.0:
                    continue
                h = 0.5 * (N[b, b] - N[a, a]) / N[a, b]
                t = 1.0 / (abs(h) + math.sqrt(h * h + 1.0))
                if h < 0.0:
                    t = -t
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(4):
                    u = N[k, a]
                    v = N[k, b]
                    N[k, a] = c * u - s * v
                    N[k, b] = s * u + c * v
                for k in range(4):
                    u = N[a, k]
                    v = N[b, k]
                    N[a, k] = c * u - s * v
                    N[b, k] = s * u + c * v
                for k in range(4):
                    u = Q[k, a]
                    v = Q[k, b]
                    Q[k, a] = c * u - s * v
                    Q[k, b] = s * u + c * v
    best = 0
    for k in range(1, 4):
        if N[k, k] > N[best, best]:
            best = k
    w, x, y, z = Q[0, best], Q[1, best], Q[2, best], Q[3, best]
    R[0, 0] = w * w + x * x - y * y - z * z
    R[0, 1] = 2.0 * (x * y - w * z)
    R[0, 2] = 2.0 * (x * z + w * y)
    R[1, 0] = 2.0 * (x * y + w * z)
    R[1, 1] = w * w - x * x + y * y - z * z
    R[1, 2] = 2.0 * (y * z - w * x)
    R[2, 0] = 2.0 * (x * z - w * y)
    R[2, 1] = 2.0 * (y * z + w * x)
    R[2, 2] = w * w - x * x - y * y + z * z


@njit(nogil=True, error_model="numpy")
def closest_rotation_(T, R):
    """R (3,3) proper rotation closest to T (3,3): the rotation factor of T = R S."""
    norm2 = 0.0
    for a in range(3):
        for b in range(3):
            R[a, b] = T[a, b]
            norm2 += T[a, b] * T[a, b]
    # Higham's scaled Newton iteration, X ← ½(γX + (γX)⁻ᵀ), is several times faster than an
    # eigen-decomposition; it needs a positive, not too small determinant.
    C = np.empty((3, 3))
    for iteration in range(20):
        C[0, 0] = R[1, 1] * R[2, 2] - R[1, 2] * R[2, 1]
        C[0, 1] = R[1, 2] * R[2, 0] - R[1, 0] * R[2, 2]
        C[0, 2] = R[1, 0] * R[2, 1] - R[1, 1] * R[2, 0]
        C[1, 0] = R[0, 2] * R[2, 1] - R[0, 1] * R[2, 2]
        C[1, 1] = R[0, 0] * R[2, 2] - R[0, 2] * R[2, 0]
        C[1, 2] = R[0, 1] * R[2, 0] - R[0, 0] * R[2, 1]
        C[2, 0] = R[0, 1] * R[1, 2] - R[0, 2] * R[1, 1]
        C[2, 1] = R[0, 2] * R[1, 0] - R[0, 0] * R[1, 2]
        C[2, 2] = R[0, 0] * R[1, 1] - R[0, 1] * R[1, 0]
        det = R[0, 0] * C[0, 0] + R[0, 1] * C[0, 1] + R[0, 2] * C[0, 2]
        if iteration == 0 and not det > 1e-6 * norm2 * math.sqrt(norm2):
            _closest_rotation_by_quaternion_(T, R)
            return
        gamma = det ** (-1.0 / 3.0)
        change = 0.0
        for a in range(3):
            for b in range(3):
                new = 0.5 * (gamma * R[a, b] + C[a, b] / (gamma * det))
                change += (new - R[a, b]) ** 2
                R[a, b] = new
        if change < 1e-30:
            return


@called_with("void(f8[:, ::1], f8[:, :, ::1])")
@njit(nogil=True)
def _exp_batch(r, R):
    for i in range(len(r)):
        exp_(r[i], R[i])


@called_with("void(f8[:, ::1], f8[:, :, ::1])")
@njit(nogil=True)
def _right_jacobian_batch(r, J):
    for i in range(len(r)):
        right_jacobian_(r[i], J[i])


@njit(nogil=True)
def _log_batch(R, r):
    for i in range(len(R)):
        log_(R[i], r[i])


@njit(nogil=True)
def _closest_rotation_batch(T, R):
    for i in range(len(T)):
        closest_rotation_(T[i], R[i])


def log_to_rotation(r: ArrayLike) -> FloatArray:
    """Rotation matrices (..., 3, 3) of rotation vectors r (..., 3), in radians."""
    # A fit calls this ten thousand times: what needs no check has none.
    ready = type(r) is np.ndarray and r.dtype == np.float64 and r.ndim and r.shape[-1] == 3
    flat = np.ascontiguousarray(r if ready else checked_array(r, "r", ("...", 3), finite=False))
    out = np.empty((*flat.shape, 3))
    _exp_batch(flat.reshape(-1, 3), out.reshape(-1, 3, 3))
    return out


def rotation_to_log(R: ArrayLike) -> FloatArray:
    """Principal rotation vectors (..., 3), ‖r‖ ≤ π radians, of rotation matrices R (..., 3, 3)."""
    flat = np.ascontiguousarray(R, dtype=np.float64)
    out = np.empty(flat.shape[:-1])
    _log_batch(flat.reshape(-1, 3, 3), out.reshape(-1, 3))
    return out


def interpolate_rotations(start: ArrayLike, end: ArrayLike, share: ArrayLike) -> FloatArray:
    """Rotations between two, along the shortest way at constant speed (slerp).

    Args:
        start: (3, 3) rotation matrix.
        end: (3, 3) rotation matrix; where it is half a turn from `start`, one way is chosen.
        share: (...) of the way: 0 is `start`, 1 is `end`.

    Returns:
        R (..., 3, 3).

    Raises:
        InputError: a matrix that is no rotation, or a share that is not finite.
    """
    first, last = (checked_rotations(R, name, ()) for R, name in ((start, "start"), (end, "end")))
    for R, name in ((first, "start"), (last, "end")):
        if np.isnan(R).any():
            raise InputError(f"{name}: expected a rotation, got none; give a matrix (3, 3)")
    t = checked_array(share, "share", largest=LARGEST)
    # R(t) = R₀ exp(t log(R₀ᵀ R₁))
    return np.asarray(first @ log_to_rotation(t[..., None] * rotation_to_log(first.T @ last)))


def right_jacobian(r: ArrayLike) -> FloatArray:
    """Right Jacobians (..., 3, 3) of exp at rotation vectors r (..., 3), in radians.

    exp(r + δ) = exp(r) exp(J δ) to first order; see Chirikjian, "Stochastic Models, Information
    Theory, and Lie Groups", volume 2, equation 10.86.
    """
    flat = np.ascontiguousarray(r, dtype=np.float64)
    out = np.empty((*flat.shape, 3))
    _right_jacobian_batch(flat.reshape(-1, 3), out.reshape(-1, 3, 3))
    return out


def closest_rotations(T: ArrayLike) -> FloatArray:
    """Proper rotations R (..., 3, 3) that maximise tr(Rᵀ T): the rotation factors of T = R S."""
    flat = np.ascontiguousarray(T, dtype=np.float64)
    R = np.empty_like(flat)
    _closest_rotation_batch(flat.reshape(-1, 3, 3), R.reshape(-1, 3, 3))
    return R


def checked_rotations(values: Any, name: object, shape: tuple[int, ...]) -> FloatArray:
    """Rotation matrices (..., 3, 3) of the rotations that a user gives; NaN where there is none.

    Args:
        values: of each rotation the unit quaternion (w, x, y, z) or the matrix (3, 3). In lists,
            which may be nested, None stands for no rotation; in arrays, NaN.
        name: what the message calls them.
        shape: (...) of the result.

    Raises:
        InputError: another shape, numbers that are not finite, quaternions that have not the
            length 1, matrices that are no rotations.
    """
    if isinstance(values, np.ndarray) or not shape:
        if values is None:
            return np.full((*shape, 3, 3), np.nan)
        expected = (*shape, 4), (*shape, 3, 3)
        array = checked_array(values, name, *expected, finite=False, remedy=_REMEDY)
        return _checked_matrices(array, name, shape)
    if not isinstance(values, list | tuple) or len(values) != shape[0]:
        got = f"{len(values)}" if isinstance(values, list | tuple) else shortened(values)
        raise InputError(f"{name}: expected a list of {shape[0]}, got {got}; {_REMEDY}")
    rows = [checked_rotations(row, f"{name}[{n}]", shape[1:]) for n, row in enumerate(values)]
    return np.array(rows).reshape(*shape, 3, 3)


_REMEDY = "give each as a unit quaternion (w, x, y, z) or as a rotation matrix (3, 3)"


def _checked_matrices(array: FloatArray, name: object, shape: tuple[int, ...]) -> FloatArray:
    """Rotation matrices (*shape, 3, 3) of an array (*shape, 4) or (*shape, 3, 3)."""
    are_quaternions = array.shape == (*shape, 4)
    numbers = array.reshape(*shape, 4 if are_quaternions else 9)
    given: NDArray = np.asarray(~np.isnan(numbers).all(axis=-1))
    finite: NDArray = np.asarray((np.abs(numbers) <= LARGEST).all(axis=-1))

    def refuse(bad: NDArray, got: Callable[[tuple[int, ...]], str]) -> None:
        if bad.any():
            index = tuple(np.argwhere(bad)[0].tolist())
            where = f"{name}[{', '.join(map(str, index))}]" if index else name
            raise InputError(f"{where}: expected a rotation, got {got(index)}; {_REMEDY}")

    refuse(given & ~finite, lambda i: shortened(array[i].tolist()))
    R = np.full((*shape, 3, 3), np.nan)
    if are_quaternions:
        length = np.linalg.norm(array, axis=-1)
        far = given & ~(np.abs(length - 1) <= _ROUNDING)
        refuse(far, lambda i: f"a quaternion of length {rounded(float(length[i]))}")
        q = array[given] / length[given][..., None]
        w, v = q[:, :1, None], q[:, 1:]
        cross = np.cross(v[:, None], np.eye(3)).swapaxes(1, 2)  # [v]×
        R[given] = np.eye(3) + 2.0 * (w * cross + cross @ cross)
        return R
    gram = np.swapaxes(array, -1, -2) @ array
    off: NDArray = np.asarray(np.abs(gram - np.eye(3)).max(axis=(-1, -2)))
    refuse(given & ~(off <= 2 * _ROUNDING), lambda i: "a matrix whose columns are no unit frame")
    mirrored = given & (np.linalg.det(np.where(given[..., None, None], array, 0.0)) < 0)
    refuse(mirrored, lambda i: "a reflection, of determinant -1")
    # A rotation remains the one that it is, to the last bit.
    rounded_ones = given & (off > _EXACT)
    R[given] = array[given]
    R[rounded_ones] = closest_rotations(array[rounded_ones])
    return R


def polar(T: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Polar decomposition T = R S of matrices (..., 3, 3) (Tan et al. 2018, polar decomposition).

    Returns:
        R (..., 3, 3), proper rotations (determinant +1) that maximise tr(Rᵀ T), and symmetric
        S = Rᵀ T (..., 3, 3). S is positive semi-definite if det T ≥ 0; if T mirrors, one eigenvalue
        of S is negative, that of the smallest magnitude.
    """
    R = closest_rotations(T)
    S = np.swapaxes(R, -1, -2) @ np.asarray(T, dtype=np.float64)
    return R, 0.5 * (S + np.swapaxes(S, -1, -2))


def procrustes(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None
) -> tuple[FloatArray, FloatArray]:
    """Rigid motion that best maps points onto points: minimises Σ w ‖R source + t − target‖².

    Args:
        source: (..., n, 3) points.
        target: (..., n, 3) points.
        weights: (n,) positive weights, or None for equal ones.

    Returns:
        R (..., 3, 3), proper rotations, and t (..., 3). If the points do not determine R (one
        point, points on a line), the result is one of the minimisers.
    """
    a = np.asarray(source, dtype=np.float64)
    b = np.asarray(target, dtype=np.float64)
    w = np.ones(a.shape[-2]) if weights is None else np.asarray(weights, dtype=np.float64)
    w = w / w.sum()
    centre_a, centre_b = w @ a, w @ b
    away_a, away_b = a - centre_a[..., None, :], b - centre_b[..., None, :]
    R = closest_rotations(np.swapaxes(away_b, -1, -2) @ (away_a * w[:, None]))
    return R, centre_b - (R @ centre_a[..., None])[..., 0]


def align(vertices: FloatArray, target: FloatArray) -> FloatArray:
    """Shapes `vertices` (N, V, 3), each moved rigidly as close as possible to `target` (V, 3)."""
    moved = np.empty_like(vertices)
    for n, shape in enumerate(vertices):
        R, t = procrustes(shape, target)
        moved[n] = shape @ R.T + t
    return moved
