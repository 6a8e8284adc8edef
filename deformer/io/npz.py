"""Arrays of NPZ files: sizes are checked before any memory is asked for."""

from __future__ import annotations

import math
import warnings
import zipfile
from pathlib import Path
from typing import IO

import numpy as np

from deformer.checks import shortened
from deformer.errors import InputError
from deformer.io.atomic import check_file

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
            room = max(_MOST_UNPACKED, _MOST_SHRUNK * path.stat().st_size) // _BYTES_OF_NUMBER
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
                    arrays[name] = _read_array(
                        stream, info.file_size, room, f"{path}, array {name!r}"
                    )
                room -= arrays[name].size
            return arrays
    except InputError:
        raise
    # zipfile and its decompressors raise errors of many types for damaged contents.
    except Exception as error:
        raise InputError(
            f"{path}: not an NPZ archive, or a damaged one ({type(error).__name__}); save it with "
            "numpy.savez(path, vertices=…, faces=…)"
        ) from error


def _read_array(stream: IO[bytes], size: int, room: int, label: str) -> np.ndarray:
    """The array of a member of `size` bytes, of at most `room` numbers, if its header says so."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of headers as Python 2 wrote them
        return _checked_array(stream, size, room, label)


def _checked_array(stream: IO[bytes], size: int, room: int, label: str) -> np.ndarray:
    try:
        version = np.lib.format.read_magic(stream)
        reader = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[version]
        shape, _, dtype = reader(stream)
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
    stream.seek(0)
    # Reading to the end compares the checksum, too.
    return np.lib.format.read_array(stream, allow_pickle=False)
