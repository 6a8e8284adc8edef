"""Recognises handle targets in other units than the model's."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import checked_array, checked_instance
from deformer.editing.handles import Point, check_points
from deformer.geometry import FloatArray, SurfacePoints, procrustes
from deformer.model import DeformationModel

# How many times larger numbers are in the first unit than in the second.
_UNITS = (
    (2.54, "centimetres", "inches"),
    (1 / 0.3048, "feet", "metres"),
    (10.0, "millimetres", "centimetres"),
    (12.0, "inches", "feet"),
    (25.4, "millimetres", "inches"),
    (30.48, "centimetres", "feet"),
    (1 / 0.0254, "inches", "metres"),
    (100.0, "centimetres", "metres"),
    (304.8, "millimetres", "feet"),
    (1000.0, "millimetres", "metres"),
)
_FACTORS = np.array([unit[0] for unit in _UNITS])
# Logarithm of the largest ratio between a measured factor and one of `_UNITS`. Poses change the
# distances of handles, mostly to smaller ones.
_TOLERANCE = 0.35
# Spans that differ less are no sign of other units.
_LEAST_FACTOR = 1.8
# Largest distance of scaled targets from the rigidly moved model, in the span of the points.
_OFF = 0.6
# Handles can be dragged apart and brought together. Fewer than `_MANY` small targets, or fewer than
# three large ones, are a sign of other units only where the scaled targets are this near to their
# points on the model, in bounding diagonals; so are all targets by factors of `_EXTREME` and more.
_MANY, _NEAR, _EXTREME = 8, 1.5, 100.0
# Targets are in the model's units where an example, as it is, is nearly as like them as the scaled
# model: this share of its distance from them. Fingertips of a fist are as near to each other as
# those of an open hand in inches.
_EXAMPLE = 0.8
# Handles that are compared, frames of a sequence, and training shapes.
_COMPARED, FRAMES, _EXAMPLES = 16, 25, 25


def unit_warning(
    model: DeformationModel, vertices: ArrayLike | Sequence[Point], targets: ArrayLike
) -> str | None:
    """A warning if the targets are most likely in other units than the model; else None.

    The targets must be close to a scaled copy of the model's points, remain so without any one of
    them, and be less like the points of a training shape: handles that are dragged far, figures
    that move far, and poses that bring handles together are no reason to warn.

    Args:
        model: the model whose vertices they are.
        vertices: (H,) vertex indices, `SurfacePoint`s, or both.
        targets: (H, 3) positions, or (F, H, 3) in F frames, NaN where a handle is not seen. More
            than half of the frames must agree.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    reference = model.reference
    chosen = SurfacePoints(check_points(model, vertices), reference.faces)
    points, diagonal = chosen.at(reference.vertices), reference.bounding_diagonal
    if not len(points):
        return None
    H = len(points)
    frames = checked_array(targets, "targets", (H, 3), ("F", H, 3), finite=False)
    frames = frames.reshape(-1, H, 3)
    frames = frames[[bool(np.isfinite(frame).all(axis=1).any()) for frame in frames]]
    if not len(frames):
        return None
    frames = frames[np.unique(np.linspace(0, len(frames) - 1, FRAMES).astype(int))]
    found = [_of_frame(points, frame, diagonal) for frame in frames]
    if any(factor is not None and 1 / _EXTREME < factor < _EXTREME for factor in found):
        examples = chosen.at(_examples(model))
        found = [
            None if factor is None or _as_an_example(points, frame, factor, examples) else factor
            for frame, factor in zip(frames, found, strict=True)
        ]
    factors = [factor for factor in found if factor is not None]
    if not factors:
        return _of_size(frames, diagonal)
    likely = max(set(factors), key=factors.count)
    if 2 * factors.count(likely) <= len(found):
        return None
    larger = likely > 1
    size = likely if larger else 1 / likely
    _, fine, coarse = _UNITS[int(np.abs(_FACTORS - size).argmin())]
    of_targets, of_model = (fine, coarse) if larger else (coarse, fine)
    return (
        f"the targets span about {likely:.4g} times what their points span on the model, as if "
        f"they were in {of_targets} and the model in {of_model}; if so, scale them by "
        f"{1 / likely:.4g}"
    )


def _of_size(frames: FloatArray, diagonal: float) -> str | None:
    """A warning if targets (F, H, 3) of most frames lie farther apart than any pose has them."""
    sizes = [np.linalg.norm(np.ptp(frame[~np.isnan(frame[:, 0])], axis=0)) for frame in frames]
    size = float(np.median(sizes)) / diagonal
    if size < _EXTREME:
        return None
    return (
        f"the targets lie up to {size:.3g} times as far from each other as the model is large; if "
        "they are in smaller units than the model, scale them"
    )


