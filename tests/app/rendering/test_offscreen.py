"""Off-screen pictures: what is drawn, where, and in which colour."""

import os

import numpy as np
import pytest
from PIL import Image, ImageColor

from bars import bar_mesh
from deformer import InputError, Mesh
from deformer_app.rendering.camera import Camera, aim, upright_axes
from deformer_app.rendering.offscreen import (
    HandleGlyphs,
    Layer,
    contact_sheet,
    render,
    save_picture,
)
from deformer_app.rendering.palette import BACKGROUND, HANDLE, PINNED, TARGET

SIZE = (240, 320)  # width, height


@pytest.fixture(scope="module")
def bar():
    return Mesh(*bar_mesh())


@pytest.fixture(scope="module")
def camera(bar):
    return aim(bar.vertices, aspect=SIZE[0] / SIZE[1])


def drawn(image):
    """Mask of the pixels that differ from the background."""
    background = np.array(ImageColor.getrgb(BACKGROUND))
    return (np.abs(image.astype(int) - background) > 8).any(axis=2)


def box(mask):
    """Left, top, right and bottom border of what a mask holds."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([columns[0], rows[0], columns[-1], rows[-1]])


def hue_distance(image, color):
    """How far every pixel is from a colour, brightness left out."""
    pixels = image / np.maximum(image.sum(axis=2, keepdims=True), 1)
    wanted = np.array(ImageColor.getrgb(color), dtype=float)
    return np.abs(pixels - wanted / wanted.sum()).sum(axis=2)


def test_a_rendering_fills_the_box_of_the_projected_vertices(bar, camera):
    image = render(bar, camera, SIZE)
    assert image.shape == (SIZE[1], SIZE[0], 3)
    assert image.dtype == np.uint8
    pixels = camera.project(bar.vertices, SIZE)
    expected = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
    assert np.abs(box(drawn(image)) - expected).max() < 2.5


def test_a_rendering_needs_no_display_and_leaves_the_environment_alone(bar, camera, monkeypatch):
    for name in ("DISPLAY", "VTK_DEFAULT_OPENGL_WINDOW"):
        monkeypatch.delenv(name, raising=False)
    before = dict(os.environ)
    assert drawn(render(bar, camera, SIZE)).any()
    assert dict(os.environ) == before


def test_smooth_shading_keeps_the_edges_of_a_bar_sharp(bar):
    """The sides of a square bar are flat: within one side the shade hardly varies."""
    view = aim(bar.vertices, azimuth=45, elevation=0, aspect=SIZE[0] / SIZE[1])
    row = render(bar, view, SIZE)[SIZE[1] // 2].astype(int).sum(axis=1)
    sides = row[drawn(render(bar, view, SIZE))[SIZE[1] // 2]]
    left, right = sides[3 : len(sides) // 2 - 3], sides[len(sides) // 2 + 3 : -3]
    assert np.ptp(left) < 30
    assert np.ptp(right) < 30
    assert abs(left.mean() - right.mean()) > 60


@pytest.mark.parametrize("up", ["x", "y", "z", "-y", "-z"])
def test_aim_shows_the_whole_shape_upright_and_large(up):
    axes = upright_axes(up)
    vertices = bar_mesh()[0] @ axes + [5, -3, 2]  # stands along `up`
    camera = aim(vertices, up=up, aspect=SIZE[0] / SIZE[1])
    pixels = camera.project(vertices, SIZE)
    share = np.ptp(pixels, axis=0) / SIZE
    assert (pixels > 0).all() and (pixels < SIZE).all()
    assert share.max() == pytest.approx(0.84, abs=0.03)  # a margin of 8 % on each side
    top, bottom = pixels[-1], pixels[-2]
    assert top[1] < bottom[1]
    assert top[0] == pytest.approx(bottom[0], abs=SIZE[0] / 10)


@pytest.mark.parametrize("stretch", [(6, 1, 1), (1, 6, 1), (1, 1, 6)])
def test_aim_centres_a_shape_that_leans_to_one_side(stretch):
    # Seen from a corner of its box this triangle is all on one side of the box's middle.
    triangle = stretch * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 1]])
    camera = aim(triangle, azimuth=45, elevation=20, aspect=SIZE[0] / SIZE[1])
    pixels = camera.project(triangle, SIZE)
    assert (pixels > 0).all() and (pixels < SIZE).all()
    middle = (pixels.min(axis=0) + pixels.max(axis=0)) / 2
    assert np.abs(middle / SIZE - 0.5).max() < 0.08
    assert (np.ptp(pixels, axis=0) / SIZE).max() > 0.7


def test_axes_are_right_handed_and_left_is_left():
    for up in ("x", "y", "z", "-x", "-y", "-z"):
        left, sky, front = upright_axes(up)
        assert np.allclose(np.cross(left, sky), front)
    front_view = aim(bar_mesh()[0], azimuth=0, elevation=0)
    left, right = front_view.project([[0.5, 0, 0], [-0.5, 0, 0]], SIZE)
    assert left[0] > right[0]  # the figure's left hand is on our right


def test_aim_does_not_depend_on_scale():
    vertices = bar_mesh()[0]
    pixels = [aim(s * vertices).project(s * vertices, SIZE) for s in (1e-3, 1.0, 1e3)]
    assert np.allclose(pixels[0], pixels[1]) and np.allclose(pixels[2], pixels[1])


def test_an_unknown_up_axis_is_a_mistake():
    with pytest.raises(InputError, match="'w'"):
        aim(bar_mesh()[0], up="w")


def test_project_puts_the_focal_point_in_the_middle():
    camera = Camera((3, 1, 2), (0, 0.5, 0), (0, 1, 0))
    assert np.allclose(camera.project([camera.focal], SIZE), [[SIZE[0] / 2, SIZE[1] / 2]])


def test_handles_appear_where_they_project_in_their_colour(bar, camera):
    # Off the surface on the near side, so that the bar hides none of them.
    forward = camera.axes()[2]
    positions = bar.vertices[[0, 100, -1]] + 0.25 * forward
    targets = positions.copy()
    targets[1] += (0.15, 0.1, 0)
    image = render(bar, camera, SIZE, HandleGlyphs(positions, targets, [True, False, False]))
    colors = [PINNED, HANDLE, HANDLE, TARGET]
    points = camera.project([*positions, targets[1]], SIZE)
    for color, (x, y) in zip(colors, points, strict=True):
        assert hue_distance(image, color)[round(y), round(x)] < 0.12, color
    middle = camera.project([(positions[1] + targets[1]) / 2], SIZE)[0]
    line = hue_distance(image, TARGET)
    x, y = np.round(middle).astype(int)
    assert line[y - 1 : y + 2, x - 1 : x + 2].min() < 0.12


def test_a_target_that_is_met_is_not_drawn(bar, camera):
    position = bar.vertices[[100]] + 0.25 * camera.axes()[2]
    met = render(bar, camera, SIZE, HandleGlyphs(position, position))
    assert not (hue_distance(met, TARGET) < 0.12).any()


def test_scalars_colour_the_surface_and_draw_a_bar(bar, camera):
    height = bar.vertices[:, 1]
    image = render(Layer(bar, scalars=height, title="height"), camera, (400, 320))
    middle = drawn(image)[:, 180:220]
    rows = np.flatnonzero(middle.any(axis=1))
    top, bottom = image[rows[0] + 12, 200].astype(int), image[rows[-1] - 12, 200].astype(int)
    assert top[1] > 2 * top[2]  # yellow
    assert bottom[2] > 1.5 * bottom[1]  # violet
    assert drawn(image)[:, 320:].any()
    assert not drawn(render(bar, camera, (400, 320)))[:, 320:].any()


def test_layers_share_one_space(bar, camera):
    shifted = Mesh(bar.vertices + np.array([0.3, 0, 0]), bar.faces)
    wide = aim([bar.vertices, shifted.vertices])
    one = drawn(render(bar, wide, SIZE)).sum()
    both = drawn(render([bar, Layer(shifted, opacity=0.5)], wide, SIZE)).sum()
    assert both > 1.3 * one


def test_a_contact_sheet_has_room_for_every_picture_and_title():
    pictures = [np.full((100, 80, 3), 40 * i, np.uint8) for i in range(5)]
    plain = contact_sheet(pictures, 3, gap=10)
    assert plain.shape == (2 * 110 + 10, 3 * 90 + 10, 3)
    for index in range(5):
        row, column = divmod(index, 3)
        assert (plain[10 + 110 * row + 50, 10 + 90 * column + 40] == 40 * index).all()
    titled = contact_sheet(pictures, 3, [f"pose {i}" for i in range(5)], gap=10)
    assert titled.shape[0] > plain.shape[0] and titled.shape[1] == plain.shape[1]
    assert drawn(titled[112 : 10 + 100 + 28]).any()  # ink below the first row
    assert contact_sheet(pictures[:2], 6, gap=10).shape == (120, 190, 3)
    wide = contact_sheet(pictures[:2], 6, ["a title that is wider than its picture"] * 2, gap=10)
    assert wide.shape[1] > 2 * 190


def test_a_contact_sheet_refuses_what_does_not_fit():
    picture = np.zeros((10, 10, 3), np.uint8)
    for arguments in ([], 2), ([picture, picture[:5]], 2), ([picture], 1, ["a", "b"]):
        with pytest.raises(InputError, match="contact sheet"):
            contact_sheet(*arguments)


def test_a_picture_comes_back_from_disk(tmp_path, bar, camera):
    picture = render(bar, camera, (96, 96))
    save_picture(tmp_path / "one.png", picture)
    assert (np.asarray(Image.open(tmp_path / "one.png")) == picture).all()
