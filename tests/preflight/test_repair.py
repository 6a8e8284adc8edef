"""Repairs undo what was done to a sound set, change nothing else, and say what they did."""

import numpy as np
import pytest

from bodies import bending, cut_in_two
from deformer import MeshSequence, examine, repair_shapes


def spoilt(changes, count=10):
    """The sound set, and the same with shapes changed."""
    shapes = bending(count)
    vertices = shapes.vertices.copy()
    for n, change in changes.items():
        vertices[n] = change(vertices[n])
    return shapes, MeshSequence(vertices, shapes.faces)


def faults(shapes):
    return [f.kind for f in examine(shapes).findings if f.severity != "info"]


def test_a_sound_set_stays_as_it_is():
    shapes = bending()
    repaired = repair_shapes(shapes)
    np.testing.assert_array_equal(repaired.shapes.vertices, shapes.vertices)
    assert repaired.done == ()
    assert not repaired.changed
    assert not repaired.faces_changed


def test_mirror_images_axes_and_units_are_undone_together_and_in_one_shape():
    axes = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]], float)
    sound, bad = spoilt({
        0: lambda p: p * [1, -1, 1], 4: lambda p: 1000 * p @ axes.T, 7: lambda p: p / 25.4,
    })  # fmt: skip
    repaired = repair_shapes(bad, [f"{n}.ply" for n in range(10)])
    np.testing.assert_allclose(repaired.shapes.vertices, sound.vertices, atol=1e-12)
    assert repaired.changed == {0, 4, 7}
    assert any("shape 4 (4.ply): scaled by 0.001" in line for line in repaired.done)
    assert not faults(repaired.shapes)


@pytest.mark.parametrize("share", [0.1, 1.0])
def test_vertices_in_another_order_are_put_back(share):
    rng = np.random.default_rng(5)
    chosen = rng.permutation(170)[: int(share * 170)]

    def reorder(p):
        q = p.copy()
        q[chosen] = p[np.roll(chosen, 3)]
        return q

    sound, bad = spoilt({4: reorder}, count=40)
    repaired = repair_shapes(bad)
    np.testing.assert_array_equal(repaired.shapes.vertices, sound.vertices)
    assert repaired.changed == {4}


def test_an_order_that_cannot_be_found_is_said_and_left():
    rng = np.random.default_rng(0)
    _, bad = spoilt({4: lambda p: rng.normal(size=p.shape) * p.std(axis=0)})
    repaired = repair_shapes(bad)
    np.testing.assert_array_equal(repaired.shapes.vertices, bad.vertices)
    (line,) = repaired.done
    assert "shape 4: left as it is" in line


def test_seams_stay_and_vertices_without_a_face_are_dropped():
    """A file has its vertices for its texture coordinates; the model closes seams itself."""
    shapes, cut = bending(), cut_in_two()
    vertices = np.concatenate([cut.vertices, shapes.vertices[:, :1] + 9], axis=1)
    assert faults(MeshSequence(vertices, cut.faces)) == []
    repaired = repair_shapes(MeshSequence(vertices, cut.faces))
    np.testing.assert_array_equal(repaired.shapes.vertices, cut.vertices)
    np.testing.assert_array_equal(repaired.shapes.faces, cut.faces)
    np.testing.assert_array_equal(repaired.kept, np.arange(cut.vertices.shape[1]))
    assert len(repaired.done) == 1


def test_faces_are_turned_to_agree_and_a_moebius_strip_is_left():
    shapes = bending()
    faces = shapes.faces.copy()
    faces[[3, 50, 51]] = faces[[3, 50, 51]][:, ::-1]
    repaired = repair_shapes(MeshSequence(shapes.vertices, faces))
    assert examine(repaired.shapes).facts["inconsistent_orientation"] == 0
    np.testing.assert_array_equal(np.sort(repaired.shapes.faces, axis=1), np.sort(faces, axis=1))
    assert "3 faces turned" in repaired.done[0]

    t = np.arange(12) * 2 * np.pi / 12
    edge = np.stack([np.cos(t / 2) * np.cos(t), np.cos(t / 2) * np.sin(t), np.sin(t / 2)], axis=1)
    middle = 3 * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
    strip = np.concatenate([middle + edge, middle - edge])
    k = np.arange(12)
    after = (k + 1) % 12
    # The strip closes with its sides exchanged.
    up, down = np.where(k == 11, 12, after), np.where(k == 11, 0, after + 12)
    faces = np.concatenate([np.column_stack([k, up, k + 12]), np.column_stack([up, down, k + 12])])
    shapes = np.array([strip * [1, 1, 1 + 0.1 * n] for n in range(3)])
    repaired = repair_shapes(MeshSequence(shapes, faces))
    np.testing.assert_array_equal(repaired.shapes.faces, faces)
    assert "Möbius" in repaired.done[0]


def test_turns_are_removed_only_where_that_is_advised():
    shapes = bending(12)
    angles = 0.5 * np.arange(12)
    c, s, z = np.cos(angles), np.sin(angles), np.zeros(12)
    R = np.array([[c, z, s], [z, z + 1, z], [-s, z, c]]).transpose(2, 0, 1)
    turned = MeshSequence(np.einsum("nab,nvb->nva", R, shapes.vertices), shapes.faces)
    assert faults(turned) == ["turned"]
    repaired = repair_shapes(turned)
    assert not faults(repaired.shapes)
    assert examine(repaired.shapes).facts["largest_rotation"] < 1e-6
    np.testing.assert_array_equal(repaired.shapes.vertices[0], turned.vertices[0])
