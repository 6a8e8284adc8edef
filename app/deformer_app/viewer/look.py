"""How the picture is drawn: colours, a ghost to compare with, shading, the theme."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from deformer import io
from deformer_app.viewer.colouring import COLOURINGS

Ghost = Literal["none", "reference", "target", "previous"]
GHOSTS: tuple[Ghost, ...] = ("none", "reference", "target", "previous")


@dataclass(frozen=True)
class Look:
    """How the picture is drawn; part of a session.

    Args:
        colour: name of a colouring, see `Colouring`.
        ghost: which other mesh is drawn translucently; "previous" is the pose before the last step
            or drag.
        cube: draw the orientation cube.
        wireframe: draw the faces' edges.
        smooth: shade across the edges of faces.
        dark: use the dark theme.
    """

    colour: str = "plain"
    ghost: Ghost = "none"
    cube: bool = True
    wireframe: bool = False
    smooth: bool = True
    dark: bool = False


def read_look(value: io.JsonValue) -> Look:
    """Return the look of a session's file; what the file does not name is as by default.

    Raises:
        InputError: it is damaged.
    """
    flags = ("cube", "wireframe", "smooth", "dark")
    value.check_keys((), ("colour", "ghost", *flags))
    found: dict[str, Any] = {name: value[name].flag() for name in flags if name in value}
    if "ghost" in value:
        found["ghost"] = value["ghost"].choice(GHOSTS)
    if "colour" in value:
        name, _, number = value["colour"].text().partition(":")
        known = name in COLOURINGS and (not number or (name == "component" and number.isdecimal()))
        if not known:
            raise value["colour"].error(f"one of {', '.join(COLOURINGS)}")
        found["colour"] = value["colour"].value
    return Look(**found)
