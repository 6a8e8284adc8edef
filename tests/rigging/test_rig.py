"""Truths of a model's rig: what it reproduces, that it is well-conditioned, and its file."""

import numpy as np
import pytest

import deformer
from bodies import cut_in_two
from deformer import InputError, Mesh
from deformer.io import GlbBuilder
from deformer.rigging.decomposition import _decompose, _Steps
from deformer.rigging.matrices import Frame, local_matrices
from deformer.rigging.rig_glb import continuous_quaternions, influence_sets
from shapes import pieces_model, random_rotation, small_model, tube


@pytest.fixture(scope="module")
def rig():
    return deformer.rig(small_model(), bones=6)


@pytest.fixture(scope="module")
def rig_of_pieces():
    return deformer.rig(pieces_model(), bones=8, influences=2)


@pytest.fixture(params=["rig", pytest.param("rig_of_pieces", marks=pytest.mark.slow)])
def any_rig(request):
    return request.getfixturevalue(request.param)


def test_shares_are_shares_and_bones_are_rigid(any_rig):
    w = any_rig.weights
    assert (w >= 0).all()
    np.testing.assert_allclose(w.sum(axis=1), 1.0, atol=1e-12)
    assert any_rig.stray == 0.0
    assert w.sum(axis=0).min() >= 1.0  # no bone without vertices
    R = any_rig.clip[..., :3, :3]
    assert abs(R @ R.swapaxes(-1, -2) - np.eye(3)).max() < 1e-9
    assert abs(np.linalg.det(R) - 1).max() < 1e-9
    np.testing.assert_array_equal(
        any_rig.clip[..., 3, :], np.broadcast_to([0, 0, 0, 1], any_rig.clip[..., 3, :].shape)
    )


def test_the_skeleton_is_a_tree_whose_parents_come_first(any_rig):
    B = len(any_rig.names)
    assert len(set(any_rig.names)) == B
    assert any_rig.parents[0] == -1
    assert ((any_rig.parents[1:] >= 0) & (any_rig.parents[1:] < np.arange(1, B))).all()


@pytest.mark.slow
def test_at_most_so_many_bones_and_influences(rig, rig_of_pieces):
    assert len(rig.names) <= 6 and rig.influences <= 4
    assert len(rig_of_pieces.names) <= 8 and rig_of_pieces.influences <= 2


def test_the_bind_pose_is_the_reference(any_rig):
    size = any_rig.reference.bounding_diagonal
    assert abs(any_rig.pose(any_rig.rest) - any_rig.reference.vertices).max() < 1e-12 * size


def test_the_clip_follows_the_decoded_training_shapes(rig):
    model = small_model()
    truth = model.decode(model.codes)
    poses = rig.pose(rig.clip)
    assert rig.error == pytest.approx(deformer.e_rms(truth, poses, "none"))
    # The plain alternative: each vertex to the bone that moves it most.
    whole = np.eye(len(rig.names))[rig.weights.argmax(axis=1)]
    plain = deformer.Rig(rig.reference, whole, rig.names, rig.parents, rig.rest, rig.clip, 0.0, 0.0)
    plain_error = deformer.e_rms(truth, plain.pose(plain.fit(truth)), "none")
    assert rig.error < 0.5 * plain_error
    assert rig.error < 0.01 * 1000 * model.reference.bounding_diagonal


def test_more_bones_follow_closer():
    few, more = (deformer.rig(small_model(), bones).error for bones in (2, 8))
    assert more < 0.5 * few


def test_fitted_bones_pose_what_they_were_fitted_to(rig):
    rng = np.random.default_rng(0)
    pose = rig.pose(rig.clip[5])
    R, t = random_rotation(rng, 2.0), np.array([3.0, -1.0, 2.0])
    found = rig.fit(pose @ R.T + t)
    assert found.shape == rig.rest.shape
    np.testing.assert_allclose(rig.pose(found), pose @ R.T + t, atol=2e-3)
    assert rig.fit(np.empty((0, *pose.shape))).shape == (0, *rig.rest.shape)


def test_local_matrices_lead_back_to_the_world(rig):
    local = rig.local(rig.clip)
    world = np.empty_like(local)
    for b, parent in enumerate(rig.parents):
        world[:, b] = world[:, parent] @ local[:, b] if parent >= 0 else local[:, b]
    np.testing.assert_allclose(world, rig.clip, atol=1e-9)
    np.testing.assert_array_equal(local_matrices(rig.rest[:1], rig.parents[:1]), rig.rest[:1])


