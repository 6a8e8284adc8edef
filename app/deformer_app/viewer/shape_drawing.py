"""Small pictures of shapes, drawn off the screen."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from PIL import Image

import deformer
from deformer import Mesh
from deformer_app.rendering.camera import Camera
from deformer_app.rendering.offscreen import LIGHTS, Picture
from deformer_app.rendering.palette import Theme
from deformer_app.viewer.scene import grabbed

SUPERSAMPLING = 2


def hidden_plotter(size: tuple[int, int]) -> pv.Plotter:
    """Make a plotter that draws off the screen, beside windows on the same display.

    Args:
        size: width and height in pixels.
    """
    # Like the windows it uses the display: a context of EGL and one of GLX, in turn on one
    # thread, leave VTK 9.7.2 with empty pictures.
    return pv.Plotter(off_screen=True, window_size=list(size), lighting="none")


class ShapeDrawing:
    """One surface on a plotter off the screen.

    Args:
        plotter: without lights; its side is `SUPERSAMPLING` times that of the pictures.
    """

    def __init__(self, plotter: Any) -> None:
        """Set up the lights."""
        self._plotter = plotter
        self._data: pv.PolyData | None = None
        self._actor: Any = None
        self._of: Mesh | None = None
        for position, color, strength in LIGHTS:
            light = pv.Light(color=color, intensity=strength, light_type="camera light")
            light.position = position
            plotter.add_light(light)
        plotter.render_window.AlphaBitPlanesOn()

    def picture(
        self,
        mesh: Mesh,
        vertices: NDArray[np.float64],
        camera: Camera,
        theme: Theme,
    ) -> Picture:
        """Return a picture (n, n, 4) of a shape (V, 3) with the triangles of a mesh."""
        plotter = self._plotter
        data = self._surface(mesh, theme)
        np.asarray(data.points)[:] = vertices
        data.GetPoints().GetData().Modified()
        normals = deformer.vertex_normals(vertices, mesh.faces)
        np.asarray(data.point_data["Normals"])[:] = normals
        data.GetPointData().GetNormals().Modified()
        data.Modified()
        self._actor.prop.color = theme.clay
        lens = plotter.camera
        lens.position, lens.focal_point = camera.position, camera.focal
        lens.up, lens.view_angle = camera.up, camera.view_angle
        plotter.renderer.ResetCameraClippingRange()
        window = plotter.render_window
        window.Render()
        image = Image.fromarray(grabbed(window, opacity=True))
        # Colours are averaged with their opacity, so that outlines have no dark fringe.
        small = image.convert("RGBa").reduce(SUPERSAMPLING).convert("RGBA")
        return np.asarray(small)

    def _surface(self, mesh: Mesh, theme: Theme) -> pv.PolyData:
        if self._data is None or self._of is not mesh:
            if self._actor is not None:
                self._plotter.remove_actor(self._actor, reset_camera=False, render=False)
            faces = np.insert(mesh.faces, 0, 3, axis=1).ravel()
            self._data = pv.PolyData(np.array(mesh.vertices, dtype=np.float32), faces)
            self._data.point_data["Normals"] = np.zeros((len(mesh.vertices), 3), np.float32)
            self._data.point_data.active_normals_name = "Normals"
            self._actor = self._plotter.add_mesh(
                self._data,
                color=theme.clay,
                ambient=0.16,
                diffuse=1.0,
                specular=0.1,
                specular_power=12,
                copy_mesh=False,
                render=False,
                reset_camera=False,
            )
            self._actor.prop.interpolation = "Phong"
            self._of = mesh
        return self._data

    def close(self) -> None:
        """Free the plotter."""
        self._plotter.close()
