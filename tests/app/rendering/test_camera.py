"""The camera's plain geometry: pixels and points, orbits, zooms, rays."""

import numpy as np
import pytest

from deformer_app.rendering.camera import Camera, Ray, aim, upright_axes

SIZE = (640, 480)
CAMERA = Camera((3.0, -4.0, 2.0), (0.2, 0.1, 0.5), (0.0, 0.0, 1.0), 30.0)
FLAT = Camera((3.0, -4.0, 2.0), (0.2, 0.1, 0.5), (0.0, 0.0, 1.0), 30.0, height=2.5)
BOTH = pytest.mark.parametrize("camera", [CAMERA, FLAT], ids=["perspective", "orthographic"])
POINTS = np.array([[0.3, 0.2, 0.4], [-0.5, 0.3, 0.9], [0.0, 0.0, 0.0]])


@BOTH
def test_a_pixel_at_its_depth_is_the_point(camera):
    pixels, depths = camera.project(POINTS, SIZE), camera.depths(POINTS)
    for point, pixel, depth in zip(POINTS, pixels, depths, strict=True):
        np.testing.assert_allclose(camera.unproject(pixel, depth, SIZE), point, atol=1e-12)


@BOTH
def test_a_ray_passes_through_what_is_seen(camera):
    for point, pixel in zip(POINTS, camera.project(POINTS, SIZE), strict=True):
        ray = camera.ray(pixel, SIZE)
        toward = point - ray.origin
        assert np.linalg.norm(np.cross(toward, ray.direction)) < 1e-12


@BOTH
def test_one_pixel_is_one_pixel(camera):
    step = camera.pixel_size(POINTS[0], SIZE) * camera.axes()[0]
    there = camera.project([POINTS[0], POINTS[0] + step], SIZE)
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


@BOTH
def test_what_is_dragged_to_the_right_goes_to_the_right(camera):
    """In front of the focal point orbit and pan follow the hand."""
    near = np.array(camera.focal) + 0.3 * camera.axes()[2]
    before = camera.project([near], SIZE)[0]
    for moved in (camera.orbited(5.0, 0.0, [0, 0, 1]), camera.panned(30.0, 0.0, SIZE)):
        after = moved.project([near], SIZE)[0]
        assert after[0] > before[0] + 3 and after[1] == pytest.approx(before[1], abs=2)
    for moved in (camera.orbited(0.0, 5.0, [0, 0, 1]), camera.panned(0.0, 30.0, SIZE)):
        assert moved.project([near], SIZE)[0][1] > before[1] + 3


@BOTH
def test_panning_is_exact_at_the_focal_point(camera):
    moved = camera.panned(12.0, -7.0, SIZE)
    shift = moved.project([camera.focal], SIZE) - camera.project([camera.focal], SIZE)
    np.testing.assert_allclose(shift, [[12.0, -7.0]], atol=1e-9)


@BOTH
def test_zoom_keeps_what_is_under_the_cursor(camera):
    pixel = (500.0, 130.0)
    depth = camera.depths([camera.focal])[0]
    under = camera.unproject(pixel, depth, SIZE)
    near = camera.zoomed(2.0, pixel, SIZE)
    np.testing.assert_allclose(near.project([under], SIZE)[0], pixel, atol=1e-9)
    assert near.depths([near.focal])[0] == pytest.approx(depth / 2)


def test_a_ray_against_an_axis_and_a_plane():
    ray = Ray(np.array([1.0, 5.0, 0.0]), np.array([0.0, -2.0, 0.0]))
    assert ray.along([0, 0, 3], [1, 0, 0]) == pytest.approx(1.0)
    assert ray.along([0, 0, 0], [0, 1, 0]) is None
    np.testing.assert_allclose(ray.on_plane([9, 2, 7], [0, 1, 0]), [1, 2, 0])
    assert ray.on_plane([0, 9, 0], [0, 1, 0]) is None  # behind
    assert ray.on_plane([0, 2, 0], [1, 0, 0]) is None  # along it


def test_an_orthographic_camera_sees_what_is_behind_its_eye():
    behind = np.array(FLAT.position) + 2.0 * FLAT.axes()[2] + 0.1 * FLAT.axes()[1]
    assert FLAT.depths([behind])[0] == pytest.approx(-2.0)
    pixel = FLAT.project([behind], SIZE)[0]
    np.testing.assert_allclose(pixel, [320.0, 240.0 - 0.1 * 480 / 2.5], atol=1e-9)
    np.testing.assert_allclose(FLAT.unproject(pixel, -2.0, SIZE), behind, atol=1e-12)
    hit = FLAT.ray(pixel, SIZE).on_plane(behind, FLAT.axes()[2])
    np.testing.assert_allclose(hit, behind, atol=1e-12)


