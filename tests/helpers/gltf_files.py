"""glTF files of arrays, as tests need them: written without the library's own builder."""

import base64
import json
import struct

import numpy as np

COMPONENTS = {"f4": 5126, "u1": 5121, "u2": 5123, "u4": 5125, "i1": 5120, "i2": 5122}
ROWS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="f4")
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


class GltfFile:
    """A scene of which tests change the JSON at will; its arrays go into one buffer."""

    def __init__(self, **parts):
        self.json = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": [], **parts}
        self.binary = b""

    def view(self, data):
        self.binary += b"\0" * (-len(self.binary) % 4)
        found = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)}
        self.binary += data
        self.json["bufferViews"].append(found)
        return len(self.json["bufferViews"]) - 1

    def add(self, array, **more):
        """Number of the accessor of an array (n,) or (n, width)."""
        array = np.asarray(array)
        view = self.view(array.tobytes())
        return self.describe(array, bufferView=view, **more)

    def describe(self, array, **more):
        width = array.shape[1] if array.ndim == 2 else 1
        kind = COMPONENTS[array.dtype.str[1:]]
        accessor = {"componentType": kind, "count": len(array), "type": ROWS[width], **more}
        self.json["accessors"].append(accessor)
        return len(self.json["accessors"]) - 1

    def sparse(self, array, base=None):
        """Number of an accessor that keeps the rows that differ from `base` (zeros if None)."""
        array = np.asarray(array)
        rows = np.flatnonzero((array != (0 if base is None else base)).any(axis=1))
        indices = {"bufferView": self.view(rows.astype("u2").tobytes()), "componentType": 5123}
        values = {"bufferView": self.view(array[rows].tobytes())}
        more = {} if base is None else {"bufferView": self.view(np.asarray(base).tobytes())}
        sparse = {"count": len(rows), "indices": indices, "values": values}
        return self.describe(array, sparse=sparse, **more)

    def primitive(self, points=TETRAHEDRON, faces=FACES, **attributes):
        positions = {"POSITION": self.add(points), **attributes}
        return {"attributes": positions, "indices": self.add(np.asarray(faces, "u2").ravel())}

    def described(self, uri=None):
        buffer = {"byteLength": len(self.binary), **({"uri": uri} if uri else {})}
        return {**self.json, "buffers": [buffer]}

    def glb(self):
        text = json.dumps(self.described()).encode()
        text += b" " * (-len(text) % 4)
        binary = self.binary + b"\0" * (-len(self.binary) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(binary), b"BIN\0") + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body

    def gltf(self, uri=None):
        """The JSON; the buffer is a data URI, or the file that `uri` names."""
        data = "data:application/octet-stream;base64," + base64.b64encode(self.binary).decode()
        return json.dumps(self.described(uri or data)).encode()


def with_targets(second=False):
    """A tetrahedron with the targets "up" (sparse) and "wide", in one node or in two."""
    file = GltfFile(nodes=[{"mesh": 0}])
    up, wide = np.zeros((4, 3), "f4"), np.zeros((4, 3), "f4")
    up[3] = 0, 0, 1
    wide[:, 0] = 0.5, 1, 1.5, 2
    primitive = file.primitive()
    primitive["targets"] = [{"POSITION": file.sparse(up)}, {"POSITION": file.add(wide)}]
    file.json["meshes"] = [{"primitives": [primitive], "extras": {"targetNames": ["up", "wide"]}}]
    if second:
        other = file.primitive()
        other["targets"] = [{"POSITION": file.add(2 * wide)}, {"NORMAL": file.add(wide)}]
        extras = {"targetNames": ["wide", ""]}
        file.json["meshes"].append({"primitives": [other], "extras": extras})
        file.json["nodes"].append({"mesh": 1, "translation": [10, 0, 0]})
    return file, up.astype(float), wide.astype(float)


def channel(file, animation, node, path, times, values, interpolation="LINEAR", **more):
    """Add a channel with its own sampler to an animation."""
    sampler = {
        "input": file.add(np.asarray(times, "f4")),
        "output": file.add(np.asarray(values), **more),
        "interpolation": interpolation,
    }
    animation.setdefault("samplers", []).append(sampler)
    target = {"node": node, "path": path}
    channels = animation.setdefault("channels", [])
    channels.append({"sampler": len(animation["samplers"]) - 1, "target": target})


def skinned():
    """A tetrahedron on two joints; clip "bend" turns the second one by 90° about z in a second.

    Vertices 0 and 2 go with joint 0, at the origin, vertex 1 with joint 1 at (1, 0, 0), and
    vertex 3 half with each. The node of the mesh has a transform, which skins ignore.
    """
    file = GltfFile(
        nodes=[
            {"mesh": 0, "skin": 0, "translation": [5, 5, 5]},
            {"children": [2]},
            {"translation": [1, 0, 0]},
        ],
        scenes=[{"nodes": [0, 1]}],
    )
    joints = np.array([[0, 0, 0, 0], [1, 0, 0, 0], [0, 9, 0, 0], [0, 1, 0, 0]], "u1")
    weights = np.array([[1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [0.5, 0.5, 0, 0]], "f4")
    primitive = file.primitive(JOINTS_0=file.add(joints), WEIGHTS_0=file.add(weights))
    file.json["meshes"] = [{"primitives": [primitive]}]
    binds = np.stack([np.eye(4), np.eye(4)])
    binds[1, 0, 3] = -1
    matrices = file.add(binds.transpose(0, 2, 1).reshape(2, 16).astype("f4"))
    file.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": matrices}]
    half = np.sqrt(0.5)
    animation = {"name": "bend"}
    turns = np.array([[0, 0, 0, 1], [0, 0, half, half]], "f4")
    channel(file, animation, 2, "rotation", [0, 1], turns)
    file.json["animations"] = [animation]
    return file
