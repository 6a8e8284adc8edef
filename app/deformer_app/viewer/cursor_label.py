"""A line of text beside the cursor, in the picture."""

from __future__ import annotations

from vtkmodules.vtkRenderingCore import vtkRenderer, vtkTextActor

from deformer_app.rendering.palette import Theme, rgb
from deformer_app.viewer.events import Pixel

_APART = (18.0, 14.0)  # pixels from the cursor, to the right and up
_FONT = 14  # pixels
_WIDTH = 240.0  # pixels that a text may need


class CursorLabel:
    """A text that stands beside a pixel, on the side where there is room.

    Args:
        layer: renderer that draws it.
    """

    def __init__(self, layer: vtkRenderer) -> None:
        """Begin without a text."""
        self._actor = vtkTextActor()
        self._actor.GetTextProperty().SetBackgroundOpacity(0.85)
        self._actor.VisibilityOff()
        layer.AddViewProp(self._actor)

    def set_theme(self, theme: Theme) -> None:
        """Change the colours."""
        style = self._actor.GetTextProperty()
        style.SetColor(*(c / 255 for c in rgb(theme.ink)))
        style.SetBackgroundColor(*(c / 255 for c in rgb(theme.background)))

    @property
    def text(self) -> str:
        """What is shown; empty without a label."""
        return self._actor.GetInput() if self._actor.GetVisibility() else ""

    def show(self, pixel: Pixel, text: str, size: tuple[int, int], density: float) -> None:
        """Show a text.

        Args:
            pixel: of the cursor.
            text: one line.
            size: width and height of the picture.
            density: VTK's pixels along each side of one of the picture.
        """
        (x, y), (width, height), (right, up) = pixel, size, _APART
        style = self._actor.GetTextProperty()
        style.SetFontSize(round(density * _FONT))
        if x + right + _WIDTH > width:
            style.SetJustificationToRight()
            right = -right
        else:
            style.SetJustificationToLeft()
        if y - up < 2 * _FONT:
            up = -2.0 * up
        self._actor.SetInput(text)
        self._actor.SetDisplayPosition(
            round(density * (x + right)), round(density * (height - y + up))
        )
        self._actor.VisibilityOn()

    def hide(self) -> None:
        """Show nothing."""
        self._actor.VisibilityOff()
