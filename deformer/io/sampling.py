"""Times at which animations are sampled, and how many shapes a file may hold."""

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
    found = checked_number(fps, "fps")
    if not 0 < found <= 1e6:
        raise InputError(f"fps: {found:g}, expected a number above 0; give frames a second")
    return found


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
