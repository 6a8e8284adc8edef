"""GLB files of the tube of `tubes`: split at its seam, textured, below nodes that move it."""

import struct
import zlib

import numpy as np

import tubes
from deformer.io import INDICES, VERTICES, GlbBuilder

COLUMNS = tubes.AROUND + 1
# Turned by 90° about z, twice as large, shifted, and mirrored.
PARENT = {"rotation": [0.0, 0.0, 0.5**0.5, 0.5**0.5], "scale": [2.0, 2.0, 2.0]}
CHILD = {"translation": [1.0, 2.0, 3.0], "scale": [1.0, -1.0, 1.0]}


def image():
    """A PNG of 2 by 2 pixels."""

    def chunk(kind, data):
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    rows = b"\0\xff\0\0\0\xff\0" + b"\0\0\0\xff\xff\xff\xff"
    head = struct.pack(">IIBBBBB", 2, 2, 8, 2, 0, 0, 0)
    parts = [(b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)


def split(values):
    """Values (R·A, k) of the tube's vertices, those of the seam twice."""
    grid = np.asarray(values).reshape(tubes.RINGS, tubes.AROUND, -1)
    return np.concatenate([grid, grid[:, :1]], axis=1).reshape(-1, grid.shape[2])


def triangles():
    found = []
    for i in range(tubes.RINGS - 1):
        for j in range(tubes.AROUND):
            a = i * COLUMNS + j
            b, c, d = a + 1, a + COLUMNS, a + COLUMNS + 1
            found += [[a, b, d], [a, d, c]]
    return np.array(found)


def tube_arrays(bend=0.0):
    """Attributes of the tube's side."""
    x, y = np.meshgrid(np.linspace(0, 1, tubes.RINGS), np.linspace(0, 1, COLUMNS), indexing="ij")
    normals = split(tubes.side_normals())
    # Texture coordinates grow along x, which is so where they have their first component.
    tangents = np.tile([1.0, 0, 0, 1], (len(normals), 1))
    return {
        "POSITION": split(tubes.positions(bend)),
        "NORMAL": normals,
        "TANGENT": tangents,
        "TEXCOORD_0": np.stack([x.ravel(), y.ravel()], 1),
        "COLOR_0": np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], 1),
    }


def scene(asset, primitives, **node):
    """Complete an asset: materials, a texture, nodes around the tube's, a camera; returns it."""
    picture = asset.add_bytes(image())
    asset.add("images", {"bufferView": picture, "mimeType": "image/png", "name": "checks"})
    asset.add("textures", {"source": 0})
    surface = {"baseColorTexture": {"index": 0}, "baseColorFactor": [0.8, 0.5, 0.25, 1.0]}
    asset.add("materials", {"name": "skin", "pbrMetallicRoughness": surface,
                            "normalTexture": {"index": 0}})  # fmt: skip
    lens = {"yfov": 1.0, "znear": 0.1}
    asset.add("cameras", {"type": "perspective", "perspective": lens})
    mesh = {"primitives": primitives, "name": "Tube", "extras": {"by": "hand"}}
    asset.add("meshes", mesh)
    asset.add("nodes", {"name": "Root", **PARENT, "children": [1, 2]})
    asset.add("nodes", {"name": "Body", **CHILD, "mesh": 0, **node, "extras": {"id": 7}})
    asset.add("nodes", {"name": "Eye", "camera": 0})
    asset.json["scenes"] = [{"nodes": [0]}]
    asset.json["scene"] = 0
    return asset


def plain(bend=0.0):
    """A GLB with single-precision arrays, one after the other."""
    asset = GlbBuilder("a test")
    attributes = {k: asset.add_array(a, VERTICES) for k, a in tube_arrays(bend).items()}
    corners = asset.add_array(triangles().ravel().astype("u2"), INDICES)
    return scene(asset, [{"attributes": attributes, "indices": corners, "material": 0}])


