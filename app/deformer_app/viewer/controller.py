"""Mouse and keys to commands: a state machine that needs no window.

Left button: on a handle it drags what is selected, on the manipulator it moves exactly, on the
surface it places a handle (and drags it), beside the body it orbits. Right button orbits, middle
pans, the wheel zooms, everywhere. Pixels count from the top left corner.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer_app.rendering.camera import Camera
from deformer_app.viewer.gizmo import Gizmo, Motion, translation

Button = Literal["left", "middle", "right"]
Pixel = tuple[float, float]

CLICK = 4.0  # pixels within which a press and release is a click
FINE = 0.1  # share of the mouse's way that counts while Shift is down
_TURN = 0.4  # degrees of orbit a pixel
_ZOOM = 1.15  # a notch of the wheel


@dataclass(frozen=True)
class Keys:
    """Modifier keys that are down."""

    shift: bool = False
    control: bool = False
    alt: bool = False


@dataclass(frozen=True)
class Hover:
    """What is under the cursor: at most one of a vertex, a handle's id and a manipulator's part."""

    vertex: int | None = None
    handle: int | None = None
    part: str | None = None


class Stage(Protocol):
    """What the controller looks at and commands."""

    camera: Camera
    mode: Literal["drag", "paint"]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        ...

    @property
    def sky(self) -> ArrayLike:
        """The direction (3,) that stays up while orbiting."""
        ...

    @property
    def gizmo(self) -> Gizmo | None:
        """The manipulator, if it is shown."""
        ...

    @property
    def selected(self) -> frozenset[int]:
        """Ids of the selected handles."""
        ...

    def vertex_at(self, pixel: Pixel) -> int | None:
        """The visible vertex nearest to a pixel on the surface."""
        ...

    def handle_at(self, pixel: Pixel) -> int | None:
        """Id of the visible handle at a pixel."""
        ...

    def handles_in(self, low: Pixel, high: Pixel) -> Sequence[int]:
        """Ids of the handles within a rectangle of the picture."""
        ...

    def position_of(self, handle: int) -> NDArray[np.float64]:
        """Where a handle is grasped (3,)."""
        ...

    def hover(self, found: Hover) -> None:
        """Light up what is under the cursor."""
        ...

    def select(self, handles: Sequence[int], add: bool = False, toggle: bool = False) -> None:
        """Select handles."""
        ...

    def place(self, vertex: int, add: bool) -> int:
        """Put a handle on a vertex and select it, as part of what is under way; its id."""
        ...

    def move_selected(self, motion: Motion) -> None:
        """Move the selected handles from where they were when this drag began."""
        ...

    def commit(self, label: str) -> None:
        """End what is under way as one step of the history."""
        ...

    def revert(self) -> None:
        """Take back what is under way."""
        ...

    def rubber_band(self, low: Pixel | None, high: Pixel | None) -> None:
        """Draw a rectangle, or none."""
        ...

    def brush(self, vertex: int) -> None:
        """Paint the region around a vertex."""
        ...

    def finish_region(self, add: bool) -> None:
        """Make a handle of the painted region."""
        ...

    def camera_moved(self) -> None:
        """The camera has another place."""
        ...


class Drag(Protocol):
    """What happens between a press and its release."""

    def move(self, pixel: Pixel, keys: Keys) -> None:
        """The mouse is elsewhere."""
        ...

    def release(self, keys: Keys) -> None:
        """The button is up."""
        ...

    def cancel(self) -> None:
        """The user thinks better of it."""
        ...


class Controller:
    """Turns events into commands for a stage.

    Args:
        stage: what is commanded.
    """

    def __init__(self, stage: Stage) -> None:
        """Begin idle."""
        self._stage = stage
        self._drag: Drag | None = None
        self._button: Button | None = None

    @property
    def dragging(self) -> bool:
        """Whether a button is down."""
        return self._drag is not None

    def move(self, pixel: Pixel, keys: Keys = Keys()) -> None:
        """The mouse has moved."""
        if self._drag is not None:
            self._drag.move(pixel, keys)
        else:
            self._stage.hover(self._under(pixel))

    def leave(self) -> None:
        """The mouse has left the picture."""
        if self._drag is None:
            self._stage.hover(Hover())

    def press(self, button: Button, pixel: Pixel, keys: Keys = Keys()) -> None:
        """A button has gone down; a second one during a drag is ignored."""
        if self._drag is not None:
            return
        self._button = button
        self._drag = self._begin(button, pixel, keys)

    def release(self, button: Button, pixel: Pixel, keys: Keys = Keys()) -> None:
        """A button has come up."""
        if self._drag is None or button != self._button:
            return
        drag, self._drag = self._drag, None
        drag.move(pixel, keys)
        drag.release(keys)
        self._stage.hover(self._under(pixel))

    def wheel(self, notches: float, pixel: Pixel) -> None:
        """The wheel has turned; positive is away from the user, and nearer."""
        if self._drag is None:
            self._stage.camera = self._stage.camera.zoomed(_ZOOM**notches, pixel, self._stage.size)
            self._stage.camera_moved()

    def cancel(self) -> bool:
        """Give up the drag under way; false if there is none."""
        if self._drag is None:
            return False
        drag, self._drag = self._drag, None
        drag.cancel()
        return True

    def _under(self, pixel: Pixel) -> Hover:
        """What a press of the left button would take."""
        stage = self._stage
        if stage.mode == "paint":
            return Hover(vertex=stage.vertex_at(pixel))
        gizmo = stage.gizmo
        part = gizmo.part_at(pixel, stage.camera, stage.size) if gizmo else None
        # A handle lies at the centre of its manipulator: of the two, the handle is taken there.
        handle = stage.handle_at(pixel)
        if handle is not None and (part is None or part == "s" or handle in stage.selected):
            return Hover(part="s") if part == "s" else Hover(handle=handle)
        if part is not None:
            return Hover(part=part)
        return Hover(vertex=stage.vertex_at(pixel))

    def _begin(self, button: Button, pixel: Pixel, keys: Keys) -> Drag:
        stage = self._stage
        if button == "middle" or (button == "right" and keys.shift):
            return _Pan(stage, pixel)
        if button == "right" or keys.alt:
            return _Orbit(stage, pixel)
        if keys.control and stage.mode == "drag":
            return _Box(stage, pixel)
        under = self._under(pixel)
        if stage.mode == "paint":
            return _Orbit(stage, pixel) if under.vertex is None else _Paint(stage, under.vertex)
        if under.part is not None:
            return _Exact(stage, under.part, pixel)
        if under.handle is not None:
            return _Grasp(stage, under.handle, pixel, keys)
        if under.vertex is not None:
            return _Placing(stage, under.vertex, pixel, keys)
        return _Orbit(stage, pixel, lambda: stage.select([]))


class _Way:
    """The way of the mouse since the press; with Shift it counts a tenth from where it is."""

    def __init__(self, pixel: Pixel) -> None:
        self.start = self.real = self.counted = np.array(pixel, dtype=np.float64)

    def move(self, pixel: Pixel, fine: bool) -> None:
        step = np.subtract(pixel, self.real)
        self.real = self.real + step
        self.counted = self.counted + (FINE if fine else 1.0) * step

    @property
    def is_click(self) -> bool:
        return float(np.abs(self.real - self.start).max()) <= CLICK


class _Orbit:
    def __init__(
        self, stage: Stage, pixel: Pixel, clicked: Callable[[], None] = lambda: None
    ) -> None:
        self._stage, self._way, self._clicked = stage, _Way(pixel), clicked
        self._first = stage.camera
        self._began = False

    def move(self, pixel: Pixel, keys: Keys) -> None:
        self._way.move(pixel, False)
        self._began = self._began or not self._way.is_click
        if self._began:
            right, down = _TURN * (self._way.real - self._way.start)
            self._stage.camera = self._first.orbited(right, down, self._stage.sky)
            self._stage.camera_moved()

    def release(self, keys: Keys) -> None:
        if not self._began:
            self._clicked()

    def cancel(self) -> None:
        self._stage.camera = self._first
        self._stage.camera_moved()


class _Pan:
    def __init__(self, stage: Stage, pixel: Pixel) -> None:
        self._stage, self._start, self._first = stage, pixel, stage.camera

    def move(self, pixel: Pixel, keys: Keys) -> None:
        right, down = np.subtract(pixel, self._start)
        self._stage.camera = self._first.panned(right, down, self._stage.size)
        self._stage.camera_moved()

    def release(self, keys: Keys) -> None:
        pass

    def cancel(self) -> None:
        self._stage.camera = self._first
        self._stage.camera_moved()


class _Box:
    def __init__(self, stage: Stage, pixel: Pixel) -> None:
        self._stage, self._start, self._now = stage, pixel, pixel

    def _corners(self) -> tuple[Pixel, Pixel]:
        (a, b), (c, d) = self._start, self._now
        return (min(a, c), min(b, d)), (max(a, c), max(b, d))

    def move(self, pixel: Pixel, keys: Keys) -> None:
        self._now = pixel
        self._stage.rubber_band(*self._corners())

    def release(self, keys: Keys) -> None:
        self._stage.rubber_band(None, None)
        self._stage.select(self._stage.handles_in(*self._corners()), add=keys.shift)

    def cancel(self) -> None:
        self._stage.rubber_band(None, None)


class _InPlane:
    """Moves what is selected in the camera's plane through the point that was grasped."""

    def __init__(self, stage: Stage, grasped: ArrayLike, way: _Way) -> None:
        self._stage, self.way = stage, way
        self._depth = float(stage.camera.depths(np.reshape(grasped, (1, 3)))[0])

    def move(self, pixel: Pixel, keys: Keys) -> None:
        self.way.move(pixel, keys.shift)
        camera, size = self._stage.camera, self._stage.size
        here = camera.unproject(self.way.counted, self._depth, size)
        there = camera.unproject(self.way.start, self._depth, size)
        self._stage.move_selected(translation(here - there))


