"""Activations of latent components in the examples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deformer.checks import checked_instance, checked_integer
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.model import DeformationModel


class Activations:
    """Extremes, strength and support of a model's components.

    Tan et al. 2018, component analysis (in section "Applications"): with the reference's latent
    code Z_r, entry k is set to its least and to its greatest value over the training codes. Of the
    two decoded shapes, the one whose features are farther from the reference's represents
    component k. The reference is compared as it is decoded, so that a component without effect has
    the strength 0.

    Args:
        model: the prior.

    Attributes:
        low, high: (K,) smallest and largest activation among the training codes.
        reference: (K,) latent code Z_r of the reference.
        base: (U+B, 9) features decoded from it, of vertices without seams and of links.
        extreme: (K,) activation of each component in its representative shape: `low` or `high`.
        strength: (K,) distance ‖X_k − X_r‖ of the representative shape's features from the
            reference's, in the network's units (features scaled to ±0.95).
        order: (K,) components from the strongest to the weakest.
    """

    def __init__(self, model: DeformationModel) -> None:
        """Measure all components."""
        checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
        self._model, self._seams = model.closed, model.seams
        self._weights = model.weights.C
        self.low: FloatArray = model.codes.min(axis=0)
        self.high: FloatArray = model.codes.max(axis=0)
        self.reference: FloatArray = model.encode(model.reference.vertices)
        self.base: FloatArray = model.decoder.features(self.reference)
        bounds = np.stack([self.low, self.high])
        distances = np.empty_like(bounds)
        for k in range(model.components):
            for e in range(2):
                change = self._feature_change(k, bounds[e, k])
                distances[e, k] = np.linalg.norm(self._scaled(change))
        farther = distances.argmax(axis=0)
        columns = np.arange(model.components)
        self.extreme: FloatArray = bounds[farther, columns]
        self.strength: FloatArray = distances[farther, columns]
        self.order: IntArray = np.argsort(-self.strength, kind="stable")

    def representative(self, component: int) -> FloatArray:
        """Latent code (K,) of the shape that represents a component.

        Args:
            component: index k, from 0.

        Raises:
            InputError: no such component.
        """
        self._check(component)
        z = self.reference.copy()
        z[component] = self.extreme[component]
        return z

    def change(self, component: int) -> FloatArray:
        """Difference (U+B, 9) of the representative shape's features from the reference's.

        Args:
            component: index k, from 0.

        Raises:
            InputError: no such component.
        """
        self._check(component)
        return self._feature_change(component, float(self.extreme[component]))

    def displacement(self, component: int) -> FloatArray:
        """Length (V,) of every vertex's row of `change`, in the network's units (scaled features).

        The links that carry a connected component count for its vertices.

        Args:
            component: index k, from 0.

        Raises:
            InputError: no such component.
        """
        return self._by_vertex(np.linalg.norm(self._scaled(self.change(component)), axis=1))

    def support(self, component: int) -> FloatArray:
        """Weights ‖C_k^i‖ (V,) of a component at every vertex i, the largest being 1.

        The links that carry a connected component count for its vertices.

        Args:
            component: index k, from 0.

        Raises:
            InputError: no such component.
        """
        self._check(component)
        weights = self._by_vertex(np.linalg.norm(self._weights[:, :, component], axis=1))
        return weights.astype(np.float64) / (float(weights.max()) or 1.0)

    def _by_vertex(self, lengths: NDArray) -> NDArray:
        """Lengths (V,) of the vertices, from lengths (U+B,) of those of `closed` and the links."""
        mesh = self._model.reference
        V = len(mesh.vertices)
        labels = mesh.labels
        carried = np.zeros(len(mesh.links) + 1, dtype=lengths.dtype)
        for (i, j), length in zip(mesh.links.tolist(), lengths[V:], strict=True):
            carried[labels[i]] = max(carried[labels[j]], length)
        return np.maximum(lengths[:V], carried[labels])[self._seams.closed]

    def _feature_change(self, component: int, value: float) -> FloatArray:
        """Change (V+B, 9) of the reference's features when entry k of its code becomes `value`."""
        z = self.reference.copy()
        z[component] = value
        return self._model.decoder.features(z) - self.base

    def _scaled(self, change: FloatArray) -> FloatArray:
        return change / self._model.scaler.gain

    def _check(self, component: int) -> None:
        K = self._weights.shape[2]
        checked_integer(component, "component")
        if not 0 <= component < K:
            raise InputError(f"component {component} does not exist; the model has 0…{K - 1}")
