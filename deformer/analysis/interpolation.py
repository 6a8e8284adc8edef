"""Interpolation between key shapes: of latent codes, of features, and linear, for comparison.

Linear interpolation of positions shrinks the parts that rotate, to a line at half a turn. Codes and
features represent rotations by angles, and interpolating them preserves lengths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from deformer.acap import extract_all
from deformer.analysis.synthesis import BlendSpace, check_blend_space
from deformer.checks import (
    LARGEST,
    check_memory,
    checked_array,
    checked_instance,
    checked_integer,
)
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
    """A path of n shapes through M key shapes.

    Args:
        vertices: (n, V, 3) the shapes.
        keys: (M, V, 3) the path's shapes at the times 0 … M − 1: the keys, as the interpolation
            reproduces them.
        times: (n,) from 0 at the first key to M − 1 at the last.
        faces: (F, 3) of all shapes.
    """

    vertices: FloatArray
    keys: FloatArray
    times: FloatArray
    faces: IntArray

    def edge_ratios(self) -> FloatArray:
        """Edge lengths (n, E), divided by the lengths interpolated between the neighbouring keys.

        1 is an edge whose length changes linearly from one key to the next, less than 1 an edge
        that is shorter than that. Edges without length at the keys count as 1.
        """
        pairs = edges(self.faces)
        expected = _interpolated(_edge_lengths(self.keys, pairs), self.times)
        lengths = _edge_lengths(self.vertices, pairs)
        return np.divide(lengths, expected, out=np.ones_like(lengths), where=expected > 0)

    def length_ratios(self) -> FloatArray:
        """Sum (n,) of all edge lengths, divided by the sum interpolated between the keys."""
        pairs = edges(self.faces)
        expected = _interpolated(_edge_lengths(self.keys, pairs), self.times).sum(axis=1)
        return _edge_lengths(self.vertices, pairs).sum(axis=1) / expected


def interpolate(
    model: DeformationModel, keys: ArrayLike, steps: int = 9, space: BlendSpace = "latent"
) -> ShapePath:
    """A path through shapes, in equal steps from key to key.

    Args:
        model: the prior; the shapes have its connectivity.
        keys: (M, V, 3) the key shapes, M ≥ 2, in the reference's units.
        steps: shapes from one key to the next, both included: n = (M − 1)(steps − 1) + 1.
        space: "latent" interpolates the keys' codes; the path passes through the decoded keys.
            "features" interpolates rotation vectors and stretches, which depend on no training and
            reproduce the keys exactly; the whole body's rotation is interpolated along the
            shorter arc. "linear" interpolates vertex positions.

    Raises:
        InputError: fewer than two keys, of another connectivity, fewer than two steps, or an
            unknown space.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    check_blend_space(space)
    shapes = checked_array(keys, "keys")
    V = len(model.reference.vertices)
    if shapes.ndim != 3 or shapes.shape[1:] != (V, 3) or len(shapes) < 2:
        raise InputError(f"keys: expected (2 or more, {V}, 3), got {shapes.shape}")
    checked_integer(steps, "steps", least=2)
    n = (len(shapes) - 1) * (steps - 1) + 1
    check_memory(4 * 24 * n * V, f"steps: {n} shapes of {V} vertices")
    times = np.linspace(0.0, len(shapes) - 1.0, n)
    if space == "linear":
        path = _interpolated(shapes, times)
        at_keys = shapes
    else:
        centred_shapes = _from_codes if space == "latent" else _from_features
        # The shapes at the keys come from the same interpolation: they are on the path.
        all_times = np.concatenate([times, np.arange(len(shapes), dtype=np.float64)])
        p = centred_shapes(model, shapes, all_times)
        p -= p.mean(axis=1, keepdims=True)
        p += _interpolated(shapes.mean(axis=1), all_times)[:, None]
        path, at_keys = p[: len(times)], p[len(times) :]
    return ShapePath(path, at_keys, times, model.reference.faces)


def interpolate_codes(codes: ArrayLike, times: ArrayLike) -> FloatArray:
    """Latent codes on the path through key codes, as "latent" interpolation takes it.

    Args:
        codes: (M, K) the key codes, M ≥ 2.
        times: (n,) or one number, from 0 at the first key to M − 1 at the last.

    Returns:
        (n, K), or (K,) for one time.

    Raises:
        InputError: fewer than two codes, or a time outside 0…M − 1.
    """
    keys = checked_array(codes, "codes", ("M", "K"), largest=LARGEST)
    if len(keys) < 2:
        raise InputError(f"codes: expected two or more, got {len(keys)}; add one")
    at = checked_array(times, "times", (), ("n",))
    if at.size and not (at.min() >= 0 and at.max() <= len(keys) - 1):
        raise InputError(
            f"times: expected 0…{len(keys) - 1}, got {at.min():g}…{at.max():g}; stay on the path"
        )
    found = _interpolated(keys, np.atleast_1d(at))
    return found if at.ndim else found[0]


def _from_codes(model: DeformationModel, keys: FloatArray, times: FloatArray) -> FloatArray:
    """Centred shapes (n, V, 3) of codes interpolated between the keys'."""
    p = model.decode(_interpolated(model.encode(keys), times))
    return p - p.mean(axis=1, keepdims=True)


def _from_features(model: DeformationModel, keys: FloatArray, times: FloatArray) -> FloatArray:
    """Centred shapes (n, V, 3) of features interpolated between the keys'.

    The rotation of the whole body is interpolated on its own: features represent rotations of
    several turns of one part against another, but a rotation of all parts only up to whole turns.
    """
    seams, keys = model.seams, model.seams.close(keys)
    reference = model.closed.reference.vertices
    rotations = np.stack([procrustes(reference, key)[0] for key in keys])
    centred = keys - keys.mean(axis=1, keepdims=True)
    q = extract_all(model.extractor, centred @ rotations, links=True)
    p = model.poisson.reconstruct(_interpolated(q, times))
    p -= p.mean(axis=1, keepdims=True)
    first = np.minimum(times.astype(np.int64), len(keys) - 2)
    logs = rotation_to_log(np.swapaxes(rotations[:-1], 1, 2) @ rotations[1:])
    R = rotations[first] @ log_to_rotation((times - first)[:, None] * logs[first])
    return seams.open(p @ np.swapaxes(R, 1, 2))


def _interpolated(values: FloatArray, times: FloatArray) -> FloatArray:
    """Piecewise linear interpolation at times (n,) of values (M, …) given at 0 … M − 1."""
    first = np.minimum(times.astype(np.int64), len(values) - 2)
    share = (times - first).reshape(-1, *[1] * (values.ndim - 1))
    return (1.0 - share) * values[first] + share * values[first + 1]


def _edge_lengths(vertices: FloatArray, pairs: IntArray) -> FloatArray:
    """Lengths (n, E) of edges (E, 2) of shapes (n, V, 3)."""
    return np.linalg.norm(vertices[:, pairs[:, 0]] - vertices[:, pairs[:, 1]], axis=2)
