"""The font of text that VTK draws: DejaVu Sans, which comes with matplotlib.

VTK's own font is narrower and lighter than any of a window, and looks foreign beside its text.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from vtkmodules.vtkRenderingCore import vtkTextProperty

_FROM_FILE = 4  # VTK_FONT_FILE of vtkTextProperty.h


@cache
def sans() -> str:
    """Return the path of the font's file."""
    import matplotlib  # late: a window opens without it

    return str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf")


def use_sans(text: vtkTextProperty) -> None:
    """Have a text drawn upright in the font, without shadow."""
    text.SetFontFamily(_FROM_FILE)
    text.SetFontFile(sans())
    text.BoldOff()
    text.ItalicOff()
    text.ShadowOff()
