"""A mesh from edge lengths and dihedral angles by two linear solves.

Edge lengths give each triangle in its own plane; the dihedral angle of an edge gives the rotation
between the frames of its two triangles. The first solve gives all frames, the second the vertices.
After Wang et al., "Articulated-Motion-Aware Sparse Localized Decomposition" (2017), who reconstruct
by such connection maps.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from deformer.acap import PoissonSystem
from deformer.baselines._shell import Shell
from deformer.geometry import (
    FloatArray,
    IntArray,
    closest_rotations,
    connected_components,
    cotan_weights,
)
from deformer.linalg import SparseCholesky

# Rounds of inverse iteration for the frames, and the shift that keeps their matrix definite.
_ROUNDS = 4
_SHIFT = 1e-8
# Least height of a triangle, relative to its longest edge: lengths may violate the triangle
# inequality.
_LEAST_HEIGHT = 1e-3


class Connection:
    """Approximate shape of given edge lengths and dihedral angles, the start of `Shell.closest`.

    Args:
        shell: edges and rest state of the reference.
        poisson: Poisson system of the same reference.
    """

    def __init__(self, shell: Shell, poisson: PoissonSystem) -> None:
        """Find the edges of each triangle."""
        self._shell, self._poisson = shell, poisson
        mesh = shell.reference
        self._faces = mesh.faces
        pairs = shell.hinges[:, :2]
        V = len(mesh.vertices)
        keys = pairs[:, 0] * V + pairs[:, 1]
        half = np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=-1)
        ends = np.sort(half, axis=-1)
        # Edge of each side (a b, b c, c a) of each face; true where the side runs against it.
        self._edge: IntArray = np.searchsorted(keys, ends[..., 0] * V + ends[..., 1])
        self._against = half[..., 0] != ends[..., 0]
        left = np.full(len(pairs), -1, dtype=np.int64)
        right = left.copy()
        face = np.repeat(np.arange(len(mesh.faces)), 3).reshape(-1, 3)
        left[self._edge[~self._against]] = face[~self._against]
        right[self._edge[self._against]] = face[self._against]
        self._left, self._right = left[shell.inner], right[shell.inner]
        weights = cotan_weights(mesh)
        self._cotan = np.asarray(weights[pairs[:, 0], pairs[:, 1]]).ravel()
        own = sparse.diags_array(np.asarray(weights.sum(axis=1)).ravel()) - weights
        # Right-hand side of the edges that the system adds between components, at rest.
        self._bridges = (poisson.laplacian - own) @ mesh.vertices
        self._labels = connected_components(mesh.faces, V)[1][mesh.faces[:, 0]]

    def shape(self, features: FloatArray) -> FloatArray:
        """Vertices (V, 3) of features (E, 2) of the shell, centroid at the reference's."""
        shell = self._shell
        measured = features / np.where(shell.unit > 0, shell.unit, 1.0)
        # Features may ask for lengths of 0 or less.
        lengths = np.maximum(measured[:, 0] + shell.rest_lengths, 0.05 * shell.rest_lengths)
        layout = self._layout(lengths[self._edge])
        R = self._frames(layout, shell.rest_angles + measured[:, 1])
        sides = np.einsum("fab,fsb->fsa", R[:, :, :2], np.roll(layout, -1, axis=1) - layout)
        sides[self._against] *= -1.0
        count = np.bincount(self._edge.ravel(), minlength=len(lengths))
        vectors = np.zeros((len(lengths), 3))
        np.add.at(vectors, self._edge.ravel(), sides.reshape(-1, 3))
        vectors *= (self._cotan / np.maximum(count, 1))[:, None]
        b = self._bridges.copy()
        np.add.at(b, shell.hinges[:, 1], vectors)
        np.add.at(b, shell.hinges[:, 0], -vectors)
        return self._poisson.solve_rhs(b)

    def _layout(self, lengths: FloatArray) -> FloatArray:
        """Corners (F, 3, 2) of triangles with sides a b, b c, c a of lengths (F, 3)."""
        ab, bc, ca = lengths.T
        x = (ab**2 + ca**2 - bc**2) / (2.0 * ab)
        y = np.sqrt(np.maximum(ca**2 - x**2, (_LEAST_HEIGHT * lengths.max(axis=1)) ** 2))
        zero = np.zeros_like(x)
        return np.stack(
            [np.stack([zero, zero], -1), np.stack([ab, zero], -1), np.stack([x, y], -1)], axis=1
        )

    def _frames(self, layout: FloatArray, angles: FloatArray) -> FloatArray:
        """Frames (F, 3, 3) of the triangles that fit the dihedral angles (E,) best.

        Minimises Σ ‖R_g − R_f C_fg‖² over neighbours, with frames orthonormal on average instead of
        each: the lowest eigenvectors of the connection Laplacian, by inverse iteration from the
        frames of the reference. Each frame is then replaced by its closest rotation.
        """
        F = len(layout)
        sides = np.roll(layout, -1, axis=1) - layout
        sides[self._against] *= -1.0
        heading = np.arctan2(sides[..., 1], sides[..., 0])
        inner = np.flatnonzero(self._shell.inner)
        from_left, from_right = np.zeros(len(angles)), np.zeros(len(angles))
        from_left[self._edge[~self._against]] = heading[~self._against]
        from_right[self._edge[self._against]] = heading[self._against]
        # C = R_z(to the edge) R_x(dihedral angle) R_z(back from the edge, in the other plane).
        C = _about_z(from_left[inner]) @ _about_x(angles[inner]) @ _about_z(-from_right[inner])
        f, g = self._left, self._right
        degree = np.bincount(np.concatenate([f, g]), minlength=F) + _SHIFT
        blocks = np.concatenate([degree[:, None, None] * np.eye(3), -C, -C.transpose(0, 2, 1)])
        row, column = np.concatenate([np.arange(F), f, g]), np.concatenate([np.arange(F), g, f])
        index = np.arange(3)
        A = sparse.coo_array(
            (
                blocks.ravel(),
                (
                    np.broadcast_to(3 * row[:, None, None] + index[:, None], blocks.shape).ravel(),
                    np.broadcast_to(3 * column[:, None, None] + index, blocks.shape).ravel(),
                ),
            ),
            shape=(3 * F, 3 * F),
        )
        centres = self._shell.reference.vertices[self._faces].mean(axis=1)
        factor = SparseCholesky(A.tocsr(), np.repeat(centres, 3, axis=0))
        X = self._reference_frames().transpose(0, 2, 1).reshape(-1, 3)
        for _ in range(_ROUNDS):
            X = orthonormal_on_average(factor.solve(X).reshape(F, 3, 3), self._labels).reshape(
                -1, 3
            )
        return closest_rotations(X.reshape(F, 3, 3).transpose(0, 2, 1))

    def _reference_frames(self) -> FloatArray:
        """Frames (F, 3, 3) of the reference's triangles."""
        v = self._shell.reference.vertices[self._faces]
        x = v[:, 1] - v[:, 0]
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        z = np.cross(x, v[:, 2] - v[:, 0])
        z /= np.maximum(np.linalg.norm(z, axis=1, keepdims=True), np.finfo(float).tiny)
        return np.stack([x, np.cross(z, x), z], axis=-1)