def interleaved():
    """The same with positions, normals and texture coordinates row by row in one view."""
    asset, arrays = GlbBuilder("a test"), tube_arrays()
    names = ("POSITION", "NORMAL", "TEXCOORD_0")
    rows = np.concatenate([arrays[name] for name in names], axis=1).astype("<f4")
    view = asset.add_bytes(rows.tobytes(), VERTICES, stride=4 * rows.shape[1])
    attributes = {}
    for name, first, width in zip(names, (0, 12, 24), (3, 3, 2), strict=True):
        accessor = {"bufferView": view, "byteOffset": first, "componentType": 5126,
                    "count": len(rows), "type": f"VEC{width}"}  # fmt: skip
        if name == "POSITION":
            low, high = rows[:, :3].min(axis=0), rows[:, :3].max(axis=0)
            accessor |= {"min": low.tolist(), "max": high.tolist()}
        attributes[name] = asset.add("accessors", accessor)
    corners = asset.add_array(triangles().ravel().astype("u2"), INDICES)
    return scene(asset, [{"attributes": attributes, "indices": corners, "material": 0}])


def quantised():
    """Positions in 16 bits, normals in 8, texture coordinates in 16 with a fraction's meaning."""
    asset, arrays = GlbBuilder("a test"), tube_arrays()
    asset.use_extension("KHR_mesh_quantization", required=True)
    stored = {
        "POSITION": (np.rint(arrays["POSITION"] * 1000).astype("i2"), False),
        "NORMAL": (np.rint(arrays["NORMAL"] * 127).astype("i1"), True),
        "TEXCOORD_0": (np.rint(arrays["TEXCOORD_0"] * 65535).astype("u2"), True),
    }
    attributes = {k: asset.add_array(a, VERTICES, n) for k, (a, n) in stored.items()}
    corners = asset.add_array(triangles().ravel().astype("u2"), INDICES)
    return scene(asset, [{"attributes": attributes, "indices": corners, "material": 0}])


def sparse():
    """Positions of zeros, all of which a sparse array sets."""
    asset = plain()
    accessor = asset.json["accessors"][0]
    count = accessor["count"]
    places = asset.add_bytes(np.arange(count, dtype="<u2").tobytes())
    values = {"bufferView": accessor.pop("bufferView")}
    del asset.json["bufferViews"][values["bufferView"]]["target"]
    indices = {"bufferView": places, "componentType": 5123}
    accessor["sparse"] = {"count": count, "indices": indices, "values": values}
    return asset


def deformed():
    """A tube with morph targets and a skin, and animations of its node, its bone and a camera."""
    asset = plain()
    moved = asset.add_array(np.tile([0.0, 0.1, 0.0], (tubes.RINGS * COLUMNS, 1)), VERTICES)
    primitive = asset.json["meshes"][0]["primitives"][0]
    primitive["targets"] = [{"POSITION": moved}]
    asset.json["meshes"][0]["weights"] = [0.5]
    asset.json["meshes"][0]["extras"] = {"targetNames": ["up"], "by": "hand"}
    n = tubes.RINGS * COLUMNS
    influences = {"JOINTS_0": np.zeros((n, 4), "u1"), "WEIGHTS_0": np.tile([1.0, 0, 0, 0], (n, 1))}
    for name, array in influences.items():
        primitive["attributes"][name] = asset.add_array(array, VERTICES)
    bone = asset.add("nodes", {"name": "Bone", "translation": [0.5, 0.0, 0.0]})
    asset.json["scenes"][0]["nodes"].append(bone)
    asset.add("skins", {"joints": [bone]})
    asset.json["nodes"][1]["skin"] = 0
    times = asset.add_array(np.array([0.0, 1.0]))
    steps = asset.add_array(np.array([[0.0, 0, 0], [1, 1, 1]]))
    weights = asset.add_array(np.array([0.0, 1.0]))
    samplers = [{"input": times, "output": output} for output in (weights, steps)]

    def channel(node, path, sampler):
        return {"sampler": sampler, "target": {"node": node, "path": path}}

    channels = [channel(1, "weights", 0), channel(0, "translation", 1), channel(2, "scale", 1)]
    asset.add("animations", {"name": "walk", "channels": channels, "samplers": samplers})
    asset.add("animations", {"name": "rise", "channels": channels[1:2], "samplers": samplers})
    asset.json["animations"][1]["channels"][0] = channel(0, "translation", 1)
    return asset


def shown_twice():
    """Two nodes with one mesh."""
    asset = plain()
    asset.add("nodes", {"name": "Twin", "mesh": 0, "translation": [10.0, 0.0, 0.0]})
    asset.json["scenes"][0]["nodes"].append(3)
    return asset
