"""Translucent copies of the mesh: where they are seen, what they leave as it was."""

import numpy as np
import pytest
import pyvista as pv

from deformer import vertex_normals
from deformer_app.rendering.camera import aim
from deformer_app.rendering.offscreen import off_screen
from deformer_app.rendering.palette import DARK, HANDLE, LIGHT, PINNED
from deformer_app.viewer.overlays import HandleDots
from deformer_app.viewer.patches import Patch
from deformer_app.viewer.scene import MeshView

SIZE = (200, 200)
# A square that faces the eye, which is on the z axis.
SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
NEARER = SQUARE + np.array([0, 0, 0.5])
MIDDLE = (100, 100)


@pytest.fixture
def view():
    with off_screen():
        plotter = pv.Plotter(off_screen=True, window_size=list(SIZE), lighting="none")
        plotter.show(auto_close=False)
    made = MeshView(plotter)
    made.cube.show(False)  # it would cover half of such a small picture
    made.surface.set_mesh(0.5 * SQUARE, FACES, vertex_normals(SQUARE, FACES))
    made.ghosts.set_faces(FACES)
    made.look(aim(1.5 * SQUARE, azimuth=0, elevation=0))
    yield made
    plotter.close()


def drawn(view, sharp=False):
    view.sharpen(sharp)
    view.render()
    return view.grab().astype(int)


def show_dot(view, position):
    view.overlays.show_handles(
        HandleDots(np.array([position]), np.array([position]), [HANDLE], [30])
    )


def pixel_of(view, point):
    x, y = view.camera.project([point], view.size)[0]
    return round(y), round(x)


@pytest.mark.parametrize("sharp", [False, True])
def test_a_ghost_tints_the_surface_behind_it_and_no_handle(view, sharp):
    show_dot(view, [0.0, 0.0, 0.0])
    before = drawn(view, sharp)
    view.ghosts.show("one", SQUARE + np.array([0, 0, 2.0]), "earlier", 0.5)  # before the ball, too
    after = drawn(view, sharp)
    beside = pixel_of(view, [0.4, 0.4, 0.0])
    assert np.abs(after[beside] - before[beside]).max() > 20
    dot = slice(92, 109), slice(92, 109)  # inside the ball
    assert np.abs(after[dot] - before[dot]).max() <= 2


@pytest.mark.parametrize("patched", [False, True])
@pytest.mark.parametrize("sharp", [False, True])
def test_the_surface_hides_a_handle_and_what_is_behind_it_of_a_ghost(view, sharp, patched):
    """Also with a patch, for which VTK changes how all is drawn."""
    if patched:
        view.surface.show_patches([Patch((0, 1, 2), PINNED)])
    view.surface.move(0.5 * SQUARE + np.array([0, 0, 0.5]), vertex_normals(SQUARE, FACES))
    alone = drawn(view, sharp)
    show_dot(view, [0.0, 0.0, -0.5])
    view.ghosts.show("one", SQUARE - np.array([0, 0, 0.5]), "earlier", 0.5)
    both = drawn(view, sharp)
    assert np.abs(both[MIDDLE] - alone[MIDDLE]).max() <= 2
    around = pixel_of(view, [0.9, 0.0, -0.5])
    assert np.abs(both[around] - alone[around]).max() > 20


@pytest.mark.parametrize("sharp", [False, True])
def test_a_ghost_that_hardly_leaves_the_surface_does_not_speckle_it(view, sharp):
    alone = drawn(view, sharp)
    tilted = 0.5 * SQUARE
    tilted[:, 2] = 1e-3 * np.sign(SQUARE[:, 0])  # one half of it is before the surface
    view.ghosts.show("one", tilted, "earlier", 0.5)
    assert np.abs(drawn(view, sharp)[60:140, 60:140] - alone[60:140, 60:140]).max() <= 2
    view.ghosts.show("one", tilted + np.array([0, 0, 0.1]), "earlier", 0.5)
    assert np.abs(drawn(view, sharp)[MIDDLE] - alone[MIDDLE]).max() > 20


def test_ghosts_are_shown_moved_hidden_and_cleared_by_their_names(view):
    empty = drawn(view)
    view.ghosts.show("one", NEARER)
    view.ghosts.show("two", NEARER + np.array([0, 0, 0.1]), "later")
    assert view.ghosts.names == {"one", "two"}
    two = drawn(view)
    view.ghosts.hide("two")
    assert view.ghosts.names == {"one"}
    one = drawn(view)
    assert (two != one).any() and (one != empty).any()
    view.ghosts.show("one", NEARER + np.array([0.8, 0.0, 0.0]))
    moved = drawn(view)
    left, right = pixel_of(view, [-0.9, 0.0, 0.5]), pixel_of(view, [1.5, 0.0, 0.5])
    assert (moved[left] == empty[left]).all() and (moved[right] != empty[right]).any()
    view.ghosts.clear()
    assert not view.ghosts.names
    assert (drawn(view) == empty).all()


def test_a_ghost_has_the_opacity_and_the_theme_s_tint(view):
    spot = pixel_of(view, [0.9, 0.0, 0.5])
    empty = drawn(view)[spot]
    colours = {}
    for tint in ("ghost", "earlier", "later"):
        view.ghosts.show("one", NEARER, tint, 0.2)
        faint = drawn(view)[spot]
        view.ghosts.show("one", NEARER, tint, 0.8)
        colours[tint] = drawn(view)[spot]
        assert np.abs(colours[tint] - empty).max() > 2 * np.abs(faint - empty).max()
    red, _, blue = colours["earlier"]
    assert red > blue
    red, green, _ = colours["later"]
    assert green > red
    view.set_theme(DARK)
    assert (drawn(view)[spot] != colours["later"]).any()
    view.set_theme(LIGHT)
    assert (drawn(view)[spot] == colours["later"]).all()


def test_ghosts_are_not_picked_and_go_with_their_mesh(view):
    view.ghosts.show("one", 3 * NEARER, opacity=1.0)
    assert view.vertex_at((5.0, 5.0)) is None
    assert view.vertex_at((100.0, 100.0)) is not None
    assert view.sees([0.0, 0.0, 0.1])
    view.ghosts.set_faces(FACES[:1])
    assert not view.ghosts.names
    view.ghosts.show("one", NEARER)
    assert view.ghosts.names == {"one"}
