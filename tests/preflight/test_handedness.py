"""A mirror image is told from any motion of a body, and from a sheet that bends the other way."""

import numpy as np
import pytest

from bars import bar_mesh, bend
from bodies import bending, cut_in_two, grid, turn
from deformer import MeshSequence, examine, repair_shapes
from deformer.geometry import procrustes


def faults(shapes):
    return [(f.kind, f.shapes) for f in examine(shapes).findings if f.severity != "info"]


def changed(shapes, n, change):
    vertices = shapes.vertices.copy()
    vertices[n] = change(vertices[n])
    return MeshSequence(vertices, shapes.faces)


def twisted(most, seed=0, count=16, lids=True):
    """A bar that bends, and whose top turns further and further, at last by `most` radians."""
    vertices, faces = bar_mesh(rings=40, side=3)
    bends = np.random.default_rng(seed).uniform(-2, 2) * np.sin(np.linspace(0, 5, count))
    shapes = [bend(vertices, *x) for x in zip(bends, np.linspace(0, most, count), strict=True)]
    if not lids:
        shapes = [p[:-2] for p in shapes]
        faces = faces[(faces < len(vertices) - 2).all(axis=1)]
    return MeshSequence(np.array(shapes) * [1, 1, 0.7], faces)


def waves(count=16):
    """A sheet over which waves run slowly."""
    vertices, faces = grid(9, 13)
    x, y = vertices[:, 0] / 12, vertices[:, 1] / 8
    phase = np.linspace(0, 4, count)[:, None]
    height = np.sin(7 * x - phase) + 0.5 * np.sin(4 * y + 5 * x + 2 * phase)
    shapes = np.tile(vertices, (count, 1, 1))
    shapes[:, :, 2] = 0.6 * height
    return MeshSequence(shapes, faces)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("most", [3, -8, 12, 20])
def test_a_twist_of_many_turns_is_no_mirror_image(most, seed):
    assert "mirrored" not in {kind for kind, _ in faults(twisted(most, seed))}


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("rings", [14, 20, 40])
def test_bars_twisted_and_bent_at_random_have_no_mirror_image(rings, seed):
    rng = np.random.default_rng(seed)
    vertices, faces = bar_mesh(rings, side=3)
    bends, twists = rng.uniform(-2, 2, 18), rng.uniform(-20, 20, 18)
    shapes = [bend(vertices, *x) for x in zip(bends, twists, strict=True)]
    assert not faults(MeshSequence(np.array(shapes) * [1, 1, 0.7], faces))


def test_a_bar_twisted_to_either_side_has_no_mirror_image():
    one, other = twisted(12), twisted(-12)
    both = MeshSequence(np.concatenate([one.vertices[::-1], other.vertices[1:]]), one.faces)
    assert not faults(both)


@pytest.mark.parametrize("n", [0, 9, 15])
@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("lids", [True, False])
def test_the_mirror_image_among_twisted_bars_is_found_and_undone(lids, axis, n):
    shapes = twisted(14, lids=lids)
    bad = changed(shapes, n, lambda p: p * (1 - 2 * np.eye(3)[axis]))
    assert faults(bad) == [("mirrored", (n,))]
    repaired = repair_shapes(bad)
    np.testing.assert_allclose(repaired.shapes.vertices, shapes.vertices, atol=1e-12)


@pytest.mark.parametrize("n", [0, 4])
def test_a_mirror_image_in_any_plane_is_undone_up_to_a_rigid_motion(n):
    shapes = bending()
    P = turn([1, 2, 3], 0.6) @ np.diag([-1, 1, 1])
    repaired = repair_shapes(changed(shapes, n, lambda p: p @ P.T)).shapes.vertices[n]
    R, t = procrustes(repaired, shapes.vertices[n])
    np.testing.assert_allclose(repaired @ R.T + t, shapes.vertices[n], atol=1e-12)


def test_of_as_many_on_either_side_those_like_the_first_are_right():
    bad = changed(bending(4), [1, 2], lambda p: p * [-1, 1, 1])
    assert faults(bad) == [("mirrored", (1, 2))]


def test_faces_that_all_look_inwards_change_nothing():
    shapes = bending()
    inside = MeshSequence(shapes.vertices, shapes.faces[:, ::-1])
    assert not faults(inside)
    assert faults(changed(inside, 3, lambda p: p * [1, 1, -1])) == [("mirrored", (3,))]


def test_a_body_cut_along_seams_is_judged_as_a_whole():
    assert ("mirrored", (5,)) in faults(changed(cut_in_two(), 5, lambda p: p * [-1, 1, 1]))


def test_a_body_turned_inside_out_is_no_mirror_image():
    """The volume has the other sign, but the faces do not meet as in a mirror image."""
    shapes = bending()
    eversion = shapes.vertices[3] * [-0.3, 1, 1] @ turn([0, 1, 0], 1.0)
    eversion += 2.0 * np.random.default_rng(0).normal(size=eversion.shape)
    assert "mirrored" not in {kind for kind, _ in faults(changed(shapes, 3, lambda p: eversion))}


@pytest.mark.parametrize("shift", [1, 2, 3, 5, 13])
@pytest.mark.parametrize("make", [waves, bending, lambda: twisted(14)])
def test_shifted_vertices_are_no_mirror_image(make, shift):
    bad = changed(make(), 4, lambda p: np.roll(p, shift, axis=0))
    assert "mirrored" not in {kind for kind, _ in faults(bad)}


@pytest.mark.parametrize("n", [0, 6, 15])
@pytest.mark.parametrize("sign", [[1, 1, -1], [-1, 1, 1]])
@pytest.mark.parametrize("height", [1.0, 0.2])
def test_a_mirrored_sheet_among_slow_waves_is_undone(height, sign, n):
    shapes = MeshSequence(waves().vertices * [1, 1, height], waves().faces)
    assert not faults(shapes)
    bad = changed(shapes, n, lambda p: p * sign)
    assert faults(bad) == [("mirrored", (n,))]
    np.testing.assert_allclose(repair_shapes(bad).shapes.vertices, shapes.vertices, atol=1e-12)


def test_of_sheets_in_no_order_or_flat_ones_nothing_is_said():
    shapes = waves()
    mixed = shapes.subset(np.random.default_rng(1).permutation(16))
    assert not faults(mixed)
    flat = MeshSequence(shapes.vertices * [1, 1, 1e-3], shapes.faces)
    assert not faults(changed(flat, 6, lambda p: p * [1, 1, -1]))
    assert not faults(changed(shapes, 6, lambda p: p * [1, 1, -0.3]))


@pytest.mark.filterwarnings("error")
def test_of_triangles_without_a_common_edge_nothing_is_said():
    vertices = np.random.default_rng(0).normal(size=(6, 30, 3))
    shapes = MeshSequence(vertices[:1] + 0.02 * vertices, np.arange(30).reshape(10, 3))
    assert "mirrored" not in {kind for kind, _ in faults(shapes)}
