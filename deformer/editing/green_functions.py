"""What a model's handles stand on: Green rows, coefficients, landmarks, and the surface of a frame.

All is made once a model, or once a handle vertex; nothing depends on targets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deformer.editing.arap import Surface
from deformer.editing.cubature import Grouping, choose_landmarks
from deformer.editing.handle_kernels import BlockDecoder, BlockHandlePositions
from deformer.editing.handle_positions import DenseHandlePositions, Handles
from deformer.geometry import FloatArray, IntArray
from deformer.model import DeformationModel

# Vertices that stand for all while the latent code is searched.
_LANDMARKS = 800


@dataclass(frozen=True, eq=False)
class _Kept:
    """What a handle's vertex keeps.

    Args:
        green: (V,) Green row.
        landmark_coefficients: (S, 3).
        block_coefficients: as `Surface.block_coefficients` gives them.
    """

    green: FloatArray
    landmark_coefficients: FloatArray
    block_coefficients: NDArray


class HandleBasis:
    """Handle vertices of a model, and their positions as functions of the latent code.

    Args:
        model: the prior.
    """

    def __init__(self, model: DeformationModel) -> None:
        """Factor the Laplacian, choose landmarks; there are no handles yet."""
        self.model = model
        # Now, and not when the first handle is made exact.
        _ = model.poisson.tensed
        self.surface = Surface(model.decoder, model.poisson)
        marks, labels = choose_landmarks(
            model.decoder, model.prior.factor, model.reference.vertices, _LANDMARKS
        )
        # Side by side in space they have most components in common.
        order = np.argsort(self.surface.place[marks])
        marks, labels = marks[order], np.argsort(order)[labels]
        self._grouping = Grouping(labels, len(marks))
        self.landmark_decoder = model.decoder_at(marks)
        pointwise = self.landmark_decoder.pointwise
        self._packed = BlockDecoder(self.landmark_decoder) if pointwise else None
        self._kept: dict[int, _Kept] = {}
        # Bending rows of the vertices that were held, and the same as `Surface.ordered` has them.
        self._held: dict[int, tuple[FloatArray, NDArray]] = {}
        self.vertices: IntArray = np.empty(0, dtype=np.int64)
        self._by_all: DenseHandlePositions | None = None
        self._by_landmarks: Handles | None = None
        self.landmark_coefficients = np.empty((0, len(marks), 3))

    def take(self, vertices: list[int]) -> None:
        """Make `vertices` (H,), all different, the handles; what is kept of them is used again.

        It is the cheaper the more of them keep their places.
        """
        poisson = self.model.poisson
        new = [v for v in vertices if v not in self._kept]
        for vertex, row in zip(new, poisson.green_rows(new), strict=True):
            coefficients = poisson.position_coefficients(row[None])
            self._kept[vertex] = _Kept(
                row,
                self._grouping.sums(coefficients)[0],
                self.surface.block_coefficients(coefficients[0]),
            )
        for gone in set(self._kept) - set(vertices):
            del self._kept[gone]
            self._held.pop(gone, None)
        self.vertices = np.array(vertices, dtype=np.int64)
        self._by_all = self._by_landmarks = None
        kept = [self._kept[v] for v in vertices]
        by_landmark = np.array([entry.landmark_coefficients for entry in kept])
        self.landmark_coefficients = by_landmark.reshape(len(kept), self._grouping.count, 3)
        self.surface.take_handles(self.vertices, [entry.block_coefficients for entry in kept])

    def green(self, vertices: IntArray) -> FloatArray:
        """Green rows (n, V) of handle vertices (n,)."""
        rows = [self._kept[v].green for v in vertices.tolist()]
        return np.array(rows).reshape(len(rows), len(self.model.reference.vertices))

    def hold(self, vertices: IntArray, surface: Surface | None = None) -> None:
        """Let the handle vertices (n,) be exact on a surface, the basis's own or a twin of it."""
        block = self.bending(vertices)[:, vertices]
        rows = [self._held[v][1] for v in vertices.tolist()]
        (surface or self.surface).take_exact(vertices, rows, block)

    def bending(self, vertices: IntArray) -> FloatArray:
        """Rows (n, V) by which handle vertices (n,) move the rest when they are exact."""
        new = np.array([v for v in vertices.tolist() if v not in self._held], dtype=np.int64)
        rows = self.model.poisson.bending_rows(new, self.green(new))
        for vertex, row in zip(new.tolist(), rows, strict=True):
            self._held[vertex] = row, self.surface.ordered(row)
        found = [self._held[v][0] for v in vertices.tolist()]
        return np.array(found).reshape(len(found), len(self.model.reference.vertices))

    def by_landmarks(self) -> Handles:
        """Positions of the handles by landmarks: fast, and off by what they leave out."""
        if self._by_landmarks is None:
            if self._packed is None:
                self._by_landmarks = DenseHandlePositions(
                    self.landmark_decoder, self.landmark_coefficients, True
                )
            else:
                self._by_landmarks = BlockHandlePositions(self._packed, self.landmark_coefficients)
        return self._by_landmarks

    def by_all(self) -> DenseHandlePositions:
        """Positions of the handles by all vertices."""
        if self._by_all is None:
            coefficients = self.model.poisson.position_coefficients(self.green(self.vertices))
            self._by_all = DenseHandlePositions(self.model.decoder, coefficients, fast=True)
        return self._by_all
