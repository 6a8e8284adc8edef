"""Large arrays: in memory as far as a limit allows, in temporary files beyond it.

Files are read and written in pieces and never mapped: pages of a mapped file would count as memory
of the process. They have no name (where the system allows that), so that nothing is left of them
when the process ends, however it ends.
"""

from __future__ import annotations

import math
import os
import shutil
import tempfile
import threading
import weakref
from collections.abc import Callable, Iterator
from copy import copy
from itertools import pairwise
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from deformer.checks import checked_number, checked_path, free_memory, rounded
from deformer.errors import InputError

# Bytes of the libraries, the mesh and its factors, which no limit can bring down.
LEAST_MEMORY = 500_000_000
# Limit where hardly any memory is free: small sets are trained on nevertheless.
_LEAST_DEFAULT = 1_500_000_000
# Share of the free memory that is the limit where none is given.
_SHARE = 0.5
# An array larger than this share of the memory that is left goes to a file.
LARGE_SHARE = 0.5
# Bytes that are read at once where an array is gone through.
_BLOCK = 8_000_000


class StoredArray:
    """An array in a file. It is indexed along its first axis, and by (integer, slice).

    Args:
        file: unbuffered binary file, open for what is done with the array.
        shape: of the array.
        dtype: of its numbers.
        offset: of its first byte in the file.
    """

    def __init__(
        self, file: IO[bytes], shape: tuple[int, ...], dtype: DTypeLike, offset: int = 0
    ) -> None:
        """Nothing is read yet."""
        self._file, self._offset, self._lock = file, offset, threading.Lock()
        self.shape, self.dtype = tuple(shape), np.dtype(dtype)
        # Rows of the file, where the array has others than all in order.
        self._rows: NDArray[np.int64] | None = None

    def take(self, rows: NDArray[np.int64]) -> StoredArray:
        """The array of the rows at indices (n,), in the same file; it is only read."""
        found = copy(self)
        found.shape = len(rows), *self.shape[1:]
        found._rows = rows if self._rows is None else self._rows[rows]
        return found

    def __len__(self) -> int:
        """Length of the first axis."""
        return self.shape[0]

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    @property
    def nbytes(self) -> int:
        """Size in bytes."""
        return math.prod(self.shape) * self.dtype.itemsize

    def __iter__(self) -> Iterator[NDArray]:
        """Go through the first axis; a few megabytes are in memory at a time."""
        for part in blocks(self):
            yield from self[part]

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray:
        """Refuse: what converts the whole array was not made for one that memory may not hold."""
        raise InputError(
            f"an array of shape {self.shape} is in a file, expected one in memory; give more memory"
        )

    def __getitem__(self, key: Any) -> NDArray:
        """Read a row, the rows of a slice without steps or at indices, or (row, slice) of one."""
        if isinstance(key, tuple):
            row, inner = key
            start, stop, _ = inner.indices(self.shape[1])
            out = np.empty((max(0, stop - start), *self.shape[2:]), self.dtype)
            if self._rows is not None:
                row = int(self._rows[row])
            self._read(row * self.shape[1] + start, math.prod(self.shape[2:]), out)
            return out
        if isinstance(key, slice):
            start, stop, _ = key.indices(len(self))
            out = np.empty((max(0, stop - start), *self.shape[1:]), self.dtype)
            self.read_into(start, out)
            return out
        if isinstance(key, int | np.integer):
            out = np.empty((1, *self.shape[1:]), self.dtype)
            self.read_into(range(len(self))[int(key)], out)
            return out[0]
        rows = np.asarray(key, dtype=np.int64)
        out = np.empty((len(rows), *self.shape[1:]), self.dtype)
        for n, row in enumerate(rows.tolist()):
            self.read_into(row, out[n : n + 1])
        return out

    def __setitem__(self, key: slice | tuple[int, slice], values: ArrayLike) -> None:
        """Write the rows of a slice without steps, or those of (row, slice)."""
        if isinstance(key, tuple):
            row, inner = key
            first, size = row * self.shape[1] + inner.start, math.prod(self.shape[2:])
        else:
            first, size = key.start or 0, math.prod(self.shape[1:])
        data = np.ascontiguousarray(values, dtype=self.dtype)
        if data.size:
            with self._lock:
                self._file.seek(self._offset + first * size * self.dtype.itemsize)
                view = data.reshape(-1).data.cast("B")
                while len(view):
                    view = view[self._file.write(view) :]

    def read_into(self, start: int, out: NDArray) -> None:
        """Read rows from `start` on into `out`, a contiguous array of this one's dtype."""
        size = math.prod(self.shape[1:])
        if self._rows is None:
            self._read(start, size, out)
            return
        # Rows that follow each other in the file are read at once.
        rows = self._rows[start : start + len(out)]
        bounds = [0, *(np.flatnonzero(np.diff(rows) != 1) + 1).tolist(), len(rows)]
        for first, last in pairwise(bounds):
            if first < last:
                self._read(int(rows[first]), size, out[first:last])

    def _read(self, start: int, size: int, out: NDArray) -> None:
        """Read into `out` from item `start` on, of `size` numbers each."""
        if not out.size:
            return
        view = out.reshape(-1).data.cast("B")
        with self._lock:
            self._file.seek(self._offset + start * size * self.dtype.itemsize)
            while len(view):
                count = self._file.readinto(view)  # type: ignore[attr-defined]
                if not count:
                    raise OSError(f"{self._file.name}: cut short while it was read")
                view = view[count:]


