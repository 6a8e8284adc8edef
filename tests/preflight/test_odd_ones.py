"""One shape turned or moved among quiet neighbours is put back; what spins or walks is sound."""

import numpy as np
import pytest

from bars import bar_mesh, bend
from bodies import bending, turn
from deformer import MeshSequence, examine, load_shapes, repair_shapes
from deformer.geometry import procrustes
from deformer.preflight.axes import _turn_so
from deformer.preflight.local_rotations import LocalRotations
from paths import DATA

COUNT = 14
DIAGONAL = float(np.linalg.norm(np.ptp(bending().vertices[0], axis=0)))
STEADY = np.arange(COUNT)


def found(shapes):
    """Kinds and shapes of findings, without the advice to align a set that turns."""
    return [
        (f.kind, f.shapes)
        for f in examine(shapes).findings
        if f.severity != "info" and f.kind != "turned"
    ]


def turned(angles, shapes=None):
    """Shapes turned by angles (N,) about one axis."""
    shapes = bending(COUNT) if shapes is None else shapes
    vertices = [p @ turn([1, 3, 2], a).T for p, a in zip(shapes.vertices, angles, strict=True)]
    return MeshSequence(np.array(vertices), shapes.faces)


def shifted(diagonals):
    """Shapes moved along one direction by so many diagonals (N,)."""
    shapes = bending(COUNT)
    by = np.asarray(diagonals)[:, None, None] * DIAGONAL * np.array([0.6, 0, 0.8])
    return MeshSequence(shapes.vertices + by, shapes.faces)


def alone(n, value, others=0.0):
    """`others` for all shapes, and for shape n `value` more."""
    values = np.zeros(COUNT) + others
    values[n] += value
    return values


@pytest.mark.parametrize("n", [0, 1, 6, COUNT - 1])
@pytest.mark.parametrize("degrees", [50, 77, 143, 180])
def test_one_turned_shape_is_named_and_turned_back(degrees, n):
    bad = turned(alone(n, np.radians(degrees)))
    (finding,) = (f for f in examine(bad, [f"{k}.obj" for k in range(COUNT)]).findings
                  if f.severity == "warning")  # fmt: skip
    assert finding.shapes == (n,)
    assert f"shape {n} ({n}.obj)" in finding.message
    repaired = repair_shapes(bad)
    assert not found(repaired.shapes)
    assert repaired.changed == {n}
    p, q = repaired.shapes.vertices[n], bending(COUNT).vertices[n]
    R, t = procrustes(p, q)
    np.testing.assert_allclose(p @ R.T + t, q, atol=1e-12)
    assert np.trace(R) > 1 + 2 * np.cos(np.radians(25))
    assert np.linalg.norm(p.mean(axis=0) - q.mean(axis=0)) < 0.1 * DIAGONAL


def test_the_message_of_a_turned_shape_has_its_angle():
    (finding,) = examine(turned(alone(6, np.radians(143)))).of_kind("rotated")
    angle = float(finding.message.split("turned by ")[1].split("°")[0])
    assert angle == pytest.approx(143, abs=15)


@pytest.mark.parametrize("n", [3, 9])
def test_one_turned_shape_is_named_where_the_set_spins_slowly(n):
    assert found(turned(alone(n, 2.5, 0.1 * STEADY))) == [("rotated", (n,))]


def test_two_turned_shapes_are_both_named():
    bad = turned(alone(3, 2.4) + alone(8, -2.2))
    assert found(bad) == [("rotated", (3,)), ("rotated", (8,))]


@pytest.mark.parametrize(
    "angles",
    [0.2 * STEADY, 0.7 * STEADY, 1.1 * STEADY, 2.3 * STEADY, 0.02 * STEADY**2,
     np.where(STEADY > 6, 2.4, 0.0), np.where(STEADY % 3 == 1, 2.4, 0.0),
     np.clip(0.9 * STEADY - 4, 0, 2 * np.pi), 2.4 * np.maximum(0, 1 - abs(STEADY - 6) / 3)],
    ids=["slow", "fast", "faster", "fastest", "speeding up", "turns once", "every third",
         "tumbles", "there and back"],
)  # fmt: skip
def test_a_set_that_spins_has_no_turned_shape(angles):
    assert not found(turned(angles))


@pytest.mark.parametrize("last", [80, 90, 100])
def test_a_dancer_that_turns_by_a_right_angle_has_no_mixed_up_axes(last):
    """Few frames of one that turns about the upright axis, quickly at the end of each half."""
    base = bending(COUNT)
    degrees = np.array([0, 10, 25, 40, 60, 85, last, 75, 50, 30, 20, 5])[: len(base)]
    angles = np.radians(np.resize(degrees, len(base)))
    vertices = [p @ turn([0, 1, 0], a).T for p, a in zip(base.vertices, angles, strict=True)]
    assert not found(MeshSequence(np.array(vertices), base.faces))


