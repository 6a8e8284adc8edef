"""Noise of measured shapes: separated from their detail, and removed before training.

Features depend on one-rings, where noise of a tenth of an edge already causes large rotations and
stretches. The model of a shape is p_n = s_n + R_n d + noise: s_n is smooth, and d is the fine
detail, which is the same in all shapes and rotates with the surface by R_n. Smoothing removes noise
from s_n; the mean over all shapes removes it from d. The strength of smoothing is the one with
which a vertex's neighbours and the detail of the other shapes predict the vertex best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from deformer.geometry import (
    FloatArray,
    ShapeSequence,
    closest_rotations,
    edges,
    shape_sequence,
)
from deformer.linalg import SparseCholesky
from deformer.workspace import Rows, Workspace, slices

# With fewer shapes their common detail is unknown.
_FEWEST_SHAPES = 4
# Standard deviation, in median edges, below which noise and detail cannot be distinguished.
_LEAST_NOISE = 0.02
# Strengths of smoothing: the one that detects noise, and the candidates in decreasing order.
_DETECTION_STRENGTH = 1.0
_STRENGTHS = np.logspace(6, -1, 15)
# Number of evenly spread shapes by which noise is detected and the strength chosen.
_SAMPLE = 24
# Shapes smoothed at a time: bounds memory.
_BLOCK = 16
# Number of random vectors that estimate the trace of the smoothing (Hutchinson).
_PROBES = 16
# Median absolute value of the standard normal distribution.
_NORMAL_MEDIAN = 0.6745


def remove_noise(shapes: ShapeSequence, workspace: Workspace) -> tuple[ShapeSequence, float]:
    """Remove the noise of shapes.

    Noise is the part of the positions that neither neighbours nor other shapes predict; it is
    assumed independent between vertices and of the same size everywhere. Shapes with noise below
    a fiftieth of an edge, and sets of fewer than four shapes, are not changed.

    Args:
        shapes: N shapes.
        workspace: where the result is.

    Returns:
        The shapes without noise, and the noise's standard deviation in each coordinate, in the unit
        of the data; 0 if the shapes are not changed.
    """
    vertices = shapes.vertices
    if len(vertices) < _FEWEST_SHAPES:
        return shapes, 0.0
    sample = vertices[np.unique(np.linspace(0, len(vertices) - 1, _SAMPLE).round().astype(int))]
    smoother = _Smoother(shapes)
    i, j = edges(shapes.faces).T
    edge = float(np.median(np.linalg.norm(sample[:, i] - sample[:, j], axis=2)))
    if smoother.split(sample, _DETECTION_STRENGTH).noise < _LEAST_NOISE * edge:
        return shapes, 0.0
    # In decreasing order: with too weak smoothing the rotations follow the noise and predict it.
    best = smoother.split(sample, _STRENGTHS[0])
    for strength in _STRENGTHS[1:]:
        found = smoother.split(sample, strength)
        if found.prediction_error >= best.prediction_error:
            break
        best = found
    clean = smoother.clean(vertices, best.strength, workspace)
    return shape_sequence(clean, shapes.faces, shapes.names), best.noise


@dataclass(frozen=True, eq=False)
class _Split:
    """How well smooth surfaces and their common detail predict shapes.

    Args:
        strength: of the smoothing.
        prediction_error: root mean square error of the prediction by neighbours and other shapes.
        noise: the same deviation, estimated by the median, which few vertices with detail of their
            own do not change.
    """

    strength: float
    prediction_error: float
    noise: float


class _Smoother:
    """Least squares of positions with the squared second differences of their neighbourhoods."""

    def __init__(self, shapes: ShapeSequence) -> None:
        """Set up the differences; their weights are uniform, since noise distorts angles."""
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
        """Split shapes (N, V, 3); vertices without a face stay as they are."""
        N, V = shapes.shape[:2]
        system = self._system(strength)
        parts = [self._smooth(system, shapes[part]) for part in slices(N, _BLOCK)]
        smooth = np.concatenate(parts)
        rotations = self._rotations(smooth[0], smooth)
        detail = np.einsum("nvba,nvb->nva", rotations, shapes - smooth)
        # Mean diagonal of the smoothing: a vertex's own share in its smoothed position.
        probes = np.random.default_rng(0).choice([-1.0, 1.0], size=(V, _PROBES))
        own = float((probes * system.solve(probes)).mean())
        others = (detail.sum(axis=0) - detail) / (N - 1)
        # The mean of the others has noise, too, of variance 1/(N − 1).
        residual = (detail - others) / ((1.0 - own) * np.sqrt(N / (N - 1)))
        noise = float(np.median(np.abs(residual))) / _NORMAL_MEDIAN
        rms = float(np.sqrt((residual**2).mean()))
        return _Split(strength, rms, noise)

    def clean(self, shapes: Rows, strength: float, workspace: Workspace) -> Rows:
        """Shapes (N, V, 3) as smooth surfaces with their mean detail, some at a time."""
        out = workspace.empty(shapes.shape, np.float64)
        system, parts = self._system(strength), slices(len(shapes), _BLOCK)
        base = self._smooth(system, shapes[:1])[0]
        detail = np.zeros(shapes.shape[1:])
        for part in parts:
            p = shapes[part]
            out[part] = smooth = self._smooth(system, p)
            detail += np.einsum("nvba,nvb->va", self._rotations(base, smooth), p - smooth)
        detail /= len(shapes)
        for part in parts:
            smooth = out[part]
            out[part] = smooth + np.einsum("nvab,vb->nva", self._rotations(base, smooth), detail)
        return out

    def _system(self, strength: float) -> SparseCholesky:
        V = len(self._points)
        return SparseCholesky(sparse.eye_array(V) + strength * self._bending, self._points)

    def _smooth(self, system: SparseCholesky, shapes: FloatArray) -> FloatArray:
        columns = shapes.transpose(1, 0, 2)
        found = system.solve(np.ascontiguousarray(columns.reshape(len(columns), -1)))
        return found.reshape(columns.shape).transpose(1, 0, 2)

    def _rotations(self, base: FloatArray, shapes: FloatArray) -> FloatArray:
        """Rotations (n, V, 3, 3) of neighbourhoods, two edges wide, from `base` to shapes."""
        return np.stack([self._rotation(base, shape) for shape in shapes])

    def _rotation(self, base: FloatArray, shape: FloatArray) -> FloatArray:
        a, b = base - base.mean(axis=0), shape - shape.mean(axis=0)
        outer = np.einsum("va,vb->vab", b, a)
        spread = (self._near @ outer.reshape(-1, 9)).reshape(-1, 3, 3)
        spread += self._degree[:, None, None] * outer
        spread -= np.einsum("va,vb->vab", b, self._near @ a)
        spread -= np.einsum("va,vb->vab", self._near @ b, a)
        wide = spread + (self._near @ spread.reshape(-1, 9)).reshape(-1, 3, 3)
        return closest_rotations(wide)
