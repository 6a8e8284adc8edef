"""Truths of points on a surface and off it, against the mesh itself."""

import numpy as np
import pytest

from deformer import InputError, Mesh, SurfacePoint, vertex_normals
from deformer.geometry import FramePoint, SurfacePoints, plain_point
from shapes import icosphere, random_rotation, tube

TRIANGLE = Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0]], [[0, 1, 2]])


def test_a_triangle_by_hand():
    point = SurfacePoint.on_face(TRIANGLE, 0, (0.5, 0.25, 0.25), 0.5)
    found = SurfacePoints([point, 1], TRIANGLE.faces).at(TRIANGLE.vertices)
    assert np.allclose(found, [[0.5, 0.5, 0.5], [2, 0, 0]], atol=1e-15)


def some_points(mesh, rng):
    """Vertices, points of faces, and both off the surface."""
    faces = rng.choice(len(mesh.faces), 6, replace=False)
    inside = rng.dirichlet(np.ones(3), 6)
    return [
        3,
        SurfacePoint((5,), offset=0.3),
        *(SurfacePoint.on_face(mesh, f, b) for f, b in zip(faces[:3], inside, strict=False)),
        *(SurfacePoint.on_face(mesh, f, b, -0.1) for f, b in zip(faces[3:], inside, strict=False)),
        SurfacePoint((1, 8, 20, 33), (1, 2, 3, 4), 0.05),
    ]


@pytest.mark.parametrize("mesh", [tube(), icosphere()], ids=["tube", "sphere"])
def test_points_are_those_of_the_mesh(mesh):
    rng = np.random.default_rng(0)
    points = some_points(mesh, rng)
    shapes = mesh.vertices + 0.02 * rng.normal(size=(4, *mesh.vertices.shape))
    found = SurfacePoints(points, mesh.faces).at(shapes)
    for shape, row in zip(shapes, found, strict=True):
        normals = vertex_normals(shape, mesh.faces)
        for point, p in zip(points, row, strict=True):
            if isinstance(point, int):
                assert (p == shape[point]).all()
                continue
            w, at = np.array(point.weights), list(point.vertices)
            n = w @ normals[at]
            expected = w @ shape[at] + point.offset * n / np.linalg.norm(n)
            assert np.allclose(p, expected, atol=1e-12)


def test_points_move_rigidly_with_the_mesh():
    rng, mesh = np.random.default_rng(1), tube()
    points = SurfacePoints(some_points(mesh, rng), mesh.faces)
    R, t = random_rotation(rng), rng.normal(size=3)
    moved = points.at(mesh.vertices @ R.T + t)
    assert np.allclose(moved, points.at(mesh.vertices) @ R.T + t, atol=1e-12)


def frame(name, rng):
    """Three points at 120° in a plane, by weights of four vertices."""
    weights = rng.normal(size=(3, 4))
    weights += (1 - weights.sum(axis=1, keepdims=True)) / 4
    return [FramePoint(name, n, (1, 8, 20, 33), tuple(w)) for n, w in enumerate(weights)]


def test_frames_are_found_in_any_order_and_keep_their_stretch():
    """Goals are the points as they are, turned and moved; the turn is the best one."""
    mesh, rng = tube(), np.random.default_rng(4)
    (a, b, c), (d, e, f) = frame("a", rng), frame("b", rng)
    points = SurfacePoints([e, 3, c, a, f, b, d], mesh.faces)
    assert sorted(map(tuple, points.frames.tolist())) == [(3, 5, 2), (6, 0, 4)]
    here = points.at(mesh.vertices)
    R, shift = random_rotation(rng, 2.0), np.array([1.0, 2, 3])
    stretched = points.stretched(here, here @ R.T + shift)
    np.testing.assert_allclose(stretched, here @ R.T + shift, atol=1e-12)
    targets = here + 0.3 * rng.normal(size=here.shape)
    goals = points.stretched(np.stack([here, 2 * here]), targets)
    assert np.array_equal(goals[:, 1], [targets[1]] * 2)
    for rows, turn in zip(points.frames, points.frame_rotations(here, targets), strict=True):
        own, wanted = here[rows] - here[rows].mean(0), targets[rows] - targets[rows].mean(0)
        np.testing.assert_allclose(goals[0][rows].mean(0), targets[rows].mean(0), atol=1e-12)
        np.testing.assert_allclose(
            goals[0][rows] - goals[0][rows].mean(0), own @ turn.T, atol=1e-12
        )
        np.testing.assert_allclose(
            goals[1][rows] - goals[1][rows].mean(0), 2 * own @ turn.T, atol=1e-12
        )
        best = np.linalg.norm(own @ turn.T - wanted)
        for _ in range(20):
            other = random_rotation(rng, 0.1) @ turn
            assert np.linalg.norm(own @ other.T - wanted) > best


def test_a_point_that_is_a_vertex():
    mesh = tube()
    corner = int(mesh.faces[7, 1])
    assert plain_point(SurfacePoint.on_face(mesh, 7, (0, 1, 0))) == corner
    off = plain_point(SurfacePoint.on_face(mesh, 7, (0, 1, 0), 0.1))
    assert off == SurfacePoint((corner,), offset=0.1)
    assert SurfacePoint.on_face(mesh, 7, (0.3, 0.3, 0.399)).weights[0] == pytest.approx(0.3 / 0.999)


@pytest.mark.parametrize(
    ("make", "parts"),
    [
        (lambda: SurfacePoint.on_face(TRIANGLE, 1, (1, 0, 0)), ["face", "0…0", "1"]),
        (lambda: SurfacePoint.on_face(TRIANGLE, 0, (1, 1, 0)), ["barycentric", "sum of 1"]),
        (lambda: SurfacePoint.on_face(TRIANGLE, 0, (1.5, -0.5, 0)), ["barycentric", "-0.5"]),
        (lambda: SurfacePoint.on_face(TRIANGLE, 0, (1, 0)), ["barycentric"]),
        (lambda: SurfacePoint((1, 1), (1, 1)), ["vertices", "different"]),
        (lambda: SurfacePoint((), ()), ["vertices"]),
        (lambda: SurfacePoint((1, 2), (1,)), ["weights"]),
        (lambda: SurfacePoint((1, 2), (0, 0)), ["weights", "not all 0"]),
        (lambda: SurfacePoint((-1,)), ["vertices", "-1"]),
        (lambda: SurfacePoint((1,), offset=np.nan), ["offset", "nan"]),
    ],
)
def test_wrong_points(make, parts):
    with pytest.raises(InputError) as caught:
        make()
    for part in parts:
        assert part in str(caught.value)
