"""Mouse to commands: a state machine that needs no window.

Left button: on a handle it drags the selected handles, on the manipulator it moves them exactly,
on the surface it places a handle (and drags it), beside the body it orbits. Right button orbits
and by a click asks for a menu, middle pans, the wheel zooms: everywhere, and during a drag, too.
"""

from __future__ import annotations

from dataclasses import dataclass

from deformer_app.viewer.drag import Drag
from deformer_app.viewer.events import (
    Button,
    ButtonPressed,
    ButtonReleased,
    KeyPressed,
    Keys,
    MouseEvent,
    MouseLeft,
    MouseMoved,
    Pixel,
    WheelTurned,
)
from deformer_app.viewer.gizmo import Gizmo, is_square
from deformer_app.viewer.gizmo_drag import GizmoDrag
from deformer_app.viewer.handle_drags import BoxSelection, HandleDrag, Placement, RegionStroke
from deformer_app.viewer.stage import Hover, Stage
from deformer_app.viewer.typed_numbers import ENTER
from deformer_app.viewer.view_cube import is_reached
from deformer_app.viewer.view_drags import Orbit, Pan
from deformer_app.viewer.zoom import zoomed_by_wheel


@dataclass
class _Running:
    """A drag that lasts until its button comes up."""

    button: Button
    drag: Drag


