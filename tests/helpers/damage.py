"""Damaged inputs of every reader, by seed, and what must hold when they are read."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors.numpy import load_file, save_file

from deformer import io
from deformer.errors import InputError
from deformer.evaluation.journal import COLUMNS, Journal
from deformer.geometry import Mesh, MeshSequence
from deformer.io import GltfAsset
from deformer.model import load_model
from deformer.model.storage import _digest_of_description
from deformer.training.checkpoints import Stages, check_identity, load_checkpoint, save_checkpoint
from deformer_app.viewer.edit import Edit, Handle, Solution
from deformer_app.viewer.session import Entry, ModelName, Session
from gltf_files import channel, skinned, with_targets
from memory import peak_memory
from shapes import small_model

MEMORY = 600e6  # bytes that reading an input of a few kilobytes may take
SECONDS = 120  # after which a reader is taken to hang

POINTS = np.array(
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1.5, 1.25, 0.5], [0.125, 0.25, 3], [7, 0.5, 7]]
)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 4], [0, 3, 2], [3, 1, 4], [4, 2, 3]])

# Contents


NUMBERS = (b"-1", b"0", b"2.5", b"1e9", b"1e308", b"99999999999", b"18446744073709551616", b"nan",
           b"inf", b"", b"x")  # fmt: skip
VALUES = (None, True, "", "x", -1, 0, 2.5, 1e308, 10**30, math.nan, math.inf, [], {}, [[]], ["x"],
          [None], {"x": 1})  # fmt: skip


def damaged(content, rng):
    """The bytes cut, with bits flipped, spliced, with a number replaced, or lines moved."""
    content = bytearray(content)
    match rng.integers(6):
        case 0:
            del content[rng.integers(len(content)) :]
        case 1:
            for at in rng.integers(len(content), size=rng.integers(1, 5)):
                content[at] ^= 1 << rng.integers(8)
        case 2:
            start, length = rng.integers(len(content)), rng.integers(1, 9)
            content[start : start + length] = rng.bytes(rng.integers(0, 9))
        case 3:
            numbers = [i for i, byte in enumerate(content) if 48 <= byte <= 57]
            at = numbers[rng.integers(len(numbers))] if numbers else 0
            content[at : at + 1] = NUMBERS[rng.integers(len(NUMBERS))]
        case 4:
            a, b, to = sorted(rng.integers(len(content), size=3))
            content[to:to] = content[a:b]
        case 5:
            lines = content.splitlines(keepends=True)
            at = rng.integers(len(lines))
            lines[at : at + 1] = [lines[at]] * int(rng.choice([0, 2]))
            content = bytearray(b"".join(lines))
    return bytes(content) or b"x"


def places(value):
    """Every container of a JSON value with each of its keys or indices."""
    keys = value if isinstance(value, dict) else range(len(value))
    for key in list(keys):
        yield value, key
        if isinstance(value[key], dict | list):
            yield from places(value[key])


def damaged_json(data, rng):
    """JSON values of which one is missing, doubled, nested, or another one."""
    found = list(places(data))
    where, key = found[rng.integers(len(found))]
    match rng.integers(5):
        case 0:
            del where[key]
        case 1 if isinstance(where, list):
            where.insert(key, where[key])
        case 2:
            other, place = found[rng.integers(len(found))]
            where[key] = json.loads(json.dumps(other[place]))
        case 3:
            depth = int(rng.choice([1, 3, 2000]))
            where[key] = "nested"
            text = json.dumps(data)
            return text.replace('"nested"', "[" * depth + "]" * depth).encode()
        case _:
            where[key] = VALUES[rng.integers(len(VALUES))]
    return json.dumps(data).encode()


def damaged_arrays(arrays, rng):
    """Arrays of which one is missing, of another shape or type, or has absurd numbers."""
    name = str(rng.choice(sorted(arrays)))
    array = arrays.pop(name)
    match rng.integers(6):
        case 0:
            return {**arrays, f"{name}x": array}
        case 1:
            return {**arrays, name: array[:-1] if array.ndim else array[None]}
        case 2:
            return {**arrays, name: array[None]}
        case 3:
            return {**arrays, name: array.astype(rng.choice(["i4", "f2", "u1", "f8"]))}
        case 4:
            return {**arrays, name: np.zeros((0, *array.shape[1:]), array.dtype)}
    changed = np.array(array)
    if changed.size and changed.dtype.kind in "fiu":
        value = rng.choice([np.nan, np.inf, -np.inf, 1e308, -1.0])
        with np.errstate(all="ignore"):
            changed.flat[rng.integers(changed.size)] = np.asarray(value).astype(changed.dtype)
    return {**arrays, name: changed}


def damage_bytes(path, rng):
    path.write_bytes(damaged(path.read_bytes(), rng))


def damage_json(path, rng):
    if rng.random() < 0.4:
        damage_bytes(path, rng)
    else:
        path.write_bytes(damaged_json(json.loads(path.read_bytes()), rng))


def damage_arrays(path, rng):
    if rng.random() < 0.3:
        damage_bytes(path, rng)
    else:
        arrays = damaged_arrays(load_file(path), rng)
        save_file({name: np.ascontiguousarray(array) for name, array in arrays.items()}, path)


def damage_lines(path, rng):
    """One line of JSON lines."""
    lines = path.read_bytes().splitlines()
    at = rng.integers(len(lines))
    lines[at] = damaged_json(json.loads(lines[at]), rng)
    path.write_bytes(b"\n".join(lines) + b"\n")


# Meshes


ROWS = "".join(f"{x} {y} {z}\n" for x, y, z in POINTS)
XYZ = "property double x\nproperty double y\nproperty double z\n"
PLY = f"ply\nformat ascii 1.0\nelement vertex 7\n{XYZ}element face 6\n"
PLY += f"property list uchar int vertex_indices\nend_header\n{ROWS}"
PLY += "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)


def text_stl():
    lines = ["solid a"]
    for face in FACES:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in POINTS[face]]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid a", ""])


def text_gltf(path):
    """Targets, sparse and not, two nodes, and a clip of weights."""
    file, _, _ = with_targets(second=True)
    animation = {"name": "talk"}
    channel(file, animation, 0, "weights", [0, 0.25], np.array([0, 1, 1, 0], "f4"))
    file.json["animations"] = [animation]
    path.write_bytes(file.gltf())


def damage_either(path, rng):
    """Damage the JSON of a .gltf file, or its bytes."""
    (damage_json if rng.random() < 0.8 else damage_bytes)(path, rng)


def write_usd(path):
    """A mesh with time samples below a transform."""
    from pxr import Gf, Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.Xform.Define(stage, "/a").AddTranslateOp().Set(Gf.Vec3d(1, 2, 3))
    mesh = UsdGeom.Mesh.Define(stage, "/a/m")
    mesh.CreateFaceVertexCountsAttr([3] * len(FACES))
    mesh.CreateFaceVertexIndicesAttr(FACES.ravel().tolist())
    for time in (0, 3):
        mesh.CreatePointsAttr().Set([Gf.Vec3f(*p) for p in (POINTS + time).tolist()], time)
    stage.Save()


def write_cache(path):
    """Three frames, and the mesh beside them that has their faces."""
    io.save_mesh(path.with_suffix(".obj"), Mesh(POINTS, FACES))
    frames = np.stack([POINTS + n for n in range(3)])
    if path.suffix == ".mdd":
        head = np.array([3, 7], ">i4").tobytes() + np.arange(3, dtype=">f4").tobytes()
        path.write_bytes(head + frames.astype(">f4").tobytes())
    else:
        head = b"POINTCACHE2\0" + np.array([1, 7], "<i4").tobytes()
        head += np.array([0, 1], "<f4").tobytes() + np.array([3], "<i4").tobytes()
        path.write_bytes(head + frames.astype("<f4").tobytes())


TEXTS = {"text.ply": PLY, "text.stl": text_stl()}


def write_mesh(path):
    if path.name in TEXTS:
        path.write_text(TEXTS[path.name])
    elif path.suffix == ".npz":
        io.write_npz(path, {"vertices": POINTS[None], "faces": FACES})
    else:
        io.save_mesh(path, Mesh(POINTS, FACES))


def check_shapes(shapes):
    assert isinstance(shapes, MeshSequence)
    assert np.isfinite(shapes.vertices).all()
    assert not shapes.faces.size or shapes.faces.min() >= 0
    assert not shapes.faces.size or shapes.faces.max() < shapes.vertices.shape[1]


# JSON


def write_handles(path):
    first = [{"vertex": 3, "position": [0.0, 1.0, 2.5], "weight": 2.0}]
    first[0] |= {"orientation": [0.6, 0.8, 0.0, 0.0], "orientation_weight": 0.5}
    second = [{"vertex": 3, "position": [0.5, 1.0, 2.5]}, {"vertex": 7, "position": [1, 2, 3]}]
    second[1]["orientation"] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    path.write_text(json.dumps({"frames": [first, second]}))


def check_handles(file):
    for handle in (handle for frame in file.frames for handle in frame):
        assert 0 <= handle.vertex < 20
        assert handle.weight > 0
        assert np.isfinite([*handle.position, handle.weight]).all() and len(handle.position) == 3
        check_orientation(handle)


def check_orientation(handle):
    if handle.orientation is not None:
        R = np.array(handle.orientation)
        assert np.allclose(R @ R.T, np.eye(3)) and np.linalg.det(R) > 0
    assert handle.orientation_weight > 0


def check_split(split):
    indices = [*split["train"], *split["test"]]
    assert split["train"] and len(set(indices)) == len(indices)
    assert all(type(index) is int and 0 <= index < 12 for index in indices)


def write_session(path):
    handles = (
        Handle(1, (17,), ((0.0, 1.0, 2.0),)),
        Handle(2, (4, 5), ((0.0, 1.0, 2.0), (1.0, 1.0, 1.0)), "exact", patch=(4, 5, 6)),
    )
    edits = [Edit((0.0, 0.5)), Edit((0.0, 0.5), handles[:1]), Edit((1.0, 0.5), handles)]
    solution = Solution((0.1, 0.2), (0.0, 0.0, 0.1), (0.0, 0.0, 0.0))
    entries = [Entry(f"Step {n}", edit, solution if n else None) for n, edit in enumerate(edits)]
    Session(ModelName("humanoid", "0123"), entries, 2, {}).save(path)


def check_session(session):
    for entry in session.entries:
        assert np.isfinite([*entry.edit.base, entry.edit.noise]).all()
        for handle in entry.edit.handles:
            assert np.isfinite(handle.targets).all() and np.isfinite(handle.weight)
            assert len(handle.targets) == len(handle.vertices)
    assert json.dumps(session.summary(), allow_nan=False)


# Folders


def damage_model(path, rng):
    """Damage one of a model's files, and give the description the new checksums."""
    description = path / "model.json"
    match rng.integers(3):
        case 0:
            damage_bytes(path / "reference.ply", rng)
        case 1:
            damage_arrays(path / "weights.safetensors", rng)
        case 2:
            damage_json(description, rng)
    try:
        data = json.loads(description.read_bytes())
        for name in data["sha256"]:
            if name != "model.json":
                data["sha256"][name] = io.digest(path / name)
        data["sha256"]["model.json"] = _digest_of_description(data)
        description.write_text(json.dumps(data))
    except (ValueError, KeyError, TypeError, AttributeError, OSError, RecursionError):
        pass  # the description itself is what is damaged


