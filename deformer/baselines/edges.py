"""Sparse localised components of edge lengths and dihedral angles."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from deformer.acap import PoissonSystem
from deformer.baselines._checks import (
    checked_codes,
    checked_handles,
    checked_shapes,
    checked_training,
)
from deformer.baselines._edge_space import EdgeDeformation, EdgeSpace
from deformer.baselines._shell import Shell
from deformer.baselines.method import Space
from deformer.errors import InputError
from deformer.geometry import (
    FloatArray,
    Geodesics,
    IntArray,
    MeshSequence,
    log_to_rotation,
    procrustes,
    rotation_to_log,
)
from deformer.model import fit_prior
from deformer.training import (
    HandleFit,
    LocalisedSettings,
    choose_noise,
    fit_each_noise,
    localised_components,
)

# Candidate noises: residuals of an edge's feature that add as much energy as one standard deviation
# of the prior.
NOISES = (0.01, 0.03, 0.1)
_TRIAL_ROUNDS = 10


class EdgeSplocs:
    """Sparse localised components of edge lengths and dihedral angles, which no rotation changes.

    After Wang et al., "Articulated-Motion-Aware Sparse Localized Decomposition" (2017): components
    are linear in the changes of edge lengths and dihedral angles against the reference, weighted as
    in `Shell`. The distance of two edges is the mean of the geodesic distances of their ends. The
    paper's two linear solves (`Connection`) reconstruct a shape; Gauss–Newton on the vertices
    (Fröhlich and Botsch 2011), which the paper does not have, refines it. `EdgeDeformation` fits
    handles.

    The features do not determine a shape's rigid motion. Codes are therefore (N, K + 3): the
    weights, then the rotation vector of the shape; other methods have K numbers.

    Args:
        settings: settings of the decomposition; None is its default.
        noise: σ of handle fits, see `EdgeDeformation.fit`; None lets `fit` choose it from `NOISES`
            on held-out training shapes.

    Attributes:
        chosen_noise: the noise of handle fits, given or chosen; 0 before `fit`.
    """

    name: ClassVar[str] = "SPLOCS edges"
    space: ClassVar[Space] = "edges"

    def __init__(
        self, settings: LocalisedSettings | None = None, noise: float | None = None
    ) -> None:
        """Nothing is learned yet."""
        self.settings = settings or LocalisedSettings()
        self.noise = noise
        self._deformation: EdgeDeformation | None = None
        self.chosen_noise = 0.0

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Self:
        """Learn K = `components` components; shape 0 is the reference.

        Args:
            shapes: at least 2 training shapes.
            components: K.
            seed: draws the control vertices for the choice of the noise; all else is deterministic.

        Raises:
            InputError: too few shapes, no component, a noise that is not positive, or a reference
                that `Shell` refuses.
        """
        checked_training(len(shapes), components, self.noise)
        reference = shapes.mesh(0)
        shell, poisson, geodesics = Shell(reference), PoissonSystem(reference), Geodesics(reference)
        features = np.stack([shell.features(p) for p in shapes.vertices])
        ends = shell.hinges[:, :2]

        def distances(edge: int) -> FloatArray:
            a, b = (geodesics.normalised_row(int(end)) for end in ends[edge])
            return 0.25 * (a + b)[ends].sum(axis=1)

        def fit_deformation(indices: IntArray, settings: LocalisedSettings) -> EdgeDeformation:
            base = features[indices].mean(axis=0)
            found = localised_components(features[indices] - base, distances, components, settings)
            space = EdgeSpace(shell, poisson, base, found.components)
            codes = space.project(features[indices])
            return EdgeDeformation(space, fit_prior(codes), shapes.vertices[indices], codes)

        def train_on(indices: IntArray) -> HandleFit:
            rounds = min(self.settings.rounds, _TRIAL_ROUNDS)
            return fit_each_noise(
                fit_deformation(indices, replace(self.settings, rounds=rounds)).fit
            )

        self.chosen_noise = self.noise or choose_noise(train_on, shapes, geodesics, NOISES, seed)
        self._deformation = fit_deformation(np.arange(len(shapes)), self.settings)
        return self

    @property
    def components(self) -> FloatArray:
        """Components (K, E, 2): changes of edge lengths and angles in the units of `Shell`."""
        return self.learned().space.components

    @property
    def edges(self) -> IntArray:
        """Ends (E, 2) int64 of the edges, in the order of the components."""
        return self.learned().space.shell.hinges[:, :2]

    def weights(self, vertices: ArrayLike) -> FloatArray:
        """Weights (N, K) of shapes (N, V, 3) by least squares on features, without rotations."""
        shapes = self._checked(vertices)
        space = self.learned().space
        return space.project(np.array([space.shell.features(p) for p in shapes]))

    def encode(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K + 3) of shapes (N, V, 3): their weights, then their rotation vectors."""
        shapes = self._checked(vertices)
        return self._with_frames(self.weights(shapes), shapes)

    def fit_codes(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K + 3) whose vertices come closest to shapes (N, V, 3)."""
        deformation = self.learned()
        space = deformation.space
        shapes = self._checked(vertices)
        w = self.weights(shapes)
        found = [space.closest(p, row, deformation.prior) for p, row in zip(shapes, w, strict=True)]
        return self._with_frames(np.array(found), shapes)

    def decode(self, codes: ArrayLike) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K + 3), centroids at the reference's."""
        space = self.learned().space
        rows = checked_codes(codes, len(space.components) + 3)
        centre = space.poisson.centroid
        p = np.empty((len(rows), *space.shell.reference.vertices.shape))
        for n, row in enumerate(rows):
            p[n] = (space.decode(row[:-3]) - centre) @ log_to_rotation(row[-3:]).T + centre
        return p

    def fit_handles(
        self, vertices: ArrayLike, targets: ArrayLike, noise: float = 0.0
    ) -> FloatArray:
        """The mesh (V, 3) with vertices (H,) at targets (H, 3), exactly if these have no noise."""
        deformation = self.learned()
        V = len(deformation.space.shell.reference.vertices)
        index, goals, error = checked_handles(vertices, targets, V, noise)
        return deformation.fit(index, goals, self.chosen_noise, error)

    def learned(self) -> EdgeDeformation:
        """The deformation that `fit` has learned; InputError before `fit`."""
        if self._deformation is None:
            raise InputError("EdgeSplocs has learned nothing yet; call fit first")
        return self._deformation

    def _checked(self, vertices: ArrayLike) -> FloatArray:
        V = len(self.learned().space.shell.reference.vertices)
        return checked_shapes(vertices, V)

    def _with_frames(self, w: FloatArray, shapes: FloatArray) -> FloatArray:
        """Weights (N, K), and the rotation vectors that align their shapes to `shapes` best."""
        space = self.learned().space
        turned = np.empty((len(w), 3))
        for n, row in enumerate(w):
            turned[n] = rotation_to_log(procrustes(space.decode(row), shapes[n])[0])
        return np.column_stack([w, turned])
