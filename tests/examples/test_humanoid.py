"""The generated humanoid set: one sound connectivity, sound shapes, the same for a seed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("anny", reason="the humanoid set needs anny: pip install 'deformer[data]'")

POSES, VERTICES = 9, 3400


@pytest.fixture(scope="module")
def example(load_example):
    return load_example("01_make_humanoid")


@pytest.fixture(scope="module")
def made(example):
    return example.make_set(POSES, seed=3)


def directed_edges(faces):
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def test_shapes_dtypes_and_names(made):
    arrays, reports, _ = made
    assert arrays["vertices"].shape == (POSES, VERTICES, 3)
    assert arrays["vertices"].dtype == np.float32
    assert arrays["faces"].dtype == np.int32
    assert np.isfinite(arrays["vertices"]).all()
    assert len(arrays["names"]) == len(reports) == POSES
    assert arrays["names"][0] == "rest"
    assert arrays["names"].dtype.kind == "U"


def test_surface_is_one_closed_oriented_sphere(made):
    faces = made[0]["faces"]
    edges = directed_edges(faces)
    assert len(np.unique(edges, axis=0)) == len(edges)  # no edge twice in one direction
    undirected, count = np.unique(np.sort(edges, 1), axis=0, return_counts=True)
    assert (count == 2).all()
    assert (np.unique(faces) == np.arange(VERTICES)).all()
    assert VERTICES - len(undirected) + len(faces) == 2
    corners = made[0]["vertices"][0].astype(float)[faces]
    assert np.linalg.det(corners).sum() / 6 > 0.05  # cubic metres: the normals point outwards


def test_every_vertex_has_one_fan_of_triangles(made):
    faces = made[0]["faces"]
    corners = np.concatenate([np.roll(faces, -shift, axis=1) for shift in range(3)])
    for vertex in range(0, VERTICES, 7):
        after = {int(i): int(j) for v, i, j in corners[corners[:, 0] == vertex]}
        first = i = next(iter(after))
        steps = 0
        while steps == 0 or i != first:
            i, steps = after[i], steps + 1
        assert steps == len(after)


def test_no_degenerate_triangle_at_rest(made):
    a, b, c = made[0]["vertices"][0].astype(float)[made[0]["faces"]].transpose(1, 0, 2)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    longest = np.max([((p - q) ** 2).sum(1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    assert area.min() > 1e-8  # square metres
    assert (area / longest).min() > 0.05  # equilateral: 0.43


def test_edges_keep_their_length_within_bounds(made):
    arrays = made[0]
    i, j = directed_edges(arrays["faces"]).T
    length = np.linalg.norm(arrays["vertices"][:, i] - arrays["vertices"][:, j], axis=2)
    low, high = np.percentile(length[1:] / length[0], [1, 99], axis=1)
    assert low.min() > 0.45
    assert high.max() < 1.8
    assert high.max() > 1.02  # and the poses do move


def test_same_seed_same_set_other_seed_other_set(example):
    # Little decimation, to be quick: its cost is the collapses.
    one, again, other = (example.make_set(5, seed, vertex_count=11500)[0] for seed in (3, 3, 4))
    for name, array in one.items():
        np.testing.assert_array_equal(array, again[name])
    np.testing.assert_array_equal(one["faces"], other["faces"])
    np.testing.assert_array_equal(one["vertices"][0], other["vertices"][0])
    assert np.abs(one["vertices"][1] - other["vertices"][1]).max() > 1e-3


def test_written_file_needs_no_pickle(example, made, tmp_path, monkeypatch):
    monkeypatch.setattr(example, "make_set", lambda *_, **__: made)
    example.main(tmp_path / "deep" / "set.npz", POSES)
    with np.load(tmp_path / "deep" / "set.npz", allow_pickle=False) as stored:
        np.testing.assert_array_equal(stored["vertices"], made[0]["vertices"])
        assert stored["names"].tolist() == made[0]["names"].tolist()
    assert [p.name for p in (tmp_path / "deep").iterdir()] == ["set.npz"]


def test_one_rotation_of_the_root_moves_the_skin_rigidly(example):
    from humanoid.rig import Pose, Rig

    body = example.load_body()
    rig = Rig(body)
    standing, turned = rig.skin(Pose("a")), rig.skin(Pose("b", pelvis=(20.0, 10.0, 30.0)))
    # About fixed axes: the twist about z first, then the bend about y, then the lean about x.
    R = Rotation.from_euler("zyx", [30.0, 10.0, 20.0], degrees=True).as_matrix()
    expected = (standing - body.heads[0]) @ R.T + body.heads[0]
    np.testing.assert_allclose(turned, expected, atol=1e-9)


def test_mirrored_angles_give_the_mirrored_skeleton(example):
    from humanoid.rig import Arm, Leg, Pose, Rig

    rig = Rig(example.load_body())
    arm, leg = Arm(reach=(0.2, 0.7, 0.3)), Leg(hip=60, knee=80, abduction=10)
    pose = Pose("a")
    pose.arms["L"], pose.legs["L"] = arm, leg
    mirrored = Pose("b")
    mirrored.arms["R"], mirrored.legs["R"] = arm, leg
    left, right = rig.bone_transforms(pose)[0], rig.bone_transforms(mirrored)[0]
    flip = np.diag([-1.0, 1.0, 1.0])
    for name in ("wrist", "finger3-2", "foot", "lowerarm02"):
        expected = flip @ left[rig.index[f"{name}.L"]] @ flip
        np.testing.assert_allclose(right[rig.index[f"{name}.R"]], expected, atol=1e-9)


def test_reach_puts_the_wrist_at_its_target(example):
    from humanoid.rig import Arm, Pose, Rig

    rig = Rig(example.load_body())
    pose = Pose("a")
    pose.arms["L"] = Arm(reach=(0.3, 0.6, 0.2))
    rotations, translations = rig.bone_transforms(pose)
    wrist = rotations[rig.index["wrist.L"]] @ rig.wrist + translations[rig.index["wrist.L"]]
    arm = rig.upper + rig.fore
    np.testing.assert_allclose(wrist, rig.shoulder + arm * np.array([0.3, -0.6, 0.2]), atol=5e-3)


def test_regions_of_the_body_are_on_its_own_sides(example):
    from humanoid.regions import body_regions

    body = example.load_body()
    regions = body_regions(body)
    x, z = body.vertices[:, 0], body.vertices[:, 2]
    for limb in ("arm", "forearm", "hand", "leg", "lower leg", "foot"):
        left, right = (regions[f"{side} {limb}"] for side in ("Left", "Right"))
        assert left @ x > 0 > right @ x
        both = "Feet" if limb == "foot" else f"{limb.capitalize()}s"
        np.testing.assert_allclose(left + right, regions[both], atol=1e-12)
    np.testing.assert_allclose(regions["Whole body"], 1.0)
    parts = ("Upper body", "Waist", "Hips", "Legs")
    np.testing.assert_allclose(sum(regions[name] for name in parts), 1.0, atol=1e-12)
    order = ("Feet", "Upper legs", "Hips", "Chest", "Head")
    heights = [regions[name] @ z / regions[name].sum() for name in order]
    assert heights == sorted(heights)
