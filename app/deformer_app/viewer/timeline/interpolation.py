"""Curves through the values of keys: eased or straight between two keys, constant outside."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Curve:
    """A curve through values (k, n) at frames (k,).

    An eased piece is a cubic with monotone slopes (Fritsch and Butland, 1984): no coordinate leaves
    the range of the two keys, the motion goes through a key without a stop where it goes on in the
    same direction, and starts and ends at rest. Two keys alone give 3 t² − 2 t³.

    Args:
        frames: (k,) ascending frames of the keys, at least one.
        values: (k, n) their values.
        straight: (k,) true where the piece after a key is straight.
    """

    def __init__(self, frames: Sequence[int], values: ArrayLike, straight: Sequence[bool]) -> None:
        """Choose the slopes at the keys."""
        self._frames = np.array(frames, dtype=np.float64)
        self._values = np.array(values, dtype=np.float64).reshape(len(frames), -1)
        self._straight = np.array(straight, dtype=bool)
        self._slopes = _monotone_slopes(self._frames, self._values)

    def piece(self, frames: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Index (m,) of the key before each frame (m,), and the share (m,) of the way to the next.

        The share is that of time; before the first key and after the last one it is 0.
        """
        f = np.asarray(frames, dtype=np.float64)
        before = np.clip(np.searchsorted(self._frames, f, side="right") - 1, 0, None)
        after = np.minimum(before + 1, len(self._frames) - 1)
        length = np.maximum(self._frames[after] - self._frames[before], 1.0)
        share = np.clip((f - self._frames[before]) / length, 0.0, 1.0)
        return before, np.where(after == before, 0.0, share)

    def shares(self, frames: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """As `piece`, with the share eased where the piece is not straight: 3 t² − 2 t³."""
        before, t = self.piece(frames)
        return before, np.where(self._straight[before], t, t * t * (3.0 - 2.0 * t))

    def __call__(self, frames: ArrayLike) -> NDArray[np.float64]:
        """Values (m, n) at frames (m,)."""
        before, t = self.piece(frames)
        after = np.minimum(before + 1, len(self._frames) - 1)
        t, gap = t[:, None], (self._frames[after] - self._frames[before])[:, None]
        a, b = self._values[before], self._values[after]
        # Hermite: a + t² (3 − 2 t) (b − a) + t (1 − t)² h m_a − t² (1 − t) h m_b
        eased = a + t * t * (3.0 - 2.0 * t) * (b - a)
        eased += t * (1.0 - t) * gap * ((1.0 - t) * self._slopes[before] - t * self._slopes[after])
        return np.where(self._straight[before, None], a + t * (b - a), eased)


def _monotone_slopes(
    frames: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Slopes (k, n) at keys: zero at the ends and at extremes, else a harmonic mean."""
    slopes = np.zeros_like(values)
    if len(frames) > 2:
        gaps = np.diff(frames)[:, None]
        rises = np.diff(values, axis=0) / gaps
        left, right = rises[:-1], rises[1:]
        before, after = 2.0 * gaps[1:] + gaps[:-1], gaps[1:] + 2.0 * gaps[:-1]
        same = left * right > 0.0
        safe = np.where(same, left, 1.0), np.where(same, right, 1.0)
        slopes[1:-1] = np.where(same, (before + after) / (before / safe[0] + after / safe[1]), 0.0)
    return slopes
