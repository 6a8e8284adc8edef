"""Edge lengths and dihedral angles of a mesh, their derivatives, and reconstruction from them.

They determine a mesh's shape and do not depend on its rigid motion. After Fröhlich and Botsch,
"Example-Driven Deformations Based on Discrete Shells" (2011), with the bending weights of Grinspun
et al., "Discrete Shells" (2003).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from deformer.compilation import njit
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, Mesh
from deformer.linalg import Damping, Dissection, SparseCholesky, descend

# Stiffness against stretch relative to that against bending: a relative change of length by 0.1
# has the same energy as a change of angle by one radian.
_STRETCH = 100.0
# Bounds on the bending weight, which is 1 for an edge between equilateral triangles: without them
# slivers dominate the energy.
_BENDING_RANGE = 0.1, 10.0
# Stiffness against the six rigid motions, which makes the system regular; relative to the mean
# diagonal.
_RIGID_STIFFNESS = 1e-9
_ROUNDING = 1e-18
# Slivers fold over within a step. Such a step is first shortened, which needs no factorisation, and
# only then damped, with a large factor.
SHORTENINGS = 3
DAMPING = Damping(up=64.0)


@njit(nogil=True, error_model="numpy")
def _normals(p, hinge, u, m, n):
    """Edge vector u of a hinge, and its left and right normals m and n, of twice the areas."""
    a, b, c, d = hinge
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        u[k] = p[b, k] - p[a, k]
        m[k] = (p[b, i] - p[a, i]) * (p[c, j] - p[a, j])
        m[k] -= (p[b, j] - p[a, j]) * (p[c, i] - p[a, i])
        n[k] = (p[d, i] - p[a, i]) * (p[b, j] - p[a, j])
        n[k] -= (p[d, j] - p[a, j]) * (p[b, i] - p[a, i])


@njit(nogil=True, error_model="numpy")
def _dot(x, y):
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@njit(nogil=True, error_model="numpy")
def _measure(p, hinges, length, angle):
    """Length and signed dihedral angle (0 flat, positive convex) of every edge a-b."""
    u, m, n = np.empty(3), np.empty(3), np.empty(3)
    for e in range(len(hinges)):
        _normals(p, hinges[e], u, m, n)
        length[e] = math.sqrt(_dot(u, u))
        angle[e] = 0.0
        if hinges[e, 2] >= 0 and hinges[e, 3] >= 0 and length[e] > 0.0:
            # (m × n) · u = |m| |n| |u| sin θ
            sine = m[0] * (n[1] * u[2] - n[2] * u[1])
            sine += m[1] * (n[2] * u[0] - n[0] * u[2])
            sine += m[2] * (n[0] * u[1] - n[1] * u[0])
            angle[e] = math.atan2(sine / length[e], _dot(m, n))


@njit(nogil=True, error_model="numpy")
def _differentiate(p, hinges, dlength, dangle):
    """Fill dlength[e] (3,) = ∂length/∂b = −∂length/∂a and dangle[e] (4, 3) = ∂angle/∂(a,b,c,d)."""
    u, m, n = np.empty(3), np.empty(3), np.empty(3)
    for e in range(len(hinges)):
        a, _, c, d = hinges[e]
        _normals(p, hinges[e], u, m, n)
        size = math.sqrt(_dot(u, u))
        dlength[e] = 0.0
        dangle[e] = 0.0
        if size == 0.0:
            continue
        for k in range(3):
            dlength[e, k] = u[k] / size
        mm, nn = _dot(m, m), _dot(n, n)
        # A triangle without area has no normal.
        if c < 0 or d < 0 or mm == 0.0 or nn == 0.0:
            continue
        # Projections of c and d on the edge, from 0 at a to 1 at b.
        s, t = 0.0, 0.0
        for k in range(3):
            s += (p[c, k] - p[a, k]) * u[k] / size**2
            t += (p[d, k] - p[a, k]) * u[k] / size**2
        for k in range(3):
            by_c, by_d = -size / mm * m[k], -size / nn * n[k]
            dangle[e, 0, k] = -(1.0 - s) * by_c - (1.0 - t) * by_d
            dangle[e, 1, k] = -s * by_c - t * by_d
            dangle[e, 2, k] = by_c
            dangle[e, 3, k] = by_d


def _hinges(faces: IntArray) -> IntArray:
    """Edges a-b with opposite vertices (E, 4): c left of a→b, d right of it, −1 on boundaries."""
    half = np.concatenate([faces[:, [0, 1, 2]], faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]])
    half = half[half[:, 0] != half[:, 1]]
    ends = np.sort(half[:, :2], axis=1)
    pairs, edge = np.unique(ends, axis=0, return_inverse=True)
    hinges = np.full((len(pairs), 4), -1, dtype=np.int64)
    hinges[:, :2] = pairs
    side = np.where(half[:, 0] == ends[:, 0], 2, 3)
    count = np.zeros((len(pairs), 2), dtype=np.int64)
    np.add.at(count, (edge.ravel(), side - 2), 1)
    bad = np.flatnonzero((count > 1).any(axis=1))
    if len(bad):
        raise InputError(
            f"edge {pairs[bad[0]].tolist()}: dihedral angles need every edge to lie in at most "
            "two faces of consistent orientation; repair the mesh"
        )
    hinges[edge.ravel(), side] = half[:, 2]
    return hinges


class Shell:
    """Features of edges against a reference, and the shape closest to given features.

    The feature of an edge is (√100 (l / l̄ − 1), √β (θ − θ̄)): the relative change of its length
    and the change of its dihedral angle in radians, weighted so that squared distances of features
    are the energy that `closest` minimises. β is l̄² over the area of the two triangles, scaled to 1
    for equilateral ones and clamped to [0.1, 10]. The change of angle is 0 for a boundary edge.

    Args:
        reference: mesh of V vertices and E edges; each edge is in at most two faces, of consistent
            orientation.

    Raises:
        InputError: an edge with more faces, with faces of opposite orientation or without length.
    """

    def __init__(self, reference: Mesh) -> None:
        """Find the hinges and measure the reference."""
        self.reference = reference
        self.hinges = _hinges(reference.faces)
        self.inner = (self.hinges[:, 2:] >= 0).all(axis=1)
        v = reference.vertices
        self.rest_lengths, self.rest_angles = self.measure(v)
        short = np.flatnonzero(self.rest_lengths == 0)
        if len(short):
            raise InputError(
                f"edge {self.hinges[short[0], :2].tolist()} of the reference has no length; "
                "merge its vertices"
            )
        a, b, c, d = np.where(self.hinges >= 0, self.hinges, 0).T
        u = v[b] - v[a]
        area = np.linalg.norm(np.cross(u, v[c] - v[a]), axis=1)
        area += np.linalg.norm(np.cross(u, v[d] - v[a]), axis=1)
        # Two equilateral triangles have the (double) area √3 l².
        floor = np.finfo(float).tiny
        bending = np.sqrt(3.0) * self.rest_lengths**2 / np.maximum(area, floor)
        bending = np.where(self.inner, np.clip(bending, *_BENDING_RANGE), 0.0)
        self.unit = np.column_stack([np.sqrt(_STRETCH) / self.rest_lengths, np.sqrt(bending)])
        self._pattern = self._entries()
        self._points = np.repeat(v, 3, axis=0)
        self._plan: Dissection | None = None

    def measure(self, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Edge lengths (E,) and dihedral angles (E,) in (−π, π], 0 on boundaries, of p (V, 3)."""
        length, angle = np.empty(len(self.hinges)), np.empty(len(self.hinges))
        _measure(np.ascontiguousarray(p, dtype=np.float64), self.hinges, length, angle)
        return length, angle

    def features(self, p: FloatArray) -> FloatArray:
        """Features (E, 2) of a shape (V, 3); changes of angles are wrapped to [−π, π)."""
        length, angle = self.measure(p)
        turn = angle - self.rest_angles
        turn = np.mod(turn + np.pi, 2.0 * np.pi) - np.pi
        return np.column_stack([length - self.rest_lengths, turn]) * self.unit

    def difference(self, p: FloatArray, target: FloatArray) -> FloatArray:
        """Features of p (V, 3) minus target features (E, 2), angles wrapped to [−π, π)."""
        away = self.features(p) - target
        unit = np.where(self.inner, self.unit[:, 1], 1.0)
        away[:, 1] = unit * (np.mod(away[:, 1] / unit + np.pi, 2.0 * np.pi) - np.pi)
        away[~self.inner, 1] = 0.0
        return away

    def jacobian(self, p: FloatArray) -> sparse.csr_array:
        """Jacobian (2E, 3V) of the features at p (V, 3); row 2e is the length, 2e + 1 the angle."""
        E, V = len(self.hinges), len(p)
        dlength, dangle = np.empty((E, 3)), np.empty((E, 4, 3))
        _differentiate(np.ascontiguousarray(p, dtype=np.float64), self.hinges, dlength, dangle)
        dlength *= self.unit[:, :1]
        dangle *= self.unit[:, 1, None, None]
        data = np.concatenate([-dlength, dlength, dangle.reshape(E, 12)], axis=1)
        indices, indptr = self._pattern
        return sparse.csr_array((data.ravel(), indices, indptr), shape=(2 * E, 3 * V))

    def _entries(self) -> tuple[IntArray, IntArray]:
        """Columns and row starts of the Jacobian: 6 entries for a length, 12 for an angle."""
        E = len(self.hinges)
        ends = np.where(self.hinges >= 0, self.hinges, self.hinges[:, :1])
        columns = 3 * ends[:, :, None] + np.arange(3)
        columns = columns.reshape(E, 12)
        indices = np.concatenate([columns[:, :6], columns], axis=1).ravel()
        indptr = np.concatenate([[0], np.cumsum(np.tile([6, 12], E))])
        return indices, indptr

    def normal_matrix(self, p: FloatArray) -> tuple[sparse.csr_array, sparse.csr_array]:
        """Jacobian J (2E, 3V) at p, and JᵀJ plus a small stiffness against rigid motions."""
        J = self.jacobian(p)
        H = sparse.csr_array(J.T @ J)
        return J, H + sparse.diags_array(np.full(p.size, _RIGID_STIFFNESS * H.diagonal().mean()))

    def factor(self, H: sparse.sparray, free: IntArray | None = None) -> SparseCholesky:
        """Cholesky factor of a normal matrix, or of its `free` rows and columns.

        The order of elimination is computed again only when the sparsity pattern changes.
        """
        points = self._points if free is None else self._points[free]
        factor = SparseCholesky(H, points, self._plan)
        self._plan = factor.plan
        return factor

    def closest(
        self, target: FloatArray, start: FloatArray, limit: int = 30, tolerance: float = 1e-5
    ) -> FloatArray:
        """Shape (V, 3) whose features are closest to `target` (E, 2), by damped Gauss–Newton.

        The result has the rigid motion of `start` (V, 3).

        Args:
            target: (E, 2) features.
            start: (V, 3) first shape.
            limit: largest number of steps.
            tolerance: relative gain of the energy that ends the descent.
        """
        # Below this share of the features' squared norm the residual is rounding.
        floor = _ROUNDING * float((target**2).sum())
        begun = _Reconstruction(self, target, start)
        found = descend(
            begun,
            steps=limit,
            relative_gain=tolerance,
            damping=replace(DAMPING, initial=1e-6),
            negligible=floor,
            shortenings=SHORTENINGS,
        )
        return found.point.p


@dataclass(eq=False)
class _Reconstruction:
    """A point of the descent: positions, and the squared distance of their features."""

    shell: Shell
    target: FloatArray
    p: FloatArray

    def __post_init__(self) -> None:
        self.residual = self.shell.difference(self.p, self.target)
        self.energy = float((self.residual**2).sum())
        self._normal: tuple[sparse.csr_array, FloatArray] | None = None

    def step(self, damping: float) -> FloatArray:
        if self._normal is None:
            J, H = self.shell.normal_matrix(self.p)
            self._normal = H, J.T @ self.residual.ravel()
        H, gradient = self._normal
        damped = H + sparse.diags_array(damping * H.diagonal())
        return -self.shell.factor(damped).solve(gradient[:, None]).reshape(-1, 3)

    def moved(self, step: FloatArray) -> _Reconstruction:
        return _Reconstruction(self.shell, self.target, self.p + step)
