"""Names that people give to latent components."""

from __future__ import annotations

from collections.abc import Mapping

from deformer.errors import InputError


def check_names(names: Mapping[int, str], components: int) -> dict[int, str]:
    """Check names of components; gives them sorted by component, without surrounding blanks.

    Args:
        names: component → name.
        components: K.

    Raises:
        InputError: no such component, a name twice, an empty name, or one that reads like an index
            or a list of weights (`3=0.8,7=1.2`).
    """
    checked: dict[int, str] = {}
    for k in sorted(names):
        name = names[k].strip()
        if not 0 <= k < components:
            raise InputError(
                f"name {name!r}: component {k} does not exist; the model has 0…{components - 1}"
            )
        if not name or name.lstrip("+-").isdigit() or set(name) & set("=,\n"):
            raise InputError(
                f"component {k}: {name!r} is no name, expected text without '=' and ',' that is "
                "not a whole number"
            )
        if name in checked.values():
            raise InputError(f"component {k}: the name {name!r} is given twice; choose another")
        checked[k] = name
    return checked


def find_component(key: int | str, names: Mapping[int, str], components: int) -> int:
    """Index of the component with a name or an index.

    Args:
        key: a name, or an index as a number or as text.
        names: component → name.
        components: K.

    Raises:
        InputError: no component has that name or index.
    """
    named = {name: k for k, name in names.items()}.get(str(key).strip())
    if named is not None:
        return named
    try:
        k = int(key)
    except ValueError:
        known = ", ".join(map(repr, names.values())) or "none"
        raise InputError(
            f"component {key!r}: no such name; the model's names: {known}; its components: "
            f"0…{components - 1}"
        ) from None
    if not 0 <= k < components:
        raise InputError(f"component {k} does not exist; the model has 0…{components - 1}")
    return k
