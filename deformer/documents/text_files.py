"""Text files in any encoding, edited without a change to the rest of their bytes."""

from __future__ import annotations

import codecs
from collections.abc import Callable
from functools import partial

import numpy as np

from deformer.errors import InputError
from deformer.geometry import FloatArray

_UTF16 = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


def decoded(data: bytes) -> tuple[bytes, Callable[[bytes], bytes]]:
    """A file's text in an encoding that extends ASCII, and the function that gives the file back.

    Args:
        data: contents of a file that a reader of `deformer.io` accepts.
    """
    for mark, encoding in _UTF16.items():
        if data.startswith(mark):
            text = data[len(mark) :].decode(encoding).encode()
            return text, partial(_encoded, mark, encoding)
    mark = codecs.BOM_UTF8 if data.startswith(codecs.BOM_UTF8) else b""
    return data[len(mark) :], partial(_encoded, mark, "")


def _encoded(mark: bytes, encoding: str, text: bytes) -> bytes:
    return mark + (text.decode().encode(encoding) if encoding else text)


def opened(data: bytes) -> tuple[bytes, Callable[[bytes], bytes]]:
    """As `decoded`; the text has line feeds even where the file has carriage returns alone."""
    text, encoded = decoded(data)
    if b"\n" in text:
        return text, encoded
    return text.replace(b"\r", b"\n"), lambda new: encoded(new.replace(b"\n", b"\r"))


def single_precision(values: FloatArray, what: str) -> np.ndarray:
    """Values rounded to single precision.

    Raises:
        InputError: one is too large for it; `what` names the file.
    """
    with np.errstate(over="ignore"):
        rounded = values.astype(np.float32)
    if not np.isfinite(rounded).all():
        raise InputError(
            f"{what}: a position is beyond ±{np.finfo(np.float32).max:.3g}, the range of the "
            "single-precision numbers there; write OBJ"
        )
    return rounded
