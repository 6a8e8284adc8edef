"""Green's functions of handle vertices, and the coefficients of handle positions.

They are computed once a model or once a handle vertex; none depends on targets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deformer.editing.arap import DecodedSurface
from deformer.editing.cubature import Grouping, choose_landmarks
from deformer.editing.handle_kernels import BlockDecoder, BlockHandlePositions
from deformer.editing.handle_positions import DenseHandlePositions, HandlePositions
from deformer.geometry import FloatArray, IntArray
from deformer.model import DeformationModel

# Number of cubature's landmarks, whose gradients replace those of all vertices in a search.
_LANDMARKS = 800


@dataclass(frozen=True, eq=False)
class _VertexRows:
    """Arrays of one handle vertex.

    Args:
        green: (V,) Green's function G_h = L⁺ e_h.
        landmark_coefficients: (S, 3) coefficients of its position, summed over landmarks' groups.
        block_coefficients: coefficients of its position, by `DecodedSurface.block_coefficients`.
    """

    green: FloatArray
    landmark_coefficients: FloatArray
    block_coefficients: NDArray


class HandleBasis:
    """Handle vertices of a model, and their positions as functions of the latent code.

    Args:
        model: the prior.

    Attributes:
        surface: decodes codes to all vertices; it has the handles and exact handles set here.
        vertices: (H,) int64 handle vertices.
        landmark_decoder: the decoder of the S landmarks.
        landmark_coefficients: (H, S, 3) coefficients of the handle positions by landmarks.
    """

    def __init__(self, model: DeformationModel) -> None:
        """Factor the Laplacian, choose landmarks; there are no handles yet."""
        self.model = model
        # The factorisation is done here so that the first exact handle need not wait for it.
        _ = model.poisson.screened_factor
        self.surface = DecodedSurface(model.decoder, model.poisson)
        landmarks, labels = choose_landmarks(
            model.decoder, model.prior.factor, model.reference.vertices, _LANDMARKS
        )
        # Landmarks that are neighbours in space have most components in common; links come last.
        inverse_order = self.surface.inverse_order
        order = np.argsort(
            np.append(inverse_order, np.arange(len(inverse_order), len(labels)))[landmarks]
        )
        landmarks, labels = landmarks[order], np.argsort(order)[labels]
        self._grouping = Grouping(labels, len(landmarks))
        self.landmark_decoder = model.decoder_at(landmarks)
        pointwise = self.landmark_decoder.pointwise
        self._landmark_blocks = BlockDecoder(self.landmark_decoder) if pointwise else None
        self._rows: dict[int, _VertexRows] = {}
        # Bending rows of vertices that are or were exact, in the user's order and in the surface's.
        self._bending_rows: dict[int, tuple[FloatArray, NDArray]] = {}
        self.vertices: IntArray = np.empty(0, dtype=np.int64)
        self._exact_positions: DenseHandlePositions | None = None
        self._landmark_positions: HandlePositions | None = None
        self.landmark_coefficients = np.empty((0, len(landmarks), 3))

    def set_vertices(self, vertices: list[int]) -> None:
        """Replace the handles; the rows of vertices that stay are reused.

        A vertex that also keeps its index costs nothing.

        Args:
            vertices: (H,) vertex indices, all different.
        """
        poisson = self.model.poisson
        new = [v for v in vertices if v not in self._rows]
        for vertex, row in zip(new, poisson.green_rows(new), strict=True):
            coefficients = poisson.position_coefficients(row[None])
            self._rows[vertex] = _VertexRows(
                row,
                self._grouping.sums(coefficients)[0],
                self.surface.block_coefficients(coefficients[0]),
            )
        for gone in set(self._rows) - set(vertices):
            del self._rows[gone]
            self._bending_rows.pop(gone, None)
        self.vertices = np.array(vertices, dtype=np.int64)
        self._exact_positions = self._landmark_positions = None
        rows = [self._rows[v] for v in vertices]
        by_landmark = np.array([entry.landmark_coefficients for entry in rows])
        self.landmark_coefficients = by_landmark.reshape(len(rows), self._grouping.count, 3)
        self.surface.set_handles_by_block(
            self.vertices, [entry.block_coefficients for entry in rows]
        )

    def green_rows(self, vertices: IntArray) -> FloatArray:
        """Green's functions (n, V) of handle vertices (n,)."""
        rows = [self._rows[v].green for v in vertices.tolist()]
        return np.array(rows).reshape(len(rows), len(self.model.reference.vertices))

    def set_exact(self, vertices: IntArray, surface: DecodedSurface | None = None) -> None:
        """Choose the exact handles of a surface.

        Args:
            vertices: (n,) int64, all of them handle vertices.
            surface: `surface` or a copy of it; None is `surface`.
        """
        block = self.bending_rows(vertices)[:, vertices]
        rows = [self._bending_rows[v][1] for v in vertices.tolist()]
        (surface or self.surface).set_exact(vertices, rows, block)

    def bending_rows(self, vertices: IntArray) -> FloatArray:
        """`PoissonSystem.bending_rows` (n, V), by which exact handles (n,) move all vertices."""
        new = np.array(
            [v for v in vertices.tolist() if v not in self._bending_rows], dtype=np.int64
        )
        rows = self.model.poisson.bending_rows(new, self.green_rows(new))
        for vertex, row in zip(new.tolist(), rows, strict=True):
            self._bending_rows[vertex] = row, self.surface.ordered(row)
        found = [self._bending_rows[v][0] for v in vertices.tolist()]
        return np.array(found).reshape(len(found), len(self.model.reference.vertices))

    def landmark_positions(self) -> HandlePositions:
        """Handle positions by landmarks: fast, with the error of cubature."""
        if self._landmark_positions is None:
            if self._landmark_blocks is None:
                self._landmark_positions = DenseHandlePositions(
                    self.landmark_decoder, self.landmark_coefficients, True
                )
            else:
                self._landmark_positions = BlockHandlePositions(
                    self._landmark_blocks, self.landmark_coefficients
                )
        return self._landmark_positions

    def exact_positions(self) -> DenseHandlePositions:
        """Handle positions by all vertices."""
        if self._exact_positions is None:
            coefficients = self.model.poisson.position_coefficients(self.green_rows(self.vertices))
            self._exact_positions = DenseHandlePositions(
                self.model.decoder, coefficients, fast=True
            )
        return self._exact_positions
