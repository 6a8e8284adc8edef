"""Named arrays in the format safetensors, written and read in parts: of any size."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from deformer.io.atomic import PathLike, atomic_path
from deformer.io.tensors import checked_tensors
from deformer.workspace import Rows, StoredArray, Workspace, blocks

_NAMES = {"F64": np.float64, "F32": np.float32, "I64": np.int64}
# The header is filled up with blanks so that arrays begin at a multiple of this.
_ALIGNED = 8


def write_rows(path: PathLike, arrays: Mapping[str, Rows], metadata: dict[str, str]) -> None:
    """Write arrays by name; an existing file is replaced once all is written.

    Args:
        path: the file; its directory must exist.
        arrays: name → array of float64, float32 or int64, in memory or in a file.
        metadata: name → text, in the file's header.

    Raises:
        OSError: writing failed.
    """
    codes = {np.dtype(kind): code for code, kind in _NAMES.items()}
    # Wide numbers first, so that all are aligned.
    order = sorted(arrays, key=lambda name: -arrays[name].dtype.itemsize)
    header: dict[str, object] = {"__metadata__": metadata}
    end = 0
    for name in order:
        rows = arrays[name]
        start, end = end, end + rows.nbytes
        header[name] = {
            "dtype": codes[rows.dtype],
            "shape": list(rows.shape),
            "data_offsets": [start, end],
        }
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % _ALIGNED)
    with atomic_path(Path(path)) as temporary, temporary.open("wb") as file:
        file.write(len(text).to_bytes(8, "little") + text)
        for name in order:
            rows = arrays[name]
            if isinstance(rows, StoredArray):
                for part in blocks(rows):
                    file.write(rows[part].reshape(-1).data)
            else:
                file.write(np.ascontiguousarray(rows).reshape(-1).data)


def read_rows(path: PathLike, workspace: Workspace, large: Collection[str]) -> dict[str, Rows]:
    """Arrays of a file by their names.

    Args:
        path: the file; it may be removed, but not changed, while the arrays are in use.
        workspace: gives memory for large arrays; those that it has none for stay in the file.
        large: names of the arrays that need not be in memory.

    Raises:
        InputError: the file is missing or damaged, or its size is not the one that it declares.
    """
    where = checked_tensors(path)
    # Closed when the arrays in it are given up.
    file = where.open("rb", buffering=0)
    length = int.from_bytes(file.read(8), "little")
    header = json.loads(file.read(length))
    found: dict[str, Rows] = {}
    for name, entry in header.items():
        if name == "__metadata__":
            continue
        offset = 8 + length + entry["data_offsets"][0]
        shape = tuple(entry["shape"])
        stored = StoredArray(file, shape or (1,), _NAMES[entry["dtype"]], offset)
        limited = name in large
        memory = workspace.memory(shape, stored.dtype) if limited else np.empty(shape, stored.dtype)
        if memory is None:
            found[name] = stored
            continue
        stored.read_into(0, memory.reshape(stored.shape))
        found[name] = memory
    return found
