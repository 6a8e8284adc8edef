"""JSON files with one long list, read entry by entry: of any size."""

from __future__ import annotations

import codecs
import json
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from deformer.checks import checked_path, shortened
from deformer.errors import InputError
from deformer.io.atomic import PathLike, check_file, reading
from deformer.io.json_values import (
    JsonValue,
    json_integer,
    json_object,
    parsing,
    read_value,
    refuse_unwritable,
)

# Bytes that are read at once.
_CHUNK = 1 << 20
_BLANKS = " \t\n\r"
# Characters of a number that may be cut off without a trace: those of "e+" and of a dot.
_OPEN_END = 3


def read_pieces(path: PathLike, key: str, on_entry: Callable[[JsonValue], None]) -> JsonValue:
    """Read a JSON file that contains an object, with the entries of one list one after the other.

    Args:
        path: the file.
        key: of the list, in the object.
        on_entry: called with each entry of the list, in order; what it raises is raised.

    Returns:
        The object, with an empty list in place of that one.

    Raises:
        InputError: as `read_value`.
    """
    path = checked_path(path)
    check_file(path)
    with reading(path), path.open("rb") as file:
        text = _Text(file, path)
        if text.next() != "{":
            return read_value(path)  # which refuses it
        return _object(text, path, key, on_entry)


def _object(text: _Text, path: Path, key: str, on_entry: Callable[[JsonValue], None]) -> JsonValue:
    found: dict[str, Any] = {}
    root = JsonValue(found, path)
    text.take("{", "Expecting value")
    more = text.next() != "}"
    while more:
        if text.next() != '"':
            raise text.error("Expecting property name enclosed in double quotes")
        name = text.value()
        if name in found:
            raise InputError(
                f"{path}: key {shortened(name)} is given twice, expected each once; remove one"
            )
        text.take(":", "Expecting ':' delimiter")
        if name == key and text.next() == "[":
            found[name] = []
            _entries(text, JsonValue(found[name], root, name), on_entry)
        else:
            found[name] = text.value()
        more = text.next() == ","
        if more:
            text.take(",", "")
    text.take("}", "Expecting ',' delimiter")
    if text.next():
        raise text.error("Extra data")
    refuse_unwritable(root)
    return root


def _entries(text: _Text, place: JsonValue, on_entry: Callable[[JsonValue], None]) -> None:
    text.take("[", "")
    number, more = 0, text.next() != "]"
    while more:
        entry = JsonValue(text.value(), place, number)
        refuse_unwritable(entry, depth=3)
        on_entry(entry)
        number, more = number + 1, text.next() == ","
        if more:
            text.take(",", "")
    text.take("]", "Expecting ',' delimiter")


class _Text:
    """The text of a file, of which a part is in memory.

    Args:
        file: the file, at its beginning.
        path: its path, for messages.
    """

    def __init__(self, file: IO[bytes], path: Path) -> None:
        """Find the encoding, as `json.loads` does."""
        self._file, self._path = file, path
        encoding = json.detect_encoding(file.read(4))
        file.seek(0)
        self._decoder = codecs.getincrementaldecoder(encoding)("surrogatepass")
        self._parser = json.JSONDecoder(object_pairs_hook=json_object, parse_int=json_integer)
        self._text, self._at, self._ended = "", 0, False
        # Bytes that were read, and lines before the text.
        self._bytes, self._lines = 0, 0

    def next(self) -> str:
        """The next character that is no blank, which stays; nothing at the end."""
        while True:
            while self._at < len(self._text):
                if self._text[self._at] not in _BLANKS:
                    return self._text[self._at]
                self._at += 1
            if not self._read(_CHUNK):
                return ""

    def take(self, character: str, fault: str) -> None:
        """Skip a character; InputError with the fault if another one is next."""
        if self.next() != character:
            raise self.error(fault)
        self._at += 1

    def value(self) -> Any:
        """The next value."""
        self.next()
        size = _CHUNK
        with parsing(self._path):
            while True:
                try:
                    value, end = self._parser.raw_decode(self._text, self._at)
                # What is cut off may be whole with more of the text.
                except json.JSONDecodeError as error:
                    if not self._read(size):
                        error.lineno += self._lines
                        raise
                else:
                    number = isinstance(value, int | float)
                    if not number or len(self._text) - end >= _OPEN_END or not self._read(size):
                        self._at = end
                        return value
                size *= 2

    def error(self, fault: str) -> InputError:
        """The error that the text is not JSON here."""
        line = self._lines + self._text.count("\n", 0, self._at) + 1
        return InputError(f"{self._path}, line {line}: not JSON ({fault}); correct the line")

    def _read(self, size: int) -> bool:
        """Read more of the file; false at its end."""
        if self._ended:
            return False
        data = self._file.read(size)
        self._ended = not data
        pending = len(self._decoder.getstate()[0])
        with parsing(self._path):
            try:
                more = self._decoder.decode(data, final=self._ended)
            except UnicodeDecodeError as error:
                error.start += self._bytes - pending
                raise
        if self._ended and not more:
            return False
        self._bytes += len(data)
        self._lines += self._text.count("\n", 0, self._at)
        self._text, self._at = self._text[self._at :] + more, 0
        return True
