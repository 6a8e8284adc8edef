"""State of the picture apart from the pose: camera, look, selection, manipulator, target."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

import deformer
from deformer import DeformationModel, Mesh, io
from deformer_app.rendering.camera import Camera, aim, upright_axes
from deformer_app.rendering.palette import DARK, KINDS, LIGHT, SELECTED
from deformer_app.viewer.changes import (
    CameraMoved,
    Change,
    HandlesChanged,
    HoverChanged,
    LookChanged,
)
from deformer_app.viewer.colouring import COLOURINGS, Paint
from deformer_app.viewer.edit import Handle, point
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.gizmo import Gizmo, Mode
from deformer_app.viewer.overlays import HandleDots
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.stage import Hover, Tool
from deformer_app.viewer.target import Target

_REST = 0.25  # seconds without change after which the picture is drawn sharply
_NEAR = 10.0  # pixels from a handle within which a press is on it
_BALL, _REGION_BALL, _HOVERED_MORE = 14, 8, 4  # pixels


@dataclass(frozen=True)
class Look:
    """How the picture is drawn; part of a session.

    Args:
        colour: name of a colouring, see `Colouring`.
        ghost: which other mesh is drawn translucently.
        wireframe: draw the faces' edges.
        smooth: shade across the edges of faces.
        dark: use the dark theme.
    """

    colour: str = "plain"
    ghost: Literal["none", "reference", "target"] = "none"
    wireframe: bool = False
    smooth: bool = True
    dark: bool = False


class ViewState:
    """The state of one picture, with its drawing.

    Args:
        view: the picture.
        announce: called with every change.
        wake: called when the picture must be drawn again.
    """

    def __init__(
        self, view: MeshView, announce: Callable[[Change], Any], wake: Callable[[], Any]
    ) -> None:
        """Begin without a mesh."""
        self.view = view
        self.look = Look()
        self.tool: Tool = "drag"
        self.gizmo_mode: Mode = "move"
        self.selected: frozenset[int] = frozenset()
        self.hovered = Hover()
        self.target: Target | None = None
        self._camera = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0))
        self._announce, self._wake = announce, wake
        self._reference: Mesh | None = None
        self._up = "y"
        self._paint: Paint | None = None
        self._stale = False
        self._changed_at = self._drawn_at = 0.0

    @property
    def target_mesh(self) -> Mesh | None:
        """The mesh to compare with, if there is one."""
        return None if self.target is None else self.target.mesh

    def show_model(self, model: DeformationModel) -> None:
        """Begin with the reference of a model."""
        self._reference = model.reference
        self._up = str(model.summary.get("up", "y"))
        self.selected, self.hovered, self.target, self.tool = frozenset(), Hover(), None, "drag"
        vertices, faces = model.reference.vertices, model.reference.faces
        self.view.surface.set_mesh(vertices, faces, deformer.vertex_normals(vertices, faces))

    # When to draw.

    def invalidate(self) -> None:
        """Mark the picture as out of date."""
        self._stale, self._changed_at = True, time.perf_counter()
        self._wake()

    @property
    def is_stale(self) -> bool:
        """True while the picture does not show this state."""
        return self._stale

    @property
    def seconds_since_frame(self) -> float:
        """Seconds since the last frame."""
        return time.perf_counter() - self._drawn_at

    def sharpen_at_rest(self) -> None:
        """Draw a sharp frame if nothing has changed for a moment."""
        at_rest = not self._stale and time.perf_counter() - self._changed_at > _REST
        if at_rest and self.view.sharpen(True):
            self.view.render()

    def draw(self, vertices: NDArray[np.float64], handles: Sequence[Handle]) -> None:
        """Draw a frame with the handles of a surface (V, 3)."""
        self._stale = False
        self.view.sharpen(False)
        overlays, vertex = self.view.overlays, self.hovered.vertex
        overlays.show_handles(self._dots(vertices, handles)[0])
        oriented = [handle for handle in handles if handle.orientation is not None]
        overlays.show_frames([(h.centre, np.array(h.orientation)) for h in oriented])
        overlays.show_hover([] if vertex is None else vertices[[vertex]])
        overlays.show_gizmo(self.gizmo(handles), self.hovered.part)
        self.view.render()
        self._drawn_at = time.perf_counter()

    # Camera.

    @property
    def camera(self) -> Camera:
        """The camera of the picture."""
        return self._camera

    def set_camera(self, camera: Camera) -> None:
        """Set the camera."""
        self._camera = camera
        self.view.look(camera)
        self.invalidate()
        self._announce(CameraMoved())

    @property
    def sky(self) -> NDArray[np.float64]:
        """The model's up direction (3,)."""
        return upright_axes(self._up)[1]

    def frame(self, vertices: ArrayLike, azimuth: float = 25.0, elevation: float = 8.0) -> None:
        """Aim the camera at points (n, 3) from a direction in degrees; see `aim`."""
        width, height = self.view.size
        self.set_camera(
            aim(
                vertices,
                up=self._up,
                azimuth=azimuth,
                elevation=elevation,
                aspect=width / height,
                margin=0.17,
            )
        )

    # Looks.

    def change_look(self, **changes: Any) -> None:
        """Change how the picture is drawn; see `Look`."""
        before, self.look = self.look, replace(self.look, **changes)
        look, view = self.look, self.view
        theme = DARK if look.dark else LIGHT
        if theme is not view.theme:
            view.set_theme(theme)
        view.surface.set_style(look.smooth, look.wireframe)
        ghosts = {"reference": self._reference, "target": self.target_mesh, "none": None}
        view.surface.show_ghost(ghosts[look.ghost])
        if before.colour != look.colour:
            self.show_paint(None)
        self.invalidate()
        self._announce(LookChanged())

    def show_paint(self, paint: Paint | None) -> None:
        """Colour the surface."""
        self._paint = paint
        self.view.surface.paint(paint)

    def preview_paint(self, paint: Paint | None) -> None:
        """Colour the surface temporarily; None restores the colours of `show_paint`."""
        self.view.surface.paint(self._paint if paint is None else paint)
        self.invalidate()

    def set_tool(self, tool: Tool) -> None:
        """Choose what the left button does."""
        self.tool = tool
        self.invalidate()
        self._announce(LookChanged())

    def set_gizmo(self, mode: Mode) -> None:
        """Choose what the manipulator does."""
        self.gizmo_mode = mode
        self.invalidate()
        self._announce(LookChanged())

    # Handles.

    def select(self, handles: Iterable[int], add: bool = False, toggle: bool = False) -> None:
        """Select handles by their ids: these alone, in addition, or toggled."""
        new = frozenset(handles)
        if toggle:
            new = self.selected ^ new
        elif add:
            new = self.selected | new
        if new != self.selected:
            self.selected = new
            self.invalidate()
            self._announce(HandlesChanged())

    def forget_missing(self, handles: Iterable[Handle]) -> None:
        """Deselect all ids that are not in `handles`."""
        self.selected &= {handle.id for handle in handles}

    def selection(self, handles: Iterable[Handle]) -> list[Handle]:
        """Return the selected ones of `handles`."""
        return [handle for handle in handles if handle.id in self.selected]

    def movable(self, handles: Iterable[Handle]) -> list[Handle]:
        """Return the selected ones of `handles` that a drag moves: all but pins."""
        return [handle for handle in self.selection(handles) if handle.kind != "pin"]

    def gizmo(self, handles: Iterable[Handle]) -> Gizmo | None:
        """Return the manipulator of those of `handles` that are selected and can be moved."""
        moved = self.movable(handles)
        if not moved or self.tool == "paint":
            return None
        several = sum(len(handle.vertices) for handle in moved) > 1
        centre = point(np.mean([handle.centre for handle in moved], axis=0))
        # Nothing of a single point can be scaled.
        return Gizmo(
            centre, "move" if self.gizmo_mode == "scale" and not several else self.gizmo_mode
        )

    def hover(self, found: Hover) -> None:
        """Highlight what is under the cursor."""
        if found != self.hovered:
            self.hovered = found
            self.invalidate()
            self._announce(HoverChanged())

    def handle_at(
        self, pixel: Pixel, vertices: NDArray[np.float64], handles: Sequence[Handle]
    ) -> int | None:
        """Return the id of the visible handle whose vertex or target is at a pixel.

        Args:
            pixel: of the picture.
            vertices: (V, 3) the surface that the handles lie on.
            handles: all that there are.
        """
        if not handles:
            return None
        dots, owners = self._dots(vertices, handles)
        both = np.vstack([dots.positions, dots.targets])
        apart = self.camera.project(both, self.view.size) - pixel
        distance = np.sqrt((apart**2).sum(axis=1))
        for row in np.argsort(distance):
            if distance[row] > _NEAR:
                return None
            if row >= len(owners) or self.view.sees(both[row]):  # nothing hides a target
                return owners[row % len(owners)]
        return None

    def handles_in(
        self, low: Pixel, high: Pixel, vertices: NDArray[np.float64], handles: Sequence[Handle]
    ) -> list[int]:
        """Return the ids of the handles within a rectangle of the picture; see `handle_at`."""
        if not handles:
            return []
        dots, owners = self._dots(vertices, handles)
        at = self.camera.project(dots.positions, self.view.size)
        inside = ((at >= low) & (at <= high)).all(axis=1)
        return sorted({owners[n] for n in np.flatnonzero(inside)})

    def _dots(
        self, vertices: NDArray[np.float64], handles: Sequence[Handle]
    ) -> tuple[HandleDots, list[int]]:
        """Dots of all handles, and the id of the handle that each belongs to."""
        rows = [
            (vertex, target, handle)
            for handle in handles
            for vertex, target in zip(handle.vertices, handle.targets, strict=True)
        ]
        colours = [
            SELECTED if handle.id in self.selected else KINDS[handle.kind] for _, _, handle in rows
        ]
        sizes = [
            (_REGION_BALL if handle.is_region else _BALL)
            + (_HOVERED_MORE if handle.id == self.hovered.handle else 0)
            for _, _, handle in rows
        ]
        targets = np.array([target for _, target, _ in rows]).reshape(-1, 3)
        positions = vertices[[vertex for vertex, _, _ in rows]]
        return HandleDots(positions, targets, colours, sizes), [h.id for _, _, h in rows]

    # In a session.

    def as_json(self) -> dict[str, Any]:
        """Return the part of this state that a session stores."""
        return {
            "camera": asdict(self._camera),
            "look": asdict(self.look),
            "target": None if self.target is None else self.target.as_json(),
        }

    def restore(self, data: dict[str, Any]) -> list[str]:
        """Restore the result of `as_json`, as far as it is complete.

        Returns:
            Messages for the user.

        Raises:
            InputError: the data are damaged.
        """
        assert self._reference is not None, "no model is shown"
        message = ""
        view = io.JsonValue(data, "session", "view")
        if data.get("camera"):
            camera = view["camera"]
            position, focal, up = (
                point(camera[name].numbers(3)) for name in ("position", "focal", "up")
            )
            self._camera = Camera(
                position, focal, up, camera["view_angle"].number(above=0, most=179)
            )
        look = _look(view["look"]) if "look" in data else Look()
        if data.get("target"):
            target = view["target"]
            self.target, message = Target.restore(
                target["path"].text(), target["sha256"].text(), self._reference
            )
        if self.target_mesh is None:
            ghost = "none" if look.ghost == "target" else look.ghost
            colour = "plain" if look.colour == "error" else look.colour
            look = replace(look, ghost=ghost, colour=colour)
        self.change_look(**asdict(look))
        self.set_camera(self._camera)
        return [message] if message else []


def _look(value: io.JsonValue) -> Look:
    flags = ("wireframe", "smooth", "dark")
    value.check_keys((), ("colour", "ghost", *flags))
    found: dict[str, Any] = {name: value[name].flag() for name in flags if name in value}
    if "ghost" in value:
        found["ghost"] = value["ghost"].choice(("none", "reference", "target"))
    if "colour" in value:
        name, _, number = value["colour"].text().partition(":")
        known = name in COLOURINGS and (not number or (name == "component" and number.isdecimal()))
        if not known:
            raise value["colour"].error(f"one of {', '.join(COLOURINGS)}")
        found["colour"] = value["colour"].value
    return Look(**found)
