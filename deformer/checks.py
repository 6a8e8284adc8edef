"""Checks of values that come from users and from files; whatever else is found is an InputError.

Each function returns the value in the form that its caller computes with. In the message, `name`
stands for the value: an argument, or a file and the place inside it. It may be any object; its
`str` is called for a message alone. `remedy` tells the user what to do.
"""

from __future__ import annotations

import contextlib
import errno
import math
import os
import re
import reprlib
from collections.abc import Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from deformer.errors import InputError

LARGEST = 1e15
"""Greatest magnitude of the numbers that are computed with: their squares fit single precision."""
# Memory, in bytes, above which a result is refused where the system does not tell how much it has.
_ASSUMED_MEMORY = 16e9
# Length to which values from users and files are cut in messages.
_ECHO = 60

T = TypeVar("T")


class _Short(reprlib.Repr):
    """`repr` in time and length that do not grow with the value."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel, self.maxstring, self.maxother, self.maxlong = 4, _ECHO, _ECHO, _ECHO

    def repr_int(self, x: int, level: int) -> str:
        """Avoid Python's error for integers of thousands of digits."""
        return super().repr_int(x, level) if x.bit_length() < 1000 else "a huge integer"

    def repr_ndarray(self, x: NDArray, level: int) -> str:
        """Dtype and shape of an array, or the number of one without dimensions."""
        return f"an array of {x.dtype} {x.shape}" if x.ndim else self.repr1(x.item(), level)

    def repr_float64(self, x: np.floating, level: int) -> str:
        """The number alone: numpy 2 adds the type."""
        return repr(x.item())

    repr_int64 = repr_float32 = repr_float64


_short = _Short()


def rounded(value: float, digits: int = 3) -> str:
    """A number of some digits; up to a million without an exponent, as 1000 for 1e+03."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+0" in text and abs(value) < 1e6 else text


def shortened(value: object) -> str:
    """`repr` of a value in one line of at most 60 characters, for messages."""
    text = " ".join(_short.repr(value).split())
    # Bytes of names of files that are no text are half surrogates in Python.
    text = re.sub(r"(?<!\\)\\udc([89a-f][0-9a-f])", r"\\x\1", text)
    return text if len(text) <= _ECHO else text[: _ECHO - 1] + "…"


def checked_number(
    value: Any,
    name: object,
    *,
    least: float | None = None,
    above: float | None = None,
    most: float = math.inf,
    largest: float = math.inf,
    remedy: str = "correct it",
) -> float:
    """A finite number; booleans and texts are none.

    Args:
        value, name, remedy: as the module says.
        least: the smallest number allowed.
        above: a bound that the number must exceed.
        most: the largest number allowed.
        largest: the largest magnitude allowed.
    """
    number = _as_float(value)
    if (
        not math.isfinite(number)
        or number > most
        or abs(number) > largest
        or (least is not None and number < least)
        or (above is not None and number <= above)
    ):
        bounds = [] if least is None else [f"of at least {least:g}"]
        bounds += [] if above is None else [f"above {above:g}"]
        bounds += [f"up to {most:g}"] if math.isfinite(most) else []
        bounds += [f"up to ±{largest:g}"] if math.isfinite(largest) else []
        expected = " ".join(["a finite number", " and ".join(bounds)]).rstrip()
        raise _unexpected(name, expected, value, remedy)
    return number


def _as_float(value: Any) -> float:
    """The number, or NaN for anything else."""
    if type(value) is float:  # saves a third of the time of large files
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf


def checked_integer(
    value: Any,
    name: object,
    *,
    least: int | None = None,
    most: int | None = None,
    remedy: str = "correct it",
) -> int:
    """A whole number of `least` to `most`, and of 64 bits; booleans and floats are none."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    number = 0 if isinstance(value, bool) or not isinstance(value, Integral) else int(value)
    if (
        isinstance(value, bool)
        or not isinstance(value, Integral)
        or not -(2**63) <= number < 2**63
        or (least is not None and number < least)
        or (most is not None and number > most)
    ):
        if least is not None and most is not None:
            bounds = f" of {least}…{most}"
        else:
            bounds = "" if least is None else f" of at least {least}"
            bounds += "" if most is None else f" up to {most}"
        raise _unexpected(name, f"an integer{bounds}", value, remedy)
    return number


