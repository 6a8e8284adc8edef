"""Colours and colour maps of all pictures and windows; nothing else names a colour."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

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
SELECTED, HOVERED, REGION = "#ffd43b", "#ffa94d", "#f2a65a"
AXES = {"x": "#e03131", "y": "#2f9e44", "z": "#1c7ed6"}

# Colour maps, by matplotlib's names.
SCALARS = "viridis"  # values of any kind, with a colour bar
HEAT = "YlOrRd"  # amounts from zero, which is light, so that shading stays visible
DIVERGING = "coolwarm"  # signed values about zero

GOOD, FAIR, BAD = "#2f9e44", "#f08c00", "#e03131"  # levels of a measure
# Backgrounds of notices in the window.
NOTICE = {"mistake": "#fff3bf", "tour": "#d0ebff", "recording": "#ffe3e3", "waiting": "#e9ecef"}
NOTICE_INK = "#212529"


@dataclass(frozen=True)
class Theme:
    """Colours of the window, light or dark.

    Args:
        background: bottom of the picture.
        horizon: top of the picture.
        ink: text in the picture.
        clay: the surface.
        ghost: a surface to compare with.
        edge: edges of faces.
        widgets: colours of widgets by role of Qt's palette.
        disabled: text on disabled widgets.
    """

    background: str
    horizon: str
    ink: str
    clay: str
    ghost: str
    edge: str
    widgets: tuple[tuple[str, str], ...]
    disabled: str


LIGHT = Theme(
    background="#f7f6f3",
    horizon="#dfe3e8",
    ink="#2f343b",
    clay=CLAY,
    ghost="#b9aa93",
    edge="#6d7a88",
    widgets=(
        ("Window", "#f1f1ef"),
        ("Base", "#ffffff"),
        ("Button", "#f7f7f5"),
        ("Highlight", TARGET),
        ("HighlightedText", "#ffffff"),
        ("WindowText", "#2f343b"),
        ("Text", "#2f343b"),
        ("ButtonText", "#2f343b"),
    ),
    disabled="#a5a9af",
)
DARK = Theme(
    background="#23272d",
    horizon="#353b44",
    ink="#e8e6e1",
    clay="#aebccb",
    ghost="#8d7f6a",
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
        ("Highlight", TARGET),
        ("HighlightedText", "#ffffff"),
        ("Light", "#4a525d"),
        ("Dark", "#1b1e22"),
        ("Mid", "#3a414a"),
    ),
    disabled="#7d848d",
)


@cache
def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue of a colour, given by its name or hexadecimal code, each 0 to 255."""
    red, green, blue = ImageColor.getrgb(colour)[:3]
    return red, green, blue