class Controller:
    """Translates events of the mouse into commands for a stage.

    Every drag ends with the release of its own button, whatever happens between. During a drag of
    the left button another one may turn or move the view; then the mouse belongs to that one.

    Args:
        stage: receiver of the commands.
    """

    def __init__(self, stage: Stage) -> None:
        """Start without a drag."""
        self._stage = stage
        self._running: list[_Running] = []  # at most two; the mouse moves the last one
        self._at: Pixel = (0.0, 0.0)
        self._inside = False

    @property
    def inside(self) -> bool:
        """True while the mouse is over the picture."""
        return self._inside

    @property
    def dragging(self) -> bool:
        """True while a button is down."""
        return bool(self._running)

    def handle(self, event: MouseEvent) -> None:
        """Carry out the command of an event."""
        self._inside = not isinstance(event, MouseLeft)
        match event:
            case MouseMoved(pixel, keys, buttons):
                if buttons is not None:
                    self._end_lost(buttons, keys)
                self._at = pixel
                if self._running:
                    self._running[-1].drag.move(pixel, keys)
                else:
                    self._stage.hover(self._under(pixel))
            case ButtonReleased(button, pixel, keys):
                self._at = pixel
                self._release(button, pixel, keys)
            case ButtonPressed(button, pixel, keys):
                self._end(button, keys)  # its release was lost
                self._at = pixel
                self._press(event)
            case WheelTurned(notches, pixel, keys) if (
                keys.shift
                and not self._running
                and self._stage.resize_pin(self._under(pixel), notches)
            ):
                pass
            case WheelTurned(notches, pixel):
                self._zoom(notches, pixel)
            case MouseLeft() if not self._running:
                self._stage.hover(Hover())

    def look_again(self) -> None:
        """Find what is under the mouse once more: the picture has changed, the mouse is still."""
        if self._inside and not self._running:
            self._stage.hover(self._under(self._at))

    def cancel(self) -> bool:
        """Cancel the current drag; return False if there is none."""
        if not self._running:
            return False
        first, self._running = self._running[0], []
        first.drag.cancel()
        return True

    @property
    def takes_numbers(self) -> bool:
        """True while numbers can be typed: during a drag of the manipulator."""
        return bool(self._running) and self._running[0].drag.takes_numbers

    def handle_key(self, event: KeyPressed) -> bool:
        """Pass a key to the current drag; return False if it has no use for it."""
        if not self.takes_numbers or event.keys.control or event.keys.alt:
            return False
        taken = self._running[0].drag.type_key(event.name)
        if taken and event.name in ENTER:
            self.finish()
        return taken

    def finish(self) -> None:
        """End the current drag as if its button had been released where the mouse was last."""
        for running in tuple(self._running):
            self._end(running.button, Keys())

    def _press(self, press: ButtonPressed) -> None:
        if not self._running:
            self._running = [_Running(press.button, self._begin(press))]
        elif len(self._running) == 1 and not self._running[0].drag.turns_view:
            held = self._running[0].drag.grasp(press.pixel)
            drag = (
                Pan(self._stage, press.pixel, held)
                if press.button == "middle" or press.keys.shift
                else Orbit(self._stage, press.pixel, held=held)
            )
            self._running.append(_Running(press.button, drag))

    def _release(self, button: Button, pixel: Pixel, keys: Keys) -> None:
        if self._running and self._running[-1].button == button:
            self._running[-1].drag.move(pixel, keys)
        self._end(button, keys)
        if not self._running:
            self._stage.hover(self._under(pixel))

    def _end(self, button: Button, keys: Keys) -> None:
        """End the drag of a button, if there is one, where the mouse was last."""
        for running in tuple(self._running):
            if running.button == button:
                if running is not self._running[-1]:  # the mouse belonged to the other one
                    running.drag.skip(self._at)
                self._running.remove(running)
                running.drag.release(keys)
                if self._running:
                    self._running[-1].drag.skip(self._at)

    def _end_lost(self, buttons: frozenset[Button], keys: Keys) -> None:
        """End drags whose buttons are up: a window that loses the mouse is told of no release."""
        for running in tuple(self._running):
            if running.button not in buttons:
                self._end(running.button, keys)

    def _zoom(self, notches: float, pixel: Pixel) -> None:
        stage, held = self._stage, None
        if self._running:
            held = self._running[0].drag.grasp(pixel)
        depth = stage.depth_at(pixel) if held is None else float(stage.camera.depths([held])[0])
        stage.set_camera(
            zoomed_by_wheel(stage.camera, notches, pixel, depth, stage.size, stage.spans)
        )

    def _under(self, pixel: Pixel) -> Hover:
        """Return what a press of the left button would act on."""
        stage = self._stage
        gizmo, side = stage.gizmo, stage.cube_at(pixel)
        if side is None:
            return self._behind_cube(pixel, gizmo)
        if gizmo is None or not is_reached(gizmo, stage.camera, stage.size):
            return Hover(side=side)
        # The cube is faded: what is seen through it has priority.
        found = self._behind_cube(pixel, gizmo)
        return Hover(side=side) if found == Hover() else found

    def _behind_cube(self, pixel: Pixel, gizmo: Gizmo | None) -> Hover:
        """Return the vertex, handle or part at a pixel, with or without the manipulator."""
        stage = self._stage
        if stage.tool == "paint":
            return Hover(vertex=stage.vertex_at(pixel))
        part = gizmo.part_at(pixel, stage.camera, stage.size) if gizmo else None
        # A handle is at the centre of its manipulator: there the handle has priority, and so it has
        # inside of squares, which have room for both.
        handle = stage.handle_at(pixel)
        if handle is not None and (part is None or is_square(part) or handle in stage.selected):
            return Hover(part="s") if part == "s" else Hover(handle=handle)
        if part is not None:
            return Hover(part=part)
        return Hover(vertex=stage.vertex_at(pixel))

    def _begin(self, press: ButtonPressed) -> Drag:
        stage, pixel, keys = self._stage, press.pixel, press.keys
        if press.button == "middle" or (press.button == "right" and keys.shift):
            return Pan(stage, pixel)
        if press.button == "right":
            return Orbit(stage, pixel, lambda: stage.context_menu(pixel, self._under(pixel)))
        if keys.alt:
            return Orbit(stage, pixel)
        under = self._under(pixel)
        side = under.side
        if side is not None:
            return Orbit(stage, pixel, lambda: stage.look_from(side))
        if keys.control and stage.tool == "drag":
            return BoxSelection(stage, pixel)
        if stage.tool == "paint":
            return (
                Orbit(stage, pixel) if under.vertex is None else RegionStroke(stage, under.vertex)
            )
        if under.part is not None:
            return GizmoDrag(
                stage, under.part, pixel,
                lambda: self._on(self._behind_cube(pixel, None), pixel, keys).release(keys),
            )  # fmt: skip
        return self._on(under, pixel, keys)

    def _on(self, under: Hover, pixel: Pixel, keys: Keys) -> Drag:
        """Return the drag of a press on what is under a pixel, apart from the manipulator."""
        if under.handle is not None:
            return HandleDrag(self._stage, under.handle, pixel, keys)
        if under.vertex is not None:
            return Placement(self._stage, under.vertex, pixel, keys)
        return Orbit(self._stage, pixel, lambda: self._stage.select([]))
