"""`batch_numba.Frames` in torch: all frames of a batch at once, on a CPU or a GPU.

Landmarks, formulas and the Poisson system's factor are those of `batch_numba`, in single precision.
A solve visits the factor's supernodes one after the other, each for all frames of the batch: the
more frames, the less the visits cost a frame.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from deformer.acap import STRETCH_COLUMNS, STRETCH_ROWS
from deformer.editing.batch_numba import Boolean
from deformer.editing.exact_handles import ExactHandles
from deformer.editing.exact_rows import schur_inverse
from deformer.editing.green_functions import HandleBasis
from deformer.editing.kernels import DAMPING, LARGEST_STEP
from deformer.editing.relaxation import FIRST_ROTATION_STEPS, ROTATION_STEPS
from deformer.errors import InputError
from deformer.geometry import FloatArray
from deformer.linalg import SparseCholesky, resolve_device
from deformer.network import Decoder

# Numbers in the gradients of a batch: frames times vertices times nine. It bounds memory.
_BATCH = 1 << 27


class TorchFrames:
    """`Frames` of one model on a torch device.

    Args:
        basis: the model's handles; they must not change while the frames are in use.
        device: name of the device, see `resolve_device`.

    Raises:
        InputError: the network has several layers, or there is no such device.
    """

    def __init__(self, basis: HandleBasis, device: str) -> None:
        """Copy the decoder, the mesh, the factor and the handles."""
        self._device = resolve_device(device)
        self._basis = basis
        model = basis.model
        V = len(model.reference.vertices)
        self._unit = model.reference.bounding_diagonal
        self._all = _Decoder(model.decoder, self._device)
        self._landmarks = _Decoder(basis.landmark_decoder, self._device)
        self._landmark_coefficients = self._tensor(basis.landmark_coefficients)
        coefficients = basis.coefficients()
        self._coefficients = self._tensor(
            coefficients.reshape(len(coefficients), 3 * coefficients.shape[1])
        )
        system = model.poisson
        rows = np.repeat(np.arange(V), np.diff(system.indptr))
        v = model.reference.vertices / self._unit
        halves: FloatArray = np.asarray(0.5 * system.c[:, None], dtype=np.float64)
        self._halves = self._tensor(halves)
        self._edges = self._tensor(halves * (v[rows] - v[system.rings]))
        self._from = torch.as_tensor(rows, device=self._device)
        self._to = torch.as_tensor(system.rings, device=self._device)
        self._links = torch.as_tensor(model.reference.links.T.copy(), device=self._device)
        self._lever = self._tensor(system.lever / self._unit)
        self._factor = _Factor(system.factor, self._device)

    def _tensor(self, array: FloatArray) -> Tensor:
        return torch.as_tensor(array, dtype=torch.float32, device=self._device)

    def _batches(self, count: int, vertices: int, width: int = 9) -> list[slice]:
        size = max(1, _BATCH // (width * vertices))
        return [slice(start, start + size) for start in range(0, count, size)]

    def by_landmarks(self, z: FloatArray) -> FloatArray:
        """Handle positions (m, H, 3) of codes z (m, K) by the landmarks alone."""
        S = self._landmark_coefficients.shape[1]
        parts = []
        for part in self._batches(len(z), S):
            T = gradients(self._landmarks(self._tensor(z[part])))
            parts.append(torch.einsum("msab,hsb->mha", T, self._landmark_coefficients))
        return _numpy(torch.cat(parts))

    def jacobians(self, z: FloatArray) -> FloatArray:
        """Derivatives (m, H, 3, K) of `by_landmarks` with respect to the codes z (m, K)."""
        coefficients = self._landmark_coefficients
        (H, S, _), K = coefficients.shape, z.shape[1]
        out = np.empty((len(z), H, 3, K))
        for part in self._batches(len(z), S, 27 * max(1, len(coefficients))):
            q, slope = self._landmarks.with_slope(self._tensor(z[part]))
            # ∂T/∂q (m, S, 3, 3, 9) times the slope and the rows of the decoder's matrix.
            dT = gradient_derivatives(q) * slope[:, :, None, None]
            by_coefficient = torch.einsum("msabc,hsb->mhasc", dT, coefficients)
            J = by_coefficient.reshape(len(q), 3 * H, 9 * S) @ self._landmarks.matrix.reshape(
                9 * S, K
            )
            out[part] = _numpy(J).reshape(len(q), H, 3, K)
        return out

    def by_all(self, z: FloatArray) -> FloatArray:
        """Handle positions (m, H, 3) of codes z (m, K) by all vertices."""
        parts = []
        for part in self._batches(len(z), self._coefficients.shape[1] // 3):
            T = gradients(self._all(self._tensor(z[part])))
            columns = T.transpose(2, 3).reshape(len(T), -1, 3)
            parts.append(self._coefficients @ columns)
        return _numpy(torch.cat(parts))

    def shapes(
        self,
        z: FloatArray,
        Q: FloatArray,
        origin: FloatArray,
        targets: FloatArray,
        exact: Boolean,
        rounds: int,
        out: FloatArray,
    ) -> None:
        """Write the shape of each code, rigidly moved, exact handles at their targets."""
        V = out.shape[1]
        # Frames with the same exact handles are computed together.
        for pattern in np.unique(exact, axis=0) if len(exact) else []:
            frames = np.flatnonzero((exact == pattern).all(axis=1))
            handles = self._basis.exact_handles(
                [self._basis.points[h] for h in np.flatnonzero(pattern)]
            )
            moved = _Mover(handles, self._unit, self._tensor)
            for part in self._batches(len(frames), V):
                f = frames[part]
                # Targets before the rigid motion, in bounding diagonals.
                local = (targets[f][:, pattern] - origin[f][:, None]) @ Q[f] / self._unit
                rest = self._rest_shapes(gradients(self._all(self._tensor(z[f]))))
                p = moved(rest, local)
                edges = self._halves * (rest[:, self._from] - rest[:, self._to])
                R = torch.eye(3, device=p.device).expand(*p.shape[:2], 3, 3)
                momentum = _Momentum()
                for n in range(rounds if pattern.any() else 0):
                    steps = ROTATION_STEPS if n else FIRST_ROTATION_STEPS
                    R = self._fitted_rotations(R, edges, momentum.moved_on(p), steps)
                    p = moved(self._solved(R, edges), local)
                turned = p @ self._tensor(self._unit * Q[f]).transpose(1, 2)
                out[f] = _numpy(turned) + origin[f][:, None]
                for frame in f:
                    handles.correct(out[frame], targets[frame, pattern])

    def _rest_shapes(self, T: Tensor) -> Tensor:
        """Positions (m, V, 3) of gradients (m, V+B, 3, 3) of vertices and links."""
        b = rhs(T[:, : T.shape[1] - self._links.shape[1]], self._from, self._to, self._edges)
        i, j = self._links
        displacement = (T[:, b.shape[1] :] - T[:, j]) @ self._lever
        b.index_add_(1, i, displacement).index_add_(1, j, displacement, alpha=-1.0)
        return self._factor.solve(b)

    def _solved(self, T: Tensor, edges: Tensor) -> Tensor:
        """Positions (m, V, 3) of L p = Σ_j (T_i + T_j) e_ij, up to a translation."""
        return self._factor.solve(rhs(T, self._from, self._to, edges))

    def _fitted_rotations(self, R: Tensor, edges: Tensor, p: Tensor, steps: int) -> Tensor:
        """Rotations (m, V, 3, 3) after a local step from R: `kernels.fit_rotations` in torch."""
        new = p[:, self._from] - p[:, self._to]
        B = torch.zeros(R.shape, device=R.device)
        B.index_add_(1, self._from, new[..., :, None] * edges[..., None, :])
        A = B @ R.transpose(2, 3)
        D = torch.zeros((*R.shape[:2], 4), device=R.device)
        D[..., 0] = 1.0
        for _ in range(steps):
            half = _rotation_step(A @ _matrices(D).transpose(2, 3))
            D = torch.nn.functional.normalize(_product(half, D), dim=-1)
        return _matrices(D) @ R


class _Momentum:
    """`momentum.Momentum` of positions (m, V, 3), each frame with its own rounds."""

    def __init__(self) -> None:
        self._last: tuple[Tensor, Tensor, Tensor] | None = None

    def moved_on(self, x: Tensor) -> Tensor:
        """Where the next round starts."""
        if self._last is None:
            self._last = x, x, torch.ones((len(x), 1, 1), device=x.device)
            return x
        before, start, count = self._last
        change = x - before
        back = ((start - x) * change).sum((1, 2), keepdim=True) > 0
        count = torch.where(back, 1.0, count)
        following = 0.5 * (1.0 + (1.0 + 4.0 * count**2).sqrt())
        start = x + (count - 1.0) / following * change
        self._last = x, start, following
        return start


class _Decoder:
    """Features gain tanh(M z + base) + offset of many codes: `Decoder` of one layer in torch."""

    def __init__(self, decoder: Decoder, device: torch.device) -> None:
        if not decoder.pointwise:
            raise InputError(
                "backend 'torch': a model of several layers is fitted to sequences by numba, on "
                "the CPU; use the backend 'numba'"
            )
        self.matrix = torch.as_tensor(decoder.matrix, device=device)
        self._base, self._gain, self._offset = (
            torch.as_tensor(array, dtype=torch.float32, device=device)
            for array in (decoder.base, decoder.gain, decoder.offset)
        )

    def _output(self, z: Tensor) -> Tensor:
        n, d, K = self.matrix.shape
        flat = z @ self.matrix.reshape(n * d, K).T
        return torch.tanh(flat.reshape(len(z), n, d) + self._base)

    def __call__(self, z: Tensor) -> Tensor:
        """Features (m, n, 9) of codes (m, K)."""
        return self._output(z) * self._gain + self._offset

    def with_slope(self, z: Tensor) -> tuple[Tensor, Tensor]:
        """Features, and their derivative (m, n, 9) with respect to M z."""
        x = self._output(z)
        return x * self._gain + self._offset, (1.0 - x * x) * self._gain


class _Factor:
    """The blocks of a `SparseCholesky` on a device, for many right-hand sides at once."""

    def __init__(self, factor: SparseCholesky, device: torch.device) -> None:
        self._order, self._inverse_order = (
            torch.as_tensor(array, device=device) for array in (factor.order, factor.inverse_order)
        )
        self._nodes = [
            (
                first,
                last,
                torch.as_tensor(rows).long().to(device),
                torch.as_tensor(block).to(device),
            )
            for first, last, rows, block in factor.supernodes()
        ]

    def solve(self, b: Tensor) -> Tensor:
        """Solutions (m, V, 3) for right-hand sides (m, V, 3)."""
        m, V, _ = b.shape
        x = b.permute(1, 0, 2).reshape(V, 3 * m)[self._order]
        for first, last, rows, block in self._nodes:
            if len(rows):
                x.index_add_(0, rows, block[last - first :] @ x[first:last])
        for first, last, rows, block in reversed(self._nodes):
            x[first:last] = block.T @ torch.cat([x[first:last], x[rows]])
        return x[self._inverse_order].reshape(V, m, 3).permute(1, 0, 2)


def rhs(T: Tensor, start: Tensor, end: Tensor, edges: Tensor) -> Tensor:
    """Right-hand sides b_i = Σ_j (T_i + T_j) e_ij, (m, V, 3): `geometry.rhs_` in torch.

    Args:
        T: (m, V, 3, 3) matrices.
        start, end: (E,) vertices i and j of directed edges.
        edges: (E, 3) or (m, E, 3) half-weighted edges e_ij = ½ c_ij (v_i − v_j).
    """
    b = torch.zeros(T.shape[:3], dtype=T.dtype, device=T.device)
    sums = ((T[:, start] + T[:, end]) @ edges[..., None])[..., 0]
    return b.index_add_(1, start, sums)


class _Mover:
    """Moves positions to exact handles: `DecodedSurface.move_to_targets` for many frames.

    Args:
        handles: the exact handles.
        unit: the bounding diagonal, in which positions and targets are.
        tensor: makes a tensor of an array.
    """

    def __init__(
        self, handles: ExactHandles, unit: float, tensor: Callable[[FloatArray], Tensor]
    ) -> None:
        self._points, self._unit, self._tensor = handles.points, unit, tensor
        self._weights, self._rows = tensor(handles.points.weights), tensor(handles.rows)
        self._inverse = tensor(schur_inverse(handles.block))

    def __call__(self, p: Tensor, targets: FloatArray) -> Tensor:
        """Positions (m, V, 3) with the handles at targets (m, H, 3), but for turned normals."""
        points = self._points
        if len(points.index) == 0:
            return p - p.mean(dim=1, keepdim=True)
        at = (self._weights[:, :, None] * p[:, points.index]).sum(dim=2)
        if len(points.frames):
            targets = points.stretched(_numpy(at), targets)
        if len(points.ring):
            ring = self._unit * _numpy(p[:, points.ring])
            targets = points.feet(ring, self._unit * targets) / self._unit
        misfit = torch.nn.functional.pad(self._tensor(targets) - at, (0, 0, 0, 1))
        change = self._inverse @ misfit
        return p + self._rows.T @ change[:, :-1] + change[:, -1:]


def _numpy(x: Tensor) -> FloatArray:
    return np.asarray(x.cpu().numpy(), dtype=np.float64)


def _cross(r: Tensor) -> Tensor:
    """Matrices (…, 3, 3) with [r]× v = r × v."""
    x, y, z = r.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))


def _matrices(q: Tensor) -> Tensor:
    """Rotations (…, 3, 3) of unit quaternions (…, 4)."""
    w, v = q[..., :1, None], q[..., 1:]
    cross = _cross(v)
    return torch.eye(3, device=q.device) + 2.0 * (w * cross + cross @ cross)


def _product(a: Tensor, b: Tensor) -> Tensor:
    """Quaternion product (…, 4)."""
    w, v, x, u = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    scalar = w * x - (v * u).sum(-1, keepdim=True)
    return torch.cat([scalar, w * u + x * v + torch.linalg.cross(v, u)], -1)


def _rotation_step(B: Tensor) -> Tensor:
    """Quaternions (…, 4) of one step of `kernels.fit_step`, not normalised; B = A Rᵀ."""
    trace = B.diagonal(dim1=-2, dim2=-1).sum(-1)[..., None]
    axial = torch.stack(
        [B[..., 2, 1] - B[..., 1, 2], B[..., 0, 2] - B[..., 2, 0], B[..., 1, 0] - B[..., 0, 1]], -1
    )
    scale = torch.maximum(trace.abs(), axial.norm(dim=-1, keepdim=True)) + 1e-30
    axial, eye = axial / scale, torch.eye(3, device=B.device)
    symmetric = 0.5 * (B + B.transpose(-1, -2))
    hessian = (trace[..., None] * eye - symmetric) / scale[..., None] + float(DAMPING) * eye
    x, y, z = hessian.unbind(-2)
    cross = torch.linalg.cross
    adjugate = torch.stack([cross(y, z), cross(z, x), cross(x, y)], -2)
    det = (x * adjugate[..., 0, :]).sum(-1, keepdim=True)
    definite = (x[..., :1] > 0) & (adjugate[..., 2, 2:] > 0) & (det > float(DAMPING) ** 2)
    newton = (adjugate @ axial[..., None])[..., 0] / torch.where(definite, det, 1.0)
    half = 0.5 * torch.where(definite, newton, axial)
    half = half * (float(LARGEST_STEP) / (half.norm(dim=-1, keepdim=True) + 1e-15)).clamp(max=1.0)
    return torch.cat([torch.ones_like(trace), half], -1)


def _exponential(r: Tensor) -> tuple[Tensor, Tensor]:
    """Rotations exp(r) and right Jacobians (…, 3, 3) of rotation vectors (…, 3)."""
    angle = r.norm(dim=-1)[..., None, None]
    small = angle < 1e-2
    t = torch.where(small, torch.ones_like(angle), angle)
    u = angle * angle
    a = torch.where(small, 1.0 - u / 6.0, t.sin() / t)
    b = torch.where(small, 0.5 - u / 24.0, 2.0 * (0.5 * t).sin() ** 2 / t**2)
    c = torch.where(small, 1.0 / 6.0 - u / 120.0, (t - t.sin()) / t**3)
    cross, eye = _cross(r), torch.eye(3, dtype=r.dtype, device=r.device)
    square = cross @ cross
    return eye + a * cross + b * square, eye - b * cross + c * square


def _stretch(s: Tensor) -> Tensor:
    """Symmetric matrices (…, 3, 3) of entries xx, xy, xz, yy, yz, zz (…, 6)."""
    S = s.new_zeros((*s.shape[:-1], 3, 3))
    S[..., STRETCH_ROWS, STRETCH_COLUMNS] = s
    S[..., STRETCH_COLUMNS, STRETCH_ROWS] = s
    return S


def gradients(q: Tensor) -> Tensor:
    """T = exp(r) S (…, 3, 3) of features (…, 9): `acap.features_to_gradients` in torch."""
    return _exponential(q[..., :3])[0] @ _stretch(q[..., 3:])


def gradient_derivatives(q: Tensor) -> Tensor:
    """∂T/∂q (…, 3, 3, 9) of features (…, 9): `acap.gradient_tangents` in torch."""
    R, J = _exponential(q[..., :3])
    S = _stretch(q[..., 3:])
    # exp(r + δ) = exp(r) exp(J δ): the change of T is R [J δ]× S.
    turned = R[..., None, :, :] @ _cross(J.transpose(-1, -2)) @ S[..., None, :, :]
    units = _stretch(torch.eye(6, dtype=q.dtype, device=q.device))
    stretched = R[..., None, :, :] @ units
    return torch.cat([turned, stretched], -3).movedim(-3, -1)
