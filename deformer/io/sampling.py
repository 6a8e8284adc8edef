"""What is read of files with several shapes: times of animations, weights of targets, how many."""

from __future__ import annotations

import numpy as np

from deformer.checks import checked_number
from deformer.errors import InputError
from deformer.geometry import FloatArray

_MOST_FRAMES = 20_000
# Bytes of shapes that any file may give, and the factor by which they may be larger than the file.
_MOST_BYTES = 1_000_000_000
_MOST_GROWN = 25
_SLACK = 1e-3  # of a frame, by which the last time may be missed


def frame_times(start: float, end: float, fps: float, name: str) -> FloatArray:
    """Times (F,) from `start` to `end`, in seconds, `fps` of them a second.

    Args:
        start, end: the first time, and the last that may be.
        fps: frames a second.
        name: what is sampled, for messages.

    Raises:
        InputError: more than 20,000 frames.
    """
    count = (end - start) * fps + _SLACK
    if not count < _MOST_FRAMES:
        raise InputError(
            f"{name}: {end - start:g} seconds at {fps:g} frames a second, expected at most "
            f"{_MOST_FRAMES} frames; give a lower fps, or export a shorter clip"
        )
    return start + np.arange(int(count) + 1) / fps


def checked_fps(fps: float) -> float:
    """Frames a second, above 0; InputError for anything else."""
    return checked_number(fps, "fps", above=0, most=1e6, remedy="give frames a second")


def check_room(
    count: int, vertex_count: int, file_size: int, name: str, what: str, remedy: str
) -> None:
    """Refuse shapes that are far larger than the file that asks for them.

    Args:
        count: N, how many shapes.
        vertex_count: V of each.
        file_size: bytes of the file.
        name: the file, for messages.
        what: what the shapes are, in the plural.
        remedy: what to do.

    Raises:
        InputError: they take more than 1 GB and more than 25 times the size of the file.
    """
    size = 24 * count * vertex_count
    if size > max(_MOST_BYTES, _MOST_GROWN * file_size):
        raise InputError(
            f"{name}: {count} {what} of {vertex_count} vertices take {size / 1e9:.1f} GB, "
            f"{_MOST_GROWN} times the size of the file or more; {remedy}"
        )


def shows_a_shape(weights: FloatArray, shown: FloatArray, shapes: FloatArray) -> bool:
    """True if what a file shows by the weights of its targets is one more example shape.

    It is none with all weights 0, or all 1 for several targets: Blender makes shape keys with the
    value 1, and their sum is no shape that anyone has seen. Nor is a shape that is there already.

    Args:
        weights: (T,) weights of all targets.
        shown: (V, 3) the shape by these weights.
        shapes: (N, V, 3) the base and the targets.
    """
    all_on = len(weights) > 1 and (weights == 1.0).all()
    known = any(np.array_equal(shown, shape) for shape in shapes)
    return bool(weights.any()) and not all_on and not known