def _of_frame(P: FloatArray, Q: FloatArray, diagonal: float) -> float | None:
    """The factor of `_UNITS`, or its inverse, by which targets Q (H, 3) are most likely scaled."""
    seen = np.isfinite(Q).all(axis=1)
    step = -(-int(seen.sum()) // _COMPARED)
    P, Q = P[seen][::step], Q[seen][::step]
    found = _of_distances(P, Q, diagonal) if len(P) > 2 else None
    return _of_positions(P, Q, diagonal) if found is None else found


def _examples(model: DeformationModel) -> FloatArray:
    """Training shapes (n, V, 3) as decoded: all, or some that are spread evenly over the set."""
    rows = np.linspace(0, len(model.codes) - 1, min(_EXAMPLES, len(model.codes)))
    return model.decode(model.codes[rows.astype(int)])


def _as_an_example(P: FloatArray, Q: FloatArray, factor: float, examples: FloatArray) -> bool:
    """True if targets Q (H, 3) are nearly as like an example as like the scaled points P (H, 3).

    Args:
        P, Q: points of the reference, and targets, NaN where one is not seen.
        factor: of the targets' units.
        examples: (n, H, 3) the points on training shapes.
    """
    seen = np.isfinite(Q).all(axis=1)
    P, Q = P[seen], Q[seen]
    off = _off(P, Q / factor) / (_span(P) or 1.0)
    return any(_EXAMPLE * _off(E[seen], Q) <= off * _span(Q) for E in examples)


def _off(P: FloatArray, Q: FloatArray) -> float:
    """Distance of points P (n, 3), moved rigidly, from Q (n, 3): the root of the summed squares."""
    R, t = procrustes(P, Q)
    return float(np.linalg.norm(P @ R.T + t - Q))


def _of_distances(P: FloatArray, Q: FloatArray, diagonal: float) -> float | None:
    """As `_of_frame`, by distances of the targets from each other."""
    if 1 / _LEAST_FACTOR < _span(Q) / (_span(P) or diagonal) < _LEAST_FACTOR:
        return None
    i, j = np.array(list(combinations(range(len(P)), 2))).T
    before, after = (np.linalg.norm(X[i] - X[j], axis=1) for X in (P, Q))
    apart = (before > 1e-3 * diagonal) & (after > 0)
    i, j = i[apart], j[apart]
    ratios = np.log(after[apart] / before[apart])
    factor = _nearest(float(np.median(ratios))) if len(ratios) else None
    if factor is None:
        return None
    scaled = Q / factor
    if factor < 1 and len(P) < _MANY and _largest(scaled - P) > _NEAR * diagonal:
        return None
    if _off(P, scaled) > _OFF * _span(P):
        return None
    for h in range(len(P)):
        others = ratios[(i != h) & (j != h)]
        if len(others) and abs(np.median(others) - np.log(factor)) > 2 * _TOLERANCE:
            return None
    return factor


def _of_positions(P: FloatArray, Q: FloatArray, diagonal: float) -> float | None:
    """An extreme factor by which the targets' positions, and not only their distances, differ."""
    extreme = _FACTORS[_FACTORS >= _EXTREME]
    found: dict[float, float] = {}
    for factor in [*extreme.tolist(), *(1 / extreme if len(P) > 1 else ())]:
        scaled = Q / factor
        alike = len(P) == 1 or 1 / 3 < _span(scaled) / (_span(P) or diagonal) < 3
        far = factor < 1 or _largest(Q - P) > _EXTREME / 2 * diagonal
        off = _largest(scaled - P)
        if alike and far and off < _NEAR * diagonal:
            found[factor] = off
    return min(found, key=found.__getitem__, default=None)


def _span(X: FloatArray) -> float:
    """Root of the summed squared distances of points (n, 3) from their centroid."""
    return float(np.linalg.norm(X - X.mean(axis=0)))


def _largest(X: FloatArray) -> float:
    """Length of the longest of vectors (n, 3)."""
    return float(np.linalg.norm(X, axis=1).max())


def _nearest(ratio: float) -> float | None:
    """The factor of `_UNITS`, or its inverse, nearest to exp(ratio); None if none is near."""
    off = np.abs(np.log(_FACTORS) - abs(ratio))
    best = int(off.argmin())
    if off[best] > _TOLERANCE:
        return None
    return float(_FACTORS[best] if ratio > 0 else 1 / _FACTORS[best])
