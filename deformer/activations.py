"""What latent components do to the mesh, how far the examples use them, how usual a code is."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deformer.errors import InputError
from deformer.mesh import FloatArray, IntArray
from deformer.model import DeformationModel


class Activations:
    """Strength, limits and support of a model's components.

    Args:
        model: the prior.

    Attributes:
        low, high: (K,) smallest and largest activation among the training codes.
        strength: (K,) root mean square motion of a vertex when the component changes by one
            standard deviation of the training codes, in the data's own units (to first order, at
            their mean).
        order: (K,) components from the strongest to the weakest.
    """

    def __init__(self, model: DeformationModel) -> None:
        """Measure all components."""
        self._weights = model.network.C
        self.low: FloatArray = model.codes.min(axis=0)
        self.high: FloatArray = model.codes.max(axis=0)
        motion = np.sqrt(3.0 * (model.tangents(model.prior.mean) ** 2).mean(axis=1))
        self.strength: FloatArray = model.codes.std(axis=0) * motion
        self.order: IntArray = np.argsort(-self.strength, kind="stable")

    def support(self, component: int) -> FloatArray:
        """Weights ‖C_k^i‖ (V,) of a component at every vertex, the largest being 1.

        Raises:
            InputError: no such component.
        """
        K = self._weights.shape[2]
        if not 0 <= component < K:
            raise InputError(f"component {component} does not exist; the model has 0…{K - 1}")
        weights = np.linalg.norm(self._weights[:, :, component].detach().numpy(), axis=1)
        return weights.astype(np.float64) / (float(weights.max()) or 1.0)


class Familiarity:
    """How far latent codes are from those of the examples.

    The unit is what the examples themselves keep from each other: the distance (Mahalanobis, by
    the prior's covariance) within which 95 % of the training codes have their nearest neighbour.

    Args:
        model: the prior with its training codes.
    """

    def __init__(self, model: DeformationModel) -> None:
        """Measure the distances among the training codes."""
        self._factor = model.prior.factor
        self._codes = self._whitened(model.codes)
        gaps = [np.sort(self._distances(y))[1] for y in self._codes]
        self._unit = float(np.quantile(gaps, 0.95)) or 1.0

    def distance(self, z: ArrayLike) -> float:
        """Distance from a latent code (K,) to the nearest training code; up to 1 is usual."""
        y = self._whitened(np.asarray(z, dtype=np.float64)[None])[0]
        return float(self._distances(y).min()) / self._unit

    def _whitened(self, codes: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.solve(self._factor, codes.T).T, dtype=np.float64)

    def _distances(self, y: FloatArray) -> FloatArray:
        return np.linalg.norm(self._codes - y, axis=1)
