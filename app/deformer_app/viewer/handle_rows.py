"""Handles as the rows of a handles file, and back."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from deformer import InputError, io
from deformer_app.viewer.edit import Handle, points


def handle_rows(handles: Iterable[Handle]) -> list[dict[str, Any]]:
    """Return the `handles` of a handles file: a row a target; regions are counted from 0."""
    rows, regions = [], 0
    for handle in handles:
        shared: dict[str, Any] = {"weight": handle.weight, "kind": handle.kind}
        if handle.orientation is not None:
            shared["orientation"] = handle.orientation
            shared["orientation_weight"] = handle.orientation_weight
        if handle.name:
            shared["name"] = handle.name
        if handle.is_region:
            shared["region"] = regions
            regions += 1
        for n, (vertex, target) in enumerate(zip(handle.vertices, handle.targets, strict=True)):
            gap = {"gap": handle.gaps[n]} if handle.gaps else {}
            rows.append({"vertex": vertex, "position": target, **shared, **gap})
    return rows


def handles_of_rows(path: object, file: io.HandleFile, first: int) -> list[Handle]:
    """Return the handles of a file's first frame.

    Args:
        path: the file, for messages.
        file: what was read of it.
        first: id of the first handle; the others count on.

    Raises:
        InputError: a handle that is not at a vertex, or rows of a region that differ in more than
            their vertex and its target.
    """
    groups: dict[Any, list[tuple[int, io.HandleTarget]]] = {}
    for n, row in enumerate(file.frames[0]):
        key = ("row", n) if row.region is None else ("region", row.region)
        groups.setdefault(key, []).append((n, row))
    return [
        _handle(path, number, rows, file.regions)
        for number, rows in enumerate(groups.values(), first)
    ]


def _handle(
    path: object,
    number: int,
    rows: list[tuple[int, io.HandleTarget]],
    regions: Sequence[tuple[int, ...]],
) -> Handle:
    row = rows[0][1]
    vertices = []
    for n, other in rows:
        if not isinstance(other.vertex, int):
            raise InputError(
                f"{path}: handles[{n}]: has an offset, expected a vertex alone; remove the offset"
            )
        for name in ("kind", "weight", "orientation", "orientation_weight"):
            if getattr(other, name) != getattr(row, name):
                raise InputError(
                    f"{path}: handles[{n}]: its {name} is {getattr(other, name)!r}, expected "
                    f"{getattr(row, name)!r} as of the others of region {row.region}; give it the "
                    "same"
                )
        vertices.append(other.vertex)
    gaps = [other.gap for _, other in rows]
    handle = Handle(
        number,
        tuple(vertices),
        points(other.position for _, other in rows),
        row.kind,
        row.weight,
        () if row.region is None else regions[row.region],
        orientation_weight=row.orientation_weight,
        name=row.name,
    ).at([other.position for _, other in rows], gaps)
    return handle if row.orientation is None else handle.oriented(row.orientation)
