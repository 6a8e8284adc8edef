"""Arrays of NPZ files: sizes are checked before any memory is asked for."""

from __future__ import annotations

import errno
import math
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np

from deformer.checks import shortened
from deformer.errors import InputError
from deformer.io.atomic import check_file
from deformer.workspace import Empty, Rows, blocks

# Zip files of zeros shrink a thousandfold, shapes a few times.
_MOST_UNPACKED = 256_000_000
_MOST_SHRUNK = 25
_BYTES_OF_NUMBER = 8  # once they are float64 or int64


def read_npz(path: Path, names: tuple[str, ...], *, others: bool = False) -> dict[str, np.ndarray]:
    """Arrays of an NPZ file.

    Args:
        path: the file.
        names: the arrays that must be there.
        others: read all others, too; else they are ignored.

    Raises:
        InputError: the file is missing, is no archive or damaged, lacks an array, or an array is
            of another size than its header says or holds Python objects.
    """
    with _members(path, names) as (archive, members):
        room = _room(path)
        arrays: dict[str, np.ndarray] = {}
        rest = [member.removesuffix(".npy") for member in members] if others else []
        for name in dict.fromkeys([*names, *rest]):
            if f"{name}.npy" not in members:
                raise InputError(
                    f"{path}: holds {shortened(name)}, which is no array; save it again with "
                    "numpy.savez"
                )
            info = members[f"{name}.npy"]
            with archive.open(info) as stream:
                arrays[name] = _read_array(stream, info.file_size, room, f"{path}, array {name!r}")
            room -= arrays[name].size
        return arrays


def read_rows_of(path: Path, name: str, empty: Empty) -> Rows:
    """A large array of an NPZ file as double precision, read some rows at a time.

    Args:
        path: the file.
        name: of an array of numbers with two or more axes.
        empty: makes the array.

    Raises:
        InputError: as `read_npz`, or the array is no array of real numbers.
    """
    with _members(path, (name,)) as (archive, members):
        info, label = members[f"{name}.npy"], f"{path}, array {name!r}"
        with archive.open(info) as stream:
            shape, by_columns, dtype = _header(stream, info.file_size, _room(path), label)
            if dtype.kind not in "fiu" or len(shape) < 2:
                raise InputError(
                    f"{label}: expected numbers of shape (N, V, 3), got {dtype} {shape}; correct it"
                )
            found = empty(shape)
            if by_columns:
                numbers = np.frombuffer(stream.read(), dtype)
                found[: shape[0]] = numbers.reshape(shape, order="F")
                return found
            for part in blocks(found):
                rows = part.stop - part.start, *shape[1:]
                data = _exactly(stream, math.prod(rows) * dtype.itemsize, label)
                found[part] = np.frombuffer(data, dtype).reshape(rows)
            # Reading to the end compares the checksum, too.
            stream.read()
            return found


def _exactly(stream: IO[bytes], size: int, label: str) -> bytes:
    data = stream.read(size)
    if len(data) != size:
        raise InputError(f"{label}: ends too early; the file is damaged, save it again")
    return data


def _room(path: Path) -> int:
    """Most numbers that a file of its size may hold."""
    return max(_MOST_UNPACKED, _MOST_SHRUNK * path.stat().st_size) // _BYTES_OF_NUMBER


@contextmanager
def _members(
    path: Path, names: tuple[str, ...]
) -> Iterator[tuple[zipfile.ZipFile, dict[str, zipfile.ZipInfo]]]:
    """An archive that has the arrays `names`, and its members; InputError if it is damaged."""
    check_file(path)
    try:
        with zipfile.ZipFile(path) as archive:
            members = {info.filename: info for info in archive.infolist()}
            for name in names:
                if f"{name}.npy" not in members:
                    found = [member.removesuffix(".npy") for member in members][:20]
                    expected = " and ".join(map(repr, names))
                    raise InputError(
                        f"{path}: holds arrays {found}, expected {expected}; add {name!r}"
                    )
            yield archive, members
    except InputError:
        raise
    # Of the system, not of the archive: such as a full disk that the array is written to.
    except OSError as error:
        if error.errno not in (None, errno.EINVAL):  # EINVAL: a place outside the file
            raise
        raise _broken(path, error) from error
    # zipfile and its decompressors raise errors of many types for damaged contents.
    except Exception as error:
        raise _broken(path, error) from error


def _broken(path: Path, error: Exception) -> InputError:
    return InputError(
        f"{path}: not an NPZ archive, or a damaged one ({type(error).__name__}); save it with "
        "numpy.savez(path, vertices=…, faces=…)"
    )


def _read_array(stream: IO[bytes], size: int, room: int, label: str) -> np.ndarray:
    """The array of a member of `size` bytes, of at most `room` numbers, if its header says so."""
    _header(stream, size, room, label)
    stream.seek(0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of headers as Python 2 wrote them
        # Reading to the end compares the checksum, too.
        return np.lib.format.read_array(stream, allow_pickle=False)


def _header(
    stream: IO[bytes], size: int, room: int, label: str
) -> tuple[tuple[int, ...], bool, np.dtype]:
    """Shape, true for columns first, and type of an array, from its checked header."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # as above
            version = np.lib.format.read_magic(stream)
            reader = {
                (1, 0): np.lib.format.read_array_header_1_0,
                (2, 0): np.lib.format.read_array_header_2_0,
            }[version]
            shape, by_columns, dtype = reader(stream)
    # The header is a Python expression, and its parser raises whatever Python's does.
    except Exception as error:
        raise InputError(
            f"{label}: its header or checksum is damaged; save it again with numpy.savez"
        ) from error
    if dtype.hasobject:
        raise InputError(
            f"{label}: holds Python objects, expected plain number arrays; cast them to numbers"
        )
    found = size - stream.tell()
    if min(shape, default=0) < 0 or math.prod(shape) * dtype.itemsize != found:
        raise InputError(
            f"{label}: {found} bytes, expected those of shape {shape} and type {dtype}; the file "
            "is damaged, save it again"
        )
    if math.prod(shape) > room:
        raise InputError(
            f"{label}: {math.prod(shape)} numbers, which is {_MOST_SHRUNK} times the size of the "
            "file or more, and shapes do not shrink that far; if they are right, save them with "
            "numpy.savez, which does not compress"
        )
    return shape, by_columns, dtype
