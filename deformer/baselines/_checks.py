"""Checks that turn the arguments of a method into arrays or raise InputError."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import checked_number
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray


def checked_shapes(vertices: ArrayLike, vertex_count: int) -> FloatArray:
    """Finite shapes (N, V, 3); InputError for any others."""
    shapes = np.asarray(vertices, dtype=np.float64)
    if shapes.ndim != 3 or shapes.shape[1:] != (vertex_count, 3):
        raise InputError(
            f"vertices: expected (N, {vertex_count}, 3), got {shapes.shape}; "
            "all shapes share the reference's connectivity"
        )
    bad = np.argwhere(~np.isfinite(shapes))
    if len(bad):
        raise InputError(
            f"vertices{bad[0][:2].tolist()}: {shapes[tuple(bad[0])]} is not a finite position; "
            "repair or remove the shape"
        )
    return shapes


def checked_codes(codes: ArrayLike, size: int) -> FloatArray:
    """Finite codes (N, size); InputError for any others."""
    array = np.asarray(codes, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != size or not np.isfinite(array).all():
        raise InputError(f"codes: expected finite numbers of shape (N, {size}), got {array.shape}")
    return array


def checked_handles(
    vertices: ArrayLike, targets: ArrayLike, vertex_count: int, noise: float = 0.0
) -> tuple[IntArray, FloatArray, float]:
    """Vertices (H,) int64, targets (H, 3) and their noise.

    Raises:
        InputError: no vertices, repeated or unknown ones, targets that are not finite or of another
            shape, or a noise that is not a number of at least 0.
    """
    index = np.asarray(vertices)
    goals = np.asarray(targets, dtype=np.float64)
    if index.ndim != 1 or len(index) == 0 or not np.issubdtype(index.dtype, np.integer):
        raise InputError(
            f"vertices: expected at least one vertex index (H,), got {index.dtype} "
            f"of shape {index.shape}"
        )
    if goals.shape != (len(index), 3):
        raise InputError(f"targets: expected {(len(index), 3)}, got shape {goals.shape}")
    for h, vertex in enumerate(index.tolist()):
        if not 0 <= vertex < vertex_count:
            raise InputError(
                f"handle {h}: vertex {vertex} does not exist; "
                f"the mesh has vertices 0…{vertex_count - 1}"
            )
        if not np.isfinite(goals[h]).all():
            raise InputError(
                f"handle {h}: target {goals[h].tolist()} is not finite; "
                "targets are finite positions"
            )
    same = np.flatnonzero(np.bincount(index, minlength=vertex_count) > 1)
    if len(same):
        raise InputError(f"vertex {same[0]} is given twice; give each vertex one target")
    return index.astype(np.int64), goals, checked_number(noise, "noise", least=0)


def checked_training(shape_count: int, components: int, noise: float | None) -> None:
    """InputError unless there are 2 shapes, 1 component and a positive noise (or None)."""
    if shape_count < 2:
        raise InputError(f"shapes: expected at least 2 training shapes, got {shape_count}")
    if components < 1:
        raise InputError(f"components: expected at least 1, got {components}")
    if noise is not None and not noise > 0:
        raise InputError(f"noise: expected a positive number, got {noise}")
