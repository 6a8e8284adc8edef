"""Onion skins: translucent shapes of the frames before and after the playhead."""

from __future__ import annotations

from dataclasses import dataclass

from deformer_app.viewer.timeline.keys import Clip

MOST = 5  # skins on each side
_OPACITY = 0.3  # of the nearest skin; each further one has a smaller share of it


@dataclass(frozen=True)
class Onion:
    """Which skins are shown.

    Args:
        before, after: number of skins on each side, at most MOST.
        at_keys: true for the frames of keys, false for frames at equal distances.
        step: distance of these frames.
    """

    before: int = 0
    after: int = 0
    at_keys: bool = False
    step: int = 4

    def frames(self, clip: Clip, frame: int) -> dict[int, int]:
        """The skin of each number −before…after but 0: its frame, where the clip has it."""
        found: dict[int, int] = {}
        for side, count in ((-1, self.before), (1, self.after)):
            at: int | None = frame
            for n in range(1, count + 1):
                at = clip.next_key(at, side) if self.at_keys else frame + side * n * self.step
                if at is None or not 0 <= at < clip.length:
                    break
                found[side * n] = at
        return found


def opacity(number: int) -> float:
    """Opacity of the n-th skin, counted from the playhead."""
    return _OPACITY / (1 + 0.7 * (abs(number) - 1))
