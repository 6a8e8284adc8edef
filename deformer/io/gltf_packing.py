"""A .gltf file with its buffers and images as one GLB file."""

from __future__ import annotations

import copy
import json
import logging
import re
from pathlib import PurePosixPath
from typing import Any
from urllib.parse import quote, unquote

from deformer.errors import InputError
from deformer.io.atomic import PathLike
from deformer.io.glb_builder import glb_of
from deformer.io.gltf import GltfAsset, read_gltf

_log = logging.getLogger("deformer")
_DATA_TYPE = re.compile(r"data:([\w.+-]+/[\w.+-]+)", re.IGNORECASE)
# Of images the first bytes tell the type, whatever their names are.
_IMAGES = {
    b"\x89PNG": "image/png",
    b"\xff\xd8\xff": "image/jpeg",
    b"RIFF": "image/webp",
    b"\xabKTX": "image/ktx2",
    b"DDS ": "image/vnd-ms.dds",
}


def packed_gltf(path: PathLike) -> bytes:
    """The asset of a .glb or .gltf file as one GLB, with all buffers and images inside.

    Numbers of accessors, buffer views, meshes and nodes stay. An image that is missing is left as
    the name of a file without a folder, and a warning in the log names it.

    Args:
        path: the file.

    Raises:
        InputError: as of `read_gltf`, a missing buffer, or one outside of the file's folder.
    """
    asset = read_gltf(path)
    described = copy.deepcopy(asset.json)
    buffers = asset.part(asset.json, "buffers", [], "the file")
    binary = bytearray()
    starts = []
    for n in range(len(buffers)):
        length = asset.whole(
            asset.item("buffers", n, "the file"), "byteLength", None, f"buffer {n}"
        )
        data = memoryview(asset.buffer(n, "the file"))[:length]
        binary += b"\0" * (-len(binary) % 4)
        starts.append(len(binary))
        binary += data
        # Buffers may share a file, which would be written once for each.
        if len(binary) > 2 * asset.size + 4 * len(buffers):
            raise asset.broken(f"buffers take {len(binary)} bytes, more than their files")
    for n, view in enumerate(asset.part(described, "bufferViews", [], "the file")):
        asset.item("bufferViews", n, "the file")
        number = view.get("buffer")
        asset.item("buffers", number, f"buffer view {n}")
        start = asset.whole(view, "byteOffset", 0, f"buffer view {n}")
        view["buffer"], view["byteOffset"] = 0, starts[number] + start
    _pack_images(asset, described, binary)
    described.pop("buffers", None)
    if binary:
        described["buffers"] = [{"byteLength": len(binary)}]
    text = json.dumps(described, separators=(",", ":"), ensure_ascii=False)
    return glb_of(text.encode("utf-8", "replace"), bytes(binary))


def _pack_images(asset: GltfAsset, described: dict[str, Any], binary: bytearray) -> None:
    views: dict[str, int] = {}
    for n, image in enumerate(asset.part(described, "images", [], "the file")):
        uri = asset.item("images", n, "the file").get("uri")
        if uri is None:
            continue
        if not isinstance(uri, str) or uri not in views:
            try:
                data = asset.resource(uri, f"image {n}")
            except InputError as error:
                _log.warning(str(error))
                name = PurePosixPath(unquote(str(uri)[:2000]).replace("\\", "/")).name
                image["uri"] = quote(name[:200] or f"image-{n}", errors="replace")
                continue
            binary += b"\0" * (-len(binary) % 4)
            view = {"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)}
            binary += data
            described.setdefault("bufferViews", []).append(view)
            views[uri] = len(described["bufferViews"]) - 1
        del image["uri"]
        image["bufferView"] = views[uri]
        if "mimeType" not in image:
            start = described["bufferViews"][views[uri]]["byteOffset"]
            image["mimeType"] = _type_of(bytes(binary[start : start + 4]), uri)


def _type_of(head: bytes, uri: str) -> str:
    """MIME type of an image by its first bytes, or by its data URI."""
    for magic, name in _IMAGES.items():
        if head.startswith(magic):
            return name
    stated = _DATA_TYPE.match(uri[:200])
    return stated[1].lower() if stated else "image/png"