def test_shapes_of_two_rigid_parts_have_two_bones():
    """However many are asked for; each vertex then has one bone, and all shapes come back."""
    mesh, frame = tube(), Frame.of(tube())
    rest = frame.inward(mesh.vertices)
    rng = np.random.default_rng(3)
    left = np.arange(120) < 48
    shapes = np.empty((120, 6, 3))
    for part in (left, ~left):
        for n in range(6):
            shapes[part, n] = rest[part] @ random_rotation(rng, 1.0).T + 0.1 * rng.normal(size=3)
    w = _decompose(mesh, frame, shapes, 10, 4, _Steps(None, 0))
    np.testing.assert_allclose(w[:, w[0].argmax()], left, atol=1e-6)
    assert w.shape == (120, 2)


def test_the_same_model_gives_the_same_rig(rig):
    again = deformer.rig(small_model(), bones=6)
    np.testing.assert_allclose(again.weights, rig.weights, atol=1e-9)
    np.testing.assert_allclose(again.clip, rig.clip, atol=1e-9)


def test_progress_counts_to_its_end():
    told = []
    deformer.rig(small_model(), 3, on_progress=lambda *step: told.append(step))
    done, totals = zip(*told, strict=True)
    assert list(done) == sorted(done) and len(set(totals)) == 1 and done[-1] == totals[-1]


def test_ctrl_c_ends_it():
    def press(done, total):
        if done > 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        deformer.rig(small_model(), on_progress=press)


@pytest.mark.parametrize(("argument", "value"), [
    ("bones", 0), ("bones", 1001), ("bones", 2.0), ("influences", 0), ("influences", 17),
    ("on_progress", 3),
])  # fmt: skip
def test_wrong_numbers_are_named(argument, value):
    with pytest.raises(InputError, match=argument):
        deformer.rig(small_model(), **{argument: value})


def test_poses_of_other_bones_and_shapes_of_other_meshes_are_named(rig):
    for call, name in ((rig.pose, "matrices"), (rig.local, "matrices"), (rig.fit, "vertices")):
        with pytest.raises(InputError, match=name):
            call(np.zeros((3, 3)))
        with pytest.raises(InputError, match=name):
            call(np.full((*rig.rest.shape,) if name == "matrices" else (120, 3), np.nan))
    with pytest.raises(InputError, match="fps"):
        rig.glb(0)


@pytest.mark.slow
def test_seams_of_a_file_are_no_border_to_bones():
    """Where vertices coincide in all shapes the surface is one: their weights are equal."""
    shapes = cut_in_two()
    model = deformer.train(shapes, components=4, epochs=60, device="cpu")
    assert model.seams
    found = deformer.rig(model, bones=5)
    closed = model.seams.closed
    np.testing.assert_array_equal(found.weights, found.weights[model.seams.first][closed])
    assert found.weights.shape == (shapes.vertices.shape[1], len(found.names))
    assert found.stray == 0.0
    truth = model.decode(model.codes)
    assert found.error == pytest.approx(deformer.e_rms(truth, found.pose(found.clip), "none"))
    described, rows = arrays_of(found.glb())
    attributes = described["meshes"][0]["primitives"][0]["attributes"]
    normals = rows(attributes["NORMAL"])
    np.testing.assert_array_equal(normals, normals[model.seams.first][closed])
    assert abs(played(found.glb(), 2) - found.pose(found.clip[2])).max() < 1e-4


# The file, read back as glTF 2.0 says, by numbers of its own.


def arrays_of(data):
    """The JSON of a GLB file, and a function that gives an accessor's rows."""
    import json

    length = int.from_bytes(data[12:16], "little")
    described, binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def rows(index):
        accessor = described["accessors"][index]
        view = described["bufferViews"][accessor["bufferView"]]
        kind = {5126: "<f4", 5121: "u1", 5123: "<u2", 5125: "<u4"}[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor["type"]]
        stride = view.get("byteStride", width * np.dtype(kind).itemsize)
        shape, strides = (accessor["count"], width), (stride, np.dtype(kind).itemsize)
        return np.ndarray(shape, kind, binary, view["byteOffset"], strides)

    return described, rows


