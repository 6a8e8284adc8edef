"""The hand set: what is read of a skinned GLB file, poses in their ranges, and sound shapes."""

import numpy as np
import pytest
from hand.poses import CYCLE, FINGERS, finger, schedule, thumb, wrist
from hand.quality import MOST_INSIDE, Inspector
from hand.regions import hand_regions
from hand.rig import DIGITS, TO_UPRIGHT, joints_of, load_hand

import deformer
from deformer.io import GlbBuilder

pytestmark = pytest.mark.slow
# As in the real file: fingers along −y, the back of the hand along +x, the thumb's side along −z.
AXES = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]).T
SIDES = {"thumb": -0.03, "index": -0.018, "middle": -0.006, "ring": 0.006, "pinky": 0.018}
LENGTH = 0.025  # between two joints of a digit


def tube(z, low, high, radius, rings):
    """A closed tube along −y at x = 0, as vertices and outward triangles."""
    around = 2 * np.pi * np.arange(8) / 8
    y = np.linspace(high, low, rings)
    ring = np.stack([radius * np.cos(around), radius * np.sin(around) + z], axis=1)
    points = [(ring[n, 0], level, ring[n, 1]) for level in y for n in range(8)]
    points += [(0.0, high, z), (0.0, low, z)]
    top, bottom, last = len(points) - 2, len(points) - 1, 8 * (rings - 1)
    faces = []
    for n in range(8):
        m = (n + 1) % 8
        faces += [(8 * r + n, 8 * r + m, 8 * r + 8 + n) for r in range(rings - 1)]
        faces += [(8 * r + m, 8 * r + 8 + m, 8 * r + 8 + n) for r in range(rings - 1)]
        faces += [(top, m, n), (bottom, last + n, last + m)]
    return np.array(points), np.array(faces)


def write_hand(path, left_out=()):
    """A palm and five digits of tubes, with the joints of WebXR; the palm's vertices split."""
    joints = {"wrist": (0.0, 0.0, 0.0)}
    for digit in DIGITS:
        for n, name in enumerate(joints_of(digit)):
            joints[name] = (0.0, -LENGTH * n, SIDES[digit])
    names = [name for name in joints if name not in left_out]
    palm, palm_faces = tube(0.0, -0.02, 0.02, 0.04, 9)
    points, faces, owners = [palm], [palm_faces], [np.full(len(palm), names.index("wrist"))]
    for digit in DIGITS:
        part, triangles = tube(SIDES[digit], -4 * LENGTH, -0.022, 0.004, 25)
        faces.append(triangles + sum(map(len, points)))
        bones = [name for name in joints_of(digit)[:-1] if name in names]
        heads = np.array([joints[name][1] for name in bones])
        nearest = [int(np.flatnonzero(heads >= min(y, heads[0]))[-1]) for y in part[:, 1]]
        points.append(part)
        owners.append(np.array([names.index(bones[n]) for n in nearest]))
    points, faces = np.concatenate(points), np.concatenate(faces)
    split = len(points)  # a copy of vertex 0 for one of its triangles
    points = np.concatenate([points, points[:1]])
    faces[np.flatnonzero((faces == 0).any(axis=1))[0]] = [
        split if v == 0 else v for v in faces[np.flatnonzero((faces == 0).any(axis=1))[0]]
    ]
    owner = np.concatenate([*owners, owners[0][:1]])
    asset = GlbBuilder()
    skinned = np.zeros((len(points), 4), np.uint8)
    skinned[:, 0] = owner
    shares = np.tile(np.array([1, 0, 0, 0], np.float32), (len(points), 1))
    binds = np.tile(np.eye(4), (len(names), 1, 1))
    binds[:, :3, :3], binds[:, :3, 3] = AXES, [joints[name] for name in names]
    for name, bind in zip(names, binds, strict=True):
        asset.add("nodes", {"name": name, "matrix": bind.T.ravel().tolist()})
    attributes = {
        "POSITION": asset.add_array(points.astype(np.float32)),
        "JOINTS_0": asset.add_array(skinned),
        "WEIGHTS_0": asset.add_array(shares),
    }
    primitive = {
        "attributes": attributes,
        "indices": asset.add_array(faces.astype(np.uint32).ravel()),
    }
    asset.add("meshes", {"primitives": [primitive]})
    inverse = np.linalg.inv(binds).transpose(0, 2, 1).reshape(-1, 16).astype(np.float32)
    matrices = asset.add_array(inverse.reshape(-1, 4, 4).transpose(0, 2, 1))
    asset.add("skins", {"joints": list(range(len(names))), "inverseBindMatrices": matrices})
    node = asset.add("nodes", {"mesh": 0, "skin": 0})
    asset.json["scenes"], asset.json["scene"] = [{"nodes": list(range(node + 1))}], 0
    path.write_bytes(asset.data)
    return path, len(points) - 1, faces


