"""JSON values with the place where they were found, so that a message names file and path.

`read_value` parses a file; the methods of `JsonValue` check what they return.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar

from deformer.checks import (
    LARGEST as LARGEST,
    checked_choice,
    checked_flag,
    checked_integer,
    checked_number,
    checked_path,
    checked_text,
    is_unicode,
    shortened,
)
from deformer.errors import InputError
from deformer.io.atomic import PathLike, read_bytes

# Objects and lists inside one another: more are no file of this program, and exhaust the stack.
_DEEPEST = 100
# Larger integers are not exact in every reader of JSON.
_LARGEST_INTEGER = 2**53
_REMEDY = "correct or restore the file"

T = TypeVar("T")


class JsonValue:
    """A JSON value, and where it was found.

    Args:
        value: what `json` has parsed.
        parent: the value that contains it; at the top the file, or a text that names the source.
        key: its key or index in the parent.

    Every method raises InputError, with the file and the path inside it, for any other value.
    """

    __slots__ = ("_key", "_parent", "value")

    def __init__(
        self, value: Any, parent: JsonValue | PathLike, key: str | int | None = None
    ) -> None:
        """Keep the place; it becomes a text only in a message."""
        self.value = value
        self._parent = parent
        self._key = key

    def __str__(self) -> str:
        """File and path, such as `s.json: camera.position[1]`; what checks call this value."""
        parts: list[str] = []
        place: JsonValue | PathLike = self
        while isinstance(place, JsonValue):
            if isinstance(place._key, int):
                parts.append(f"[{place._key}]")
            elif place._key is not None:
                key = place._key
                parts.append(f".{key if key.isidentifier() else shortened(key)}")
            place = place._parent
        path = "".join(reversed(parts)).removeprefix(".")
        return f"{place}: {path}" if path else str(place)

    def error(self, expected: str, remedy: str = _REMEDY) -> InputError:
        """The error that this value is not what was expected."""
        return InputError(f"{self}: expected {expected}, got {shortened(self.value)}; {remedy}")

    def check_keys(self, required: Iterable[str], optional: Iterable[str] = ()) -> None:
        """Check that this is an object with all of the required keys and none but the optional."""
        required, optional = list(required), list(optional)
        if not isinstance(self.value, dict):
            raise self.error(f"an object with {', '.join(required)}")
        for key in required:
            if key not in self.value:
                raise InputError(f"{self}: no {key!r}; complete or restore the file")
        for key in self.value:
            if key not in required and key not in optional:
                raise InputError(
                    f"{self}: unknown key {shortened(key)}, expected "
                    f"{', '.join([*required, *optional])}; rename or remove it"
                )

    def __contains__(self, key: str) -> bool:
        """True if this is an object with that key."""
        return isinstance(self.value, dict) and key in self.value

    def __getitem__(self, key: str) -> JsonValue:
        """The value of a key of an object."""
        if not isinstance(self.value, dict):
            raise self.error(f"an object with {key!r}")
        if key not in self.value:
            raise InputError(f"{self}: no {key!r}; complete or restore the file")
        return JsonValue(self.value[key], self, key)

    def entries(self) -> list[tuple[str, JsonValue]]:
        """Keys and values of an object."""
        if not isinstance(self.value, dict):
            raise self.error("an object {…}")
        return [(key, JsonValue(value, self, key)) for key, value in self.value.items()]

    def items(self, length: int | None = None) -> list[JsonValue]:
        """Entries of a list, of a length if one is given."""
        if not isinstance(self.value, list) or length not in (None, len(self.value)):
            raise self.error("a list" if length is None else f"a list of {length}")
        return [JsonValue(value, self, n) for n, value in enumerate(self.value)]

    def number(self, **bounds: float) -> float:
        """A finite number; `bounds` as in `checked_number`."""
        return checked_number(self.value, self, remedy=_REMEDY, **bounds)

    def numbers(self, length: int | None = None, **bounds: float) -> tuple[float, ...]:
        """A list of finite numbers."""
        return tuple(entry.number(**bounds) for entry in self.items(length))

    def integer(self, least: int | None = None, most: int = _LARGEST_INTEGER) -> int:
        """A whole number."""
        return checked_integer(self.value, self, least=least, most=most, remedy=_REMEDY)

    def integers(self, least: int | None = None, most: int = _LARGEST_INTEGER) -> list[int]:
        """A list of whole numbers."""
        return [entry.integer(least, most) for entry in self.items()]

    def flag(self) -> bool:
        """True or false."""
        return checked_flag(self.value, self, remedy=_REMEDY)

    def text(self) -> str:
        """A text."""
        return checked_text(self.value, self, remedy=_REMEDY)

    def choice(self, choices: Sequence[T]) -> T:
        """One of some texts."""
        return checked_choice(self.value, self, choices, remedy=_REMEDY)

    def rotation(self) -> tuple[tuple[float, float, float], ...]:
        """The rows of a rotation matrix, given as a unit quaternion [w, x, y, z] or as rows."""
        # This needs numba's kernels, which reading other values does not.
        from deformer.geometry import checked_rotations

        if self.value is None:
            raise self.error("a unit quaternion [w, x, y, z] or a rotation matrix")
        return tuple((x, y, z) for x, y, z in checked_rotations(self.value, self, ()).tolist())


def read_value(path: PathLike) -> JsonValue:
    """Read a JSON file that contains an object.

    Args:
        path: the file.

    Raises:
        InputError: the file is missing, not JSON, contains something else, or a number or text
            that JSON cannot represent.
    """
    path = checked_path(path)
    return parse_value(read_bytes(path), path)


def parse_value(content: str | bytes, source: PathLike) -> JsonValue:
    """The object in a JSON text.

    Args:
        content: the text.
        source: where it comes from, for messages.

    Raises:
        InputError: as `read_value`.
    """
    if not isinstance(content, str | bytes):
        raise InputError(f"{source}: expected the text of a file, got {shortened(content)}")
    with parsing(source):
        data = json.loads(content, object_pairs_hook=json_object, parse_int=json_integer)
    if not isinstance(data, dict):
        raise InputError(f"{source}: a JSON {_name(data)}, expected an object {{…}}; wrap it")
    root = JsonValue(data, source)
    refuse_unwritable(root)
    return root


@contextmanager
def parsing(source: PathLike) -> Iterator[None]:
    """Within the block, errors of parsers become lines that name the source.

    Raises:
        InputError: in place of these errors.
    """
    try:
        yield
    except json.JSONDecodeError as error:
        raise InputError(
            f"{source}, line {error.lineno}: not JSON ({error.msg}); correct the line"
        ) from error
    except UnicodeDecodeError as error:
        raise InputError(
            f"{source}: not JSON (byte {error.start} is no UTF-8); write the file again"
        ) from error
    except RecursionError as error:
        raise _too_deep(source) from error
    except MemoryError as error:
        raise InputError(f"{source}: takes more than memory holds; write less into it") from error
    except InputError as error:
        raise InputError(f"{source}: {error}") from error


def _name(value: Any) -> str:
    """What JSON calls the kind of a value."""
    if value is None or isinstance(value, bool):
        return json.dumps(value)
    return "list" if isinstance(value, list) else "text" if isinstance(value, str) else "number"


def json_object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An object, whose keys must differ: readers disagree on which of two counts."""
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))
        raise InputError(f"key {shortened(twice)} is given twice, expected each once; remove one")
    return found


