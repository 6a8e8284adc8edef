"""Actions that components of the face are named after: the expressions of the kit."""

from __future__ import annotations

import re
from dataclasses import replace

from numpy.typing import NDArray

from face.expressions import PAIRED, SINGLE, mix
from face.kit import Face

_SIDES = {"L": "left", "R": "right"}


def action_shapes(face: Face) -> dict[str, NDArray]:
    """Name of an action, as "Left mouth smile" → (V, 3) the face that does nothing else.

    Two-sided ones are there for each side, left being the face's own, and for both.
    """
    weights = {name: {name: 1.0} for name in SINGLE}
    weights |= {name: {f"{name}_L": 1.0, f"{name}_R": 1.0} for name in PAIRED}
    return {_title(name): mix(face, each) for name, each in weights.items()}


def action_regions() -> dict[str, str]:
    """Name of an action → name of the region that it moves: "Left mouth smile" → "Left mouth"."""
    return {_title(name): _title(_region(name)) for name in (*SINGLE, *PAIRED)}


def at_vertices(face: Face, rows: NDArray) -> Face:
    """The face over some of its vertices, (V,) of them; its triangles are left out."""
    offsets = {name: offset[rows] for name, offset in face.offsets.items()}
    return replace(face, neutral=face.neutral[rows], faces=face.faces[:0], offsets=offsets)


def _title(name: str) -> str:
    """Name of an expression in words: "Left mouth smile" of "mouthSmile_L"."""
    action, _, side = name.partition("_")
    words = re.sub("(?=[A-Z])", " ", action).lower()
    return " ".join(filter(None, (_SIDES.get(side), words))).capitalize()


def _region(name: str) -> str:
    """What an expression moves: "mouth_L" of "mouthSmile_L"."""
    action, underscore, side = name.partition("_")
    return re.split("[A-Z]", action)[0] + underscore + side
