"""Shapes between shapes: along latent codes, along features, and straight, to compare.

A straight line between two poses shortens what turns between them; a turn by half a circle
collapses it. Codes and features hold rotations as angles and keep lengths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deformer.acap import extract_all
from deformer.analysis.synthesis import Way, check_way
from deformer.errors import InputError
from deformer.geometry import (
    FloatArray,
    IntArray,
    edges,
    log_to_rotation,
    procrustes,
    rotation_to_log,
)
from deformer.model import DeformationModel


@dataclass(frozen=True, eq=False)
class ShapePath:
    """A path of n shapes through M keys.

    Args:
        vertices: (n, V, 3) the shapes.
        keys: (M, V, 3) what this way makes of the keys: on the path at whole times.
        times: (n,) from 0 at the first key to M − 1 at the last.
        faces: (F, 3) of all shapes.
    """

    vertices: FloatArray
    keys: FloatArray
    times: FloatArray
    faces: IntArray

    def edge_ratios(self) -> FloatArray:
        """Lengths (n, E) of every edge over what is between those at the two nearest keys.

        1 is an edge that grows or shrinks evenly from one key to the next; below 1 it is shorter
        than that on the way. Edges of no length at the keys count as 1.
        """
        pairs = edges(self.faces)
        expected = _between(_edge_lengths(self.keys, pairs), self.times)
        found = _edge_lengths(self.vertices, pairs)
        return np.divide(found, expected, out=np.ones_like(found), where=expected > 0)

    def length_ratios(self) -> FloatArray:
        """Sum (n,) of all edge lengths over what is between those sums at the two nearest keys."""
        pairs = edges(self.faces)
        expected = _between(_edge_lengths(self.keys, pairs), self.times).sum(axis=1)
        return _edge_lengths(self.vertices, pairs).sum(axis=1) / expected


def interpolate(
    model: DeformationModel, keys: ArrayLike, steps: int = 9, way: Way = "latent"
) -> ShapePath:
    """A path through shapes, in equal steps from key to key.

    Args:
        model: the prior; the shapes have its connectivity.
        keys: (M, V, 3) two shapes or more.
        steps: pictures from one key to the next, both counted: n = (M − 1)(steps − 1) + 1.
        way: "latent" goes straight from code to code, through what the model makes of the keys.
            "features" goes from rotation vectors and stretches to others and needs no training;
            the keys stay as they are, and the body as a whole turns evenly by the shorter way.
            "linear" goes straight from vertex to vertex.

    Raises:
        InputError: fewer than two keys, of another connectivity, fewer than two steps, or an
            unknown way.
    """
    check_way(way)
    shapes = np.asarray(keys, dtype=np.float64)
    V = len(model.reference.vertices)
    if shapes.ndim != 3 or shapes.shape[1:] != (V, 3) or len(shapes) < 2:
        raise InputError(f"keys: expected (2 or more, {V}, 3), got {shapes.shape}")
    if steps < 2:
        raise InputError(f"steps: expected at least 2, got {steps}")
    times = np.linspace(0.0, len(shapes) - 1.0, (len(shapes) - 1) * (steps - 1) + 1)
    whole = np.arange(len(shapes), dtype=np.float64)
    if way == "linear":
        along = _between(shapes, times)
        at_keys = shapes
    else:
        posed = _along_codes if way == "latent" else _along_features
        # The keys' shapes are decoded with the path's: they are on it.
        found = posed(model, shapes, np.concatenate([times, whole]))
        found += _between(shapes.mean(axis=1), np.concatenate([times, whole]))[:, None]
        along, at_keys = found[: len(times)], found[len(times) :]
    return ShapePath(along, at_keys, times, model.reference.faces)


def _along_codes(model: DeformationModel, keys: FloatArray, times: FloatArray) -> FloatArray:
    """Centred shapes (n, V, 3) of codes between the keys' codes."""
    p = model.decode(_between(model.encode(keys), times))
    return p - p.mean(axis=1, keepdims=True)


def _along_features(model: DeformationModel, keys: FloatArray, times: FloatArray) -> FloatArray:
    """Centred shapes (n, V, 3) of features between the keys', the turn of the whole set apart.

    Features tell rotations apart by more than one turn over a mesh, but not which way the mesh as
    a whole has turned.
    """
    reference = model.reference.vertices
    turns = np.stack([procrustes(reference, key)[0] for key in keys])
    centred = keys - keys.mean(axis=1, keepdims=True)
    q = extract_all(model.extractor, centred @ turns)
    p = model.poisson.reconstruct(_between(q, times))
    p -= p.mean(axis=1, keepdims=True)
    first = np.minimum(times.astype(np.int64), len(keys) - 2)
    angles = rotation_to_log(np.swapaxes(turns[:-1], 1, 2) @ turns[1:])
    turned = turns[first] @ log_to_rotation((times - first)[:, None] * angles[first])
    return p @ np.swapaxes(turned, 1, 2)


def _between(values: FloatArray, times: FloatArray) -> FloatArray:
    """Piecewise linear between values (M, …) at times 0 … M − 1."""
    first = np.minimum(times.astype(np.int64), len(values) - 2)
    share = (times - first).reshape(-1, *[1] * (values.ndim - 1))
    return (1.0 - share) * values[first] + share * values[first + 1]


def _edge_lengths(vertices: FloatArray, pairs: IntArray) -> FloatArray:
    """Lengths (n, E) of edges (E, 2) of shapes (n, V, 3)."""
    return np.linalg.norm(vertices[:, pairs[:, 0]] - vertices[:, pairs[:, 1]], axis=2)