def json_integer(digits: str) -> int:
    """An integer; Python refuses thousands of digits with advice on its own settings."""
    try:
        return int(digits)
    except ValueError:
        raise InputError(
            f"an integer of {len(digits)} digits, expected at most {sys.get_int_max_str_digits()}; "
            "correct it"
        ) from None


def _too_deep(source: object) -> InputError:
    return InputError(
        f"{source}: lists and objects are nested more than {_DEEPEST} deep, expected fewer; write "
        "the file again"
    )


def refuse_unwritable(root: JsonValue, depth: int = 1) -> None:
    """Raise InputError for numbers and texts that JSON cannot represent, and for deep nesting.

    Args:
        root: the value.
        depth: of its nesting in the file, 1 at the top.
    """
    nested = isinstance(root.value, dict | list)
    path = _unwritable(root.value if nested else [root.value], depth)
    if path is None:
        return
    place = root
    for key in path if nested else ():
        place = JsonValue(place.value[key], place, key)
    if isinstance(place.value, float):
        raise place.error("a finite number")
    if isinstance(place.value, str):
        raise place.error("a text")
    if len(path) + depth - 1 == _DEEPEST:
        raise _too_deep(root)
    raise place.error("keys that are texts")


def _unwritable(value: Any, depth: int) -> tuple[str | int, ...] | None:
    """Keys that lead to the first such value inside an object or a list; None if there is none."""
    is_object = type(value) is dict
    if is_object and not all(map(is_unicode, value)):
        return ()
    for n, child in enumerate(value.values() if is_object else value):
        kind = type(child)
        found = None
        if kind is float:
            found = None if math.isfinite(child) else ()
        elif kind is str:
            found = None if is_unicode(child) else ()
        elif (kind is dict or kind is list) and child:
            found = () if depth == _DEEPEST else _unwritable(child, depth + 1)
        if found is not None:
            return (list(value)[n] if is_object else n, *found)
    return None
