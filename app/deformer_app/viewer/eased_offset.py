"""The way from the shown surface to a better pose, which vertices go smoothly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# 1/s; 99 % of the way takes 0.4 s, and the fastest sixtieth of a second is a tenth of it.
_RATE = 16.0
# An offset shorter than this, in bounding diagonals, which grows by less a time constant, is none.
_LEAST = 1e-4


class EasedOffset:
    """Offset (V, 3) of the shown surface from the newest pose, which vanishes without a jolt.

    It is that of a critically damped spring, o'' + 2 r o' + r² o = 0: a pose that comes while the
    surface is on its way to the last one changes where it goes, not how fast it moves. Where poses
    agree, as at the targets of exact handles, the offset stays zero.

    Args:
        diagonal: bounding diagonal of the reference.
    """

    def __init__(self, diagonal: float) -> None:
        """Start without an offset."""
        self._diagonal = diagonal
        self._offset: NDArray[np.float64] | None = None
        self._velocity = np.zeros((0, 3))
        self._time = 0.0

    def __bool__(self) -> bool:
        """Return True while there is an offset."""
        return self._offset is not None

    def clear(self) -> None:
        """Show the newest pose at once."""
        self._offset = None

    def add(self, step: NDArray[np.float64], time: float) -> None:
        """Go on from the surface that was shown, after the pose has changed.

        Args:
            step: (V, 3) from the new pose to the one before.
            time: now, in seconds.
        """
        if self._offset is None:
            self._velocity, self._time = np.zeros_like(step), time
            self._offset = step.copy()
        else:
            self.advance(time)
            self._offset = step if self._offset is None else self._offset + step
        self._end_if_small()

    def advance(self, time: float) -> None:
        """Move the offset on to a time in seconds."""
        if self._offset is None:
            return
        t, self._time = time - self._time, time
        # o(t) = (o + (v + r o) t) e^(−r t)
        fade, slope = np.exp(-_RATE * t), self._velocity + _RATE * self._offset
        self._offset = fade * (self._offset + t * slope)
        self._velocity = fade * slope - _RATE * self._offset
        self._end_if_small()

    def added_to(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the surface (V, 3) to show for the newest pose (V, 3)."""
        return pose if self._offset is None else pose + self._offset

    def _end_if_small(self) -> None:
        assert self._offset is not None
        least = _LEAST * self._diagonal
        moving = np.abs(self._velocity).max(initial=0.0) > _RATE * least
        if not moving and np.abs(self._offset).max(initial=0.0) < least:
            self._offset = None
