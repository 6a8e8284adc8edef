"""Green's functions of handles, and the coefficients of handle positions.

They are computed once a model or once a handle; none depends on targets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deformer.editing.arap import DecodedSurface
from deformer.editing.cubature import Grouping, choose_landmarks
from deformer.editing.exact_handles import ExactHandles
from deformer.editing.handle_errors import ModelErrors
from deformer.editing.handle_kernels import BlockDecoder, BlockHandlePositions
from deformer.editing.handle_positions import DenseHandlePositions, HandlePositions
from deformer.editing.lifted_surface import LiftedSurface, moving_surface
from deformer.editing.misfit_field import MisfitField
from deformer.editing.orientations import LocalFrames
from deformer.geometry import FloatArray, RowPoint, SurfacePoints, farthest_rows
from deformer.model import DeformationModel

# Number of cubature's landmarks, whose gradients replace those of all vertices in a search.
_LANDMARKS = 800
# Number of sites of `HandleBasis.misfit_field`.
_SITES = 500


@dataclass(frozen=True, eq=False)
class _PointRows:
    """Arrays of one of `HandleBasis.points`.

    Args:
        green: (V,) Green's function G_h = L⁺ e_h.
        landmark_coefficients: (S, 3) coefficients of its position, summed over landmarks' groups.
        block_coefficients: coefficients of its position, by `DecodedSurface.block_coefficients`.
        moving_coefficients: the same of the surface of moving handles.
    """

    green: FloatArray
    landmark_coefficients: FloatArray
    block_coefficients: NDArray
    moving_coefficients: NDArray


class HandleBasis:
    """Handles of a model, and their positions as functions of the latent code.

    Args:
        model: the prior.

    Attributes:
        surface: decodes codes to all vertices; it has the handles and exact handles set here.
        moving: the surface while handles move: of a large mesh one that decodes to nodes, otherwise
            `surface`.
        points: the H handles: vertices, points of the surface, or points of local frames.
        landmark_decoder: the decoder of the S landmarks.
        landmark_coefficients: (H, S, 3) coefficients of the handle positions by landmarks.
        frames: the local frames of handles with orientations.
    """

    def __init__(self, model: DeformationModel) -> None:
        """Factor the Laplacian, choose landmarks; there are no handles yet."""
        self.model = model
        # The factorisation is done here so that the first exact handle need not wait for it.
        _ = model.poisson.screened_factor
        self.surface = DecodedSurface(model.decoder, model.poisson)
        self.moving = moving_surface(model, self.surface)
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
        self.frames = LocalFrames(model)
        self._rows: dict[RowPoint, _PointRows] = {}
        # Bending rows of handles that are or were exact, in the user's order and in the surface's.
        self._bending_rows: dict[RowPoint, tuple[FloatArray, NDArray]] = {}
        # Rows of the model's misfit, of handles for which it was asked.
        self._misfit_rows: dict[RowPoint, FloatArray] = {}
        self.points: list[RowPoint] = []
        self._errors: ModelErrors | None = None
        self._exact_positions: DenseHandlePositions | None = None
        self._landmark_positions: HandlePositions | None = None
        self.landmark_coefficients = np.empty((0, len(landmarks), 3))

    def set_points(self, points: Sequence[RowPoint]) -> None:
        """Replace the handles; the rows of handles that stay are reused.

        A handle that also keeps its index costs nothing. Rows are computed one by one: a solve for
        several rounds each of them otherwise, and poses would depend on when handles were added.

        Args:
            points: H handles, all different.
        """
        poisson = self.model.poisson
        for point in points:
            if point in self._rows:
                continue
            where = self._surface_points([point])
            row = poisson.green_rows(where.index, where.weights)
            coefficients = self._coefficients([point], row)
            blocked = self.surface.block_coefficients(coefficients[0])
            moving = blocked
            if self.moving is not self.surface:
                moving = self.moving.block_coefficients(coefficients[0])
            by_landmark = self._grouping.sums(coefficients)[0]
            self._rows[point] = _PointRows(row[0], by_landmark, blocked, moving)
        for gone in set(self._rows) - set(points):
            del self._rows[gone]
            self._bending_rows.pop(gone, None)
            self._misfit_rows.pop(gone, None)
        self.points = list(points)
        self._exact_positions = self._landmark_positions = self._errors = None
        rows = [self._rows[point] for point in points]
        by_landmark = np.array([entry.landmark_coefficients for entry in rows])
        self.landmark_coefficients = by_landmark.reshape(len(rows), self._grouping.count, 3)
        self.surface.set_handles_by_block([entry.block_coefficients for entry in rows])
        self.moving.set_handles_by_block([entry.moving_coefficients for entry in rows])

    def _surface_points(self, points: Sequence[RowPoint]) -> SurfacePoints:
        return SurfacePoints(points, self.model.reference.faces)

    def _coefficients(self, points: Sequence[RowPoint], green: FloatArray) -> FloatArray:
        """Coefficients (H, V+B, 3) of points with Green's functions `green` (H, V).

        A deformation gradient maps the reference's normal to the shape's: an offset along the
        normal is linear in the gradients, too.
        """
        coefficients = self.model.poisson.position_coefficients(green)
        where = self._surface_points(points)
        if where.offsets.any():
            lifts = where.lifts(self.model.reference.vertices)
            np.add.at(coefficients, (np.arange(len(green))[:, None], where.index), lifts)
        return coefficients

    def coefficients(self) -> FloatArray:
        """Coefficients a (H, V+B, 3) of the handles' positions Σ_i T_i a_h,i."""
        return self._coefficients(self.points, self._green_rows(self.points))

    def _green_rows(self, points: Sequence[RowPoint]) -> FloatArray:
        """Green's functions (n, V) of handles."""
        rows = [self._rows[point].green for point in points]
        return np.array(rows).reshape(len(rows), len(self.model.reference.vertices))

    def set_exact(
        self, points: Sequence[RowPoint], surface: DecodedSurface | None = None
    ) -> ExactHandles:
        """Choose the exact handles of a surface.

        Args:
            points: n of the handles.
            surface: a copy of `surface`; None is `surface` and `moving`.
        """
        exact = self.exact_handles(points)
        where, rows = exact.points, [self._bending_rows[point][1] for point in points]
        index, weights = where.index, None if where.is_vertex.all() else where.weights
        index = index[:, 0] if weights is None else index
        (surface or self.surface).set_exact(index, rows, exact.block, weights)
        if surface is None and isinstance(self.moving, LiftedSurface):
            self.moving.handles_changed()
        return exact

    def exact_handles(self, points: Sequence[RowPoint]) -> ExactHandles:
        """Handles (n,) as exact ones, with the rows by which they move all vertices."""
        for point in points:
            if point in self._bending_rows:
                continue
            where, green = self._surface_points([point]), self._green_rows([point])
            (row,) = self.model.poisson.bending_rows(where.index, green, where.weights)
            self._bending_rows[point] = row, self.surface.ordered(row)
        found = [self._bending_rows[point][0] for point in points]
        rows = np.array(found).reshape(len(found), len(self.model.reference.vertices))
        diagonal = self.model.reference.bounding_diagonal
        return ExactHandles(self._surface_points(points), rows, diagonal)

    def misfit_rows(self) -> FloatArray:
        """Covariances (H, V) of the model's errors at the handles and at all vertices.

        They are those of a thin plate on an elastic foundation (`PoissonSystem.foundation_rows`),
        of any scale.
        """
        for point in self.points:
            if point not in self._misfit_rows:
                where = self._surface_points([point])
                (row,) = self.model.poisson.foundation_rows(where.index, where.weights)
                self._misfit_rows[point] = row
        found = [self._misfit_rows[point] for point in self.points]
        return np.array(found).reshape(len(found), len(self.model.reference.vertices))

    def misfit_block(self) -> FloatArray:
        """Covariances (H, H) of the model's errors at the handles, of the scale of the rows."""
        where = self._surface_points(self.points)
        K = np.einsum("hm,ghm->gh", where.weights, self.misfit_rows()[:, where.index])
        # Rounding makes Green's functions slightly asymmetric.
        return 0.5 * (K + K.T)

    @cached_property
    def misfit_field(self) -> MisfitField:
        """What the model cannot express, at sites spread over the mesh."""
        v = self.model.reference.vertices
        return MisfitField(self.model, farthest_rows(v, min(len(v), _SITES))[0])

    def model_errors(self, misfit: float) -> ModelErrors:
        """The model's errors at the handles.

        The same object, with what it keeps, for the same handles and misfit.

        Args:
            misfit: τ, in bounding diagonals; positive.
        """
        if self._errors is None or self._errors.misfit != misfit:
            K = self.misfit_block()
            scale = 1.0 / np.sqrt(np.diag(K))
            self._errors = ModelErrors(misfit, K * scale[:, None] * scale)
        return self._errors

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
            self._exact_positions = DenseHandlePositions(
                self.model.decoder, self.coefficients(), fast=True
            )
        return self._exact_positions