def check_model(model):
    assert np.isfinite(model.codes).all()
    vertices = model.decode(model.prior.mean)
    assert vertices.shape == model.reference.vertices.shape
    assert np.isfinite(vertices).all()


IDENTITY = {"config": {"components": 3}, "seed": 0}


def write_checkpoint(path):
    arrays = {"C": np.ones((4, 3), np.float32), "codes": np.eye(3)}
    save_checkpoint(path, IDENTITY, {"epoch": 4, "seconds": 1.5}, arrays)
    Stages(path, IDENTITY).save("features", {"x": np.ones((2, 5, 9))})


def damage_checkpoint(path, rng):
    file = sorted(path.iterdir())[rng.integers(3)]
    damage_json(file, rng) if file.suffix == ".json" else damage_bytes(file, rng)


def read_checkpoint(path):
    check_identity(path, IDENTITY)
    stage = Stages(path, IDENTITY).load("features")
    return load_checkpoint(path, IDENTITY), stage


def check_checkpoint(found):
    (status, arrays), _ = found
    assert isinstance(status, dict)
    assert all(isinstance(array, np.ndarray) for array in arrays.values())


def write_journal(path):
    journal = Journal(path)
    for n in range(3):
        journal.add(f"key {n}", [dict(zip(COLUMNS, ["a", "b", "c", 1, 0, "m", 0.5], strict=True))])


