"""A few vertices that stand for all: the decoder's Jacobian, at a fraction of the cost.

Deformation gradients vary smoothly and together, so vertices are grouped by how they react to the
latent code. All vertices of a group get the deformation gradient of one landmark, and a handle's
position Σ_i T_i a_h,i becomes a short sum over landmarks with the coefficients of each group added
up. What that leaves out is measured exactly at the current code and added as an offset.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from deformer.geometry import FloatArray, IntArray, farthest_rows
from deformer.network import Decoder

# Numbers that describe a vertex's derivative.
_SKETCH = 12
# Landmarks of larger meshes are chosen among this many random vertices.
_POOL = 20_000


def choose_landmarks(
    decoder: Decoder, factor: FloatArray, positions: FloatArray, count: int, seed: int = 0
) -> tuple[IntArray, IntArray]:
    """Landmark vertices (S,) and the landmark number (V,) that each vertex follows.

    Vertices are described by a random projection of their derivative with respect to the whitened
    code, and faintly by their position; landmarks are farthest points of these descriptions.

    Args:
        decoder: of all V vertices.
        factor: (K, K) Cholesky factor of the latent covariance.
        positions: (V, 3) reference vertices.
        count: S; with V or more every vertex is its own landmark.
        seed: of the projection.
    """
    V = len(positions)
    if count >= V:
        return np.arange(V), np.arange(V)
    rng = np.random.default_rng(seed)
    probes = factor @ rng.normal(size=(len(factor), 4))
    sketch = (decoder.matrix @ probes.astype(np.float32)).reshape(V, -1)
    sketch = sketch @ rng.normal(size=(sketch.shape[1], _SKETCH)) / _SKETCH**0.5
    sketch /= sketch.std() or 1.0
    spread = positions - positions.mean(axis=0)
    description = np.hstack([sketch, spread / (spread.std() or 1.0)]).astype(np.float32)
    # Farthest points of a part keep the choice linear in V for large meshes.
    pool = np.arange(V) if V <= _POOL else np.sort(rng.choice(V, _POOL, replace=False))
    chosen, labels = farthest_rows(description[pool], count)
    chosen = pool[chosen]
    if len(pool) < V:
        landmarks = description[chosen]
        labels = np.empty(V, dtype=np.int64)
        for start in range(0, V, 4096):
            part = description[start : start + 4096]
            cost = (landmarks**2).sum(axis=1) - 2.0 * part @ landmarks.T
            labels[start : start + 4096] = cost.argmin(axis=1)
    return chosen, labels


class Grouping:
    """Adds up per-vertex quantities over the groups of landmarks.

    Args:
        labels: (V,) landmark number of every vertex.
        count: number of landmarks S.
    """

    def __init__(self, labels: IntArray, count: int) -> None:
        """Store the summation as a sparse matrix (S, V)."""
        V = len(labels)
        self.count = count
        self._sum = sparse.csr_array((np.ones(V), (labels, np.arange(V))), shape=(count, V))

    def sums(self, coefficients: FloatArray) -> FloatArray:
        """Coefficients (H, V, 3) of vertices to coefficients (H, S, 3) of landmarks."""
        return np.array([self._sum @ a for a in coefficients]).reshape(len(coefficients), -1, 3)
