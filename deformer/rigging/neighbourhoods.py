"""Neighbourhoods on a surface: what a bone may move, and what of its weights lies astray."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from deformer.geometry import FloatArray, IntArray, Mesh, edges


def surface_graph(mesh: Mesh, unit: float = 1.0) -> sparse.csr_array:
    """Symmetric matrix (V, V) of the lengths of edges and of links between pieces, by a unit."""
    v = mesh.vertices
    i, j = np.concatenate([edges(mesh.faces), mesh.links]).T
    # A stored 0 would be no edge.
    lengths = np.maximum(np.linalg.norm(v[i] - v[j], axis=1) / unit, np.finfo(float).tiny)
    graph = sparse.csr_array((lengths, (i, j)), shape=(len(v), len(v)))
    return sparse.csr_array(graph.maximum(graph.T))


def averaging(graph: sparse.csr_array) -> sparse.csr_array:
    """Matrix (V, V) of the mean over each vertex and its neighbours, the vertex counted once."""
    neighbours = np.diff(graph.indptr)
    V = len(neighbours)
    around = sparse.csr_array((np.ones(graph.nnz), graph.indices, graph.indptr), shape=(V, V))
    shares = sparse.diags_array(1.0 / (1.0 + neighbours))
    return sparse.csr_array(shares @ (around + sparse.eye_array(V)))


def main_part(graph: sparse.csr_array, mass: FloatArray) -> NDArray[np.bool_]:
    """The connected part (V,) of the vertices with mass > 0 that has the most of it."""
    inside = np.flatnonzero(mass > 0)
    part = np.zeros(len(mass), dtype=bool)
    if len(inside):
        _, labels = csgraph.connected_components(graph[inside][:, inside], directed=False)
        part[inside[labels == np.bincount(labels, mass[inside]).argmax()]] = True
    return part


def main_parts(graph: sparse.csr_array, weights: FloatArray) -> NDArray[np.bool_]:
    """`main_part` (V, B) of each bone's weights (V, B)."""
    return np.column_stack([main_part(graph, w) for w in weights.T])


def stray_share(graph: sparse.csr_array, weights: FloatArray) -> float:
    """Share, 0…1, of all weights (V, B) that is not connected to its bone's main part."""
    return float(weights[~main_parts(graph, weights)].sum() / weights.sum())


def gathered(graph: sparse.csr_array, weights: FloatArray) -> FloatArray:
    """Weights (V, B) without what lies astray, each row with the sum 1.

    A vertex of which nothing is left gets the weights of its neighbours.
    """
    kept = np.where(main_parts(graph, weights), weights, 0.0)
    bare = np.flatnonzero(kept.sum(axis=1) == 0)
    if len(bare):
        bones = filled_labels(graph, np.where(kept.any(axis=1), kept.argmax(axis=1), -1))
        kept[bare, bones[bare]] = 1.0
    return kept / kept.sum(axis=1, keepdims=True)


def filled_labels(graph: sparse.csr_array, labels: IntArray) -> IntArray:
    """Labels (V,) where those below 0 are replaced by that of the nearest vertex with one."""
    sources = np.flatnonzero(labels >= 0)
    if len(sources) == len(labels):
        return labels
    _, _, nearest = csgraph.dijkstra(
        graph, directed=False, indices=sources, return_predecessors=True, min_only=True
    )
    return labels[nearest]


def connected_labels(graph: sparse.csr_array, labels: IntArray) -> IntArray:
    """Labels (V,) where each label keeps its largest connected part; the rest joins neighbours."""
    kept = np.full(len(labels), -1)
    for label in np.unique(labels):
        kept[main_part(graph, (labels == label).astype(np.float64))] = label
    return filled_labels(graph, kept)


def within_reach(
    graph: sparse.csr_array, labels: IntArray, bones: int, reach: float
) -> NDArray[np.bool_]:
    """Which bones (V, B) may move a vertex: those with a vertex of their label within `reach`."""
    near = np.zeros((len(labels), bones), dtype=bool)
    for b in range(bones):
        own = np.flatnonzero(labels == b)
        if len(own):
            distance = csgraph.dijkstra(
                graph, directed=False, indices=own, limit=reach, min_only=True
            )
            near[:, b] = np.isfinite(distance)
    return near
