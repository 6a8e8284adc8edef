"""Building of GLB files from numpy arrays: accessors, meshes, nodes, skins, animations, images."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

# glTF 2.0, 3.6.2.2 and 5.1: kinds of numbers, and of what a row of them is.
_COMPONENTS = {"f4": 5126, "u1": 5121, "u2": 5123, "u4": 5125, "i1": 5120, "i2": 5122}
_ROWS = {(): "SCALAR", (2,): "VEC2", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
VERTICES = 34962
"""Target of a buffer view with attributes of vertices."""
INDICES = 34963
"""Target of a buffer view with indices."""
_JSON, _BINARY = b"JSON", b"BIN\0"


class GlbBuilder:
    """Collects the parts of a glTF 2.0 asset; `data` is the GLB file.

    `add` appends an object to one of the lists at the top of the JSON and returns its index, by
    which others refer to it; arrays and images become accessors and buffer views in one buffer,
    whose bytes are `binary`.
    """

    def __init__(self, generator: str = "Deformer") -> None:
        """An asset without content."""
        self.json: dict[str, Any] = {"asset": {"version": "2.0", "generator": generator}}
        self.binary = bytearray()

    @classmethod
    def of(cls, description: dict[str, Any], binary: bytes) -> GlbBuilder:
        """An asset to go on with.

        Args:
            description: its JSON, which is changed in place.
            binary: the bytes of its only buffer.
        """
        found = cls()
        found.json, found.binary = description, bytearray(binary)
        return found

    def add(self, family: str, item: dict[str, Any]) -> int:
        """Append an item to a list of the JSON, such as "nodes"; gives its index."""
        items = self.json.setdefault(family, [])
        items.append(item)
        return len(items) - 1

    def use_extension(self, name: str, required: bool = False) -> None:
        """Declare an extension that the asset uses."""
        for key in ("extensionsUsed", "extensionsRequired")[: 1 + required]:
            if name not in self.json.setdefault(key, []):
                self.json[key].append(name)

    def add_array(self, array: NDArray, target: int | None = None, normalised: bool = False) -> int:
        """Index of a new accessor.

        Args:
            array: (n,), (n, 2…4) or (n, 4, 4) numbers, n > 0. Floats are stored in single
                precision, whole numbers in their own type; matrices are transposed, as glTF has
                them by columns.
            target: `VERTICES` for attributes and morph targets, `INDICES` for corners of
                triangles; None for all other arrays.
            normalised: whole numbers stand for fractions of the largest.
        """
        array = np.asarray(array)
        if array.dtype.kind == "f":
            array = array.astype("<f4")
        row = array.shape[1:]
        stored = np.ascontiguousarray(array.swapaxes(1, 2) if row == (4, 4) else array)
        width = int(np.prod(row, dtype=int)) * array.itemsize
        # Attributes of vertices begin at multiples of four bytes.
        padding = -width % 4 if target == VERTICES else 0
        if padding:
            rows = np.zeros((len(stored), width + padding), np.uint8)
            rows[:, :width] = stored.view(np.uint8).reshape(len(stored), width)
            view = self.add_bytes(rows.tobytes(), target, stride=width + padding)
        else:
            view = self.add_bytes(stored.tobytes(), target)
        accessor: dict[str, Any] = {
            "bufferView": view,
            "componentType": _COMPONENTS[array.dtype.str[1:]],
            "count": len(array),
            "type": _ROWS[row],
        }
        if normalised:
            accessor["normalized"] = True
        if row in ((), (3,)):
            # Positions and times of animations must have these; others may.
            flat = array.reshape(len(array), -1)
            accessor["min"] = flat.min(axis=0).tolist()
            accessor["max"] = flat.max(axis=0).tolist()
        return self.add("accessors", accessor)

    def add_bytes(self, data: bytes, target: int | None = None, stride: int | None = None) -> int:
        """Index of a new buffer view of bytes, such as those of an image.

        Args:
            data: the bytes.
            target: as in `add_array`.
            stride: bytes from row to row, where the rows are padded.
        """
        self.binary += b"\0" * (-len(self.binary) % 4)
        view: dict[str, Any] = {
            "buffer": 0,
            "byteOffset": len(self.binary),
            "byteLength": len(data),
        }
        if target is not None:
            view["target"] = target
        if stride is not None:
            view["byteStride"] = stride
        self.binary += data
        return self.add("bufferViews", view)

    @property
    def data(self) -> bytes:
        """The GLB file."""
        described = dict(self.json)
        if self.binary:
            buffer = next(iter(self.json.get("buffers", [])), {})
            described["buffers"] = [{**buffer, "byteLength": len(self.binary)}]
        text = json.dumps(described, separators=(",", ":"), allow_nan=False).encode()
        return glb_of(text, bytes(self.binary))


def glb_of(text: bytes, binary: bytes) -> bytes:
    """The GLB file of a JSON text and the bytes of its first buffer (which may be none)."""
    chunks = [(_JSON, text + b" " * (-len(text) % 4))]
    if binary:
        chunks.append((_BINARY, binary + b"\0" * (-len(binary) % 4)))
    body = b"".join(len(data).to_bytes(4, "little") + kind + data for kind, data in chunks)
    return b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body
