"""Mouse to commands: a state machine that needs no window.

Left button: on a handle it drags the selected handles, on the manipulator it moves them exactly,
on the surface it places a handle (and drags it), beside the body it orbits. Right button orbits,
middle pans, the wheel zooms, everywhere.
"""

from __future__ import annotations

from deformer_app.viewer.drags import (
    BoxSelection,
    Drag,
    GizmoDrag,
    HandleDrag,
    Orbit,
    Pan,
    Placement,
    RegionStroke,
)
from deformer_app.viewer.events import (
    Button,
    ButtonPressed,
    ButtonReleased,
    MouseEvent,
    MouseLeft,
    MouseMoved,
    Pixel,
    WheelTurned,
)
from deformer_app.viewer.stage import Hover, Stage

_ZOOM = 1.15  # a notch of the wheel


class Controller:
    """Translates events of the mouse into commands for a stage.

    Args:
        stage: receiver of the commands.
    """

    def __init__(self, stage: Stage) -> None:
        """Start without a drag."""
        self._stage = stage
        self._drag: Drag | None = None
        self._button: Button | None = None

    @property
    def dragging(self) -> bool:
        """True while a button is down."""
        return self._drag is not None

    def handle(self, event: MouseEvent) -> None:
        """Carry out the command of an event.

        During a drag another button, the wheel and the picture's border are ignored.
        """
        match event:
            case MouseMoved(pixel, keys) if self._drag is not None:
                self._drag.move(pixel, keys)
            case MouseMoved(pixel, _):
                self._stage.hover(self._under(pixel))
            case ButtonReleased(button, pixel, keys) if self._drag is not None:
                if button == self._button:
                    drag, self._drag = self._drag, None
                    drag.move(pixel, keys)
                    drag.release(keys)
                    self._stage.hover(self._under(pixel))
            case _ if self._drag is not None:
                pass
            case MouseLeft():
                self._stage.hover(Hover())
            case ButtonPressed():
                self._button, self._drag = event.button, self._begin(event)
            case WheelTurned(notches, pixel):
                camera, size = self._stage.camera, self._stage.size
                self._stage.set_camera(camera.zoomed(_ZOOM**notches, pixel, size))

    def cancel(self) -> bool:
        """Cancel the current drag; return False if there is none."""
        if self._drag is None:
            return False
        drag, self._drag = self._drag, None
        drag.cancel()
        return True

    def _under(self, pixel: Pixel) -> Hover:
        """Return the vertex, handle or part that a press of the left button would act on."""
        stage = self._stage
        if stage.tool == "paint":
            return Hover(vertex=stage.vertex_at(pixel))
        gizmo = stage.gizmo
        part = gizmo.part_at(pixel, stage.camera, stage.size) if gizmo else None
        # A handle is at the centre of its manipulator: there the handle has priority.
        handle = stage.handle_at(pixel)
        if handle is not None and (part is None or part == "s" or handle in stage.selected):
            return Hover(part="s") if part == "s" else Hover(handle=handle)
        if part is not None:
            return Hover(part=part)
        return Hover(vertex=stage.vertex_at(pixel))

    def _begin(self, press: ButtonPressed) -> Drag:
        stage, pixel, keys = self._stage, press.pixel, press.keys
        if press.button == "middle" or (press.button == "right" and keys.shift):
            return Pan(stage, pixel)
        if press.button == "right" or keys.alt:
            return Orbit(stage, pixel)
        if keys.control and stage.tool == "drag":
            return BoxSelection(stage, pixel)
        under = self._under(pixel)
        if stage.tool == "paint":
            return (
                Orbit(stage, pixel) if under.vertex is None else RegionStroke(stage, under.vertex)
            )
        if under.part is not None:
            return GizmoDrag(stage, under.part, pixel)
        if under.handle is not None:
            return HandleDrag(stage, under.handle, pixel, keys)
        if under.vertex is not None:
            return Placement(stage, under.vertex, pixel, keys)
        return Orbit(stage, pixel, lambda: stage.select([]))
