"""The colour bar of a painted surface: its font, its unit, its colours."""

from pathlib import Path

import numpy as np
import pytest

import deformer
from shapes import small_model

pv = pytest.importorskip("pyvista", reason='needs pyvista: pip install "deformer[app]"')


@pytest.mark.parametrize("dark", [False, True])
def test_the_bar_has_the_font_of_windows_and_the_ink_of_the_theme(dark):
    from deformer_app.rendering.fonts import sans
    from deformer_app.rendering.palette import DARK, LIGHT, rgb
    from deformer_app.viewer.colouring import Paint
    from deformer_app.viewer.surface import Surface

    theme = DARK if dark else LIGHT
    mesh = small_model().reference
    plotter = pv.Plotter(off_screen=True)
    surface = Surface(plotter, theme)
    normals = deformer.vertex_normals(mesh.vertices, mesh.faces)
    surface.set_mesh(mesh.vertices, mesh.faces, normals)
    surface.paint(Paint(np.ones(len(mesh.vertices)), "vertices", "height\n(m)", (0.0, 2.0)))
    bar = plotter.scalar_bars["height\n(m)"]
    assert Path(sans()).is_file()
    for text in (bar.GetTitleTextProperty(), bar.GetLabelTextProperty()):
        assert text.GetFontFile() == sans()
        assert text.GetColor() == pytest.approx([part / 255 for part in rgb(theme.ink)], abs=0.01)
    plotter.close()


@pytest.mark.parametrize("size", [(420, 420), (1300, 800)])
@pytest.mark.parametrize("dark", [False, True])
def test_the_bar_has_a_ground_of_its_own_before_a_surface_of_its_colours(dark, size):
    """Before a bright surface, all around the texts is as the theme's background, whatever size."""
    from deformer_app.rendering.offscreen import off_screen
    from deformer_app.rendering.palette import DARK, LIGHT, rgb
    from deformer_app.viewer.colouring import Paint
    from deformer_app.viewer.surface import Surface

    theme = DARK if dark else LIGHT
    corners = np.array([[-9.0, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]])
    with off_screen():
        plotter = pv.Plotter(off_screen=True, window_size=list(size))
    surface = Surface(plotter, theme)
    surface.set_mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.tile([0.0, 0, 1], (4, 1)))
    plotter.view_vector((0, 0, 1), (0, 1, 0))
    plotter.camera.zoom(4)

    def drawn():
        plotter.render()
        return plotter.screenshot(return_img=True).astype(int)

    bright = drawn()
    pictures = []
    for title in ("displacement\n(model units)", "gain"):
        surface.paint(Paint(np.zeros(4), "vertices", title, (0.0, 2.5e-4)))
        pictures.append(drawn())
    surface.paint(None)
    np.testing.assert_array_equal(drawn(), bright)
    plotter.close()
    for picture in pictures:
        ink = np.abs(picture - rgb(theme.ink)).max(axis=2) < 40
        rows, columns = np.flatnonzero(ink.any(axis=1)), np.flatnonzero(ink.any(axis=0))
        assert len(rows) and len(columns) > 20
        assert 4 < size[0] - columns[-1] < 140, "inside the picture, beside its edge"
        behind = picture[rows[0] - 4 : rows[-1] + 5, [columns[-1] + 3]]
        assert np.abs(behind - rgb(theme.background)).max() < 45
        assert np.abs(picture[rows[0] - 4, columns] - rgb(theme.background)).max() < 45


@pytest.mark.parametrize("density", [1.0, 2.0])
@pytest.mark.parametrize("size", [(254, 150), (254, 200), (254, 247), (400, 330), (1300, 800)])
def test_the_bar_lies_beside_the_cube_and_is_drawn_whole(size, density):
    """Down to the smallest picture of the window: all of the bar that a large picture shows."""
    from deformer_app.rendering.offscreen import off_screen
    from deformer_app.rendering.palette import LIGHT, rgb
    from deformer_app.viewer.colouring import Paint
    from deformer_app.viewer.surface import Surface
    from deformer_app.viewer.view_cube import BOTTOM, LEFT

    mesh = small_model().reference

    def ink(size):
        """Rows and columns, in pixels that a person sees, of each dark pixel of the texts."""
        pixels = [round(density * side) for side in size]
        with off_screen():
            plotter = pv.Plotter(off_screen=True, window_size=pixels)
        plotter.set_background(LIGHT.background)
        surface = Surface(plotter, LIGHT)
        surface.set_mesh(mesh.vertices, mesh.faces, np.tile([0.0, 0, 1], (len(mesh.vertices), 1)))
        values = np.zeros(len(mesh.vertices))
        surface.paint(Paint(values, "vertices", "displacement\n(model units)", (0.0, 0.11)))
        surface.actor.VisibilityOff()
        surface.bar.place(tuple(pixels), density)
        picture = plotter.screenshot(return_img=True).astype(int)
        plotter.close()
        return np.argwhere(np.abs(picture - rgb(LIGHT.ink)).max(axis=2) < 40) / density

    here, large = ink(size), ink((1300, 800))
    assert len(here) == pytest.approx(len(large), rel=0.15)
    np.testing.assert_allclose(np.ptp(here[:, 1]), np.ptp(large[:, 1]), atol=2)
    lines = [np.count_nonzero(np.diff(np.unique(found[:, 0])) > 1) for found in (here, large)]
    assert lines[0] == lines[1], "the title and each number are apart"
    (above, left), (below, right) = here.min(axis=0), here.max(axis=0)
    assert above > BOTTOM or right < size[0] - LEFT
    assert left > 0 and above > 4 and right < size[0] - 4 and below < size[1] - 4
