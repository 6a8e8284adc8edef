"""The interface between the controller of the mouse and an editor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer_app.rendering.camera import Camera
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.gizmo import Frame, Gizmo, Motion
from deformer_app.viewer.view_cube import Side

Tool = Literal["drag", "paint"]  # of the left button


@dataclass(frozen=True)
class Measure:
    """How far a part of the manipulator has been dragged.

    Args:
        pixel: of the mouse.
        text: the amount, with its unit.
        frame: axes of the manipulator at the beginning of the drag, which it has until the end.
    """

    pixel: Pixel
    text: str
    frame: Frame


@dataclass(frozen=True)
class Hover:
    """What is under the cursor: at most one thing.

    Args:
        vertex: number of a vertex.
        handle: id of a handle.
        part: name of a part of the manipulator.
        side: part of the orientation cube.
    """

    vertex: int | None = None
    handle: int | None = None
    part: str | None = None
    side: Side | None = None


class Stage(Protocol):
    """Queries and commands of the controller."""

    @property
    def camera(self) -> Camera:
        """The camera of the picture."""
        ...

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        ...

    @property
    def sky(self) -> ArrayLike:
        """The direction (3,) that stays up while orbiting."""
        ...

    @property
    def spans(self) -> tuple[float, float]:
        """The smallest and largest length that the picture's height may show, in model units."""
        ...

    @property
    def tool(self) -> Tool:
        """What the left button does."""
        ...

    @property
    def gizmo(self) -> Gizmo | None:
        """The manipulator, if it is shown."""
        ...

    @property
    def selected(self) -> frozenset[int]:
        """Ids of the selected handles."""
        ...

    def cube_at(self, pixel: Pixel) -> Side | None:
        """Return the part of the orientation cube at a pixel."""
        ...

    def look_from(self, side: Side) -> None:
        """Look from a part of the orientation cube."""
        ...

    def vertex_at(self, pixel: Pixel) -> int | None:
        """Return the visible vertex nearest to a pixel on the surface."""
        ...

    def depth_at(self, pixel: Pixel) -> float:
        """Return the depth of the surface at a pixel; beside it, of what is seen next to it."""
        ...

    def handle_at(self, pixel: Pixel) -> int | None:
        """Return the id of the visible handle at a pixel."""
        ...

    def handles_in(self, low: Pixel, high: Pixel) -> Sequence[int]:
        """Return the ids of the handles within a rectangle of the picture."""
        ...

    def position_of(self, handle: int) -> NDArray[np.float64]:
        """Return the point (3,) at which a handle is dragged."""
        ...

    def hover(self, found: Hover) -> None:
        """Highlight what is under the cursor."""
        ...

    def context_menu(self, pixel: Pixel, under: Hover) -> None:
        """Offer what can be done with what is under a pixel."""
        ...

    def select(self, handles: Sequence[int], add: bool = False, toggle: bool = False) -> None:
        """Select handles: these alone, in addition, or toggled."""
        ...

    def place(self, vertex: int, add: bool) -> int:
        """Place a handle on a vertex and select it, within the current change; return its id."""
        ...

    def move_selected(self, motion: Motion) -> None:
        """Move the selected handles relative to the start of this drag."""
        ...

    def measure(self, measure: Measure | None) -> None:
        """Show beside the cursor how far a part has been dragged; None at the end of its drag."""
        ...

    def commit(self, label: str) -> None:
        """Make the current change one step of the history."""
        ...

    def revert(self) -> None:
        """Discard the current change."""
        ...

    def set_camera(self, camera: Camera) -> None:
        """Set the camera."""
        ...

    def show_box(self, corners: tuple[Pixel, Pixel] | None) -> None:
        """Draw the rectangle from the top left to the bottom right corner, or none."""
        ...

    def paint_region(self, vertex: int) -> None:
        """Paint the region around a vertex."""
        ...

    def resize_pin(self, under: Hover, steps: float) -> bool:
        """Make the pin under the cursor larger or smaller; return False if there is none."""
        ...

    def finish_region(self, add: bool) -> None:
        """Make a handle of the painted region."""
        ...
