"""Onion skins and loaded footage in the picture, as ghosts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from numpy.typing import NDArray

from deformer_app.viewer.ghosts import Ghosts
from deformer_app.viewer.timeline.onion import opacity

if TYPE_CHECKING:
    from deformer_app.viewer.timeline.timeline import Timeline

_FOOTAGE = "footage"


class Skins:
    """Ghosts of the frames around the playhead, and of the footage at it.

    Args:
        ghosts: of the picture.
    """

    def __init__(self, ghosts: Ghosts) -> None:
        """Begin with none."""
        self._ghosts = ghosts
        self._shown: dict[str, NDArray] = {}

    def update(self, timeline: Timeline) -> bool:
        """Show those of the present frame; return True if the picture must be drawn again.

        Onion skins need the fitted clip, and are hidden while it plays.
        """
        wanted: dict[str, NDArray] = {}
        fitted, footage, frame = timeline.fitted, timeline.footage, timeline.frame
        sides: dict[str, int] = {}
        if fitted is not None and not timeline.playing:
            for number, at in timeline.onion.frames(timeline.clip, frame).items():
                name = f"onion{number:+d}"
                wanted[name], sides[name] = fitted.vertices[at], number
        if footage is not None and frame < len(footage):
            wanted[_FOOTAGE] = footage[frame]
        if list(wanted) == list(self._shown) and all(
            _same(wanted[name], self._shown[name]) for name in wanted
        ):
            return False
        for name in self._shown.keys() - wanted.keys():
            self._ghosts.hide(name)
        for name, shape in wanted.items():
            if name == _FOOTAGE:
                self._ghosts.show(name, shape)
            else:
                tint = "earlier" if sides[name] < 0 else "later"
                self._ghosts.show(name, shape, tint, opacity(sides[name]))
        self._shown = wanted
        return True

    def forget(self) -> None:
        """Hide all, as another model has other faces."""
        for name in self._shown:
            self._ghosts.hide(name)
        self._shown = {}


def _same(a: NDArray, b: NDArray) -> bool:
    """True for the same memory: shapes of a clip are never written again."""
    return a.ctypes.data == b.ctypes.data and a.base is b.base
