"""The structured norm of deformation factors, and its proximal map."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from deformer.compilation import njit
from deformer.geometry import FloatArray, IntArray, Mesh, edges
from deformer.linalg import over_ranges

# Iterations from a warm start; 20, as in the authors' program, change the objective's ninth digit.
_ITERATIONS = 5


@dataclass(frozen=True, eq=False)
class StructuredNorm:
    """‖φ‖ = λ₁‖φ‖₁ + λ₂‖φ‖₂ + λ_∞ Σ_i ‖φ_i‖_∞ + λ_G ‖E φ‖₂ of a factor φ (V, 3).

    E φ has a row √w_e (φ_i − φ_j) for every edge e = (i, j): equation 6 of Bernard et al. (2016).

    Args:
        pairs: (E, 2) edges.
        weights: (E,) w, positive.
        l1, l2, group, graph: λ₁, λ₂, λ_∞, λ_G.
    """

    pairs: IntArray
    weights: FloatArray
    l1: float
    l2: float
    group: float
    graph: float

    def values(self, factors: FloatArray) -> FloatArray:
        """Norms (K,) of factors (K, V, 3)."""
        i, j = self.pairs.T
        norms = np.empty(len(factors))
        for k, f in enumerate(factors):
            magnitude = np.abs(f)
            difference = (f[i] - f[j]) ** 2
            norms[k] = (
                self.l1 * magnitude.sum()
                + self.l2 * np.sqrt((f**2).sum())
                + self.group * magnitude.max(1).sum()
                + self.graph * np.sqrt(self.weights @ difference.sum(1))
            )
        return norms

    def proximal_map(self, factors: FloatArray, scales: FloatArray, dual: FloatArray) -> FloatArray:
        """Proximal map argmin_x ½‖x − φ‖² + s ‖x‖ of factors φ (K, V, 3) with scales s (K,).

        Forward-backward steps on the dual variable of the edge term, from a warm start. The steps
        are few: the result is close to the minimum and has its sparsity.

        Args:
            factors: (K, V, 3) φ.
            scales: (K,) s.
            dual: (K, E, 3) start of the dual variable; replaced in place by its last value.
        """
        result = np.empty_like(factors)
        degree = np.bincount(self.pairs.ravel(), np.repeat(self.weights, 2))
        # ‖E‖² is at most twice the largest weighted degree; up to 2 / ‖E‖² a step converges.
        step = 0.9 / degree.max()
        constants = self.l1, self.l2, self.group, self.graph
        roots = np.sqrt(self.weights)
        shared = scales, self.pairs, roots, constants, step, dual, result
        over_ranges(_proximal_maps, len(factors), factors, *shared, share=1)
        return result


def structured_norm(
    reference: Mesh, l1: float = 1.0, l2: float = 1.0, group: float = 2.0, graph: float = 1.0
) -> StructuredNorm:
    """The structured norm of a mesh, with weights that do not depend on its size.

    An edge of length l has the weight 2 exp(−(l / mean)²). Each λ is divided by the square root of
    the number of terms (3V, 3V, V, 3E). Formula and defaults are those of the authors' program.
    """
    pairs = edges(reference.faces)
    V = len(reference.vertices)
    length = np.linalg.norm(
        reference.vertices[pairs[:, 0]] - reference.vertices[pairs[:, 1]], axis=1
    )
    weights = 2 * np.exp(-((length / (length.mean() or 1.0)) ** 2))
    return StructuredNorm(
        pairs,
        weights,
        l1 / np.sqrt(3 * V),
        l2 / np.sqrt(3 * V),
        group / np.sqrt(V),
        graph / np.sqrt(3 * len(pairs)),
    )


@njit(nogil=True, error_model="numpy")
def _proximal_maps(start, stop, factors, scales, pairs, roots, constants, step, dual, result):
    l1, l2, group, graph = constants
    V, E = factors.shape[1], len(pairs)
    for k in range(start, stop):
        s, v, x = scales[k], dual[k], result[k]
        for _ in range(_ITERATIONS):
            # x = prox of the other terms at φ − Eᵀ v
            x[:] = factors[k]
            for e in range(E):
                i, j, root = pairs[e, 0], pairs[e, 1], roots[e]
                for d in range(3):
                    x[i, d] -= root * v[e, d]
                    x[j, d] += root * v[e, d]
            square = 0.0
            for i in range(V):
                x[i, 0], x[i, 1], x[i, 2] = _proximal_point(
                    x[i, 0], x[i, 1], x[i, 2], s * l1, s * group
                )
                square += x[i, 0] ** 2 + x[i, 1] ** 2 + x[i, 2] ** 2
            shrinkage = max(0.0, 1.0 - s * l2 / math.sqrt(square)) if square > 0 else 0.0
            x *= shrinkage
            # v = projection of v + step E x on the ball of radius s λ_G
            square = 0.0
            for e in range(E):
                i, j, scaled = pairs[e, 0], pairs[e, 1], step * roots[e]
                for d in range(3):
                    v[e, d] += scaled * (x[i, d] - x[j, d])
                    square += v[e, d] ** 2
            radius = s * graph
            if square > radius**2:
                v *= radius / math.sqrt(square)


@njit(nogil=True, error_model="numpy")
def _proximal_point(x, y, z, l1, group):
    """Proximal map of l1 ‖·‖₁ + group ‖·‖_∞ at three numbers.

    Soft thresholding, then clipping of magnitudes at a height with Σ max(0, |x_d| − height) =
    `group`: if the c largest are above it, height = (their sum − group) / c.
    """
    a, b, c = max(0.0, abs(x) - l1), max(0.0, abs(y) - l1), max(0.0, abs(z) - l1)
    total = a + b + c
    if total <= group:
        return 0.0, 0.0, 0.0
    high, low = max(a, b, c), min(a, b, c)
    middle = total - high - low
    height = high - group
    if height < middle:
        height = (high + middle - group) / 2
        if height < low:
            height = (total - group) / 3
    return (
        math.copysign(min(a, height), x),
        math.copysign(min(b, height), y),
        math.copysign(min(c, height), z),
    )
