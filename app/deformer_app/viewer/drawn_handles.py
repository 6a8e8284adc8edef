"""Handles as they are drawn: dots, targets and patches, and which of them is at a pixel."""

from __future__ import annotations

from collections.abc import Iterable, Sequence, Set
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from deformer_app.rendering.camera import Camera
from deformer_app.rendering.palette import KINDS, SELECTED
from deformer_app.viewer.edit import Handle, Point
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.overlays import HandleDots
from deformer_app.viewer.patches import Patch

_NEAR = 10.0  # pixels from a handle within which a press is on it
_BALL, _REGION_BALL, _HOVERED_MORE = 14, 8, 4  # pixels


class _Picture(Protocol):
    """What a hit test asks of the picture."""

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        ...

    def sees(self, point: NDArray[np.float64]) -> bool:
        """Return True if the surface does not hide a point (3,)."""
        ...


class DrawnHandles:
    """Handles of a surface as a picture shows them.

    Args:
        vertices: (V, 3) the surface that the handles lie on.
        handles: all that there are.
        selected: ids of the selected handles.
        hovered: id of the handle under the mouse; None without one.

    Attributes:
        dots: dots of all handles.
    """

    def __init__(
        self,
        vertices: NDArray[np.float64],
        handles: Sequence[Handle],
        selected: Set[int],
        hovered: int | None,
    ) -> None:
        """Lay out the dots."""
        rows = [
            (vertex, target, handle)
            for handle in handles
            for vertex, target in _shown_targets(handle)
        ]
        colours = [SELECTED if h.id in selected else KINDS[h.kind] for _, _, h in rows]
        sizes = [
            (_REGION_BALL if handle.is_region else _BALL)
            + (_HOVERED_MORE if handle.id == hovered else 0)
            for _, _, handle in rows
        ]
        targets = np.array([target for _, target, _ in rows]).reshape(-1, 3)
        positions = vertices[[vertex for vertex, _, _ in rows]]
        self.dots = HandleDots(positions, targets, colours, sizes)
        self._owners = [handle.id for _, _, handle in rows]  # of each dot
        self._handles, self._selected = handles, selected

    def at(self, pixel: Pixel, camera: Camera, picture: _Picture) -> int | None:
        """Return the id of the visible handle whose vertex or target is at a pixel."""
        if not self._owners:
            return None
        both = np.vstack([self.dots.positions, self.dots.targets])
        apart = camera.project(both, picture.size) - pixel
        distance = np.sqrt((apart**2).sum(axis=1))
        owners = self._owners
        for row in np.argsort(distance):
            if distance[row] > _NEAR:
                return None
            if row >= len(owners) or picture.sees(both[row]):  # nothing hides a target
                return owners[row % len(owners)]
        return None

    def within(self, low: Pixel, high: Pixel, camera: Camera, picture: _Picture) -> list[int]:
        """Return the ids of the handles within a rectangle of the picture; see `at`."""
        if not self._owners:
            return []
        at = camera.project(self.dots.positions, picture.size)
        inside = ((at >= low) & (at <= high)).all(axis=1)
        return sorted({self._owners[n] for n in np.flatnonzero(inside)})

    @property
    def patches(self) -> list[Patch]:
        """Patches of regions in the colours of their handles; the selected ones last."""
        chosen = self._selected
        regions = sorted((h for h in self._handles if h.patch), key=lambda h: h.id in chosen)
        return [Patch(h.patch, SELECTED if h.id in chosen else KINDS[h.kind]) for h in regions]


def _shown_targets(handle: Handle) -> Iterable[tuple[int, Point]]:
    """Vertices and targets that are drawn: of a pin's disc, its middle."""
    every = zip(handle.vertices, handle.targets, strict=True)
    return list(every)[:1] if handle.radius else every
