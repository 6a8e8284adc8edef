"""Measures of every shape against the usual one of its set: edge lengths, size, thickness.

"Usual" is a median over shapes, so that a minority of faulty ones, shape 0 among them, does not
change it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deformer.geometry import FloatArray, IntArray, ShapeSequence, edges

# Shapes whose lengths make the usual ones, and faces and edges that stand for all: evenly chosen.
_SHAPES = 33
_FACES, _EDGES = 2000, 4000
# Edges shorter than this part of the typical edge count as that long: their noise says nothing.
_SHORTEST = 0.01
# A vertex is far off if all its edges are _FAR_EDGES times as long as usual, and its distance from
# the middle of its neighbours is as many usual edges and _FAR_DISTANCE radii of the shape: where a
# surface stretches, a vertex stays in the middle. A vertex may have changed places with another if
# the geometric mean of its edges, each cut off at _BOUND, is _LONG_EDGES times the usual one.
_FAR_EDGES = 2.5
_LONG_EDGES, _BOUND = 1.8, 8.0
_FAR_DISTANCE = 0.05


def evenly(count: int, most: int) -> IntArray:
    """Indices 0 … count − 1, or `most` of them at even distances."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


@dataclass(frozen=True, eq=False)
class Statistics:
    """Measures of N shapes.

    Args:
        shapes: the shapes; none has all vertices at one point.
        edges: (E, 2) as of `geometry.edges`.
        usual_lengths: (E,) median over shapes of the edge's length over the shape's median edge.
        scale: (N,) factor from the usual lengths to the shape's, a median over edges.
        spread: (N,) median over edges of |log(length / (scale · usual length))|.
        radius: (N,) median distance of vertices from the median vertex.
        sigma: (N, 3) standard deviations along the principal axes, the largest first, without
            vertices far off.
        far: vertices far off, for each shape with any.
        long: vertices whose edges are long, for each shape with any.
    """

    shapes: ShapeSequence
    edges: IntArray
    usual_lengths: FloatArray
    scale: FloatArray
    spread: FloatArray
    radius: FloatArray
    sigma: FloatArray
    far: dict[int, IntArray]
    long: dict[int, IntArray]

    @classmethod
    def measure(cls, shapes: ShapeSequence) -> Statistics:
        """Measure all shapes, one after the other."""
        N, V = shapes.vertices.shape[:2]
        pairs = edges(shapes.faces)
        rings = _Rings(pairs, V)
        chosen = evenly(N, _SHAPES)
        usual = np.median([_relative(_lengths(shapes.vertices[n], pairs)) for n in chosen], axis=0)
        usual = np.maximum(usual, _SHORTEST)
        scale, spread, radius = np.empty(N), np.empty(N), np.empty(N)
        sigma = np.empty((N, 3))
        far: dict[int, IntArray] = {}
        long: dict[int, IntArray] = {}
        some, few = evenly(len(pairs), _EDGES), evenly(V, _EDGES)
        for n, p in enumerate(shapes.vertices):
            found = _lengths(p, pairs)
            found = np.maximum(found, _SHORTEST * max(float(np.median(found[some])), 1e-300))
            ratios = found / usual
            scale[n] = np.median(ratios[some])
            ratios /= scale[n]
            spread[n] = np.median(np.abs(np.log(ratios[some])))
            sample = p[few]
            radius[n] = np.median(np.linalg.norm(sample - np.median(sample, axis=0), axis=1))
            if ratios.max(initial=0.0) > _LONG_EDGES:
                long[n], off = rings.off(p, ratios, scale[n] * usual, radius[n])
                if len(off):
                    far[n] = off
                    p = np.delete(p, off, axis=0)
            variances = np.linalg.eigvalsh(np.cov(p.T, bias=True))
            sigma[n] = np.sqrt(np.maximum(variances[::-1], 0.0))
        return cls(shapes, pairs, usual, scale, spread, radius, sigma, far, long)

    @cached_property
    def sampled_faces(self) -> IntArray:
        """Faces (f, 3), evenly chosen, that stand for all."""
        return self.shapes.faces[evenly(len(self.shapes.faces), _FACES)]

    def roughness(self, n: int) -> float:
        """Typical edge of a shape over its radius."""
        return float(self.scale[n] * np.median(self.usual_lengths) / max(self.radius[n], 1e-300))


class _Rings:
    """Edges at each vertex, in compressed rows."""

    def __init__(self, pairs: IntArray, vertex_count: int) -> None:
        ends = pairs.T.ravel()
        order = np.argsort(ends, kind="stable")
        self._edge = np.tile(np.arange(len(pairs)), 2)[order]
        self._other = pairs[:, ::-1].T.ravel()[order]
        self._degree = np.bincount(ends, minlength=vertex_count)
        self._with_edges = np.flatnonzero(self._degree)
        self._start = (np.cumsum(self._degree) - self._degree)[self._with_edges]

    def off(
        self, p: FloatArray, ratios: FloatArray, usual: FloatArray, radius: float
    ) -> tuple[IntArray, IntArray]:
        """Vertices whose edges are long, and those of them that are far off.

        Args:
            p: (V, 3) positions.
            ratios: (E,) lengths of edges over their usual lengths.
            usual: (E,) their usual lengths.
            radius: of the shape.
        """
        at_vertices = ratios[self._edge]
        # Bounded, so that one vertex far off does not make its neighbours' edges long.
        typical = np.add.reduceat(np.log(np.minimum(at_vertices, _BOUND)), self._start)
        typical /= self._degree[self._with_edges]
        long = np.flatnonzero(typical > np.log(_LONG_EDGES))
        if not len(long):
            return long, long
        middles = np.add.reduceat(p[self._other], self._start, axis=0)[long]
        found = self._with_edges[long]
        away = np.linalg.norm(p[found] - middles / self._degree[found, None], axis=1)
        least = np.minimum.reduceat(at_vertices, self._start)[long]
        edge = np.add.reduceat(usual[self._edge], self._start)[long] / self._degree[found]
        far = (away > _FAR_EDGES * edge) & (away > _FAR_DISTANCE * radius)
        return found, found[(least > _FAR_EDGES) & far]


def _lengths(p: FloatArray, pairs: IntArray) -> FloatArray:
    d = p[pairs[:, 0]] - p[pairs[:, 1]]
    return np.sqrt(np.einsum("ei,ei->e", d, d))


def _relative(lengths: FloatArray) -> FloatArray:
    return lengths / max(float(np.median(lengths)), 1e-300)
