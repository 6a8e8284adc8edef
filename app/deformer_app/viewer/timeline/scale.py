"""The scale of the timeline: frames to pixels and back, zooming and scrolling."""

from __future__ import annotations

from dataclasses import dataclass, replace

_LEAST_WIDTH, _MOST_WIDTH = 0.05, 60.0  # pixels of a frame
_MARGIN = 12.0  # pixels beside the first and the last frame
_APART = 46.0  # least distance of two numbers, in pixels
_STEPS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000)


@dataclass(frozen=True)
class Scale:
    """Where frames are along the timeline.

    Args:
        first: frame at the left margin.
        width: pixels of a frame.
    """

    first: float = 0.0
    width: float = 10.0

    @classmethod
    def of(cls, length: int, pixels: int) -> Scale:
        """The scale that shows a whole clip in so many pixels."""
        room = max(pixels - 2 * _MARGIN, 1.0)
        return cls(0.0, min(_MOST_WIDTH, max(_LEAST_WIDTH, room / max(length - 1, 1))))

    def x(self, frame: float) -> float:
        """Pixel of a frame."""
        return _MARGIN + (frame - self.first) * self.width

    def frame(self, x: float) -> int:
        """The frame nearest to a pixel; may lie outside of the clip."""
        return round(self.first + (x - _MARGIN) / self.width)

    def zoomed(self, factor: float, x: float) -> Scale:
        """The scale with frames wider by a factor; what is at pixel x stays there."""
        width = min(_MOST_WIDTH, max(_LEAST_WIDTH, self.width * factor))
        at = self.first + (x - _MARGIN) / self.width
        return Scale(max(0.0, at - (x - _MARGIN) / width), width)

    def scrolled(self, pixels: float, length: int) -> Scale:
        """The scale with other frames at the left; the last one stays in sight."""
        first = self.first + pixels / self.width
        return replace(self, first=min(max(0.0, first), max(0.0, length - 1.0)))

    @property
    def step(self) -> int:
        """Distance of frames that have a number."""
        return next((n for n in _STEPS if n * self.width >= _APART), _STEPS[-1])