def checked_flag(value: Any, name: object, *, remedy: str = "give one of them") -> bool:
    """True or false."""
    if not isinstance(value, bool | np.bool_):
        raise _unexpected(name, "true or false", value, remedy)
    return bool(value)


def checked_text(value: Any, name: object, *, remedy: str = "correct it") -> str:
    """A text that is Unicode, or the name of a file."""
    if not isinstance(value, str) or not is_unicode(value):
        raise _unexpected(name, "a text", value, remedy)
    return value


def is_unicode(text: str) -> bool:
    """False if the text contains half of a surrogate pair and is no name of a file either.

    Python reads bytes of file names that are no UTF-8 as U+DC80 to U+DCFF.
    """
    if text.isascii():
        return True
    try:
        text.encode(errors="surrogateescape")
    except UnicodeEncodeError:
        return False
    return True


def checked_choice(
    value: Any, name: object, choices: Sequence[T], *, remedy: str = "choose one"
) -> T:
    """One of `choices`, which are texts."""
    for choice in choices:
        if isinstance(value, str) and value == choice:
            return choice
    raise _unexpected(name, f"one of {', '.join(map(str, choices))}", value, remedy)


def checked_path(value: Any, name: object = "path") -> Path:
    """A path, as text or as a path."""
    text = os.fspath(value) if isinstance(value, str | os.PathLike) else None
    if not isinstance(text, str) or "\0" in text or not is_unicode(text):
        raise _unexpected(name, "the path of a file or directory", value, "give a text or a Path")
    check_path_length(Path(text), name)
    return Path(text)


def check_path_length(path: Path, name: object) -> None:
    """Raise InputError if `path`, or a name in it, is longer than the system allows."""
    try:
        path.lstat()
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise InputError(
                f"{name}: {shortened(str(path))} is longer than the system allows; shorten it"
            ) from error


def checked_instance(value: Any, name: object, kind: type[T], *, remedy: str) -> T:
    """An object of the class `kind`."""
    if not isinstance(value, kind):
        raise _unexpected(name, f"a {kind.__name__}", value, remedy)
    return value


def checked_array(
    values: Any,
    name: object,
    *shapes: tuple[int | str, ...],
    finite: bool = True,
    largest: float = math.inf,
    remedy: str = "correct it",
) -> NDArray[np.float64]:
    """An array of real numbers, as float64.

    Args:
        values, name, remedy: as the module says.
        shapes: the shapes allowed; a text stands for any length of 0 or more, "..." at the start
            for any dimensions. None given allows all.
        finite: refuse numbers that are not finite.
        largest: refuse magnitudes above it.
    """
    array = as_array(values, name)
    if array.dtype.kind not in "fiu" and array.size:
        expected = f"numbers of shape {_shapes(shapes)}" if shapes else "numbers"
        raise _unexpected(name, expected, values, remedy)
    if shapes and not any(_has_shape(array, shape) for shape in shapes):
        raise InputError(f"{name}: expected {_shapes(shapes)}, got {array.shape}; {remedy}")
    array = array.astype(np.float64, copy=False)
    if finite:
        bound = min(largest, np.finfo(float).max)
        # Without an array of the same size, unless there is something to tell.
        if array.size and not (-bound <= array.min() and array.max() <= bound):
            refuse_bad(name, array, ~(np.abs(array) <= bound), largest, remedy=remedy)
    return array


def refuse_bad(
    name: object,
    array: NDArray,
    bad: NDArray,
    largest: float = math.inf,
    *,
    remedy: str = "correct it",
) -> None:
    """Name the first number of an array that is `bad`: not finite, or larger than `largest`."""
    if bad.any():
        index = tuple(np.argwhere(bad)[0].tolist())
        where = f"{name}[{', '.join(map(str, index))}]" if index else name
        bound = f" up to ±{largest:g}" if math.isfinite(largest) else ""
        raise _unexpected(where, f"a finite number{bound}", float(array[index]), remedy)