@pytest.mark.skipif(not DATA.is_dir(), reason="the example sets are not there")
@pytest.mark.parametrize("step", [5, 7, 12, 20])
def test_a_real_dancer_has_no_mixed_up_axes(step):
    shapes = load_shapes(DATA / "crane.npz")
    assert not found(shapes.subset(range(0, len(shapes), step)))


def test_turns_about_an_axis_are_told_from_others():
    upright = turn([0, 1, 0], np.pi / 2)
    tilted = turn([1, 0, 0], np.pi / 2)
    base = bending(COUNT)

    def told(degrees, P):
        angles = np.radians(np.resize(degrees, COUNT))
        vertices = [p @ turn([0, 1, 0], a).T for p, a in zip(base.vertices, angles, strict=True)]
        local = LocalRotations.of(np.array(vertices), base.faces)
        return _turn_so(local, np.arange(COUNT), P)

    assert told([0, 20, 60, 100], upright)
    assert not told([0, 20, 60, 100], tilted)
    assert not told([0, 5, 10, 15], upright)


def test_a_bar_whose_twist_jumps_is_not_turned_as_a_whole():
    vertices, faces = bar_mesh(rings=30)
    twists = [0, 0.1, 0.2, 0.3, 0.4, 4.0, 0.5, 0.6, 0.7]
    shapes = np.array([bend(vertices, 0.0, twist) for twist in twists])
    assert not found(MeshSequence(shapes, faces))


@pytest.mark.parametrize("lying", [(3, 9), (3, 8, 9)])
def test_poses_in_no_order_that_lie_as_others_do_are_not_turned(lying):
    """Shape 9 is the most alike to shape 3, and lies as it does."""
    shapes = bending(COUNT)
    vertices = shapes.vertices[np.random.default_rng(0).permutation(COUNT)]
    vertices[9] = vertices[3] * [1, 1, 1.01]
    angles = np.where(np.isin(STEADY, lying), 1.57, 0.0)
    named = {n for _, shapes in found(turned(angles, MeshSequence(vertices, shapes.faces)))
             for n in shapes}  # fmt: skip
    assert 3 not in named


@pytest.mark.parametrize("n", [0, 1, 6, COUNT - 1])
@pytest.mark.parametrize("away", [1.5, 3.0, 24.0])
def test_one_shape_moved_away_is_named_and_moved_back(away, n):
    near = 0.2 * np.sin(1.7 * STEADY)
    bad = shifted(alone(n, away, near))
    assert found(bad) == [("moved", (n,))]
    repaired = repair_shapes(bad)
    assert repaired.changed == {n}
    assert "moved back" in repaired.done[0]
    p, q = repaired.shapes.vertices[n], shifted(near).vertices[n]
    t = (q - p).mean(axis=0)
    np.testing.assert_allclose(p + t, q, atol=1e-9)
    assert np.linalg.norm(t) < 0.5 * DIAGONAL


def test_the_message_of_a_moved_shape_has_its_distance_and_way_back():
    (finding,) = examine(shifted(alone(6, 24.0))).of_kind("moved")
    away = float(finding.message.split("lies ")[1].split(" ")[0])
    assert away == pytest.approx(24, rel=0.1)
    by = np.array(finding.values["by"])
    np.testing.assert_allclose(by, -24 * DIAGONAL * np.array([0.6, 0, 0.8]), atol=0.1 * DIAGONAL)


@pytest.mark.parametrize(
    "path",
    [0.3 * STEADY, 3.0 * STEADY, 0.1 * STEADY**2, np.where(STEADY > 6, 24.0, 0.0),
     np.maximum(STEADY - 5, 0) * 2.0, 3.0 * np.maximum(0, 1 - abs(STEADY - 6) / 2),
     np.where(STEADY % 3 == 1, 5.0, 0.0), 4 * np.sin(STEADY), alone(6, 0.8)],
    ids=["walk", "leaps", "speeding up", "moves once", "stands and runs", "there and back",
         "every third", "swings", "a step"],
)  # fmt: skip
def test_a_set_that_walks_has_no_moved_shape(path):
    assert not found(shifted(path))


def test_a_shape_is_named_for_one_reason():
    shapes = bending(COUNT)
    vertices = shapes.vertices + np.array([0.0, 0.0, 30.0])
    vertices[3, 17] += 1e6
    vertices[6] *= [1, 1, -1]
    vertices[9] = vertices[9] @ turn([1, 0, 0], 2.5).T
    shapes = MeshSequence(vertices, shapes.faces)
    assert sorted(found(shapes)) == [("far", (3,)), ("mirrored", (6,)), ("rotated", (9,))]


def test_three_shapes_have_no_odd_one():
    vertices = bending(3).vertices.copy()
    vertices[1] += 100.0
    assert not found(MeshSequence(vertices, bending(3).faces))
