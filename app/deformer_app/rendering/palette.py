"""Colours and colour maps of all pictures and windows; nothing else names a colour."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

from PIL import ImageColor

# Pictures without a window.
BACKGROUND = "#f3f2ef"
INK = "#33373d"  # titles and numbers
CLAY = "#c5d2de"  # a surface
GHOST = "#d8d2c8"  # a surface to compare with

# Handles, in pictures and windows.
HANDLE = "#e8641b"
PINNED = "#3d4754"
TARGET = "#1f78d1"
KINDS = {"soft": HANDLE, "exact": "#c2255c", "pin": "#7048e8"}
LINKED = "#12b886"  # handles that are posed together
SELECTED, HOVERED, REGION = "#ffd43b", "#ffa94d", "#f2a65a"
AXES = {"x": "#e03131", "y": "#2f9e44", "z": "#1c7ed6"}

# Colour maps, by matplotlib's names.
SCALARS = "viridis"  # values of any kind, with a colour bar
HEAT = "YlOrRd"  # amounts from zero, which is light, so that shading stays visible
DIVERGING = "coolwarm"  # signed values about zero

GOOD, FAIR, BAD = "#2f9e44", "#f08c00", "#e03131"  # levels of a measure
# Bars at the edge of notices in the window.
NOTICE = {
    "mistake": "#e03131",
    "note": TARGET,
    "tour": "#2f9e44",
    "recording": "#e03131",
    "waiting": "#868e96",
}


Tint = Literal["ghost", "earlier", "later"]  # colours of translucent shapes


@dataclass(frozen=True)
class Theme:
    """Colours of the window, light or dark.

    Args:
        background: bottom of the picture.
        horizon: top of the picture.
        ink: text in the picture.
        clay: the surface.
        ghost: a surface to compare with.
        earlier, later: surfaces of times before and after the one that is shown.
        edge: edges of faces.
        widgets: colours of widgets by role of Qt's palette.
        disabled: text on disabled widgets.
        line: borders of widgets and rules between them.
        muted: text of second rank.
        raised: widgets under the mouse.
        accent: what is on or has the keyboard; text upon it is `HighlightedText`.
    """

    background: str
    horizon: str
    ink: str
    clay: str
    ghost: str
    earlier: str
    later: str
    edge: str
    widgets: tuple[tuple[str, str], ...]
    disabled: str
    line: str
    muted: str
    raised: str
    accent: str

    def widget(self, role: str) -> str:
        """Return the colour of a role of Qt's palette."""
        return dict(self.widgets)[role]

    def tint(self, name: Tint) -> str:
        """Return the colour of translucent shapes of a kind."""
        return {"ghost": self.ghost, "earlier": self.earlier, "later": self.later}[name]


LIGHT = Theme(
    background="#f7f6f3",
    horizon="#dfe3e8",
    ink="#2f343b",
    clay=CLAY,
    ghost="#b9aa93",
    earlier="#d0604a",
    later="#3f9e6e",
    edge="#6d7a88",
    widgets=(
        ("Window", "#f3f3f1"),
        ("Base", "#ffffff"),
        ("AlternateBase", "#f8f8f6"),
        ("Button", "#fbfbfa"),
        ("ToolTipBase", "#ffffff"),
        ("ToolTipText", "#2f343b"),
        ("PlaceholderText", "#8a9099"),
        ("Highlight", TARGET),
        ("HighlightedText", "#ffffff"),
        ("WindowText", "#2f343b"),
        ("Text", "#2f343b"),
        ("ButtonText", "#2f343b"),
    ),
    disabled="#a5a9af",
    line="#d3d4d1",
    muted="#666c75",
    raised="#e6e8e9",
    accent=TARGET,
)
DARK = Theme(
    background="#23272d",
    horizon="#353b44",
    ink="#e8e6e1",
    clay="#aebccb",
    ghost="#8d7f6a",
    earlier="#d9735d",
    later="#55b583",
    edge="#3c4650",
    widgets=(
        ("Window", "#2b3037"),
        ("WindowText", "#e8e6e1"),
        ("Base", "#23272d"),
        ("AlternateBase", "#2b3037"),
        ("Text", "#e8e6e1"),
        ("Button", "#363c45"),
        ("ButtonText", "#e8e6e1"),
        ("ToolTipBase", "#363c45"),
        ("ToolTipText", "#e8e6e1"),
        ("Highlight", "#4a9fe8"),
        ("HighlightedText", "#12161b"),
        ("Light", "#4a525d"),
        ("Dark", "#1b1e22"),
        ("Mid", "#3a414a"),
        ("PlaceholderText", "#8b929b"),
    ),
    disabled="#7d848d",
    line="#454c56",
    muted="#a2a8b0",
    raised="#424a55",
    accent="#4a9fe8",
)


@cache
def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of a colour, given by its name or hexadecimal code, each 0 to 255."""
    red, green, blue = ImageColor.getrgb(colour)[:3]
    return red, green, blue