class _Grasp:
    """A press on a handle: a click selects it, a drag moves it with all that is selected."""

    def __init__(self, stage: Stage, handle: int, pixel: Pixel, keys: Keys) -> None:
        self._stage, self._handle = stage, handle
        self._was_selected = handle in stage.selected
        self._add = keys.shift or keys.control
        if not self._was_selected:
            stage.select([handle], add=self._add)
        self._plane = _InPlane(stage, stage.position_of(handle), _Way(pixel))
        self._began = False

    def move(self, pixel: Pixel, keys: Keys) -> None:
        if not self._began:
            at = np.abs(np.subtract(pixel, self._plane.way.start)).max()
            self._began = bool(at > CLICK)
        if self._began:
            self._plane.move(pixel, keys)

    def release(self, keys: Keys) -> None:
        if self._began:
            self._stage.commit("Drag")
        elif self._was_selected:
            self._stage.select([self._handle], toggle=self._add)

    def cancel(self) -> None:
        self._stage.revert()


class _Placing:
    """A press on the surface: a click places a handle, a drag places it and takes it along."""

    def __init__(self, stage: Stage, vertex: int, pixel: Pixel, keys: Keys) -> None:
        self._stage, self._vertex, self._add = stage, vertex, keys.shift
        self._way, self._plane = _Way(pixel), None

    def move(self, pixel: Pixel, keys: Keys) -> None:
        if self._plane is None:
            if float(np.abs(np.subtract(pixel, self._way.start)).max()) <= CLICK:
                return
            handle = self._stage.place(self._vertex, self._add)
            self._plane = _InPlane(self._stage, self._stage.position_of(handle), self._way)
        self._plane.move(pixel, keys)

    def release(self, keys: Keys) -> None:
        if self._plane is None:
            self._stage.place(self._vertex, self._add)
            self._stage.commit("Place handle")
        else:
            self._stage.commit("Place and drag")

    def cancel(self) -> None:
        self._stage.revert()


