"""Noise of measured shapes: told from their detail, and taken off before anything is learned.

Features are read from one-rings, where noise of a tenth of an edge already turns and stretches
everything. A shape is taken as p_n = s_n + R_n d + noise: s_n smooth, d the fine detail, which all
shapes have in common once it is turned along with the surface, R_n. Smoothing takes noise off s_n;
the mean over all shapes takes it off d. How far to smooth is chosen by how well a vertex is
foretold by its neighbours and by the detail of the other shapes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from deformer.geometry import FloatArray, MeshSequence, closest_rotations, edges
from deformer.linalg import SparseCholesky

# Fewer shapes do not tell what they have in common.
_FEWEST = 4
# Deviation, in median edges, from which noise can be told from detail that a shape has alone.
_NOTICED = 0.02
# Strengths of smoothing: where noise is looked for, and what is tried from the strongest down.
_WEAK = 1.0
_STRENGTHS = np.logspace(6, -1, 15)
# Shapes, evenly spread, on which both are done; shapes smoothed at a time.
_LOOKED_AT = 24
_BLOCK = 16
_PROBES = 16
# Median absolute value to standard deviation of a normal distribution.
_MEDIAN = 0.6745


def remove_noise(shapes: MeshSequence) -> tuple[FloatArray, float]:
    """Shapes (N, V, 3) without their noise, and its standard deviation a coordinate.

    Noise is what neither the neighbours nor the other shapes foretell, the same everywhere and
    independent from vertex to vertex. Below a fiftieth of an edge, or of fewer than four shapes,
    nothing is taken off: the shapes come back as they are, with a deviation of 0.
    """
    vertices = shapes.vertices
    if len(vertices) < _FEWEST:
        return vertices, 0.0
    some = vertices[np.unique(np.linspace(0, len(vertices) - 1, _LOOKED_AT).round().astype(int))]
    smoother = _Smoother(shapes)
    i, j = edges(shapes.faces).T
    edge = float(np.median(np.linalg.norm(some[:, i] - some[:, j], axis=2)))
    if smoother.split(some, _WEAK).noise < _NOTICED * edge:
        return vertices, 0.0
    # From above: where smoothing is too weak, the rotations follow the noise and foretell it.
    best = smoother.split(some, _STRENGTHS[0])
    for strength in _STRENGTHS[1:]:
        found = smoother.split(some, strength)
        if found.surprise >= best.surprise:
            break
        best = found
    return smoother.split(vertices, best.strength).clean(), best.noise


@dataclass(frozen=True, eq=False)
class _Split:
    """Shapes as smooth surfaces and detail.

    Args:
        strength: of the smoothing.
        smooth: s (N, V, 3).
        turns: R (N, V, 3, 3).
        detail: (N, V, 3) in the common frame, before it is averaged.
        surprise: root mean square of what neighbours and other shapes do not foretell.
        noise: the same by the median, which detail of single places does not move.
    """

    strength: float
    smooth: FloatArray
    turns: FloatArray
    detail: FloatArray
    surprise: float
    noise: float

    def clean(self) -> FloatArray:
        """Shapes (N, V, 3) with the mean detail."""
        return self.smooth + np.einsum("nvab,vb->nva", self.turns, self.detail.mean(axis=0))


class _Smoother:
    """Least squares of positions with the squared second differences of their neighbourhoods."""

    def __init__(self, shapes: MeshSequence) -> None:
        """Set up the differences; they are uniform, since noise has spoilt the angles."""
        V = shapes.vertices.shape[1]
        i, j = edges(shapes.faces).T
        ones = np.ones(2 * len(i))
        ends = np.concatenate([i, j]), np.concatenate([j, i])
        self._near = sparse.csr_array((ones, ends), shape=(V, V))
        self._degree = np.asarray(self._near.sum(axis=1)).ravel()
        used = (self._degree > 0).astype(float)
        mean = sparse.diags_array(used / np.maximum(self._degree, 1.0)) @ self._near
        differences = sparse.diags_array(used) - mean
        self._bending = (differences.T @ differences).tocsr()
        self._points = shapes.vertices[0]

    def split(self, shapes: FloatArray, strength: float) -> _Split:
        """Split shapes (N, V, 3); vertices of no face are left as they are."""
        N, V = shapes.shape[:2]
        system = SparseCholesky(sparse.eye_array(V) + strength * self._bending, self._points)
        smooth = np.concatenate([self._smooth(system, block) for block in _blocks(shapes)])
        turns = np.stack([self._turns(smooth[0], shape) for shape in smooth])
        detail = np.einsum("nvba,nvb->nva", turns, shapes - smooth)
        # How much of a vertex's own position is in what its neighbourhood says of it.
        probes = np.random.default_rng(0).choice([-1.0, 1.0], size=(V, _PROBES))
        own = float((probes * system.solve(probes)).mean())
        others = (detail.sum(axis=0) - detail) / (N - 1)
        # The mean of the others has noise of its own.
        away = (detail - others) / ((1.0 - own) * np.sqrt(N / (N - 1)))
        noise = float(np.median(np.abs(away))) / _MEDIAN
        return _Split(strength, smooth, turns, detail, float(np.sqrt((away**2).mean())), noise)

    def _smooth(self, system: SparseCholesky, shapes: FloatArray) -> FloatArray:
        columns = shapes.transpose(1, 0, 2)
        found = system.solve(np.ascontiguousarray(columns.reshape(len(columns), -1)))
        return found.reshape(columns.shape).transpose(1, 0, 2)

    def _turns(self, base: FloatArray, shape: FloatArray) -> FloatArray:
        """Rotations (V, 3, 3) of neighbourhoods, two edges wide, from `base` to `shape`."""
        a, b = base - base.mean(axis=0), shape - shape.mean(axis=0)
        outer = np.einsum("va,vb->vab", b, a)
        spread = (self._near @ outer.reshape(-1, 9)).reshape(-1, 3, 3)
        spread += self._degree[:, None, None] * outer
        spread -= np.einsum("va,vb->vab", b, self._near @ a)
        spread -= np.einsum("va,vb->vab", self._near @ b, a)
        wide = spread + (self._near @ spread.reshape(-1, 9)).reshape(-1, 3, 3)
        return closest_rotations(wide)


def _blocks(shapes: FloatArray) -> Iterator[FloatArray]:
    for start in range(0, len(shapes), _BLOCK):
        yield shapes[start : start + _BLOCK]
