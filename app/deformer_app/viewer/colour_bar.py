"""The colour bar of a painted surface, on a ground of its own beside the view's right edge."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkCoordinate, vtkPolyDataMapper2D

from deformer_app.rendering.fonts import use_sans
from deformer_app.rendering.palette import Theme, rgb
from deformer_app.viewer.view_cube import BOTTOM, LEFT

# Pixels: width for the longest title and numbers, of the bar itself, around both, to the edge.
_WIDTH, _BAR, _PAD, _EDGE = 118, 12, 8, 12
_LEAST = 70  # pixels that title and numbers need, one above the other
_TITLE_FONT, _FONT = 13, 12  # pixels
_TOP, _HEIGHT = 0.28, 0.42  # from the top of the view and over all, in heights of the view
_OPACITY = 0.85  # of the ground: a surface behind may be as bright, or as dark, as the texts


class ColourBar:
    """At most one colour bar.

    Args:
        plotter: of any kind.
    """

    def __init__(self, plotter: Any) -> None:
        """Begin without a bar."""
        self._plotter = plotter
        self._bar: Any = None
        self._texts: tuple[Any, ...] = ()
        mapper, within = vtkPolyDataMapper2D(), vtkCoordinate()
        within.SetCoordinateSystemToNormalizedViewport()
        mapper.SetTransformCoordinate(within)
        self._square = pv.PolyData(np.zeros((4, 3), dtype=np.float32), [4, 0, 1, 2, 3])
        mapper.SetInputData(self._square)
        self._ground = vtkActor2D()
        self._ground.SetMapper(mapper)
        self._ground.GetProperty().SetOpacity(_OPACITY)
        self._ground.SetVisibility(False)
        plotter.renderer.AddViewProp(self._ground)  # before the bar, and so behind it

    def hide(self) -> None:
        """Remove the bar."""
        for title in list(self._plotter.scalar_bars.keys()):
            self._plotter.remove_scalar_bar(title, render=False)
        self._ground.SetVisibility(False)
        self._bar = None

    def show(self, title: str, mapper: Any, theme: Theme) -> None:
        """Show the colours of a mapper, and no other bar."""
        self.hide()
        bar = self._plotter.add_scalar_bar(
            title,
            mapper=mapper,
            vertical=True,
            n_labels=3,
            fmt="%.2g",
            title_font_size=_TITLE_FONT,
            label_font_size=_FONT,
            color=theme.ink,
            render=False,
        )
        bar.SetVerticalTitleSeparation(10)
        bar.SetBarRatio(_BAR / _WIDTH)
        bar.SetTextPad(2)
        self._texts = bar.GetTitleTextProperty(), bar.GetLabelTextProperty()
        for text in self._texts:
            use_sans(text)
        self._ground.GetProperty().SetColor(*(part / 255 for part in rgb(theme.background)))
        self._ground.SetVisibility(True)
        self._bar = bar
        self.place(self._plotter.window_size)

    def place(self, size: tuple[int, int], density: float = 1.0) -> None:
        """Put the bar beside the right edge of a picture, below the orientation cube.

        Where there is no room for it below the cube, it is at the left of the cube.

        Args:
            size: width and height of the picture in VTK's pixels.
            density: number of them along each side of one that a person sees.
        """
        if self._bar is None:
            return
        width, height = np.array(size) / density
        right, top = width - _PAD - _EDGE, max(_TOP * height, BOTTOM + 2 * _PAD)
        if height - top - _PAD - _EDGE < _LEAST:
            right, top = right - LEFT, _EDGE + 2 * _PAD
        below = min(top + _HEIGHT * height, height - _PAD - _EDGE)
        pixel = 1.0 / np.array([width, height])
        low, high = np.array([right - _WIDTH, height - below]), np.array([right, height - top])
        low, high = low * pixel, high * pixel
        self._bar.SetPosition(*low)
        self._bar.SetPosition2(*(high - low))
        for text, font in zip(self._texts, (_TITLE_FONT, _FONT), strict=True):
            text.SetFontSize(round(density * font))
        (left, bottom), (right, top) = low - _PAD * pixel, high + (_PAD, 2 * _PAD) * pixel
        corners = [[left, bottom, 0], [right, bottom, 0], [right, top, 0], [left, top, 0]]
        self._square.points = np.array(corners, dtype=np.float32)