def test_an_orthographic_image_is_as_high_as_it_says_at_every_depth():
    right, up, backward = FLAT.axes()
    for depth in (-5.0, 0.0, 3.0):
        top, bottom = (np.array(FLAT.position) - depth * backward + y * up for y in (1.25, -1.25))
        np.testing.assert_allclose(
            FLAT.project([top, bottom], SIZE), [[320, 0], [320, 480]], atol=1e-9
        )
        step = FLAT.pixel_size(top, SIZE) * right
        there = FLAT.project([top, top + step], SIZE)
        np.testing.assert_allclose(there[1] - there[0], [1.0, 0.0], atol=1e-9)


def test_zoom_changes_the_height_of_an_orthographic_image():
    assert FLAT.zoomed(2.0, (10.0, 20.0), SIZE).height == pytest.approx(1.25)
    assert FLAT.panned(5.0, 5.0, SIZE).height == FLAT.orbited(5.0, 5.0, [0, 0, 1]).height == 2.5
    assert CAMERA.zoomed(2.0, (10.0, 20.0), SIZE).height is None


def test_the_two_projections_agree_at_the_focal_point_s_depth():
    right, up, _ = CAMERA.axes()
    spots = np.array(CAMERA.focal) + np.outer([0.0, 0.4, -0.3], right) + np.outer([0, 0.2, 0.5], up)
    flat = CAMERA.orthographic()
    np.testing.assert_allclose(flat.project(spots, SIZE), CAMERA.project(spots, SIZE), atol=1e-9)
    back = flat.perspective()
    np.testing.assert_allclose(back.position, CAMERA.position, atol=1e-12)
    # After a zoom, too, whose height alone says how large things are.
    near = flat.zoomed(3.0, (320.0, 240.0), SIZE)
    again = near.perspective()
    np.testing.assert_allclose(again.project(spots, SIZE), near.project(spots, SIZE), atol=1e-9)
    assert again.perspective() is again


@BOTH
def test_a_raised_point_is_seen_at_the_same_pixel_nearer(camera):
    raised = camera.raised(POINTS, 10.0, SIZE)
    np.testing.assert_allclose(
        camera.project(raised, SIZE), camera.project(POINTS, SIZE), atol=1e-9
    )
    lengths = np.sqrt(((raised - POINTS) ** 2).sum(axis=1))
    expected = [10.0 * camera.pixel_size(point, SIZE) for point in POINTS]
    np.testing.assert_allclose(lengths, expected)
    assert (camera.depths(raised) < camera.depths(POINTS)).all()


@pytest.mark.parametrize("up", ["x", "y", "z", "-y"])
@pytest.mark.parametrize(
    ("azimuth", "elevation", "backward", "upward"),
    [
        (0, 0, (0, 0, 1), (0, 1, 0)),
        (90, 0, (1, 0, 0), (0, 1, 0)),
        (180, 0, (0, 0, -1), (0, 1, 0)),
        (0, 90, (0, 1, 0), (0, 0, -1)),
        (0, -90, (0, -1, 0), (0, 0, 1)),
    ],
)
def test_the_six_directions_are_exact(up, azimuth, elevation, backward, upward):
    """In terms of the shape's own left, up and front."""
    frame = upright_axes(up)
    camera = aim(POINTS, up=up, azimuth=azimuth, elevation=elevation, orthographic=True)
    np.testing.assert_allclose(frame @ camera.axes()[2], backward, atol=1e-12)
    np.testing.assert_allclose(frame @ camera.axes()[1], upward, atol=1e-12)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("elevation", [-90, -20, 0, 60, 90])
def test_aim_shows_all_as_large_as_fits(orthographic, elevation):
    width, height = SIZE
    camera = aim(
        POINTS, elevation=elevation, aspect=width / height, margin=0.1, orthographic=orthographic
    )
    assert camera.is_orthographic == orthographic
    places = camera.project(POINTS, SIZE) / SIZE - 0.5
    low, high = places.min(axis=0), places.max(axis=0)
    np.testing.assert_allclose(low, -high, atol=1e-6, err_msg="in the middle of the picture")
    assert high.max() == pytest.approx(0.4)


@pytest.mark.parametrize("elevation", [90.0, -90.0])
def test_orbiting_leaves_a_pole_without_a_jump(elevation):
    camera = aim(POINTS, up="z", azimuth=30.0, elevation=elevation)
    tipped = camera.orbited(0.0, -np.sign(elevation) * 2.0, [0, 0, 1])
    np.testing.assert_allclose(tipped.axes()[0], camera.axes()[0], atol=1e-9)
    assert tipped.axes()[2] @ camera.axes()[2] == pytest.approx(np.cos(np.radians(2.0)), abs=1e-9)
