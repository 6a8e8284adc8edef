"""Handles as sessions and libraries of poses store them."""

from __future__ import annotations

from deformer import io
from deformer_app.viewer.edit import KINDS, Handle, Point, point


def read_handle(item: io.JsonValue) -> Handle:
    """Read a handle from the fields of `Handle`.

    Raises:
        InputError: a field is missing or wrong; the message names the file and the field.
    """
    vertices = item["vertices"].integers(least=0)
    if not vertices:
        raise item["vertices"].error("a list of at least one vertex")
    # Sessions of earlier versions have none of these.
    turn = item["orientation"].value if "orientation" in item else None
    factor = "orientation_weight"
    handle = Handle(
        item["id"].integer(least=0),
        tuple(vertices),
        tuple(point(target.numbers(3)) for target in item["targets"].items(len(vertices))),
        item["kind"].choice(KINDS),
        item["weight"].number(above=0, most=io.LARGEST),
        tuple(item["patch"].integers(least=0)),
        orientation_weight=item[factor].number(above=0, most=1e4) if factor in item else 1.0,
        gaps=_gaps(item, len(vertices)),
        radius=item["radius"].number(least=0, most=io.LARGEST) if "radius" in item else 0.0,
        name=item["name"].text() if "name" in item else "",
    )
    return handle if turn is None else handle.oriented(item["orientation"].rotation())


def _gaps(item: io.JsonValue, count: int) -> tuple[Point, ...]:
    if "gaps" not in item or item["gaps"].value == []:
        return ()
    return tuple(point(gap.numbers(3, largest=io.LARGEST)) for gap in item["gaps"].items(count))
