"""Deformation factors that are sparse and smooth over the graph of the mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from deformer.baselines._linear import LinearMethod
from deformer.baselines._linear_basis import LinearBasis
from deformer.baselines._structured_norm import StructuredNorm, structured_norm
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, Mesh

# λ_A of the authors' program.
_CODE_WEIGHT = 1e-4
# Number of attempts with λ, λ / 4, λ / 16, …; the first one that gives K pieces is the last.
_ATTEMPTS = 4
# Coordinates with a variance below this (the mean is 1) count as immobile.
_IMMOBILE = 1e-12


class StructuredFactors(LinearMethod):
    """Bernard et al., "Linear Shape Deformation Models with Local Support ...", CVPR 2016.

    "... using Graph-based Structured Matrix Factorisation". Displacements from the mean of the
    training shapes, scaled to unit variance, are factorised under a norm that favours factors of
    few, smoothly varying vertices (`StructuredNorm`). Each factor is then split into the connected
    regions of the mesh where it is not 0, and the K pieces of largest energy are the components.
    There may be many more pieces than K. If there are fewer, as where most of the mesh hardly
    moves, the factorisation is repeated with λ / 4, up to three times. Least squares encodes unseen
    shapes. All other weights and the number of iterations are those of the authors' program, which
    uses the graph of the mean shape in place of the reference's.

    Args:
        strength: λ, the weight of the whole norm.
        iterations: largest number of iterations of the block coordinate descent.

    Raises:
        InputError: a negative strength, or fewer than 1 iteration.
    """

    name: ClassVar[str] = "Structured factors"

    def __init__(self, strength: float = 64.0, iterations: int = 100) -> None:
        """Store the settings."""
        if not strength >= 0:
            raise InputError(f"strength: expected at least 0, got {strength}")
        if iterations < 1:
            raise InputError(f"iterations: expected at least 1, got {iterations}")
        self._strength, self._iterations = strength, iterations

    def fit_basis(
        self, vertices: FloatArray, reference: Mesh, components: int, seed: int
    ) -> LinearBasis:
        """Basis of shapes (N, V, 3); `seed` draws the coordinates at which factors start."""
        mean = vertices.mean(0)
        unit = float((vertices - mean).std()) or 1.0
        norm = structured_norm(reference)
        pieces: list[FloatArray] = []
        for weaker in range(_ATTEMPTS):
            strength = self._strength / 4**weaker
            found = factorise(
                (vertices - mean) / unit, norm, components, strength, self._iterations, seed
            )
            pieces = split(found, norm.pairs)[:components]
            if len(pieces) == components:
                break
        factors = np.zeros((components, *mean.shape))
        factors[: len(pieces)] = np.reshape(pieces, (-1, *mean.shape))
        return LinearBasis(mean, factors * unit, np.empty((0, components)))


@dataclass(frozen=True, eq=False)
class Factors:
    """Data (N, V, 3) ≈ Σ_k weights_nk factors_k.

    Args:
        factors: (K, V, 3).
        weights: (N, K).
        objective: value at the start and after each iteration; it never increases.
    """

    factors: FloatArray
    weights: FloatArray
    objective: FloatArray


def factorise(
    data: FloatArray, norm: StructuredNorm, count: int, strength: float, iterations: int, seed: int
) -> Factors:
    """Minimise ½‖X − A Φ‖² + λ Σ_k ‖Φ_k‖ λ_A ‖A_k‖₂/√N by block coordinate descent.

    Proximal gradient steps on A and Φ in turn from extrapolated points (Xu and Yin 2013), as in
    Haeffele, Young and Vidal (2014). A step that does not lower the objective is repeated without
    extrapolation; the descent ends when that does not lower it either.

    Args:
        data: (N, V, 3) displacements of unit variance.
        norm: norm of the factors.
        count: K. Each factor starts as one coordinate of one vertex, drawn from those that move:
            others would never get weights.
        strength: λ K / (3 V N), whose effect does not depend on the size of the data.
        iterations: largest number of iterations.
        seed: draws the start.
    """
    N, V, _ = data.shape
    X = data.reshape(N, -1)
    penalty = strength * 3 * V * N / count * _CODE_WEIGHT / np.sqrt(N)
    moving = np.flatnonzero((X**2).sum(0) > _IMMOBILE * N)
    start = np.random.default_rng(seed).choice(
        moving if len(moving) else 3 * V, count, replace=count > (len(moving) or 3 * V)
    )
    factors = np.zeros((count, V, 3))
    factors.reshape(count, -1)[np.arange(count), start] = 1.0
    weights = np.zeros((N, count))
    dual = np.zeros((count, len(norm.pairs), 3))
    norms = norm.values(factors)

    def objective(A: FloatArray, F: FloatArray, of_factors: FloatArray) -> float:
        misfit = ((X - A @ F.reshape(count, -1)) ** 2).sum() / 2
        return float(misfit + penalty * (of_factors * np.linalg.norm(A, axis=0)).sum())

    history = [objective(weights, factors, norms)]
    extrapolated_weights, extrapolated_factors, is_extrapolated = weights, factors, False
    momentum, bounds = 1.0, (np.inf, np.inf)
    for _ in range(iterations):
        flat = factors.reshape(count, -1)
        gram = flat @ flat.T
        bound = _largest(gram)
        new_weights = _shrink_columns(
            extrapolated_weights - (extrapolated_weights @ gram - X @ flat.T) / bound,
            penalty * norms / bound,
        )
        gram, lengths = new_weights.T @ new_weights, np.linalg.norm(new_weights, axis=0)
        bound = bound, _largest(gram)
        flat = extrapolated_factors.reshape(count, -1)
        step = flat - (gram @ flat - new_weights.T @ X) / bound[1]
        new_factors = norm.proximal_map(
            step.reshape(factors.shape), penalty * lengths / bound[1], dual
        )
        new_factors[lengths == 0] = 0.0
        new_norms = norm.values(new_factors)
        value = objective(new_weights, new_factors, new_norms)
        if value >= history[-1]:
            if not is_extrapolated:
                break
            extrapolated_weights, extrapolated_factors, is_extrapolated = weights, factors, False
            continue
        history.append(value)
        momentum, previous = (1 + np.sqrt(1 + 4 * momentum**2)) / 2, momentum
        inertia = (previous - 1) / momentum
        extrapolation = [min(inertia, np.sqrt(a / b)) for a, b in zip(bounds, bound, strict=True)]
        extrapolated_weights = new_weights + extrapolation[0] * (new_weights - weights)
        extrapolated_factors = new_factors + extrapolation[1] * (new_factors - factors)
        weights, factors, norms = new_weights, new_factors, new_norms
        bounds, is_extrapolated = bound, True
    return Factors(factors, weights, np.array(history))


def split(found: Factors, pairs: IntArray) -> list[FloatArray]:
    """Pieces (V, 3) of the factors, one for each connected region where a factor is not 0.

    `pairs` (E, 2) are the edges of the graph. Pieces are in decreasing order of energy, the squared
    length of the piece times that of its weights; a factor without weights has no pieces.
    """
    pieces, energies = [], []
    for factor, weight in zip(found.factors, found.weights.T, strict=True):
        active = factor.any(1) & weight.any()
        inside = pairs[active[pairs].all(1)]
        graph = sparse.coo_array((np.ones(len(inside)), inside.T), shape=(len(factor),) * 2)
        labels = csgraph.connected_components(graph, directed=False)[1]
        for label in np.unique(labels[active]):
            piece = np.where(((labels == label) & active)[:, None], factor, 0.0)
            pieces.append(piece)
            energies.append((piece**2).sum() * (weight @ weight))
    return [pieces[p] for p in np.argsort(-np.array(energies), kind="stable")]


def _largest(gram: FloatArray) -> float:
    """Largest eigenvalue of a Gram matrix (K, K), a Lipschitz constant; 1 where it is 0."""
    return float(np.linalg.eigvalsh(gram)[-1]) or 1.0


def _shrink_columns(columns: FloatArray, by: FloatArray) -> FloatArray:
    """Columns (N, K) shortened by (K,), at most to 0: the proximal map of their lengths."""
    length = np.linalg.norm(columns, axis=0)
    kept = np.maximum(0.0, length - by) / np.where(length > 0, length, 1.0)
    return columns * kept
