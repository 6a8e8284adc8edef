"""Truths of vertices that coincide in all shapes."""

import numpy as np
import pytest

from deformer import MeshSequence, SurfacePoint
from deformer.geometry import SEAM_TOLERANCE, find_seams, no_seams
from shapes import sequence


def split(shapes, chosen):
    """Shapes whose faces 0, 2, 4, … use copies of the chosen vertices, which come last."""
    V = shapes.vertices.shape[1]
    vertices = np.concatenate([shapes.vertices, shapes.vertices[:, chosen]], axis=1)
    faces = shapes.faces.copy()
    for n, v in enumerate(chosen):
        faces[::2][faces[::2] == v] = V + n
    return MeshSequence(vertices, faces)


def test_the_closed_surface_is_the_one_before_it_was_split():
    shapes = sequence(4)
    cut = split(shapes, [3, 40, 41, 119])
    seams = find_seams(cut.vertices)
    assert seams and not find_seams(shapes.vertices)
    np.testing.assert_array_equal(seams.closed, [*range(120), 3, 40, 41, 119])
    np.testing.assert_array_equal(seams.first, np.arange(120))
    closed = seams.close_shapes(cut)
    np.testing.assert_array_equal(closed.vertices, shapes.vertices)
    np.testing.assert_array_equal(closed.faces, shapes.faces)
    np.testing.assert_array_equal(seams.open(closed.vertices), cut.vertices)


def test_all_shapes_decide_not_the_first():
    shapes = split(sequence(4), [3, 40])
    vertices = shapes.vertices.copy()
    D = np.linalg.norm(np.ptp(vertices[2], axis=0))
    vertices[2, 3] += [0.5 * SEAM_TOLERANCE * D, 0, 0]
    vertices[2, 40] += [2 * SEAM_TOLERANCE * D, 0, 0]
    np.testing.assert_array_equal(find_seams(vertices).closed[[3, 120, 40, 121]], [3, 3, 40, 120])


@pytest.mark.parametrize("count", [2, 30])
def test_many_at_one_place_are_one(count):
    """More than are looked at as neighbours, exactly or nearly at one place."""
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(3, 200, 3))
    vertices[:, 20 : 20 + count] = vertices[:, 20:21]
    nearly = vertices.copy()
    nearly[:, 100 : 100 + count] = nearly[:, 100:101]
    nearly[:, 100 : 100 + count, 0] += 1e-9 * np.arange(count)
    assert len(find_seams(vertices).first) == 200 - (count - 1)
    assert len(find_seams(nearly).first) == 200 - 2 * (count - 1)


def test_a_far_vertex_joins_no_crowd():
    """All others would be within the tolerance of a diagonal that a single vertex makes long."""
    vertices = np.random.default_rng(0).normal(size=(2, 5000, 3))
    vertices[:, 0] = 1e30
    seams = find_seams(vertices)
    assert seams.closed[0] == 0 and len(seams.first) <= 5000


def test_faces_that_become_lines_are_left_out():
    vertices = np.array([[[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [0, 1, 0]]] * 2)
    shapes = MeshSequence(vertices, [[0, 1, 3], [0, 1, 2]])
    closed = find_seams(vertices).close_shapes(shapes)
    np.testing.assert_array_equal(closed.faces, [[0, 1, 2]])
    nothing = MeshSequence(np.zeros((2, 3, 3)), [[0, 1, 2]])
    assert len(find_seams(nothing.vertices).close_shapes(nothing).faces) == 1


def test_points_keep_their_places():
    shapes = split(sequence(4), [3, 40])
    seams, p = find_seams(shapes.vertices), shapes.vertices[1]
    assert seams.close_point(120) == 3 and seams.close_point(50) == 50
    point = SurfacePoint((121, 40, 7), (0.25, 0.25, 0.5), 0.1)
    closed = seams.close_point(point)
    assert isinstance(closed, SurfacePoint) and closed.offset == 0.1
    weights = dict(zip(closed.vertices, closed.weights, strict=True))
    assert weights == pytest.approx({7: 0.5, 40: 0.5})
    assert no_seams(122).close_point(point) is point
    assert np.isfinite(p).all()