# An array that is read and written along its first axis, wherever it is.
Rows = NDArray | StoredArray


def slices(count: int, size: int) -> list[slice]:
    """Slices that cover 0…count − 1, each of `size` but the last."""
    return [slice(start, min(start + size, count)) for start in range(0, count, size)]


def blocks(rows: Rows, size: int = _BLOCK) -> list[slice]:
    """Slices that cover the first axis of an array, each of `size` bytes or of one row."""
    row = math.prod(rows.shape[1:]) * rows.dtype.itemsize
    return slices(len(rows), max(1, size // max(row, 1)))


# Makes an array of double precision, of any contents, of a shape.
Empty = Callable[[tuple[int, ...]], Rows]


def _gigabytes(size: float, whole: Callable[[float], int]) -> str:
    """Three digits, rounded by `whole`: up for what is needed, so that as much is enough."""
    digit = 10.0 ** (math.floor(math.log10(size)) - 2)
    return rounded(whole(size / digit) * digit / 1e9)


def in_memory(shape: tuple[int, ...]) -> Rows:
    """An array of double precision in memory, whatever its size."""
    return np.empty(shape)


class Workspace:
    """Memory for arrays, up to a limit, and a folder for those that exceed it.

    Args:
        memory: bytes that the process may use; None is half of what is free.
        folder: for temporary files; None is the system's folder for them.

    Raises:
        InputError: less memory than the libraries alone take, or no folder that is writable.
    """

    def __init__(self, memory: float | None = None, folder: str | Path | None = None) -> None:
        """Nothing is allotted yet."""
        if memory is None:
            memory = max(_LEAST_DEFAULT, _SHARE * free_memory())
        remedy = f"give at least {LEAST_MEMORY / 1e6:g}MB ({LEAST_MEMORY:g} bytes), or leave it out"
        self.limit = checked_number(memory, "memory", least=LEAST_MEMORY, remedy=remedy)
        self.folder = None if folder is None else checked_path(folder, "cache")
        if self.folder is not None and not self.folder.is_dir():
            raise InputError(f"cache: {self.folder} is no directory; create it or name another")
        if self.folder is not None and not os.access(self.folder, os.W_OK | os.X_OK):
            raise InputError(f"cache: {self.folder} is not writable; name another")
        self._left, self._reserved = self.limit - LEAST_MEMORY, 0.0

    @property
    def left(self) -> float:
        """Bytes of the limit that are neither kept nor taken."""
        return self._left

    def reserve(self, size: float, what: str) -> None:
        """Keep memory for what is always in memory; what was kept before is free again.

        Args:
            size: in bytes.
            what: subject of the message, with the numbers that the user can change.

        Raises:
            InputError: the limit does not allow as much.
        """
        self._left, self._reserved = self._left + self._reserved, 0.0
        if size > self._left:
            needed = self.limit - self._left + size
            raise InputError(
                f"{what}: would take {_gigabytes(needed, math.ceil)} GB of memory, expected at "
                f"most the {_gigabytes(self.limit, math.floor)} GB that it may use; give it as "
                "much, or ask for less"
            )
        self._left, self._reserved = self._left - size, size

    def empty(self, shape: tuple[int, ...], dtype: DTypeLike) -> Rows:
        """An array of any contents, in memory if it is small for what is left of it.

        Raises:
            InputError: the folder has no room for it.
        """
        dtype = np.dtype(dtype)
        array = self.memory(shape, dtype)
        if array is not None:
            return array
        return StoredArray(self._file(math.prod(shape) * dtype.itemsize), shape, dtype)

    def doubles(self, shape: tuple[int, ...]) -> Rows:
        """`empty` of double precision."""
        return self.empty(shape, np.float64)

    def memory(self, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray | None:
        """An array (*shape) in memory, of any contents; None if not small for what is left."""
        size = math.prod(shape) * np.dtype(dtype).itemsize
        if size > LARGE_SHARE * self._left:
            return None
        array = np.empty(shape, dtype)
        self._left -= size
        weakref.finalize(array, self._release, size)
        return array

    def growing(self) -> IO[bytes]:
        """A temporary file for what has no known size, such as entries of a list that is read."""
        return tempfile.TemporaryFile(dir=self.place, prefix="deformer-")

    @property
    def place(self) -> Path:
        """The folder of temporary files."""
        return Path(tempfile.gettempdir()) if self.folder is None else self.folder

    def _release(self, size: int) -> None:
        self._left += size

    def _file(self, size: int) -> IO[bytes]:
        where = self.place
        free = shutil.disk_usage(where).free
        if size > free:
            raise InputError(
                f"{where}: has {rounded(free / 1e9)} GB free, expected {rounded(size / 1e9)} GB "
                "for a temporary file; make room or name another folder for the cache"
            )
        # Closed when the array is given up.
        file = tempfile.TemporaryFile(dir=where, prefix="deformer-", buffering=0)  # noqa: SIM115
        # The file has its size from the start: what was not written yet reads as zeros.
        file.truncate(size)
        return file  # type: ignore[return-value]
