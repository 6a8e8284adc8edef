"""A GLB file whose arrays can be replaced, while all that is not replaced keeps its bytes."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any

import numpy as np

from deformer.io import VERTICES, GlbBuilder, GltfAsset

# glTF 2.0, 3.6.2.2: kinds of numbers, and how many a row has.
COMPONENTS = {5126: "<f4", 5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2"}
_FLOAT = 5126
_SIZES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


class GlbFile:
    """An editable copy of an asset with one buffer.

    `json` is its description, to be changed in place; `data` the file, without the bytes that
    nothing refers to any more.
    """

    def __init__(self, asset: GltfAsset) -> None:
        """A copy of an asset that has no other files."""
        binary = asset.buffer(0, "the file") if asset.json.get("buffers") else b""
        self._builder = GlbBuilder.of(copy.deepcopy(asset.json), binary)
        self.json = self._builder.json
        self._views = set(_references(self.json, "bufferView"))
        self._accessors = set(self._used_accessors())

    def add(self, family: str, item: dict[str, Any]) -> int:
        """Append an item to a list of the description; gives its index."""
        return self._builder.add(family, item)

    def add_array(self, array: np.ndarray, target: int) -> int:
        """Index of a new accessor; arguments as of `GlbBuilder.add_array`."""
        return self._builder.add_array(array, target)

    def replace_array(
        self, index: int, rows: np.ndarray, owners: list[dict[str, Any]], key: str
    ) -> int:
        """Index of an accessor with new rows for some of its users.

        Args:
            index: the accessor that they use now.
            rows: (n, k) float32.
            owners: the objects that refer to it.
            key: the name under which they do.
        """
        accessor = self.json["accessors"][index]
        if sum(1 for user in self._used_accessors() if user == index) > len(owners):
            return self._builder.add_array(rows, VERTICES)
        bounded = key == "POSITION" or "min" in accessor or "max" in accessor
        if (place := self._own_place(index, rows)) is not None:
            self._builder.binary[place : place + 4 * rows.size] = rows.astype("<f4").tobytes()
        else:
            new = self.json["accessors"].pop(self._builder.add_array(rows, VERTICES))
            named = {k: v for k, v in accessor.items() if k in ("name", "extras")}
            accessor.clear()
            accessor.update({**new, **named})
        for bound, values in (("min", rows.min(axis=0)), ("max", rows.max(axis=0))):
            accessor.pop(bound, None)
            if bounded:
                accessor[bound] = values.tolist()
        return index

    def _own_place(self, index: int, rows: np.ndarray) -> int | None:
        """Byte of the buffer where an array can be written over; None if others are in its way."""
        accessor = self.json["accessors"][index]
        if accessor["componentType"] != _FLOAT or "sparse" in accessor:
            return None
        first, last = self._span(accessor)
        if last - first != rows.size * 4 or "bufferView" not in accessor:
            return None
        number = accessor["bufferView"]
        for n, other in enumerate(self.json["accessors"]):
            if n != index and "bufferView" in other:
                start, end = self._span(other)
                if start < last and first < end:
                    return None
        shown = {other.get("bufferView") for other in self.json["accessors"]}
        for n in set(_references(self.json, "bufferView")) - shown | {number}:
            view = self.json["bufferViews"][n]
            start = view.get("byteOffset", 0)
            if n != number and start < last and first < start + view["byteLength"]:
                return None
        return first

    def _span(self, accessor: dict[str, Any]) -> tuple[int, int]:
        """First byte of an array in the buffer, and that after its last one."""
        if "bufferView" not in accessor:
            return 0, 0
        view = self.json["bufferViews"][accessor["bufferView"]]
        size = _SIZES[accessor["componentType"]] * _WIDTHS[accessor["type"]]
        stride = view.get("byteStride", size)
        first = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return first, first + stride * (accessor["count"] - 1) + size

    def remove_animations(self, nodes: set[int]) -> None:
        """Remove the animations' channels that move any of some nodes."""
        animations = self.json.get("animations", [])
        for animation in animations:
            animation["channels"] = [
                channel for channel in animation["channels"] if not _moves(channel, nodes)
            ]
            used = sorted({channel["sampler"] for channel in animation["channels"]})
            animation["samplers"] = [animation["samplers"][n] for n in used]
            for channel in animation["channels"]:
                channel["sampler"] = used.index(channel["sampler"])
        left = [animation for animation in animations if animation["channels"]]
        if left:
            self.json["animations"] = left
        else:
            self.json.pop("animations", None)

    def remove_nodes(self, removed: set[int]) -> None:
        """Remove nodes that nothing but their parents and scenes refer to.

        Args:
            removed: their numbers; nodes below them are among them.
        """
        nodes = self.json["nodes"]
        left = [n for n in range(len(nodes)) if n not in removed]
        numbers = {old: new for new, old in enumerate(left)}
        owners = [(node, "children") for node in nodes]
        owners += [(shown, "nodes") for shown in self.json.get("scenes", [])]
        owners += [(skin, "joints") for skin in self.json.get("skins", [])]
        for owner, key in owners:
            if key in owner:
                owner[key] = [numbers[n] for n in owner[key] if n in numbers]
                if not owner[key]:
                    del owner[key]
        targets = [
            channel.get("target", {})
            for animation in self.json.get("animations", [])
            for channel in animation["channels"]
        ]
        for owner, key in [
            *((target, "node") for target in targets),
            *((skin, "skeleton") for skin in self.json.get("skins", [])),
        ]:
            if key in owner:
                owner[key] = numbers[owner[key]]
        self.json["nodes"] = [nodes[n] for n in left]

    @property
    def data(self) -> bytes:
        """The file."""
        for index in self._accessors - set(self._used_accessors()):
            accessor = self.json["accessors"][index]
            # Of zeros, without bytes: other numbers stay.
            for key in ("bufferView", "byteOffset", "sparse", "min", "max"):
                accessor.pop(key, None)
        self._remove_views(self._views - set(_references(self.json, "bufferView")))
        return self._builder.data

    def _remove_views(self, removed: set[int]) -> None:
        """Remove buffer views, and the bytes that were theirs alone."""
        if not removed:
            return
        views, binary = self.json["bufferViews"], self._builder.binary
        spans = [(v.get("byteOffset", 0), v.get("byteOffset", 0) + v["byteLength"]) for v in views]
        freed = np.zeros(len(binary) + 1, dtype=bool)
        for n in removed:
            freed[slice(*spans[n])] = True
        for n in set(range(len(views))) - removed:
            freed[slice(*spans[n])] = False
        # In steps of four bytes, so that all arrays keep their alignment.
        freed = freed[: len(freed) // 4 * 4].reshape(-1, 4).all(axis=1)
        kept = np.repeat(~freed, 4)
        rest = np.ones(len(binary) - len(kept), dtype=bool)
        kept = np.concatenate([kept, rest])[: len(binary)]
        gone = np.concatenate([[0], np.cumsum(~kept)])
        for n, (first, _) in enumerate(spans):
            views[n]["byteOffset"] = first - int(gone[first])
        binary[:] = np.frombuffer(bytes(binary), np.uint8)[kept].tobytes()
        left = [n for n in range(len(views)) if n not in removed]
        _renumber(self.json, "bufferView", {old: new for new, old in enumerate(left)})
        self.json["bufferViews"] = [views[n] for n in left]

    def _used_accessors(self) -> Iterator[int]:
        """The accessors that anything refers to, each as often as it does."""
        for mesh in self.json.get("meshes", []):
            for primitive in mesh.get("primitives", []):
                yield from _numbers(primitive.get("attributes"))
                yield from _numbers({"indices": primitive.get("indices")})
                for target in primitive.get("targets", []):
                    yield from _numbers(target)
                yield from _inside(primitive.get("extensions"))
        for node in self.json.get("nodes", []):
            yield from _inside(node.get("extensions"))
        for skin in self.json.get("skins", []):
            yield from _numbers({"matrices": skin.get("inverseBindMatrices")})
        for animation in self.json.get("animations", []):
            for sampler in animation.get("samplers", []):
                yield from _numbers({k: sampler.get(k) for k in ("input", "output")})


def _numbers(values: Any) -> Iterator[int]:
    if isinstance(values, dict):
        yield from (value for value in values.values() if type(value) is int)


def _inside(value: Any) -> Iterator[int]:
    """All whole numbers in a value: any of them may refer to an accessor."""
    if isinstance(value, dict | list):
        for child in value.values() if isinstance(value, dict) else value:
            yield from _inside(child)
    elif type(value) is int:
        yield value


def _references(value: Any, key: str) -> Iterator[int]:
    """The numbers that have a name, anywhere in a description."""
    if isinstance(value, dict):
        for name, child in value.items():
            if name == key and type(child) is int:
                yield child
            else:
                yield from _references(child, key)
    elif isinstance(value, list):
        for child in value:
            yield from _references(child, key)


def _renumber(value: Any, key: str, numbers: dict[int, int]) -> None:
    """Replace the numbers that have a name, anywhere in a description."""
    if isinstance(value, dict):
        if type(value.get(key)) is int:
            value[key] = numbers[value[key]]
        for child in value.values():
            _renumber(child, key, numbers)
    elif isinstance(value, list):
        for child in value:
            _renumber(child, key, numbers)


def _moves(channel: dict[str, Any], nodes: set[int]) -> bool:
    """True if a channel of an animation moves one of some nodes."""
    target = channel.get("target", {})
    pointer = target.get("extensions", {}).get("KHR_animation_pointer", {}).get("pointer", "")
    if pointer.startswith("/nodes/"):
        number = pointer.split("/")[2]
        return number.isdecimal() and int(number) in nodes
    return pointer.startswith("/meshes/") or target.get("node") in nodes
