"""Normals of groups of corners: by hand, and independent of how faces are cut."""

import numpy as np
import pytest

from deformer import vertex_normals
from deformer.documents.normals import mean_normals, renewed_normals, smooth_groups, tangents
from shapes import icosphere

CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def test_a_smooth_corner_of_a_cube_points_along_the_diagonal_however_its_sides_are_cut():
    expected = (2 * CUBE - 1) / np.sqrt(3)
    triangles = np.array([[side[0], *side[k : k + 2]] for side in SIDES for k in (1, 2)])
    for faces in (np.array(SIDES), triangles):
        counts = np.full(len(faces), faces.shape[1])
        corners = faces.ravel()
        found = mean_normals(CUBE + 1e6, counts, corners, corners, 8)
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_slivers_do_not_turn_normals():
    """A face cut through three vertices on a line, one of which is off by rounding."""
    points = np.array([[0.0, 0, 0], [1, 0, 1e-9], [2, 0, 0], [1, 1, 0], [1, -1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 4, 1], [1, 4, 2]])
    corners = faces.ravel()
    found = mean_normals(points, np.full(4, 3), corners, corners, 5)
    np.testing.assert_allclose(found, np.tile([0.0, 0, 1], (5, 1)), atol=1e-6)


def test_a_group_that_is_one_side_has_its_normal_and_an_unused_one_none():
    counts, corners = np.full(6, 4), np.array(SIDES).ravel()
    groups = np.where(np.arange(24) < 4, 0, -1)
    np.testing.assert_allclose(
        mean_normals(CUBE, counts, corners, groups, 2), [[-1, 0, 0], [0, 0, 0]], atol=1e-15
    )


def test_normals_turn_with_the_mesh_and_agree_with_those_of_areas_on_a_sphere():
    mesh = icosphere(3)
    counts, corners = np.full(len(mesh.faces), 3), mesh.faces.ravel()
    found = mean_normals(mesh.vertices, counts, corners, corners, len(mesh.vertices))
    np.testing.assert_allclose(found, vertex_normals(mesh.vertices, mesh.faces), atol=0.03)
    np.testing.assert_allclose(found, mesh.vertices, atol=0.01)


def test_normals_stay_where_no_vertex_of_their_polygons_has_moved():
    moved = CUBE.copy()
    moved[7] += (0.5, 0.2, 0.0)
    counts, corners = np.full(6, 4), np.array(SIDES).ravel()
    old = np.tile([0.0, 0.6, 0.8], (6, 1))
    groups = np.repeat(np.arange(6), 4)
    found = renewed_normals(old, groups, CUBE, moved, counts, corners)
    assert (found[[0, 2, 4]] == old[0]).all()
    assert (found[[1, 3, 5]] != old[0]).any(axis=1).all()


def test_vertices_of_one_place_are_one_group_if_their_normals_agree():
    places = np.array([[0.0, 0, 0], [-0.0, 0, 0], [0, 0, 0], [1, 0, 0]])
    normals = np.array([[0, 0, 1.0], [0, 1e-7, 1.0], [0, 1.0, 0], [0, 0, 1.0]])
    groups = smooth_groups(places, normals)
    assert groups[0] == groups[1]
    assert len(set(groups.tolist())) == 3


@pytest.mark.parametrize("mirrored", [False, True])
def test_tangents_follow_the_first_texture_coordinate(mirrored):
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    uvs = square[:, :2] * ([-1, 1] if mirrored else [1, 1])
    normals = np.tile([0.0, 0, 1], (4, 1))
    found = tangents(square, faces, uvs, normals, np.arange(4))
    np.testing.assert_allclose(
        found, np.tile([-1.0 if mirrored else 1.0, 0, 0], (4, 1)), atol=1e-15
    )