def checked_indices(
    values: Any, name: object, count: int, *, what: str = "vertex", remedy: str = "correct it"
) -> NDArray[np.int64]:
    """Indices (n,) of 0…count−1, as int64; `what` they are indices of."""
    array = as_array(values, name)
    if array.ndim != 1 or (array.dtype.kind not in "iu" and array.size):
        raise InputError(
            f"{name}: expected {what} indices (n,), integers, got {array.dtype} of shape "
            f"{array.shape}; {remedy}"
        )
    bad = np.flatnonzero((array < 0) | (array >= count))
    if len(bad):
        raise InputError(
            f"{name}[{bad[0]}]: {what} {array[bad[0]]} does not exist, expected 0…{count - 1}; "
            f"{remedy}"
        )
    return array.astype(np.int64)


def check_memory(size: float, what: str) -> None:
    """Raise InputError if `what` would take more than half of the memory.

    Args:
        size: estimate of the memory, in bytes.
        what: subject of the message, with the numbers that the user can change.
    """
    memory = 0.5 * _memory()
    if size > memory:
        raise InputError(
            f"{what}: would take {rounded(size / 1e9)} GB of memory, expected at most the "
            f"{rounded(memory / 1e9)} GB that are half of what this process may use; ask for less"
        )


def _memory() -> float:
    """Bytes of memory that this process may use: of the machine, or of its cgroup."""
    limits = []
    with contextlib.suppress(AttributeError, ValueError, OSError):
        limits.append(float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")))
    # There is no such file, or the limit is the word "max".
    with contextlib.suppress(OSError, ValueError):
        limits.append(float(int(Path("/sys/fs/cgroup/memory.max").read_text())))
    return min(limits, default=_ASSUMED_MEMORY)


def free_memory() -> float:
    """Bytes of memory that are not in use: of the machine, or of this process's cgroup."""
    limits = [_memory()]
    # What files are cached in is free, too. Only Linux has these files.
    with contextlib.suppress(OSError, StopIteration, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text().splitlines()
        line = next(line for line in lines if line.startswith("MemAvailable:"))
        limits.append(1024.0 * int(line.split()[1]))
    with contextlib.suppress(OSError, StopIteration, ValueError, IndexError):
        group = Path("/sys/fs/cgroup")
        stat = (group / "memory.stat").read_text().splitlines()
        held = next(int(line.split()[1]) for line in stat if line.startswith("anon "))
        limits.append(float(int((group / "memory.max").read_text()) - held))
    return max(0.0, min(limits))


def as_array(values: Any, name: object) -> NDArray:
    """An array of any kind; InputError for lists of unequal lengths, and for masked values."""
    parts = values if isinstance(values, list | tuple) else (values,)
    if any(isinstance(part, np.ma.MaskedArray) and np.ma.is_masked(part) for part in parts):
        raise InputError(f"{name}: has masked values, expected all; fill or leave them out")
    try:
        return np.asarray(values)
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        reason = " ".join(str(error).split())[:_ECHO]
        raise InputError(f"{name}: expected an array of numbers ({reason}); correct it") from error


def _has_shape(array: NDArray, shape: tuple[int | str, ...]) -> bool:
    if shape[:1] == ("...",):  # any number of dimensions
        shape = (*array.shape[: array.ndim - len(shape) + 1], *shape[1:])
    return array.ndim == len(shape) and all(
        isinstance(wanted, str) or wanted == length
        for wanted, length in zip(shape, array.shape, strict=True)
    )


def _shapes(shapes: Sequence[tuple[int | str, ...]]) -> str:
    texts = []
    for shape in shapes:
        inside = ", ".join(map(str, shape))
        texts.append(f"({inside},)" if len(shape) == 1 else f"({inside})")
    return " or ".join(texts)


def _unexpected(name: object, expected: str, value: object, remedy: str) -> InputError:
    return InputError(f"{name}: expected {expected}, got {shortened(value)}; {remedy}")
