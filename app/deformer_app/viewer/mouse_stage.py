"""The controller's `Stage` for an editor."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from deformer import DeformationModel
from deformer_app.rendering.camera import Camera
from deformer_app.viewer.edit import Handle
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.gizmo import Gizmo, Motion
from deformer_app.viewer.region_brush import RegionBrush
from deformer_app.viewer.stage import Hover, Measure, Tool
from deformer_app.viewer.view_cube import Side, looking_from

_REACH = 6.0  # pixels beside the surface that still count as on it

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
        self._brush_at: int | None = None

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
        return self._editor.state.viewpoint.sky

    @property
    def spans(self) -> tuple[float, float]:
        """The smallest and largest length that the picture's height may show, in model units."""
        return self._editor.state.viewpoint.spans

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
        return self._editor.handles.selected

    @property
    def hint(self) -> str:
        """A line of text about what the mouse would do here."""
        found = self._editor.state.hovered
        if self._editor.preparing:
            return "Preparing the solver …"
        if self.tool == "paint":
            return "Paint a patch with the left button; [ and ] change the brush; Esc gives up"
        if found.side is not None:
            return "Click to look from this side, drag to turn"
        if found.part is not None:
            return "Drag along this part, or type a number meanwhile; Shift for a finer step"
        handle = self._handle_under(found)
        if handle is not None:
            name = self._editor.handles.names.of(handle)
            if handle.kind != "pin":
                return f"{name}: drag the handle; S soft, E exact, P pin, Del removes it"
            size = "; Shift and wheel: its size" if handle.radius else ""
            return f"{name} is pinned: click it, and S frees it for drags, Del removes it" + size
        if found.vertex is not None:
            return f"Vertex {found.vertex}: click to place a handle, drag to pull it, P to pin it"
        return "Drag the body to bend it, beside it to look around.  F1: all keys"

    def _handle_under(self, found: Hover) -> Handle | None:
        """The handle or pin that a press is on; None of one that the last step has removed."""
        editor = self._editor
        if found.vertex is not None:
            return editor.pins.holding(found.vertex)
        return next((h for h in editor.edit.handles if h.id == found.handle), None)

    def cube_at(self, pixel: Pixel) -> Side | None:
        """Return the part of the orientation cube at a pixel."""
        return self._editor.state.cube_at(pixel)

    def look_from(self, side: Side) -> None:
        """Look from a part of the orientation cube; the focal point and the zoom stay."""
        state = self._editor.state
        state.viewpoint.set_camera(looking_from(side, state.camera, state.view.frame))

    def vertex_at(self, pixel: Pixel) -> int | None:
        """Return the visible vertex nearest to a pixel on the surface or a few pixels beside it.

        None before there is a pose.
        """
        editor = self._editor
        return None if editor.answer is None else editor.state.view.vertex_near(pixel, _REACH)

    def depth_at(self, pixel: Pixel) -> float:
        """Return the depth of the surface at a pixel; beside it, of what is seen next to it."""
        return self._editor.state.view.depth_at(pixel)

    def handle_at(self, pixel: Pixel) -> int | None:
        """Return the id of the visible handle at a pixel: where it is, or its target."""
        editor = self._editor
        if not editor.is_open:
            return None
        drawn = editor.state.drawn_handles(editor.vertices, editor.edit.handles)
        return drawn.at(pixel, editor.state.camera, editor.state.view)

    def handles_in(self, low: Pixel, high: Pixel) -> list[int]:
        """Return the ids of the handles within a rectangle of the picture."""
        editor = self._editor
        drawn = editor.state.drawn_handles(editor.vertices, editor.edit.handles)
        return drawn.within(low, high, editor.state.camera, editor.state.view)

    def position_of(self, handle: int) -> NDArray[np.float64]:
        """Return the centre (3,) of a handle's targets."""
        return np.array(self._editor.edit.handle(handle).centre)

    def hover(self, found: Hover) -> None:
        """Highlight what is under the cursor; with the brush, the disc that it would paint."""
        vertex = found.vertex if self.tool == "paint" else None
        if vertex != self._brush_at:
            self._show_brush(vertex)
        self._editor.state.hover(found)

    def context_menu(self, pixel: Pixel, under: Hover) -> None:
        """Announce that the user asks for the menu of what is under a pixel."""
        self._editor.state.ask_for_menu(pixel, under)

    def select(self, handles: Iterable[int], add: bool = False, toggle: bool = False) -> None:
        """Select handles: these alone, in addition, or toggled."""
        self._editor.handles.select(handles, add, toggle)

    def set_camera(self, camera: Camera) -> None:
        """Set the camera."""
        self._editor.state.viewpoint.set_camera(camera)

    def show_box(self, corners: tuple[Pixel, Pixel] | None) -> None:
        """Draw the rectangle from the top left to the bottom right corner, or none."""
        self._editor.state.view.overlays.show_box(corners)
        self._editor.state.invalidate()

    def place(self, vertex: int, add: bool) -> int:
        """Place a handle on a vertex and select it, within the current change; return its id."""
        return self._editor.handles.place(vertex, add)

    def move_selected(self, motion: Motion) -> None:
        """Move the selected handles relative to the start of this drag."""
        self._editor.handles.move_selected(motion)

    def measure(self, measure: Measure | None) -> None:
        """Show beside the cursor how far a part has been dragged; None at the end of its drag."""
        self._editor.state.show_measure(measure)

    def commit(self, label: str) -> None:
        """Make the current change one step of the history."""
        self._editor.commit(label)

    def revert(self) -> None:
        """Discard the current change and the painted region."""
        self.clear_region()
        self._editor.revert()

    # Painting.

    def begin(self, model: DeformationModel) -> None:
        """Begin with another model: the brush has a size for it and has painted nothing."""
        self.brush.fit(model)
        self.clear_region()

    def set_tool(self, tool: Tool) -> None:
        """Choose what the left button does; the brush shows at once where the mouse is."""
        self._editor.state.set_tool(tool)
        self.hover(self._editor.state.hovered)

    def paint_region(self, vertex: int) -> None:
        """Paint the disc around a vertex, along the surface."""
        self.brush.paint(self._editor.model, vertex)
        self._show_stroke()
        self._show_brush(vertex)

    def resize_pin(self, under: Hover, steps: float) -> bool:
        """Make the pin under the cursor larger or smaller; return False if there is none."""
        pins = self._editor.pins
        return pins.resize(steps, pins.at(under.vertex, under.handle))

    def finish_region(self, add: bool) -> None:
        """Make one handle of the painted region, and go back to dragging."""
        region = self.brush.region
        self.clear_region()
        self.set_tool("drag")
        if region:
            self._editor.handles.add_region(region, add)

    def clear_region(self) -> None:
        """Paint nothing."""
        self.brush.clear()
        self._show_stroke()
        self._show_brush(None)

    def resize_brush(self, factor: float) -> None:
        """Make the brush larger or smaller, and show its size."""
        self.brush.resize(factor)
        editor, vertex = self._editor, self._editor.state.hovered.vertex
        size = self.brush.radius * editor.model.reference.bounding_diagonal
        text = f"Brush  {size:.3g} units"
        if self.tool == "paint" and vertex is not None:
            self._show_brush(vertex)
            text += f"   {len(self.brush.disc(editor.model, vertex))} vertices"
            (pixel,) = self.camera.project(editor.vertices[[vertex]], self.size)
            editor.state.show_label((float(pixel[0]), float(pixel[1])), text)
        else:
            editor.note(text)

    def _show_stroke(self) -> None:
        self._editor.state.stroke = tuple(self.brush.region)
        self._editor.state.invalidate()

    def _show_brush(self, vertex: int | None) -> None:
        """Draw the border of the brush around a vertex, or none."""
        self._brush_at, editor, lines = vertex, self._editor, []
        if vertex is not None:
            lines = self.brush.outline(editor.model, vertex, editor.vertices)
        editor.state.view.overlays.show_brush(lines)
        editor.state.show_label((0.0, 0.0), "")