class _Exact:
    """A drag of a part of the manipulator."""

    def __init__(self, stage: Stage, part: str, pixel: Pixel) -> None:
        gizmo = stage.gizmo
        assert gizmo is not None
        self._stage, self._part, self._gizmo, self._way = stage, part, gizmo, _Way(pixel)

    def move(self, pixel: Pixel, keys: Keys) -> None:
        self._way.move(pixel, keys.shift)
        camera, size = self._stage.camera, self._stage.size
        motion = self._gizmo.motion(self._part, self._way.start, self._way.counted, camera, size)
        if motion is not None:
            self._stage.move_selected(motion)

    def release(self, keys: Keys) -> None:
        self._stage.commit({"r": "Rotate", "s": "Scale"}.get(self._part[0], "Move"))

    def cancel(self) -> None:
        self._stage.revert()


class _Paint:
    def __init__(self, stage: Stage, vertex: int) -> None:
        self._stage = stage
        stage.brush(vertex)

    def move(self, pixel: Pixel, keys: Keys) -> None:
        vertex = self._stage.vertex_at(pixel)
        if vertex is not None:
            self._stage.brush(vertex)

    def release(self, keys: Keys) -> None:
        self._stage.finish_region(add=keys.shift)

    def cancel(self) -> None:
        self._stage.revert()
