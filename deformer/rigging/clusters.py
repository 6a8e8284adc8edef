"""Parts of a surface that move rigidly: Lloyd's algorithm in the space of their transforms."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from deformer.geometry import FloatArray, IntArray
from deformer.rigging.neighbourhoods import averaging, connected_labels
from deformer.rigging.transforms import moments, separate_transforms
from deformer.rigging.weights import point_errors

# Rounds of Lloyd's algorithm after each new part, and after the last.
_ROUNDS, _LAST_ROUNDS = 1, 8
# A part moves rigidly if its vertices are off by less than this, in units of the rest shape's size.
RIGID = 1e-6


def rigid_parts(
    graph: sparse.csr_array,
    rest: FloatArray,
    shapes: FloatArray,
    count: int,
    smallest: int,
    report: Callable[[int], None],
) -> IntArray:
    """Parts (V,), each connected, numbered from 0; at most `count`.

    The first part is all. Each further one starts around the vertex whose parts explain its motion
    least; then every vertex joins the part whose transforms fit it best, and the transforms are
    fitted anew.

    Args:
        graph: `surface_graph` of the rest shape.
        rest: (V, 3) of size 1.
        shapes: (V, N, 3).
        count: most parts; fewer where all move rigidly before.
        smallest: fewest vertices of a part.
        report: called with the number of parts.
    """
    V = len(rest)
    # Means over neighbours: one vertex alone is no part.
    mean = averaging(graph)
    labels = np.zeros(V, dtype=np.int64)
    errors = _errors(rest, shapes, labels)
    for n in range(1, count):
        report(n)
        own = errors[np.arange(V), labels] / shapes.shape[1]
        patch = worst_patch(graph, mean @ own, smallest, count)
        if patch is None:
            break
        labels[patch] = labels.max() + 1
        labels = _numbered(labels)  # a patch may take all of a part
        labels, errors = _rounds(graph, rest, shapes, labels, _ROUNDS, smallest)
    return _rounds(graph, rest, shapes, labels, _LAST_ROUNDS, smallest)[0]


def worst_patch(
    graph: sparse.csr_array, errors: FloatArray, smallest: int, count: int
) -> IntArray | None:
    """The vertices around the one with the largest error, to begin a part; None if all fit.

    Args:
        graph: `surface_graph`.
        errors: (V,) mean squares of how far vertices are off, in units of the rest shape's size.
        smallest: fewest vertices of a part.
        count: number of parts there are to be; a patch is a quarter of the mean part.
    """
    seed = int(errors.argmax())
    if errors[seed] <= RIGID**2:
        return None
    around = csgraph.breadth_first_order(graph, seed, directed=False, return_predecessors=False)
    return around[: max(smallest, len(errors) // (4 * count))]


def _rounds(
    graph: sparse.csr_array,
    rest: FloatArray,
    shapes: FloatArray,
    labels: IntArray,
    rounds: int,
    smallest: int,
) -> tuple[IntArray, FloatArray]:
    """Labels (V,) after some rounds of Lloyd's algorithm, and the errors (V, B) of the parts."""
    errors = _errors(rest, shapes, labels)
    for _ in range(rounds):
        labels = connected_labels(graph, errors.argmin(axis=1))
        # Parts with few vertices join their neighbours.
        small = np.bincount(labels, minlength=errors.shape[1]) < smallest
        if small[labels].any():
            errors[:, small] = np.inf
            labels = connected_labels(graph, errors.argmin(axis=1))
        labels = _numbered(labels)
        errors = _errors(rest, shapes, labels)
    return labels, errors


def _numbered(labels: IntArray) -> IntArray:
    """Labels without gaps."""
    return np.unique(labels, return_inverse=True)[1]


def _errors(rest: FloatArray, shapes: FloatArray, labels: IntArray) -> FloatArray:
    return point_errors(rest, shapes, separate_transforms(moments(one_hot(labels), rest, shapes)))


def one_hot(labels: IntArray) -> FloatArray:
    """Weights (V, B) of 1 for the label of each vertex, for B labels from 0."""
    weights = np.zeros((len(labels), int(labels.max()) + 1))
    weights[np.arange(len(labels)), labels] = 1.0
    return weights
