"""Cubature: handle positions and their Jacobian from a few vertices, the landmarks.

Deformation gradients vary smoothly over the mesh, so vertices are grouped by how their gradients
depend on the latent code. All vertices of a group have the deformation gradient of the group's
landmark: a handle's position Σ_i T_i a_h,i becomes a short sum over landmarks, each with the sum of
its group's coefficients. The error is measured at the current code and added as an offset
(`CorrectedHandlePositions`).
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from deformer.geometry import FloatArray, IntArray, farthest_rows
from deformer.network import Decoder

# Length of the random projection that describes a vertex's derivative.
_SKETCH = 12
# Landmarks of a mesh with more vertices are chosen among this many random ones.
_POOL = 20_000


def choose_landmarks(
    decoder: Decoder, factor: FloatArray, positions: FloatArray, count: int, seed: int = 0
) -> tuple[IntArray, IntArray]:
    """Choose landmark vertices, and the landmark of each vertex.

    A random projection of its derivative with respect to the whitened code describes a vertex,
    together with its position; landmarks are farthest points of these descriptions. Every link,
    which moves a whole component, is its own landmark.

    Args:
        decoder: the model's decoder of all sites: V vertices, then B links.
        factor: (K, K) Cholesky factor of the latent covariance.
        positions: (V, 3) reference vertices.
        count: number of landmarks S, those of links included as long as they are no more than
            half; with V or more every vertex is its own landmark.
        seed: seed of the projection, and of the random choice in large meshes.

    Returns:
        Landmarks int64, those of links last, and for each site (V + B,) the index of its landmark.
    """
    V, sites = len(positions), len(decoder.matrix)
    if count >= V:
        return np.arange(sites), np.arange(sites)
    count = max(count - (sites - V), count // 2)
    rng = np.random.default_rng(seed)
    probes = factor @ rng.normal(size=(len(factor), 4))
    sketch = (decoder.matrix[:V] @ probes.astype(np.float32)).reshape(V, -1)
    sketch = sketch @ rng.normal(size=(sketch.shape[1], _SKETCH)) / _SKETCH**0.5
    sketch /= sketch.std() or 1.0
    spread = positions - positions.mean(axis=0)
    description = np.hstack([sketch, spread / (spread.std() or 1.0)]).astype(np.float32)
    # Farthest points among a bounded number of vertices: the cost is linear in V.
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
    links = np.arange(sites - V)
    return np.append(chosen, V + links), np.append(labels, len(chosen) + links)


class Grouping:
    """Adds up per-vertex quantities over the groups of landmarks.

    Args:
        labels: (V,) index of each site's landmark.
        count: number of landmarks S.
    """

    def __init__(self, labels: IntArray, count: int) -> None:
        """Store the summation as a sparse matrix (S, V)."""
        V = len(labels)
        self.count = count
        self._sum = sparse.csr_array((np.ones(V), (labels, np.arange(V))), shape=(count, V))

    def sums(self, coefficients: FloatArray) -> FloatArray:
        """Coefficients (H, S, 3) of landmarks: sums of the groups' coefficients (H, V, 3)."""
        return np.array([self._sum @ a for a in coefficients]).reshape(len(coefficients), -1, 3)
