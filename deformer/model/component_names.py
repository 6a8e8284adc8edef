"""Names that people give to latent components."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping

from deformer.checks import checked_integer, checked_text, shortened
from deformer.errors import InputError

# Characters of a name; more do not fit tables and panels.
_LONGEST = 100


def check_names(names: Mapping[int, str], components: int) -> dict[int, str]:
    """Check names of components; gives them sorted by component, without surrounding blanks.

    Args:
        names: component → name.
        components: K.

    Raises:
        InputError: no such component, a name twice, an empty name, or one that reads like an index
            or a list of weights (`3=0.8,7=1.2`).
    """
    if not isinstance(names, Mapping):
        raise InputError(f"names: expected component → name, got {shortened(names)}; give a dict")
    checked: dict[int, str] = {}
    owner: dict[str, int] = {}
    for key in names:
        k = checked_integer(key, "component", least=0, remedy="choose one of the model's")
        if k >= components:
            raise InputError(
                f"name {shortened(names[key])}: component {k} does not exist; the model has "
                f"0…{components - 1}"
            )
        name = checked_text(names[key], f"component {k}").strip()
        if not name or name.lstrip("+-").isdigit() or set(name) & set("=,") or _breaks(name):
            raise InputError(
                f"component {k}: {shortened(name)} is no name, expected text of one line and up to "
                f"{_LONGEST} characters, without '=' and ',', that is not a whole number"
            )
        if name in owner:
            raise InputError(
                f"component {k}: the name {shortened(name)} is given twice; choose another"
            )
        checked[k], owner[name] = name, k
    return dict(sorted(checked.items()))


def _breaks(name: str) -> bool:
    """True if a name is too long for a table, or has characters that break a line of one."""
    controls = {"Cc", "Cs", "Zl", "Zp"}
    return len(name) > _LONGEST or any(unicodedata.category(c) in controls for c in name)


def find_component(key: int | str, names: Mapping[int, str], components: int) -> int:
    """Index of the component with a name or an index.

    Args:
        key: a name, or an index as a number or as text.
        names: component → name.
        components: K.

    Raises:
        InputError: no component has that name or index.
    """
    text = key.strip() if isinstance(key, str) else ""
    named = {name: k for k, name in names.items()}.get(text)
    if named is not None:
        return named
    if isinstance(key, str):
        digits = key.strip()
        if not digits.lstrip("+-").isdecimal() or len(digits) > _LONGEST:
            known = ", ".join(map(repr, names.values())) or "none"
            raise InputError(
                f"component {shortened(key)}: no such name; the model's names: {known}; its "
                f"components: 0…{components - 1}"
            )
        key = int(digits)
    k = checked_integer(key, "component", remedy="give an index or a name")
    if not 0 <= k < components:
        raise InputError(f"component {k} does not exist; the model has 0…{components - 1}")
    return k
