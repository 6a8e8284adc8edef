"""Drawings over the surface: handles, manipulator, highlights and texts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from vtkmodules.vtkRenderingCore import vtkRenderer, vtkTextActor

from deformer_app.rendering.camera import Camera
from deformer_app.rendering.palette import AXES, HANDLE, HOVERED, SELECTED, TARGET, Theme, rgb
from deformer_app.viewer.cursor_label import CursorLabel
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.gizmo import Gizmo
from deformer_app.viewer.primitives import Dots, Strokes

Corner = Literal["bottom", "top", "middle"]  # left, right, and of the picture

_HOVER = 12  # pixels, diameter of the ball under the mouse
_FRAME = 26.0  # pixels from the origin to the tip of an axis of an orientation
_RISE = 1.5  # radii by which a ball is drawn above the surface that its centre lies on
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 33)
_CIRCLE = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
_APART = 4.0  # distance in pixels from which a line joins handle and target
_CORNERS: dict[Corner, tuple[float, float]] = {
    "bottom": (0.015, 0.02),
    "top": (0.985, 0.98),
    "middle": (0.5, 0.5),
}


@dataclass(frozen=True, eq=False)
class HandleDots:
    """Handles to draw.

    Args:
        positions: (n, 3) positions of the handles' vertices.
        targets: (n, 3) their targets.
        colours: n names of colours.
        sizes: n diameters in pixels.
    """

    positions: NDArray[np.float64]
    targets: NDArray[np.float64]
    colours: Sequence[str]
    sizes: Sequence[int]


class Overlays:
    """Dots, strokes and texts of one picture.

    Args:
        scene: renderer of the surface, which hides what is behind it.
        above: renderer of a layer that nothing hides.
        size: gives width and height of the picture in pixels, which may change at any time.
    """

    def __init__(
        self, scene: vtkRenderer, above: vtkRenderer, size: Callable[[], tuple[int, int]]
    ) -> None:
        """Begin with nothing to draw."""
        self._scene, self._size = scene, size
        self._camera: Camera | None = None
        self._ink = ""
        self._scale = (1.0, 1.0)
        self._balls: dict[int, Dots] = {}
        self._hover = Dots(scene, _HOVER)
        self._residuals, self._targets = Strokes(above, 2.5), Dots(above, 9)
        self._frames, self._rings = Strokes(above, 2.5), Strokes(above, 1.5)
        self._gizmo, self._gizmo_lit = Strokes(above, 3.5), Strokes(above, 5.5)
        self._tips, self._box = Dots(above, 11), Strokes(above, 1.5)
        self.label = CursorLabel(above)
        self._brush = Strokes(above, 2.0)
        self._texts = {corner: _text(above, corner) for corner in _CORNERS}

    def look(self, camera: Camera) -> None:
        """Set the camera for the following drawings."""
        self._camera = camera

    def magnify(self, scene: float, above: float) -> None:
        """Set the factor on all sizes in pixels."""
        self._scale = scene, above
        for dots in (*self._balls.values(), self._hover):
            dots.magnify(scene)
        for item in (self._residuals, self._targets, self._frames, self._rings, self._gizmo,
                     self._gizmo_lit, self._tips, self._box, self._brush):  # fmt: skip
            item.magnify(above)

    def set_theme(self, theme: Theme) -> None:
        """Change the colours of texts and outlines."""
        self._ink = theme.ink
        self.label.set_theme(theme)
        for text in self._texts.values():
            text.GetTextProperty().SetColor(*(c / 255 for c in rgb(theme.ink)))
            text.GetTextProperty().SetBackgroundColor(*(c / 255 for c in rgb(theme.background)))

    def show_handles(self, handles: HandleDots) -> None:
        """Draw handles as balls, with lines to targets that are visibly apart."""
        for size in set(self._balls) | set(handles.sizes):
            rows = [n for n, s in enumerate(handles.sizes) if s == size]
            balls = self._above_surface(handles.positions[rows], size)
            if size not in self._balls:
                self._balls[size] = Dots(self._scene, size)
                self._balls[size].magnify(self._scale[0])
            self._balls[size].show(balls, [handles.colours[n] for n in rows])
        self._targets.clear()
        self._residuals.clear()
        if not len(handles.positions) or self._camera is None:
            return
        both = np.vstack([handles.positions, handles.targets])
        here, there = self._camera.project(both, self._size()).reshape(2, -1, 2)
        apart = np.sqrt(((here - there) ** 2).sum(axis=1)) > _APART
        lines = np.stack([handles.positions[apart], handles.targets[apart]], axis=1)
        self._targets.show(handles.targets[apart], [TARGET] * len(lines))
        self._residuals.show(list(lines), [TARGET] * len(lines))

    def hide_handles(self) -> None:
        """Draw no handles, nor what belongs to them, until they are shown again."""
        self.show_handles(HandleDots(np.zeros((0, 3)), np.zeros((0, 3)), [], []))
        self.show_frames([])
        self.show_rings([], 0.0, TARGET)
        self.show_hover([])
        self.show_gizmo(None, None)

    def show_frames(self, frames: Sequence[tuple[ArrayLike, NDArray[np.float64]]]) -> None:
        """Draw the axes of orientations (3, 3), as they are turned, at points (3,)."""
        lines, colours = [], []
        if self._camera is not None:
            for origin, R in frames:
                length = _FRAME * self._camera.pixel_size(origin, self._size())
                lines += [np.stack([origin, origin + length * axis]) for axis in R.T]
                colours += AXES.values()
        self._frames.show(lines, colours)

    def show_rings(self, centres: Sequence[ArrayLike], radius: float, colour: str) -> None:
        """Draw thin rings of a radius in pixels around points (3,), facing the camera."""
        rings = []
        if self._camera is not None:
            for centre in centres:
                at = self._camera.project(np.reshape(centre, (1, 3)), self._size())[0]
                depth = float(self._camera.depths(np.reshape(centre, (1, 3)))[0])
                rim = at + radius * _CIRCLE
                rings.append(
                    np.array([self._camera.unproject(p, depth, self._size()) for p in rim])
                )
        self._rings.show(rings, [colour] * len(rings))

    def show_hover(self, points: ArrayLike) -> None:
        """Highlight points (n, 3)."""
        spots = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        self._hover.show(self._above_surface(spots, _HOVER), [HOVERED] * len(spots))

    def _above_surface(self, points: NDArray[np.float64], size: int) -> NDArray[np.float64]:
        """Return where balls at points (n, 3) are drawn, so that the surface cuts none in half."""
        if self._camera is None:
            return points
        return self._camera.raised(points, _RISE * size / 2, self._size())

    def show_gizmo(self, gizmo: Gizmo | None, lit: str | None) -> None:
        """Draw the manipulator, with one part highlighted."""
        drawn: dict[bool, list[tuple[NDArray, str]]] = {False: [], True: []}
        if gizmo is not None and self._camera is not None:
            for part in gizmo.parts_seen(self._camera):
                outline = gizmo.outline(part, self._camera, self._size())
                colour = SELECTED if part == lit else self._colour_of(part)
                drawn[part == lit].append((outline, colour))
        for is_lit, strokes in ((False, self._gizmo), (True, self._gizmo_lit)):
            strokes.show([line for line, _ in drawn[is_lit]], [c for _, c in drawn[is_lit]])
        tips = [item for items in drawn.values() for item in items if len(item[0]) == 2]
        self._tips.show(np.array([line[-1] for line, _ in tips]), [c for _, c in tips])

    def _colour_of(self, part: str) -> str:
        if part == "s":
            return self._ink
        # A plane has the colour of its normal axis.
        across = set("xyz") - set(part) if len(part) == 2 and part[0] != "r" else {part[-1]}
        return AXES[across.pop()]

    def show_box(self, corners: tuple[Pixel, Pixel] | None) -> None:
        """Draw the rectangle from the top left to the bottom right corner, or none."""
        if corners is None or self._camera is None:
            self._box.clear()
            return
        low, high = corners
        depth = float(self._camera.depths([self._camera.focal])[0])
        outline = [low, (high[0], low[1]), high, (low[0], high[1]), low]
        points = np.array([self._camera.unproject(p, depth, self._size()) for p in outline])
        self._box.show([points], [self._ink])

    def show_brush(self, lines: Sequence[NDArray[np.float64]]) -> None:
        """Draw the border of the brush, lines (n, 3); without any, no brush."""
        self._brush.show(lines, [HANDLE] * len(lines))

    def show_label(self, pixel: Pixel, text: str) -> None:
        """Write a line beside the cursor at a pixel; an empty one removes it."""
        if text:
            self.label.show(pixel, text, self._size(), self._scale[1])
        else:
            self.label.hide()

    def write(self, corner: Corner, text: str) -> None:
        """Write lines into the bottom left corner, the top right one, or the middle."""
        self._texts[corner].SetInput(text)
        self._texts[corner].SetVisibility(bool(text))


def _text(above: vtkRenderer, corner: Corner) -> vtkTextActor:
    text = vtkTextActor()
    text.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
    text.SetPosition(*_CORNERS[corner])
    style = text.GetTextProperty()
    style.SetFontSize(14)
    if corner == "top":
        style.SetJustificationToRight()
        style.SetVerticalJustificationToTop()
    elif corner == "middle":
        style.SetFontFamilyToCourier()
        style.SetJustificationToCentered()
        style.SetVerticalJustificationToCentered()
        style.SetBackgroundOpacity(0.9)
    text.VisibilityOff()
    above.AddViewProp(text)
    return text