@pytest.fixture(scope="module")
def example(load_example):
    return load_example("13_make_hand")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return write_hand(tmp_path_factory.mktemp("hand") / "right.glb")


@pytest.fixture(scope="module")
def hand(made):
    return load_hand(made[0])


def test_the_file_is_read_upright_without_seams_and_subdivided_once(hand, made):
    _, count, faces = made
    assert len(hand.faces) == 4 * len(faces)
    edges = np.sort(np.concatenate([faces[:, p] for p in ([0, 1], [1, 2], [2, 0])]), axis=1)
    merged = np.where(edges == count, 0, edges)
    assert len(hand.vertices) == count + len(np.unique(np.sort(merged, axis=1), axis=0))
    np.testing.assert_allclose(hand.weights.sum(axis=1), 1.0)
    assert hand.labels[:2] == ["forearm", "wrist"] and hand.parents[0] == -1
    for digit in DIGITS:
        chain = [hand.index[name] for name in joints_of(digit)]
        assert [hand.parents[b] for b in chain] == [1, *chain[:-1]]
        expected = np.array([-SIDES[digit], 0.0, LENGTH * (len(chain) - 1)])
        np.testing.assert_allclose(hand.heads[chain[-1]], expected, atol=1e-6)
    np.testing.assert_allclose(hand.frames[1], TO_UPRIGHT @ AXES, atol=1e-6)
    np.testing.assert_allclose(hand.skin({}), hand.vertices, atol=1e-9)


def test_positive_angles_flex_to_the_palm_and_turn_to_the_thumb(hand):
    tip = hand.index["index-finger-tip"]
    rest = hand.joint_positions({})[tip]
    flexed = hand.joint_positions(finger("index", 90, 0))[tip] - rest
    base = hand.heads[hand.index["index-finger-phalanx-proximal"]]
    reach = np.linalg.norm(rest - base)
    np.testing.assert_allclose(flexed, [0, -reach, -reach], atol=1e-6)
    aside = hand.joint_positions(finger("index", 0, 0, fan=1.0))[tip] - rest
    assert aside[0] > 0.5 * reach * np.sin(np.deg2rad(14))  # the thumb is at +x
    assert hand.joint_positions(wrist(40, 0))[tip][1] < -0.02


def test_the_palm_stays_and_the_forearm_turns(hand):
    bent = hand.skin(wrist(45, 0))
    far = hand.vertices[:, 2] > 0.05
    np.testing.assert_allclose(bent[far], hand.vertices[far], atol=1e-6)
    behind = hand.weights[:, 0] > 0.999
    assert behind.any()
    assert np.linalg.norm(bent - hand.vertices, axis=1)[behind].max() > 0.01


