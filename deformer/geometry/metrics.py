"""Error measures between shapes and their reconstructions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import uniform_filter1d

from deformer.checks import checked_array, checked_choice
from deformer.errors import InputError
from deformer.geometry.mesh import FloatArray, edges
from deformer.geometry.rotations import procrustes

Alignment = Literal["none", "centroid", "rigid"]

# Constants of STED, see `sted`.
STED_WINDOW = 5
STED_TIME_STEP = 0.01
STED_TEMPORAL_WEIGHT = 1.0
# Edges shorter than this share of a frame's mean edge are measured against that instead.
_SHORTEST_EDGE = 1e-3


def e_rms(truth: ArrayLike, estimate: ArrayLike, align: Alignment = "centroid") -> float:
    """E_rms = 1000 · sqrt(Σ ‖p − p̂‖² / (3·V·N)) in the data's own units (Kavan et al. 2010, E_rms).

    Args:
        truth: (N, V, 3) or (V, 3) true positions.
        estimate: same shape; reconstructed positions.
        align: motion that is removed from each shape first: the difference of centroids
            ("centroid", which has the paper's order of magnitude), the best rigid motion
            ("rigid"), or none ("none", for shapes whose control points fix the frame).

    Raises:
        InputError: the shapes of the arrays differ, or `align` is unknown.
    """
    return 1000.0 * float(np.sqrt((_differences(truth, estimate, align) ** 2).mean()))


def vertex_errors(truth: ArrayLike, estimate: ArrayLike, align: Alignment = "none") -> FloatArray:
    """Distances (N, V) or (V,) between true and estimated positions, in the data's own units.

    Args:
        truth: (N, V, 3) or (V, 3) true positions.
        estimate: same shape; reconstructed positions.
        align: as in `e_rms`.

    Raises:
        InputError: the shapes of the arrays differ, or `align` is unknown.
    """
    distances = np.linalg.norm(_differences(truth, estimate, align), axis=-1)
    return distances.reshape(np.asarray(truth).shape[:-1])


@dataclass(frozen=True)
class Sted:
    """The two parts of the spatio-temporal edge difference of a sequence, without unit.

    Args:
        spatial: deviation of edge lengths; see `sted_spatial`.
        temporal: deviation of steps in time; see `sted`.
    """

    spatial: float
    temporal: float

    @property
    def value(self) -> float:
        """√(spatial² + c² temporal²) with c = STED_TEMPORAL_WEIGHT."""
        return float(np.hypot(self.spatial, STED_TEMPORAL_WEIGHT * self.temporal))


def sted(truth: ArrayLike, estimate: ArrayLike, faces: ArrayLike) -> Sted:
    """STED, the spatio-temporal edge difference of two sequences.

    Váša and Skala 2011, STED ("A Perception Correlated Comparison Method for Dynamic Meshes", IEEE
    TVCG). A stretch that the surroundings share is hardly seen; one that differs from them is. The
    spatial part is `sted_spatial`. The temporal part does the same along time: a vertex's
    step from one frame to the next has the length τ = √(‖step‖² + dt²), δ = (τ̂ − τ)/τ, and its
    deviation is the τ-weighted standard deviation of δ over a window of steps; averaged over
    windows and vertices.

    The constants are this implementation's: dt = STED_TIME_STEP of the first true frame's diameter
    about its centroid, windows of STED_WINDOW steps (or all there are), and
    c = STED_TEMPORAL_WEIGHT. Values of STED can be compared only if the constants are equal; the
    two parts are given for another weight.

    Args:
        truth: (F, V, 3) true frames in order of time, F ≥ 2.
        estimate: same shape; reconstructed frames.
        faces: (T, 3) triangles.

    Returns:
        Zero for equal sequences; unchanged when either is moved rigidly as a whole or the unit of
        length is another.

    Raises:
        InputError: the shapes of the arrays differ, or there is one frame only.
    """
    p, e = _pair(truth, estimate)
    if len(p) < 2:
        raise InputError("STED needs at least 2 frames, got 1; sted_spatial takes single shapes")
    # Not the bounding diagonal, which changes as the sequence is turned.
    size = 2.0 * float(np.linalg.norm(p[0] - p[0].mean(axis=0), axis=1).max())
    time = max(STED_TIME_STEP * size, np.finfo(float).tiny)
    steps = np.sqrt((np.diff(p, axis=0) ** 2).sum(-1) + time**2)
    changes = np.sqrt((np.diff(e, axis=0) ** 2).sum(-1) + time**2) / steps - 1.0
    window = min(STED_WINDOW, len(steps))

    def mean(values: FloatArray) -> FloatArray:
        """Means (steps − window + 1, V) over every whole window."""
        means = uniform_filter1d(values, window, axis=0, mode="nearest")
        first = window // 2
        return means[first : first + len(steps) - window + 1]

    weight = mean(steps)
    # Deviations do not depend on δ's mean over all time; subtracting it first avoids cancellation.
    centred = changes - changes.mean(axis=0)
    mu = mean(steps * centred) / weight
    variance = mean(steps * centred**2) / weight - mu**2
    temporal = float(np.sqrt(np.maximum(variance, 0.0)).mean())
    return Sted(sted_spatial(p, e, faces), temporal)


def sted_spatial(truth: ArrayLike, estimate: ArrayLike, faces: ArrayLike) -> float:
    """The spatial part of STED, which does not depend on the order of the shapes.

    An edge of true length ℓ has the relative difference δ = (ℓ̂ − ℓ)/ℓ; a vertex's deviation is the
    ℓ-weighted standard deviation of δ over its edges. Averaged over shapes and over the vertices
    that have edges.

    Args:
        truth: (N, V, 3) or (V, 3) true positions.
        estimate: same shape; reconstructed positions.
        faces: (T, 3) triangles.

    Raises:
        InputError: the shapes of the arrays differ.
    """
    p, e = _pair(truth, estimate)
    i, j = edges(np.asarray(faces, dtype=np.int64)).T
    V = p.shape[1]
    ends, edge = np.concatenate([i, j]), np.tile(np.arange(len(i)), 2)
    used = np.bincount(ends, minlength=V) > 0
    total = 0.0
    for true, other in zip(p, e, strict=True):
        length = np.linalg.norm(true[i] - true[j], axis=1)
        floor = max(_SHORTEST_EDGE * length.mean(), np.finfo(float).tiny)
        change = (np.linalg.norm(other[i] - other[j], axis=1) - length) / np.maximum(length, floor)
        weight = np.maximum(length, floor)[edge]
        sums = np.bincount(ends, weight, V)[used]
        mean = np.zeros(V)
        mean[used] = np.bincount(ends, weight * change[edge], V)[used] / sums
        variance = np.bincount(ends, weight * (change[edge] - mean[ends]) ** 2, V)[used] / sums
        total += float(np.sqrt(variance).mean())
    return total / len(p)


def _pair(truth: ArrayLike, estimate: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Both as (N, V, 3) float64."""
    p = checked_array(truth, "truth", finite=False)
    e = checked_array(estimate, "estimate", finite=False)
    if p.shape != e.shape or p.ndim not in (2, 3) or p.shape[-1] != 3:
        raise InputError(
            f"truth and estimate: expected equal shapes (N, V, 3) or (V, 3), got {p.shape} "
            f"and {e.shape}"
        )
    return p.reshape(-1, *p.shape[-2:]), e.reshape(-1, *e.shape[-2:])


def _differences(truth: ArrayLike, estimate: ArrayLike, align: Alignment) -> FloatArray:
    checked_choice(align, "align", get_args(Alignment))
    p, e = _pair(truth, estimate)
    if align == "none":
        return p - e
    if align == "centroid":
        return (p - p.mean(1, keepdims=True)) - (e - e.mean(1, keepdims=True))
    moved = np.empty_like(e)
    for n in range(len(e)):
        R, t = procrustes(e[n], p[n])
        moved[n] = e[n] @ R.T + t
    return p - moved
