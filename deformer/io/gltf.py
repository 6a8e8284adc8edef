"""One glTF 2.0 asset, GLB or .gltf with its files: the JSON, the buffers, accessors as arrays."""

from __future__ import annotations

import base64
import binascii
import json
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from deformer.checks import checked_path
from deformer.errors import InputError
from deformer.geometry import FloatArray
from deformer.io.atomic import PathLike, read_bytes

# glTF 2.0, 3.6.2.2: kinds of numbers, and how many of them a row has.
FLOAT = {5126: "<f4"}
# With the extension KHR_mesh_quantization positions may be integers, too.
INTEGERS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2"}
INDICES = {5121: "u1", 5123: "<u2", 5125: "<u4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_COMPRESSION = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
# Extensions that a file may require although nothing is read of them: they leave positions alone.
_HARMLESS = (
    *("KHR_mesh_quantization", "KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_"),
    *("KHR_lights_", "EXT_lights_", "KHR_xmp", "KHR_animation_pointer", "KHR_node_visibility"),
    "EXT_mesh_gpu_instancing",  # refused where a node has it
)
_MOST_URI = 200  # characters of a name that a message shows
# An accessor without a buffer view has no bytes: so many of its rows may be asked for by any file.
_MOST_ZEROS = 4_000_000


def read_gltf(path: PathLike) -> GltfAsset:
    """Open a .glb or .gltf file; its buffers are read when they are asked for.

    Args:
        path: the file; buffers and images of a .gltf lie in its folder.

    Raises:
        InputError: the file is missing or no glTF 2.0, is compressed, or requires an extension
            that is not known here.
    """
    path = checked_path(path, "path")
    return GltfAsset(read_bytes(path), str(path), path.parent)


class GltfAsset:
    """The parsed JSON of one file, and its buffers.

    Everything that is taken from the JSON is checked: what is wrong is an InputError that names the
    object. `json` is the JSON itself, `name` the file's name for messages.
    """

    def __init__(self, data: bytes, name: str, folder: Path | None = None) -> None:
        """Parse a file.

        Args:
            data: contents of the file, GLB or JSON.
            name: file name for messages.
            folder: where buffers in files of their own lie; None if there are none.

        Raises:
            InputError: as of `read_gltf`.
        """
        self.name = name
        self._folder = folder
        self.json, self._binary = _parsed(data, name)
        self._buffers: dict[int, bytes] = {}
        self._files: dict[Path, bytes] = {}
        self._bytes = len(data)
        for extension in _strings(self.json.get("extensionsRequired")):
            self.refuse_compression("the file", [extension])
            if not extension.startswith(_HARMLESS):
                raise InputError(
                    f"{name}: requires the extension {extension[:60]!r}, which is not known here; "
                    "export the file without it, or as PLY"
                )
        used = set(_strings(self.json.get("extensionsUsed")))
        self.position_types = FLOAT | (INTEGERS if "KHR_mesh_quantization" in used else {})

    @property
    def size(self) -> int:
        """Bytes of the file and of the buffers that were read so far."""
        return self._bytes

    def buffer(self, index: Any, label: str) -> bytes:
        """All bytes of buffer `index`; views are checked against them, not its declared length.

        Args:
            index: number in the JSON's list.
            label: what refers to it, for messages.

        Raises:
            InputError: there is no such buffer or file, or its name leads out of the folder.
        """
        buffer = self.item("buffers", index, label)
        if index not in self._buffers:
            self._buffers[index] = self._contents(buffer, index)
        return self._buffers[index]

    def _contents(self, buffer: dict, index: int) -> bytes:
        if "uri" not in buffer:
            if index != 0 or self._binary is None:
                raise self.broken(f"buffer {index} is missing: it has no uri, nor a binary chunk")
            return self._binary
        return self.resource(buffer["uri"], f"buffer {index}")

    def resource(self, uri: Any, label: str) -> bytes:
        """Bytes that a uri stands for: a data URI, or a file in the folder of this one.

        Args:
            uri: the text in the JSON.
            label: what refers to it, for messages.

        Raises:
            InputError: no such file, a damaged data URI, or a name that leads out of the folder.
        """
        if not isinstance(uri, str):
            raise self.broken(f"{label} has uri {uri!r}"[:120])
        if uri[:5].lower() == "data:":
            head, comma, text = uri.partition(",")
            try:
                if not comma or not head.endswith(";base64"):
                    raise ValueError
                # Of the file, which is counted already.
                return base64.b64decode(text, validate=True)
            except (ValueError, binascii.Error):
                raise self.broken(f"{label} is a data URI that is no base64") from None
        path = self._inside(uri, label)
        # Any number of buffers may name one file.
        if path not in self._files:
            self._files[path] = read_bytes(path)
            self._bytes += len(self._files[path])
        return self._files[path]

    def _inside(self, uri: str, label: str) -> Path:
        """The file of a relative uri; it must lie in the folder of the asset."""
        shown = f"{label} is kept in {uri[:_MOST_URI]!r}"
        if self._folder is None:
            raise self.refusal(f"{shown}, outside the file", "export one .glb file")
        name = unquote(uri)
        try:
            folder = self._folder.resolve()
            path = (folder / name).resolve()
            inside = "\0" not in name and path.is_relative_to(folder)
        except (OSError, ValueError, RuntimeError):
            inside, path = False, self._folder
        if not inside or "://" in uri or "\\" in name:
            raise InputError(
                f"{self.name}: {shown}, which is not a file in its folder; put it there and name "
                "it so, or export one .glb file"
            )
        if not path.exists():
            raise InputError(
                f"{self.name}: {shown}, which is missing; put it beside the file, or export one "
                ".glb file"
            )
        return path

    def array(self, index: Any, shape: str, types: dict[int, str], label: str) -> np.ndarray:
        """Accessor `index` as it is stored, (count, numbers of a row), read-only.

        Sparse values are set; an accessor without a buffer view is of zeros.

        Args:
            index: number in the JSON's list.
            shape: "SCALAR", "VEC2", "VEC3", "VEC4" or "MAT4" (column by column).
            types: the component types that are allowed, as numbers of glTF and of numpy.
            label: what refers to it, for messages.

        Raises:
            InputError: another shape or type, or more rows than there are bytes.
        """
        accessor = self.item("accessors", index, label)
        label = f"{label}, accessor {index}"
        number, kind_name = accessor.get("componentType"), accessor.get("type")
        if kind_name != shape:
            raise self.broken(f"{label} is of type {kind_name!r}, expected {shape!r}")
        if type(number) is not int or number not in types:
            raise self.refusal(
                f"{label} has numbers of type {number!r}, expected one of {sorted(types)}"[:160],
                "export without quantisation",
            )
        kind, width = np.dtype(types[number]), _WIDTHS[shape]
        count = self.whole(accessor, "count", None, label)
        if count == 0:
            raise self.broken(f"{label} has 0 items")
        if "bufferView" in accessor:
            stored = self._rows(accessor, accessor["bufferView"], count, width, kind, label)
        elif count > _MOST_ZEROS + self.size:
            raise self.broken(f"{label} has {count} items without a byte of data")
        else:
            stored = np.broadcast_to(np.zeros((), kind), (count, width))
        if "sparse" in accessor:
            stored = self._with_sparse(accessor, stored, label)
        return stored

    def floats(self, index: Any, shape: str, types: dict[int, str], label: str) -> FloatArray:
        """Accessor `index` (count, numbers) as float64, normalised where it says so; see `array`.

        Raises:
            InputError: as of `array`, or a number that is not finite.
        """
        stored = self.array(index, shape, types, label)
        values = stored.astype(np.float64)
        if stored.dtype.kind == "f":
            if not np.isfinite(values).all():
                raise self.broken(f"{label}, accessor {index} has a number that is not finite")
        elif self.item("accessors", index, label).get("normalized"):
            # glTF 2.0, 3.6.2.2: c / 127 for 8 bits with sign, but never below −1.
            values = np.maximum(values / np.iinfo(stored.dtype).max, -1.0)
        return values

    def _rows(
        self, part: dict, view_index: Any, count: int, width: int, kind: np.dtype, label: str
    ) -> np.ndarray:
        """Rows (count, width) of a buffer view from `byteOffset` of `part` on, not copied."""
        view = self.item("bufferViews", view_index, label)
        self.refuse_compression(label, self.part(view, "extensions", {}, label))
        row = width * kind.itemsize
        stride = self.whole(view, "byteStride", row, label)
        first = self.whole(part, "byteOffset", 0, label)
        start = self.whole(view, "byteOffset", 0, label)
        length = self.whole(view, "byteLength", None, label)
        if count == 0 or stride < row or first + (count - 1) * stride + row > length:
            raise self.broken(
                f"{label} has {count} items of {row} bytes, {stride} apart from byte {first}, in a "
                f"view of {length} bytes"
            )
        data = self.buffer(view.get("buffer"), label)
        if start + length > len(data):
            raise self.broken(f"{label} is in a view up to byte {start + length} of {len(data)}")
        return np.ndarray((count, width), kind, data, start + first, (stride, kind.itemsize))

    def _with_sparse(self, accessor: dict, stored: np.ndarray, label: str) -> np.ndarray:
        """A copy of the rows in which the accessor's sparse ones are set."""
        sparse = self.part(accessor, "sparse", {}, label)
        count = self.whole(sparse, "count", None, f"{label}, sparse")
        if not 0 < count <= len(stored):
            raise self.broken(f"{label} has {count} sparse items of {len(stored)}")
        parts = [self.part(sparse, key, {}, f"{label}, sparse") for key in ("indices", "values")]
        number = parts[0].get("componentType")
        if type(number) is not int or number not in INDICES:
            raise self.broken(f"{label} has sparse indices of type {number!r}"[:120])
        rows = self._rows(
            parts[0], parts[0].get("bufferView"), count, 1, np.dtype(INDICES[number]), label
        ).ravel()
        if rows.max() >= len(stored):
            raise self.broken(f"{label} has sparse index {rows.max()} of {len(stored)} items")
        values = self._rows(
            parts[1], parts[1].get("bufferView"), count, stored.shape[1], stored.dtype, label
        )
        changed = stored.copy()
        changed[rows] = values
        return changed

    def item(self, family: str, index: Any, label: str) -> dict:
        """Object number `index` of one of the lists at the top of the JSON.

        Args:
            family: name of the list, such as "nodes".
            index: what the JSON has as the number.
            label: what refers to it, for messages.

        Raises:
            InputError: there is no such object.
        """
        items = self.json.get(family)
        if not isinstance(items, list):
            raise self.broken(f"no list of {family}")
        if type(index) is not int or not 0 <= index < len(items):
            raise self.broken(f"{label} refers to number {index!r} of {len(items)} {family}"[:120])
        if not isinstance(items[index], dict):
            raise self.broken(f"number {index} of {family} is no object")
        return items[index]

    def part(self, item: dict, key: str, default: Any, label: str) -> Any:
        """Value of `key`, which is of the type of its default.

        Raises:
            InputError: it is of another type.
        """
        value = item.get(key, default)
        if not isinstance(value, type(default)):
            kind = "a list" if isinstance(default, list) else "an object"
            raise self.broken(f"{label} has {key} {str(value)[:60]}, expected {kind}")
        return value

    def whole(self, item: dict, key: str, default: int | None, label: str) -> int:
        """Value of `key`, a number of 0 or more.

        Raises:
            InputError: it is something else.
        """
        value = item.get(key, default)
        if type(value) is not int or not 0 <= value < 2**53:
            raise self.broken(f"{label} has {key} {value!r}"[:120])
        return value

    def numbers(self, item: dict, key: str, length: int | None, label: str) -> FloatArray:
        """Value (length,) of `key`, a list of `length` finite numbers (None: any).

        Raises:
            InputError: it is something else.
        """
        values = item[key]
        if (
            not isinstance(values, list)
            or (length is not None and len(values) != length)
            or not all(type(v) in (int, float) and abs(v) < 1e300 for v in values)
        ):
            found = f"{label} has {key} {values}"
            expected = "numbers" if length is None else f"{length} numbers"
            raise self.broken(f"{found[:120]}, expected {expected}")
        return np.array(values, dtype=np.float64)

    def refuse_compression(self, label: str, extensions: Any) -> None:
        """Raise InputError if an extension is one that compresses vertices."""
        for extension, method in _COMPRESSION.items():
            if extension in extensions:
                raise self.refusal(f"{label} is compressed by {method}", "switch compression off")

    def refusal(self, found: str, remedy: str) -> InputError:
        """Error of something that the format allows and that is not read."""
        return InputError(
            f"{self.name}: {found}, so vertices cannot be kept exactly; {remedy}, or export as PLY"
        )

    def broken(self, found: str) -> InputError:
        """Error of something that the format does not allow."""
        return InputError(
            f"{self.name}: broken glTF structure, {found}; export the file again as glTF 2.0"
        )


def _parsed(data: bytes, name: str) -> tuple[dict, bytes | None]:
    """The JSON and the binary chunk of a GLB file; of a .gltf, the JSON alone."""
    text, binary = data, None
    if data.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] != b"{":
        text, binary = _chunks(data, name)
    try:
        scene = json.loads(text.removeprefix(b"\xef\xbb\xbf"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{name}: unreadable glTF JSON ({error}); export it again") from error
    if not isinstance(scene, dict):
        raise InputError(f"{name}: the glTF JSON is no object; export the file again")
    return scene, binary


def _chunks(data: bytes, name: str) -> tuple[bytes, bytes | None]:
    """The JSON chunk and the binary chunk of a GLB file."""
    if data[:4] != b"glTF" or data[4:8] != (2).to_bytes(4, "little"):
        raise InputError(
            f"{name}: no glTF 2.0 header, expected a .glb or .gltf file; export it again"
        )
    chunks: dict[bytes, bytes] = {}
    at = 12
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "little")
        chunk = data[at + 8 : at + 8 + length]
        if len(chunk) != length or at + 8 > len(data):
            raise InputError(
                f"{name}: a chunk holds {len(chunk)} bytes, expected {length}; the file is cut "
                "short, export it again"
            )
        chunks.setdefault(data[at + 4 : at + 8], chunk)
        at += 8 + length
    return chunks.get(b"JSON", b""), chunks.get(b"BIN\0")


def _strings(values: Any) -> list[str]:
    return [v for v in values if isinstance(v, str)] if isinstance(values, list) else []