def check_journal(journal):
    rows = [row for rows in journal._rows.values() for row in rows]
    assert all(set(COLUMNS) == set(row) for row in rows)
    json.dumps(rows)


@dataclass(frozen=True)
class Kind:
    """A kind of input: its name, how a valid one is written, damaged and read, what must hold."""

    name: str
    write: object
    damage: object
    read: object
    check: object


KINDS = {
    kind.name: kind
    for kind in (
        *(
            Kind(f"{name}", write_mesh, damage_bytes, io.load_shapes, check_shapes)
            for name in ("a.obj", "a.ply", "a.off", "a.stl", "a.glb", "a.npz", *TEXTS)
        ),
        Kind("targets.gltf", text_gltf, damage_either, io.load_shapes, check_shapes),
        Kind("clip.gltf", text_gltf, damage_either,
             lambda path: io.load_shapes(path, clip="talk"), check_shapes),
        Kind("skin.gltf", lambda path: path.write_bytes(skinned().gltf()), damage_either,
             io.load_shapes, check_shapes),
        Kind("skin.glb", lambda path: path.write_bytes(skinned().glb()), damage_bytes,
             io.load_shapes, check_shapes),
        Kind("a.usda", write_usd, damage_bytes, io.load_shapes, check_shapes),
        Kind("mdd.mdd", write_cache, damage_bytes, io.load_shapes, check_shapes),
        Kind("pc2.pc2", write_cache, damage_bytes, io.load_shapes, check_shapes),
        Kind("packed.gltf", text_gltf, damage_either, io.packed_gltf,
             lambda data: GltfAsset(data, "packed.glb")),
        Kind("handles.json", write_handles, damage_json,
             lambda path: io.load_handles(path, 20), check_handles),
        Kind("split.json", lambda path: path.write_text('{"train": [0, 3, 5], "test": [1, 2]}'),
             damage_json, lambda path: io.load_split(path, 12), check_split),
        Kind("session.json", write_session, damage_json, Session.load, check_session),
        Kind("model", lambda path: small_model().save(path), damage_model, load_model,
             check_model),
        Kind("m.checkpoint", write_checkpoint, damage_checkpoint, read_checkpoint,
             check_checkpoint),
        Kind("journal.jsonl", write_journal,
             lambda path, rng: (damage_lines if rng.random() < 0.6 else damage_bytes)(path, rng),
             Journal, check_journal),
    )
}  # fmt: skip


class Valid:
    """The files of a valid input, to be restored before each damage."""

    def __init__(self, kind, folder):
        self.path = Path(folder) / kind.name
        kind.write(self.path)
        files = sorted(self.path.iterdir()) if self.path.is_dir() else [self.path]
        self._files = {file: file.read_bytes() for file in files}
        kind.check(kind.read(self.path))

    def restore(self):
        for file, content in self._files.items():
            file.write_bytes(content)


def fault_of(kind, path):
    """What is wrong about how a damaged input is read, in words; None if nothing is."""
    before = peak_memory()
    try:
        with np.errstate(all="ignore"):
            kind.check(kind.read(path))
    except InputError as error:
        text = str(error)
        if "\n" in text:
            return f"more than one line: {text!r}"
        if kind.name not in text:
            return f"names no file: {text!r}"
        if "MemoryError" in text:
            return f"was about to fill the memory: {text!r}"
    except AssertionError as error:
        return f"accepted, but not whole: {error!r}"
    except BaseException as error:
        return f"{type(error).__name__}: {error}"
    grown = peak_memory() - before
    return f"took {grown / 1e6:.0f} MB" if grown > MEMORY else None
