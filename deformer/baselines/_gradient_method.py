"""Base classes of methods whose features decode to deformation gradients of the vertices."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from deformer.acap import FeatureExtractor, FeatureScaler, PoissonSystem
from deformer.baselines._checks import (
    checked_codes,
    checked_handles,
    checked_shapes,
    checked_training,
)
from deformer.baselines._data_driven import DataDrivenDeformation
from deformer.baselines._gradient_space import GradientSpace
from deformer.errors import InputError
from deformer.geometry import FloatArray, Geodesics, IntArray, MeshSequence
from deformer.model import fit_prior
from deformer.training import (
    HandleFit,
    LocalisedSettings,
    choose_noise,
    fit_each_noise,
    localised_components,
)

# Candidate noises: root mean square strains that add as much energy as one standard deviation of
# the prior.
NOISES = (0.003, 0.006, 0.012, 0.025)
# Components for the choice among them need not have converged.
_TRIAL_ROUNDS = 10


class GradientMethod(ABC):
    """Codes, shapes and handle fits of a `GradientSpace`, which a subclass learns.

    Args:
        noise: σ of handle fits, see `DataDrivenDeformation.fit`; None lets `fit` choose it from
            `NOISES` on held-out training shapes.

    Attributes:
        chosen_noise: the noise of handle fits, given or chosen; 0 before `fit`.
    """

    def __init__(self, noise: float | None = None) -> None:
        """Nothing is learned yet."""
        self.noise = noise
        self._deformation: DataDrivenDeformation | None = None
        self.chosen_noise = 0.0

    def _set_deformation(self, deformation: DataDrivenDeformation, noise: float) -> None:
        """Store the learned deformation and the noise of its handle fits."""
        self._deformation, self.chosen_noise = deformation, noise

    def _check_training(self, shape_count: int, components: int) -> None:
        checked_training(shape_count, components, self.noise)

    def learned(self) -> DataDrivenDeformation:
        """The deformation that `fit` has learned; InputError before `fit`."""
        if self._deformation is None:
            raise InputError(f"{type(self).__name__} has learned nothing yet; call fit first")
        return self._deformation

    @abstractmethod
    def extract(self, vertices: FloatArray) -> FloatArray:
        """Features (N, V, 9) of shapes (N, V, 3)."""

    def encode(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) of shapes (N, V, 3) by least squares on features.

        Raises:
            InputError: nothing is learned yet, or the shapes are not finite or of another size.
        """
        space = self.learned().space
        return space.project(self.extract(checked_shapes(vertices, len(space.base))))

    def fit_codes(self, vertices: ArrayLike) -> FloatArray:
        """Codes (N, K) whose vertices come closest to shapes (N, V, 3), centroids aligned."""
        deformation = self.learned()
        shapes = checked_shapes(vertices, len(deformation.space.base))
        found = [
            deformation.space.closest(shape, w, deformation.prior)
            for shape, w in zip(shapes, self.encode(shapes), strict=True)
        ]
        return np.array(found).reshape(len(shapes), -1)

    def decode(self, codes: ArrayLike) -> FloatArray:
        """Shapes (N, V, 3) of codes (N, K), centroids at the reference's."""
        space = self.learned().space
        return space.decode(checked_codes(codes, len(space.components)))

    def fit_handles(
        self, vertices: ArrayLike, targets: ArrayLike, noise: float = 0.0
    ) -> FloatArray:
        """The mesh (V, 3) with vertices (H,) at targets (H, 3), exactly if these have no noise."""
        deformation = self.learned()
        V = len(deformation.space.base)
        index, goals, error = checked_handles(vertices, targets, V, noise)
        return deformation.fit(index, goals, self.chosen_noise, error)


class GradientSplocsMethod(GradientMethod):
    """Sparse localised components of rotation vectors and stretches.

    Rotations and stretches are each divided by their range (the scaling of Tan et al. 2018,
    `FeatureScaler`); components decompose their differences from the mean of the training shapes.

    Args:
        settings: settings of the decomposition; None is its default.
        noise: σ of handle fits; None lets `fit` choose it.
    """

    def __init__(
        self, settings: LocalisedSettings | None = None, noise: float | None = None
    ) -> None:
        """Nothing is learned yet."""
        super().__init__(noise)
        self.settings = settings or LocalisedSettings()
        self._extractor: FeatureExtractor | None = None

    def fit(self, shapes: MeshSequence, components: int, seed: int = 0) -> Self:
        """Learn K = `components` components; shape 0 is the reference.

        Args:
            shapes: at least 2 training shapes.
            components: K.
            seed: draws the control vertices for the choice of the noise; all else is deterministic.

        Raises:
            InputError: too few shapes, no component, or a noise that is not positive.
        """
        self._check_training(len(shapes), components)
        reference = shapes.mesh(0)
        self._extractor = FeatureExtractor(reference)
        poisson, geodesics = PoissonSystem(reference), Geodesics(reference)
        q = self.extract(shapes.vertices)

        def fit_deformation(q: FloatArray, settings: LocalisedSettings) -> DataDrivenDeformation:
            gain, base = FeatureScaler.fit(q).gain, q.mean(axis=0)
            found = localised_components(
                (q - base) / gain, geodesics.normalised_row, components, settings
            )
            space = GradientSpace(poisson, base, found.components * gain, gain)
            codes = space.project(q)
            return DataDrivenDeformation(space, fit_prior(codes), codes)

        def train_on(indices: IntArray) -> HandleFit:
            rounds = min(self.settings.rounds, _TRIAL_ROUNDS)
            return fit_each_noise(
                fit_deformation(q[indices], replace(self.settings, rounds=rounds)).fit
            )

        noise = self.noise or choose_noise(train_on, shapes, geodesics, NOISES, seed)
        self._set_deformation(fit_deformation(q, self.settings), noise)
        return self

    def _learned_extractor(self) -> FeatureExtractor:
        if self._extractor is None:
            raise InputError(f"{type(self).__name__} has learned nothing yet; call fit first")
        return self._extractor
