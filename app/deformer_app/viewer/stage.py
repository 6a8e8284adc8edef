"""The interface between the controller of the mouse and an editor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer_app.rendering.camera import Camera
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.gizmo import Gizmo, Motion

Tool = Literal["drag", "paint"]  # of the left button


@dataclass(frozen=True)
class Hover:
    """What is under the cursor: at most one of a vertex, a handle's id and a manipulator's part."""

    vertex: int | None = None
    handle: int | None = None
    part: str | None = None


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

    def vertex_at(self, pixel: Pixel) -> int | None:
        """Return the visible vertex nearest to a pixel on the surface."""
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

    def select(self, handles: Sequence[int], add: bool = False, toggle: bool = False) -> None:
        """Select handles: these alone, in addition, or toggled."""
        ...

    def place(self, vertex: int, add: bool) -> int:
        """Place a handle on a vertex and select it, within the current change; return its id."""
        ...

    def move_selected(self, motion: Motion) -> None:
        """Move the selected handles relative to the start of this drag."""
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

    def finish_region(self, add: bool) -> None:
        """Make a handle of the painted region."""
        ...
