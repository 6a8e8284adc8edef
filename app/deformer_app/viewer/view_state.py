"""State of the picture apart from the pose: look, tool, selection, manipulator, target."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import DeformationModel, Mesh
from deformer_app.rendering.camera import Camera
from deformer_app.rendering.palette import DARK, LIGHT, REGION
from deformer_app.viewer.changes import (
    Change,
    HandlesChanged,
    HoverChanged,
    LookChanged,
    MenuAsked,
)
from deformer_app.viewer.colouring import Paint
from deformer_app.viewer.drawn_handles import DrawnHandles
from deformer_app.viewer.edit import Edit, Handle
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.gizmo import Gizmo, Mode
from deformer_app.viewer.look import Look
from deformer_app.viewer.manipulator import Axes, Manipulator
from deformer_app.viewer.model_files import of_open_model
from deformer_app.viewer.patches import Patch
from deformer_app.viewer.previous_pose import PreviousPose
from deformer_app.viewer.reference_picture import ReferencePicture
from deformer_app.viewer.saved_cameras import SavedCameras
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.stage import Hover, Measure, Tool
from deformer_app.viewer.target import Target
from deformer_app.viewer.view_cube import Side, is_reached, side_at
from deformer_app.viewer.viewpoint import Viewpoint

_REST = 0.25  # seconds without change after which the picture is drawn sharply
_COMPARED = "compared"  # name of the ghost that the look chooses


class ViewState:
    """The state of one picture, with its drawing.

    Args:
        view: the picture.
        announce: called with every change.
        wake: called when the picture must be drawn again.
        run: runs a job step by step.

    Attributes:
        viewpoint: the camera, with its framing.
        cameras: those that the user has saved.
        reference_picture: what the user poses by.
        drawings: called before each frame with the surface (V, 3) and the handles, to draw more.
        acting: gives handles with their targets where they act, which is where they are drawn.
    """

    def __init__(
        self,
        view: MeshView,
        announce: Callable[[Change], Any],
        wake: Callable[[], Any],
        run: Callable[[Iterator[None]], Any],
    ) -> None:
        """Begin without a mesh."""
        self.view = view
        self.look = Look()
        self.tool: Tool = "drag"
        self.manipulator = Manipulator()
        self.selected: frozenset[int] = frozenset()
        self._gone: frozenset[int] = frozenset()  # selected once they are there again
        self.hovered = Hover()
        self.target: Target | None = None
        self.drawings: list[Callable[[NDArray[np.float64], Sequence[Handle]], Any]] = []
        self.acting: Callable[[Sequence[Handle]], Sequence[Handle]] = lambda handles: handles
        self.stroke: tuple[int, ...] = ()  # vertices painted so far
        self._announce, self._wake = announce, wake
        self.viewpoint = Viewpoint(view, announce, self.invalidate)
        self._reference: Mesh | None = None
        self._paint: Paint | None = None
        self.cameras = SavedCameras()
        self.reference_picture = ReferencePicture(view.plane, run, self.invalidate)
        self._previous = PreviousPose()
        self._stale = False
        self._changed_at = self._drawn_at = 0.0

    @property
    def target_mesh(self) -> Mesh | None:
        """The mesh to compare with, if there is one."""
        return None if self.target is None else self.target.mesh

    def show_model(self, model: DeformationModel) -> None:
        """Begin with the reference of a model."""
        self._reference = model.reference
        self.viewpoint.begin(model)
        self.cameras, self._previous = SavedCameras(), PreviousPose()
        self.selected, self.hovered, self.target, self.tool = frozenset(), Hover(), None, "drag"
        self._gone = frozenset()
        self.stroke = ()
        vertices, faces = model.reference.vertices, model.reference.faces
        self.view.surface.set_mesh(vertices, faces, deformer.vertex_normals(vertices, faces))
        self.view.ghosts.set_faces(faces)

    @property
    def camera(self) -> Camera:
        """The camera that the picture is seen by."""
        return self.viewpoint.camera

    @property
    def reference(self) -> Mesh:
        """The reference of the model that is shown."""
        return of_open_model(self._reference)

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
        drawn = self.drawn_handles(vertices, handles)
        overlays.show_handles(drawn.dots)
        oriented = [handle for handle in self.acting(handles) if handle.orientation is not None]
        overlays.show_frames([(h.centre, np.array(h.orientation)) for h in oriented])
        overlays.show_hover([] if vertex is None else vertices[[vertex]])
        gizmo, size = self.gizmo(handles), self.view.size
        overlays.show_gizmo(gizmo, self.hovered.part)
        self.view.cube.fade(gizmo is not None and is_reached(gizmo, self.camera, size))
        self.view.cube.light(self.hovered.side)
        self.view.surface.show_patches(
            [*drawn.patches, *([Patch(self.stroke, REGION)] if self.stroke else ())]
        )
        for drawing in self.drawings:
            drawing(vertices, handles)
        self.view.render()
        self._drawn_at = time.perf_counter()

    # Looks.

    def change_look(self, **changes: Any) -> None:
        """Change how the picture is drawn; see `Look`."""
        before, self.look = self.look, replace(self.look, **changes)
        look, view = self.look, self.view
        theme = DARK if look.dark else LIGHT
        if theme is not view.theme:
            view.set_theme(theme)
        view.surface.set_style(look.smooth, look.wireframe)
        self._show_ghost()
        view.cube.show(look.cube)
        if before.colour != look.colour:
            self.show_paint(None)
        self.invalidate()
        self._announce(LookChanged())

    def _show_ghost(self) -> None:
        """Show the mesh that the look names, or none."""
        meshes = {"reference": self._reference, "target": self.target_mesh}
        mesh = meshes.get(self.look.ghost)
        previous = self._previous.vertices if self.look.ghost == "previous" else None
        vertices = previous if mesh is None else mesh.vertices
        if vertices is None:
            self.view.ghosts.hide(_COMPARED)
        else:
            self.view.ghosts.show(_COMPARED, vertices)

    def note_pose(self, edit: Edit, vertices: NDArray[np.float64], final: bool) -> None:
        """Follow a pose of an edit for the ghost of the previous one; see `PreviousPose`."""
        before = self._previous.vertices
        self._previous.note(edit, vertices, final)
        if self.look.ghost == "previous" and self._previous.vertices is not before:
            self._show_ghost()

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
        self.manipulator.mode = mode
        self.invalidate()
        self._announce(LookChanged())

    def set_axes(self, axes: Axes) -> None:
        """Choose whose axes the manipulator has."""
        self.manipulator.axes = axes
        self.invalidate()
        self._announce(LookChanged())

    def show_measure(self, measure: Measure | None) -> None:
        """Write how far the manipulator has been dragged, and hold its axes until None."""
        self.manipulator.held = None if measure is None else measure.frame
        self.show_label(*((0.0, 0.0), "") if measure is None else (measure.pixel, measure.text))

    def show_label(self, pixel: Pixel, text: str) -> None:
        """Write a line beside the cursor at a pixel; an empty one removes it."""
        self.view.overlays.show_label(pixel, text)
        self.invalidate()

    # Handles.

    def select(self, handles: Iterable[int], add: bool = False, toggle: bool = False) -> None:
        """Select handles by their ids: these alone, in addition, or toggled."""
        new, self._gone = frozenset(handles), frozenset()
        if toggle:
            new = self.selected ^ new
        elif add:
            new = self.selected | new
        if new != self.selected:
            self.selected = new
            self.invalidate()
            self._announce(HandlesChanged())

    def forget_missing(self, handles: Iterable[Handle]) -> None:
        """Deselect all ids that are not in `handles`.

        Until something else is selected, a later call that has them again selects them again:
        undone and redone, a handle is selected as it was.
        """
        wanted, there = self.selected | self._gone, {handle.id for handle in handles}
        self.selected, self._gone = wanted & there, wanted - there

    def selection(self, handles: Iterable[Handle]) -> list[Handle]:
        """Return the selected ones of `handles`."""
        return [handle for handle in handles if handle.id in self.selected]

    def movable(self, handles: Iterable[Handle]) -> list[Handle]:
        """Return the selected ones of `handles` that a drag moves: all but pins."""
        return [handle for handle in self.selection(handles) if handle.kind != "pin"]

    def gizmo(self, handles: Iterable[Handle]) -> Gizmo | None:
        """Return the manipulator of those of `handles` that are selected and can be moved."""
        if self.tool == "paint":
            return None
        return self.manipulator.gizmo(
            self.acting(self.movable(handles)),
            lambda: self.view.surface.normals,
            self.camera,
            self.viewpoint.sky,
        )

    def hover(self, found: Hover) -> None:
        """Highlight what is under the cursor."""
        if found != self.hovered:
            self.hovered = found
            self.invalidate()
            self._announce(HoverChanged())

    def ask_for_menu(self, pixel: Pixel, under: Hover) -> None:
        """Announce that the user asks for the menu of what is under a pixel."""
        self._announce(MenuAsked(pixel, under))

    def cube_at(self, pixel: Pixel) -> Side | None:
        """Return the part of the orientation cube at a pixel, if it is shown."""
        if not self.view.cube.shown:
            return None
        return side_at(pixel, self.camera.axes() @ self.view.frame.T, self.view.size)

    def drawn_handles(
        self, vertices: NDArray[np.float64], handles: Sequence[Handle]
    ) -> DrawnHandles:
        """Return handles of a surface (V, 3) as they are drawn, to find those under the mouse."""
        return DrawnHandles(vertices, self.acting(handles), self.selected, self.hovered.handle)
