"""What this program's glTF files say of themselves, in `extras`: read, they give what was written.

A file of another program is read as its scene shows it. A scene of this program's whose data has z
up stands on a node that turns it to glTF's y up: the node is marked, and a reader leaves it out. A
clip whose morph targets are no shapes of their own is marked with its frames a second.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

_KEY = "deformer"
_UP, _FPS = "data_up", "fps"
# A quarter turn about x, as a quaternion (x, y, z, w): z to y.
_QUARTER = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))


def upright_node(children: list[int]) -> dict[str, Any]:
    """A marked node that turns z up to y up.

    Args:
        children: numbers of the nodes that it turns.
    """
    return {
        "name": "z up",
        "rotation": [*_QUARTER],
        "children": children,
        "extras": {_KEY: {_UP: "z"}},
    }


def is_upright_node(node: dict[str, Any]) -> bool:
    """True for a node as `upright_node` makes it; false once a program has changed its transform.

    Args:
        node: the JSON's object.
    """
    if _marks(node).get(_UP) != "z" or "matrix" in node:
        return False
    expected = {"rotation": _QUARTER, "translation": (0.0, 0.0, 0.0), "scale": (1.0, 1.0, 1.0)}
    return all(_near(node.get(key, values), values) for key, values in expected.items())


def scene_up(description: dict[str, Any]) -> str:
    """The axis, "y" or "z", that points up in the data of a scene that can be read.

    Args:
        description: the JSON of the file.
    """
    scenes, nodes = description.get("scenes"), description.get("nodes", [])
    if not scenes:
        return "y"
    roots = scenes[description.get("scene", 0)].get("nodes", [])
    return "z" if any(is_upright_node(nodes[root]) for root in roots) else "y"


def clip_extras(fps: float) -> dict[str, Any]:
    """The `extras` of a clip whose frames, not its morph targets, are the shapes of the file.

    Args:
        fps: frames a second.
    """
    return {_KEY: {_FPS: fps}}


def clip_fps(animation: dict[str, Any]) -> float | None:
    """Frames a second of a clip that `clip_extras` marks; None for others.

    Args:
        animation: the JSON's object.
    """
    fps = _marks(animation).get(_FPS)
    if not isinstance(fps, int | float) or isinstance(fps, bool):
        return None
    return float(fps) if 0 < fps <= 1e6 else None


def _marks(item: dict[str, Any]) -> dict[str, Any]:
    """What this program says of an object; nothing where the `extras` are another program's."""
    extras = item.get("extras")
    found = extras.get(_KEY) if isinstance(extras, dict) else None
    return found if isinstance(found, dict) else {}


def _near(values: Any, expected: tuple[float, ...]) -> bool:
    numbers = isinstance(values, list | tuple) and all(isinstance(v, int | float) for v in values)
    return (
        numbers
        and len(values) == len(expected)
        and bool(np.allclose(np.asarray(values, dtype=float), expected, rtol=0, atol=1e-5))
    )
