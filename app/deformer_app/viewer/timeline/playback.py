"""Playback in real time: the frame that a clock asks for, whatever has been drawn."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Playback:
    """A clip that plays since a moment. A slow picture leaves frames out; the time is kept.

    Args:
        first: frame at the beginning.
        begun: time of the beginning, in seconds.
        fps: frames a second.
        length: number of frames.
        loop: true to begin anew after the last frame.
    """

    first: int
    begun: float
    fps: int
    length: int
    loop: bool

    def frame(self, now: float) -> int:
        """The frame at a time, in seconds."""
        passed = self.first + int((now - self.begun) * self.fps + 1e-9)
        return passed % self.length if self.loop else min(passed, self.length - 1)

    def ended(self, now: float) -> bool:
        """True once the last frame has been shown for its time."""
        return not self.loop and self.first + (now - self.begun) * self.fps >= self.length