def played(data, frame):
    """Vertices of a frame, as an engine skins them."""
    described, rows = arrays_of(data)
    nodes, (skin,) = described["nodes"], described["skins"]
    (clip,) = described["animations"]
    local = {}
    for n, node in enumerate(nodes):
        local[n] = np.eye(4)
        local[n][:3, 3] = node.get("translation", (0, 0, 0))
    for channel in clip["channels"]:
        node, path = channel["target"]["node"], channel["target"]["path"]
        value = rows(clip["samplers"][channel["sampler"]]["output"])[frame].astype(float)
        if path == "translation":
            local[node][:3, 3] = value
        else:
            x, y, z, w = value
            cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            local[node][:3, :3] = np.eye(3) + 2 * (w * cross + cross @ cross)
    world = {}

    def walk(n, above):
        world[n] = above @ local[n]
        for child in nodes[n].get("children", ()):
            walk(child, world[n])

    for n in described["scenes"][described["scene"]]["nodes"]:
        walk(n, np.eye(4))
    assert len(world) == len(nodes)
    inverse = rows(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2)
    skinning = np.array([world[j] @ m for j, m in zip(skin["joints"], inverse, strict=True)])
    attributes = described["meshes"][0]["primitives"][0]["attributes"]
    v = np.column_stack([rows(attributes["POSITION"]), np.ones(len(rows(attributes["POSITION"])))])
    out = np.zeros((len(v), 3))
    n = 0
    while f"JOINTS_{n}" in attributes:
        joints, shares = rows(attributes[f"JOINTS_{n}"]), rows(attributes[f"WEIGHTS_{n}"])
        moved = np.einsum("iknm,im->ikn", skinning[joints], v)[..., :3]
        out += (shares[..., None] * moved).sum(axis=1)
        n += 1
    return out


def test_an_engine_plays_what_the_rig_poses(any_rig):
    data = any_rig.glb(fps=30)
    size = any_rig.reference.bounding_diagonal
    for frame in (0, 3, len(any_rig.clip) - 1):
        off = abs(played(data, frame) - any_rig.pose(any_rig.clip[frame])).max()
        assert off < 1e-5 * size
    described, rows = arrays_of(data)
    times = rows(described["animations"][0]["samplers"][0]["input"])[:, 0]
    np.testing.assert_allclose(times, np.arange(len(any_rig.clip)) / 30, rtol=1e-6)
    names = [described["nodes"][j]["name"] for j in described["skins"][0]["joints"]]
    assert tuple(names) == any_rig.names
    normals = rows(described["meshes"][0]["primitives"][0]["attributes"]["NORMAL"])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
    corners = rows(described["meshes"][0]["primitives"][0]["indices"]).reshape(-1, 3)
    np.testing.assert_array_equal(corners, any_rig.reference.faces)


def test_more_than_four_influences_take_more_sets():
    found = deformer.rig(small_model(), bones=9, influences=6)
    assert found.influences > 4
    described, _ = arrays_of(found.glb())
    assert "WEIGHTS_1" in described["meshes"][0]["primitives"][0]["attributes"]
    pose = found.pose(found.clip[4])
    np.testing.assert_allclose(played(found.glb(), 4), pose, atol=2e-5)


def test_weights_in_the_file_are_heaviest_first_with_the_sum_one():
    rng = np.random.default_rng(0)
    w = rng.random((50, 300)) * (rng.random((50, 300)) < 0.02)
    w[:, 17] += 0.1
    w /= w.sum(axis=1, keepdims=True)
    sets = influence_sets(w)
    joints = np.hstack([j for j, _ in sets])
    shares = np.hstack([s for _, s in sets])
    assert joints.dtype == np.uint16 and shares.dtype == np.float32 and joints.shape[1] % 4 == 0
    assert (np.diff(shares, axis=1) <= 1e-7).all()
    np.testing.assert_allclose(shares.sum(axis=1, dtype=float), 1.0, atol=1e-7)
    back = np.zeros_like(w)
    np.add.at(back, (np.arange(50)[:, None], joints), shares)
    np.testing.assert_allclose(back, w, atol=1e-6)
    assert not joints[shares == 0].any()


def test_quaternions_stay_on_one_side():
    angles = np.linspace(0, 12, 60)
    c, s, o, i = np.cos(angles), np.sin(angles), 0 * angles, 1 + 0 * angles
    R = np.stack([c, -s, o, s, c, o, o, o, i], axis=-1).reshape(-1, 3, 3)
    q = continuous_quaternions(R)
    assert (np.sum(q[1:] * q[:-1], axis=1) > 0.9).all()
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1.0)


def test_saving_is_all_or_nothing(rig, tmp_path, monkeypatch):
    path = tmp_path / "rig.glb"
    rig.save(path, 12)
    assert path.read_bytes() == rig.glb(12)

    def fail(self):
        raise RuntimeError("no file")

    monkeypatch.setattr(GlbBuilder, "data", property(fail))
    with pytest.raises(RuntimeError):
        rig.save(path, 24)
    monkeypatch.undo()
    assert path.read_bytes() == rig.glb(12) and len(list(tmp_path.iterdir())) == 1
    with pytest.raises(InputError, match="nowhere"):
        rig.save(tmp_path / "nowhere" / "rig.glb")


def test_a_rig_without_a_clip_has_no_animation(rig):
    bare = deformer.Rig(
        Mesh(rig.reference.vertices, rig.reference.faces), rig.weights, rig.names, rig.parents,
        rig.rest, rig.clip[:0], 0.0, 0.0,
    )  # fmt: skip
    assert "animations" not in arrays_of(bare.glb())[0]