def orthonormal_on_average(X: FloatArray, labels: IntArray) -> FloatArray:
    """Blocks times one matrix a component, so that the component's mean of XᵀX is I.

    The matrix turns a component's blocks to positive determinants in sum. X is overwritten.

    Args:
        X: (F, 3, 3) blocks, one a triangle.
        labels: (F,) int64 index of the connected component of each triangle.
    """
    for label in range(labels.max() + 1):
        own = labels == label
        values, vectors = np.linalg.eigh(np.einsum("fab,fac->bc", X[own], X[own]) / own.sum())
        X[own] = X[own] @ ((vectors / np.sqrt(np.maximum(values, 1e-300))) @ vectors.T)
        # The sign of eigenvectors is arbitrary.
        if np.linalg.det(X[own]).sum() < 0:
            X[own] *= -1.0
    return X


def _about_x(angle: FloatArray) -> FloatArray:
    """Rotations (n, 3, 3) about the first axis."""
    R = np.zeros((len(angle), 3, 3))
    R[:, 0, 0] = 1.0
    R[:, 1, 1] = R[:, 2, 2] = np.cos(angle)
    R[:, 2, 1] = np.sin(angle)
    R[:, 1, 2] = -R[:, 2, 1]
    return R


def _about_z(angle: FloatArray) -> FloatArray:
    """Rotations (n, 3, 3) about the third axis."""
    R = np.zeros((len(angle), 3, 3))
    R[:, 2, 2] = 1.0
    R[:, 0, 0] = R[:, 1, 1] = np.cos(angle)
    R[:, 1, 0] = np.sin(angle)
    R[:, 0, 1] = -R[:, 1, 0]
    return R
