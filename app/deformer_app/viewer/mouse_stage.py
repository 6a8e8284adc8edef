"""The controller's `Stage` for an editor."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deformer_app.rendering.camera import Camera
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.gizmo import Gizmo, Motion
from deformer_app.viewer.region_brush import RegionBrush
from deformer_app.viewer.stage import Hover, Tool

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor


class MouseStage:
    """Finds what is under the mouse in an editor's picture, and passes commands to the editor.

    Args:
        editor: receiver of the commands.

    Attributes:
        brush: paints regions.
    """

    def __init__(self, editor: Editor) -> None:
        """Start with nothing painted."""
        self.brush = RegionBrush()
        self._editor = editor

    @property
    def camera(self) -> Camera:
        """The camera of the picture."""
        return self._editor.state.camera

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        return self._editor.state.view.size

    @property
    def sky(self) -> NDArray[np.float64]:
        """The model's up direction (3,)."""
        return self._editor.state.sky

    @property
    def tool(self) -> Tool:
        """What the left button does."""
        return self._editor.state.tool

    @property
    def gizmo(self) -> Gizmo | None:
        """The manipulator of what is selected and can be moved."""
        editor = self._editor
        return editor.state.gizmo(editor.edit.handles) if editor.is_open else None

    @property
    def selected(self) -> frozenset[int]:
        """Ids of the selected handles."""
        return self._editor.selected

    @property
    def hint(self) -> str:
        """A line of text about what the mouse would do here."""
        found = self._editor.state.hovered
        if self._editor.preparing:
            return "Preparing the solver …"
        if self.tool == "paint":
            return "Paint a patch with the left button; Esc gives up"
        if found.part is not None:
            return "Drag to move exactly along this part; Shift for a finer step"
        if found.handle is not None:
            return "Drag the handle; S soft, E exact, P pin, Del removes it"
        if found.vertex is not None:
            return f"Vertex {found.vertex}: click to place a handle, drag to pull it"
        return "Drag the body to bend it, beside it to look around.  F1: all keys"

    def vertex_at(self, pixel: Pixel) -> int | None:
        """Return the visible vertex nearest to a pixel; none before there is a pose."""
        editor = self._editor
        return None if editor.answer is None else editor.state.view.vertex_at(pixel)

    def handle_at(self, pixel: Pixel) -> int | None:
        """Return the id of the visible handle at a pixel: where it is, or its target."""
        editor = self._editor
        if not editor.is_open:
            return None
        return editor.state.handle_at(pixel, editor.vertices, editor.edit.handles)

    def handles_in(self, low: Pixel, high: Pixel) -> list[int]:
        """Return the ids of the handles within a rectangle of the picture."""
        editor = self._editor
        return editor.state.handles_in(low, high, editor.vertices, editor.edit.handles)

    def position_of(self, handle: int) -> NDArray[np.float64]:
        """Return the centre (3,) of a handle's targets."""
        return np.array(self._editor.edit.handle(handle).centre)

    def hover(self, found: Hover) -> None:
        """Highlight what is under the cursor."""
        self._editor.state.hover(found)

    def select(self, handles: Iterable[int], add: bool = False, toggle: bool = False) -> None:
        """Select handles: these alone, in addition, or toggled."""
        self._editor.select(handles, add, toggle)

    def set_camera(self, camera: Camera) -> None:
        """Set the camera."""
        self._editor.state.set_camera(camera)

    def show_box(self, corners: tuple[Pixel, Pixel] | None) -> None:
        """Draw the rectangle from the top left to the bottom right corner, or none."""
        self._editor.state.view.overlays.show_box(corners)
        self._editor.state.invalidate()

    def place(self, vertex: int, add: bool) -> int:
        """Place a handle on a vertex and select it, within the current change; return its id."""
        return self._editor.place(vertex, add)

    def move_selected(self, motion: Motion) -> None:
        """Move the selected handles relative to the start of this drag."""
        self._editor.move_selected(motion)

    def commit(self, label: str) -> None:
        """Make the current change one step of the history."""
        self._editor.commit(label)

    def revert(self) -> None:
        """Discard the current change and the painted region."""
        self.clear_region()
        self._editor.revert()

    def paint_region(self, vertex: int) -> None:
        """Paint the disc around a vertex, along the surface."""
        self.brush.paint(self._editor.model, vertex)
        self._editor.state.view.surface.show_region(self.brush.region)
        self._editor.state.invalidate()

    def finish_region(self, add: bool) -> None:
        """Make one handle of the painted region, and go back to dragging."""
        region = self.brush.region
        self.clear_region()
        self._editor.state.set_tool("drag")
        if region:
            self._editor.add_region(region, add)

    def clear_region(self) -> None:
        """Paint nothing."""
        self.brush.clear()
        self._editor.state.view.surface.show_region(())