def test_families_stay_within_anatomical_ranges(hand):
    knuckles = [joints_of(d)[1] for d in FINGERS]
    for number, (family, extent) in enumerate(schedule(48)):
        angles = family(hand, np.random.default_rng(number), extent)
        for name, (flexion, abduction, _) in angles.items():
            if name in knuckles:
                assert -20 <= flexion <= 88 and abs(abduction) <= 20
            elif "finger" in name:
                assert 0 <= flexion <= 105 and abduction == 0
            elif name == "wrist":
                assert abs(flexion) <= 50 and -25 <= abduction <= 15
            else:
                assert -20 <= flexion <= 80 and abs(abduction) <= 25


def test_the_schedule_has_every_family_at_all_extents():
    plan = schedule(160)
    assert {family for family, _ in plan} == set(CYCLE)
    for family in set(CYCLE):
        extents = [extent for other, extent in plan if other is family]
        assert 0.15 <= min(extents) < 0.3 and 0.85 < max(extents) <= 1.0


def test_a_digit_in_the_rest_of_the_hand_is_seen(hand):
    inspector = Inspector(hand)
    assert inspector.inside(hand.vertices) == 0.0
    moved = hand.vertices.copy()
    moved[hand.weights[:, hand.index["index-finger-phalanx-distal"]] > 0.5] *= [0.2, 0.2, 0.0]
    assert inspector.inside(moved) > 0.3


def test_the_set_is_that_of_its_seed_and_sound(example, hand):
    arrays, _ = example.make_set(hand, 9, seed=2)
    assert arrays["vertices"].dtype == np.float32 and arrays["names"][0] == "rest"
    np.testing.assert_allclose(arrays["vertices"][0], hand.vertices, atol=1e-6)
    inspector = Inspector(hand)
    assert max(inspector.inside(p.astype(float)) for p in arrays["vertices"]) <= MOST_INSIDE + 0.01
    again, other = (example.make_set(hand, 9, seed=s)[0]["vertices"] for s in (2, 3))
    np.testing.assert_array_equal(again, arrays["vertices"])
    assert np.abs(other - again).max() > 1e-3


def test_the_written_file_needs_no_pickle(example, made, tmp_path):
    example.main(made[0], tmp_path / "deep" / "hand.npz", poses=3, seed=0)
    with np.load(tmp_path / "deep" / "hand.npz", allow_pickle=False) as stored:
        assert stored["vertices"].shape[0] == len(stored["names"]) == 3
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["hand.npz"]


def test_a_file_without_the_joints_or_the_skin_is_refused(made, tmp_path):
    path, *_ = write_hand(tmp_path / "less.glb", left_out=("ring-finger-tip",))
    with pytest.raises(deformer.InputError, match="no joint 'ring-finger-tip'"):
        load_hand(path)
    mesh = deformer.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    deformer.save_mesh(tmp_path / "plain.glb", mesh)
    with pytest.raises(deformer.InputError, match="one mesh with a skin"):
        load_hand(tmp_path / "plain.glb")


def test_a_bent_thumb_turns_its_pad_to_the_fingers(hand):
    tip = hand.index["thumb-tip"]
    across = hand.joint_positions(thumb(30, 0, 30))[tip] - hand.joint_positions({})[tip]
    assert across[1] < -0.01  # to the palm's side


def test_regions_are_those_of_the_joints_that_move_them(hand):
    regions = hand_regions(hand)
    np.testing.assert_allclose(regions["Whole hand"] + regions["Wrist"], 1.0, atol=1e-12)
    digits = ("Thumb", *(f"{d.capitalize()} finger" for d in DIGITS[1:]))
    fingers = sum(regions[name] for name in digits[1:])
    np.testing.assert_allclose(fingers, regions["Fingers"], atol=1e-12)
    parts = fingers + regions["Thumb"] + regions["Palm"]
    np.testing.assert_allclose(parts, regions["Whole hand"], atol=1e-12)
    for digit, name in zip(DIGITS, digits, strict=True):
        middle = regions[name] @ hand.vertices[:, 0] / regions[name].sum()
        assert middle == pytest.approx(-SIDES[digit], abs=0.002)
    assert (regions["Index finger knuckle"] <= regions["Index finger"] + 1e-12).all()
