"""A drag of a part of the manipulator, by the mouse or by typed numbers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from deformer_app.viewer.drag import Drag, MousePath
from deformer_app.viewer.events import Keys, Pixel
from deformer_app.viewer.stage import Measure, Stage
from deformer_app.viewer.typed_numbers import ENTER, TypedNumbers


class GizmoDrag(Drag):
    """A drag of a part of the manipulator: moves, turns or scales exactly.

    Numbers typed meanwhile count in place of the mouse, until they are deleted again.

    Args:
        stage: whose selected handles are moved.
        part: of the manipulator.
        pixel: where `part` is seen.
        on_click: called at the release of a press that has not moved.
    """

    takes_numbers = True

    def __init__(self, stage: Stage, part: str, pixel: Pixel, on_click: Callable[[], None]) -> None:
        """Begin at `pixel`."""
        gizmo = stage.gizmo
        assert gizmo is not None
        self._stage, self._part, self._gizmo, self._on_click = stage, part, gizmo, on_click
        self._path = MousePath(pixel)
        self._dragged = gizmo.no_amount(part)
        self._typed = TypedNumbers(len(self._dragged))
        self._began = False

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Follow the mouse to `pixel`, where the view can tell how far."""
        self._began = self._began or not self._path.is_click_at(pixel)
        if not self._began:
            return
        before = self._path.counted
        self._path.move(pixel, keys.shift)
        camera, size = self._stage.camera, self._stage.size
        step = self._gizmo.step(self._part, before, self._path.counted, camera, size)
        if step is not None and not self._typed.begun:
            self._dragged = self._dragged + step
        self._apply()

    def type_key(self, name: str) -> bool:
        """Use a key as part of a number; Return leaves it as it is."""
        if name in ENTER:
            return self._began
        if not self._typed.take(name):
            return False
        self._began = True
        self._apply()
        return True

    def _apply(self) -> None:
        gizmo, part, typed = self._gizmo, self._part, self._typed
        amount = gizmo.amount_of(part, typed.values) if typed.begun else self._dragged
        self._stage.move_selected(gizmo.motion(part, amount))
        text = gizmo.words(part, amount, typed.texts if typed.begun else None)
        x, y = self._path.now
        self._stage.measure(Measure((float(x), float(y)), text, gizmo.frame))

    def skip(self, pixel: Pixel) -> None:
        """Go on from `pixel`."""
        self._path.skip(pixel)
        if self._began:
            self._apply()

    def grasp(self, pixel: Pixel) -> NDArray[np.float64] | None:
        """Return the point (3,) under `pixel` at the depth of the manipulator's centre."""
        camera, gizmo = self._stage.camera, self._stage.gizmo or self._gizmo
        return camera.unproject(pixel, float(camera.depths([gizmo.centre])[0]), self._stage.size)

    def release(self, keys: Keys) -> None:
        """Make the drag a step of the history."""
        self._stage.measure(None)
        if self._began:
            self._stage.commit({"r": "Rotate", "s": "Scale"}.get(self._part[0], "Move"))
        else:
            self._on_click()

    def cancel(self) -> None:
        """Restore the handles."""
        self._stage.measure(None)
        self._stage.revert()
