"""The camera's plain geometry: pixels and points, orbits, zooms, rays."""

import numpy as np
import pytest

from deformer_app.rendering.camera import Camera, Ray

SIZE = (640, 480)
CAMERA = Camera((3.0, -4.0, 2.0), (0.2, 0.1, 0.5), (0.0, 0.0, 1.0), 30.0)
POINTS = np.array([[0.3, 0.2, 0.4], [-0.5, 0.3, 0.9], [0.0, 0.0, 0.0]])


def test_a_pixel_at_its_depth_is_the_point():
    pixels, depths = CAMERA.project(POINTS, SIZE), CAMERA.depths(POINTS)
    for point, pixel, depth in zip(POINTS, pixels, depths, strict=True):
        np.testing.assert_allclose(CAMERA.unproject(pixel, depth, SIZE), point, atol=1e-12)


def test_a_ray_passes_through_what_is_seen():
    for point, pixel in zip(POINTS, CAMERA.project(POINTS, SIZE), strict=True):
        ray = CAMERA.ray(pixel, SIZE)
        toward = point - ray.origin
        assert np.linalg.norm(np.cross(toward, ray.direction)) < 1e-12


def test_one_pixel_is_one_pixel():
    step = CAMERA.pixel_size(POINTS[0], SIZE) * CAMERA.axes()[0]
    there = CAMERA.project([POINTS[0], POINTS[0] + step], SIZE)
    np.testing.assert_allclose(there[1] - there[0], [1.0, 0.0], atol=1e-9)


def test_orbiting_keeps_distance_and_horizon_and_stops_at_the_pole():
    sky = [0.0, 0.0, 1.0]
    turned = CAMERA.orbited(70.0, 20.0, sky)
    distance = np.linalg.norm(np.subtract(CAMERA.position, CAMERA.focal))
    assert np.linalg.norm(np.subtract(turned.position, turned.focal)) == pytest.approx(distance)
    assert turned.axes()[0] @ sky == pytest.approx(0, abs=1e-12)
    over = CAMERA.orbited(0.0, 400.0, sky)
    offset = np.subtract(over.position, over.focal) / distance
    assert np.degrees(np.arcsin(offset[2])) == pytest.approx(89.0)
    # From the pole it finds back, facing where it did.
    back = over.orbited(0.0, -60.0, sky)
    assert back.axes()[0] == pytest.approx(CAMERA.axes()[0], abs=1e-6)


def test_what_is_dragged_to_the_right_goes_to_the_right():
    """In front of the focal point orbit and pan follow the hand."""
    near = np.array(CAMERA.focal) + 0.3 * CAMERA.axes()[2]
    before = CAMERA.project([near], SIZE)[0]
    for moved in (CAMERA.orbited(5.0, 0.0, [0, 0, 1]), CAMERA.panned(30.0, 0.0, SIZE)):
        after = moved.project([near], SIZE)[0]
        assert after[0] > before[0] + 3 and after[1] == pytest.approx(before[1], abs=2)
    for moved in (CAMERA.orbited(0.0, 5.0, [0, 0, 1]), CAMERA.panned(0.0, 30.0, SIZE)):
        assert moved.project([near], SIZE)[0][1] > before[1] + 3


def test_panning_is_exact_at_the_focal_point():
    moved = CAMERA.panned(12.0, -7.0, SIZE)
    shift = moved.project([CAMERA.focal], SIZE) - CAMERA.project([CAMERA.focal], SIZE)
    np.testing.assert_allclose(shift, [[12.0, -7.0]], atol=1e-9)


def test_zoom_keeps_what_is_under_the_cursor():
    pixel = (500.0, 130.0)
    depth = CAMERA.depths([CAMERA.focal])[0]
    under = CAMERA.unproject(pixel, depth, SIZE)
    near = CAMERA.zoomed(2.0, pixel, SIZE)
    np.testing.assert_allclose(near.project([under], SIZE)[0], pixel, atol=1e-9)
    assert near.depths([near.focal])[0] == pytest.approx(depth / 2)


def test_a_ray_against_an_axis_and_a_plane():
    ray = Ray(np.array([1.0, 5.0, 0.0]), np.array([0.0, -2.0, 0.0]))
    assert ray.along([0, 0, 3], [1, 0, 0]) == pytest.approx(1.0)
    assert ray.along([0, 0, 0], [0, 1, 0]) is None
    np.testing.assert_allclose(ray.on_plane([9, 2, 7], [0, 1, 0]), [1, 2, 0])
    assert ray.on_plane([0, 9, 0], [0, 1, 0]) is None  # behind
    assert ray.on_plane([0, 2, 0], [1, 0, 0]) is None  # along it
