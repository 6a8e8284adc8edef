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
        # The surface behind the texts may be as bright as they are.
        ground = [part / 255 for part in rgb(theme.background)]
        assert text.GetBackgroundColor() == pytest.approx(ground, abs=0.01)
        assert text.GetBackgroundOpacity() >= 0.7
    plotter.close()
