"""Handles, settings and solutions as sessions and libraries of poses store them."""

from __future__ import annotations

from typing import Any

from deformer import InputError, io
from deformer_app.viewer.edit import BODIES, KINDS, Edit, Handle, Point, Solution, point


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
        gaps=read_gaps(item, len(vertices)),
        radius=item["radius"].number(least=0, most=io.LARGEST) if "radius" in item else 0.0,
        name=item["name"].text() if "name" in item else "",
    )
    return handle if turn is None else handle.oriented(item["orientation"].rotation())


def read_gaps(item: io.JsonValue, count: int) -> tuple[Point, ...]:
    """Read the gaps of `count` targets; none where there are none.

    Raises:
        InputError: another number of them, or what is no vector.
    """
    if "gaps" not in item or item["gaps"].value == []:
        return ()
    return tuple(point(gap.numbers(3, largest=io.LARGEST)) for gap in item["gaps"].items(count))


def settings_as_json(edit: Edit) -> dict[str, Any]:
    """Return the fields of a state beside its base and its handles."""
    return {"noise": edit.noise, "body": edit.body, "floor": edit.floor}


def read_settings(item: io.JsonValue) -> dict[str, Any]:
    """Read what `settings_as_json` has returned, as arguments of `Edit`.

    Raises:
        InputError: a field is missing or wrong; the message names the file and the field.
    """
    # Sessions of earlier versions have no floor.
    floored = "floor" in item and item["floor"].value is not None
    return {
        "noise": item["noise"].number(above=0, most=io.LARGEST),
        "body": item["body"].choice(BODIES),
        "floor": item["floor"].number(least=-io.LARGEST, most=io.LARGEST) if floored else None,
    }


def read_solution(item: io.JsonValue) -> Solution | None:
    """Read a solution from the fields of `Solution`; null is none.

    Raises:
        InputError: a field is missing or wrong; the message names the file and the field.
    """
    if item.value is None:
        return None
    code, *motion = (
        item[name].numbers(length, largest=io.LARGEST)
        for name, length in (("z", None), ("rotation", 3), ("translation", 3))
    )
    # Sessions of earlier versions show every solution as it is.
    final = item["final"].flag() if "final" in item else True
    contacts = tuple(item["contacts"].integers(least=0)) if "contacts" in item else ()
    return Solution(code, point(motion[0]), point(motion[1]), final, contacts)


def check_state_fits(edit: Edit, solution: Solution | None, K: int, V: int, where: str) -> None:
    """Check that a state and its solution can be those of a model.

    Args:
        edit: the state, as it was read.
        solution: its solution, if there is one.
        K: components of the model.
        V: vertices of the model.
        where: the file and the entry, for the message.

    Raises:
        InputError: a code of another length, or a handle or contact at a vertex that does not
            exist.
    """
    for code in (edit.base, *([solution.z] if solution else [])):
        if len(code) != K:
            raise InputError(
                f"{where}: a code of {len(code)} numbers, expected the model's {K}; restore the "
                "file"
            )
    touching = max(solution.contacts, default=0) if solution else 0
    if touching >= V:
        raise InputError(
            f"{where}: a contact at vertex {touching}, expected 0…{V - 1}; restore the file"
        )
    for handle in edit.handles:
        highest = max((*handle.vertices, *handle.patch))
        if highest >= V:
            raise InputError(
                f"{where}: handle {handle.id} has vertex {highest}, expected 0…{V - 1}; restore "
                "the file"
            )
