"""Mirror planes: found where they are, and their pairs."""

import numpy as np
import pytest

from deformer import InputError, Mesh, find_symmetry, symmetry_about
from deformer.geometry import most_symmetric
from shapes import icosphere, random_rotation, tube


def lopsided_bar():
    """A tube that a bump on one side leaves symmetric about the plane z = 0 alone."""
    mesh = tube(16, 21)
    v = mesh.vertices.copy()
    v[:, 1] += 0.4 * np.exp(-20 * (v[:, 0] - 0.4) ** 2) * (v[:, 1] > 0.01)
    return Mesh(v, mesh.faces)


@pytest.mark.parametrize("seed", range(4))
def test_the_plane_is_found_in_any_pose(seed):
    rng = np.random.default_rng(seed)
    bar, Q, t = lopsided_bar(), random_rotation(rng), rng.normal(size=3)
    symmetry = find_symmetry(Mesh(7.0 * bar.vertices @ Q.T + t, bar.faces))
    assert symmetry.error < 1e-9
    assert abs(symmetry.normal @ Q[:, 2]) == pytest.approx(1, abs=1e-9)
    assert (symmetry.point - t) @ symmetry.normal == pytest.approx(0, abs=1e-8)


def test_opposite_vertices_are_each_others_mirror_images():
    bar = lopsided_bar()
    symmetry = find_symmetry(bar)
    image = bar.vertices * [1, 1, -1]
    np.testing.assert_allclose(bar.vertices[symmetry.opposite], image, atol=1e-9)
    np.testing.assert_array_equal(symmetry.opposite[symmetry.opposite], np.arange(len(image)))


def test_mirroring_twice_is_the_identity_and_the_plane_stays():
    rng = np.random.default_rng(5)
    symmetry = symmetry_about(icosphere(1), rng.normal(size=3), 3.0 * rng.normal(size=3))
    points = rng.normal(size=(2, 4, 3))
    np.testing.assert_allclose(symmetry.mirror(symmetry.mirror(points)), points, atol=1e-12)
    np.testing.assert_allclose(symmetry.mirror(symmetry.point), symmetry.point, atol=1e-12)
    half = 0.5 * (points + symmetry.mirror(points))
    np.testing.assert_allclose((half - symmetry.point) @ symmetry.normal, 0, atol=1e-12)


def test_a_plane_that_is_none_of_the_body_has_an_error():
    shifted = symmetry_about(lopsided_bar(), [0.0, 0.0, 0.1], [0.0, 0.0, 1.0])
    assert shifted.error > 1e-3


@pytest.mark.parametrize("normal", [[0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 0]])
def test_a_plane_needs_a_normal(normal):
    with pytest.raises(InputError, match="mirror plane"):
        symmetry_about(icosphere(1), [0, 0, 0], normal)


def test_of_two_planes_the_one_of_the_least_misfit_is_found():
    """A tube with a dent: symmetric about one plane, and nearly so about others."""
    mesh = tube(24, 31)
    v = mesh.vertices * [1.0, 1.0, 1.4]
    v[:, 0] *= 0.4
    v[:, 1] += 0.02 * np.exp(-(v[:, 0] ** 2)) * np.maximum(v[:, 1], 0.0)
    symmetry = find_symmetry(Mesh(v, mesh.faces))
    assert symmetry.error < 1e-9 and abs(symmetry.normal[1]) < 1e-6


def test_the_most_symmetric_of_poses_is_found_whatever_their_order():
    bar = lopsided_bar()
    twisted = Mesh(bar.vertices + 0.3 * bar.vertices[:, [1, 2, 0]] ** 2, bar.faces)
    for shapes, expected in (([twisted, bar, bar], 1), ([bar, twisted], 0)):
        symmetry, index = most_symmetric(shapes)
        assert index == expected
        assert symmetry.error < 1e-9
