"""The edited surface, its colours and the painted region, as VTK actors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkActor

from deformer_app.rendering.palette import DIVERGING, HEAT, Theme
from deformer_app.viewer.colour_bar import ColourBar
from deformer_app.viewer.colouring import Paint
from deformer_app.viewer.patches import Patch, Patches

# Options of every actor: the view alone decides when to draw, and the camera.
_PASSIVE: dict[str, Any] = {"render": False, "reset_camera": False}


class Surface:
    """Actors of one mesh on a plotter.

    Args:
        plotter: of any kind.
        theme: colours.

    Attributes:
        patches: parts of the mesh in colours of their own.
        bar: tells what the mesh's colours mean.
    """

    def __init__(self, plotter: Any, theme: Theme) -> None:
        """Begin without a mesh."""
        self._plotter, self._theme = plotter, theme
        self.patches, self.bar = Patches(plotter), ColourBar(plotter)
        self._data: pv.PolyData | None = None
        self._actors: dict[str, Any] = {}
        self._paint: Paint | None = None
        self._smooth, self._edges = True, False
        self.faces = np.empty((0, 3), dtype=np.int64)
        self.edges = np.empty((0, 2), dtype=np.int64)
        self.vertices = np.empty((0, 3))

    @property
    def actor(self) -> vtkActor | None:
        """The actor of the mesh, if there is one; another one after every change of its looks."""
        return self._actors.get("mesh")

    def set_mesh(self, vertices: NDArray[np.float64], faces: NDArray, normals: NDArray) -> None:
        """Show another mesh.

        Args:
            vertices: (V, 3).
            faces: (F, 3).
            normals: (V, 3) of the vertices, of length 1.
        """
        self.faces, self.vertices = faces, vertices
        ends = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        self.edges = np.unique(ends, axis=0)
        self._data = _poly_data(vertices, faces)
        self._data.point_data["Normals"] = normals.astype(np.float32)
        self._data.point_data.active_normals_name = "Normals"
        self._paint = None
        self.patches.clear()
        for name in list(self._actors):
            self._remove(name)
        self._add_mesh()

    def move(self, vertices: NDArray[np.float64], normals: NDArray[np.float64]) -> None:
        """Move the vertices (V, 3) of the mesh that is shown, with their normals (V, 3)."""
        assert self._data is not None
        self.vertices = vertices
        points = self._data.GetPoints().GetData()
        np.asarray(self._data.points)[:] = vertices
        points.Modified()
        np.asarray(self._data.point_data["Normals"])[:] = normals
        self._data.GetPointData().GetNormals().Modified()
        self._data.Modified()
        if self.patches.shown:
            self.patches.move(self._data.points)

    def paint(self, paint: Paint | None) -> None:
        """Colour the mesh by values; None removes the colours."""
        before, self._paint = self._paint, paint
        if (
            before is not None
            and paint is not None
            and (before.title, before.limits) == (paint.title, paint.limits)
        ):
            self._set_values(paint)
        elif before is not paint:
            self._add_mesh()

    def set_style(self, smooth: bool, edges: bool) -> None:
        """Shade smoothly or by face; draw the faces' edges or not."""
        self._smooth, self._edges = smooth, edges
        self._add_mesh()

    def set_theme(self, theme: Theme) -> None:
        """Change the colours."""
        self._theme = theme
        self._add_mesh()

    @property
    def normals(self) -> NDArray[np.float32]:
        """Normals (V, 3) of the vertices as they are shown."""
        assert self._data is not None, "there is no mesh yet"
        return np.asarray(self._data.point_data["Normals"])

    def show_patches(self, patches: Sequence[Patch]) -> None:
        """Show patches of the surface in their colours, in place of those before."""
        if self._data is not None and tuple(patches) != self.patches.shown:
            self.patches.show(patches, self._data.points, self.faces)

    def _remove(self, name: str) -> None:
        if self._actors.pop(name, None) is not None:
            self._plotter.remove_actor(name, reset_camera=False, render=False)

    def _set_values(self, paint: Paint) -> None:
        assert self._data is not None
        data = self._data.point_data if paint.on == "vertices" else self._data.cell_data
        data["value"] = paint.values.astype(np.float32)

    def _add_mesh(self) -> None:
        """Make the mesh's actor anew."""
        data, paint = self._data, self._paint
        if data is None:
            return
        self._remove("mesh")
        for values in (data.point_data, data.cell_data):
            if "value" in values:
                del values["value"]
        style: dict[str, Any] = {
            "name": "mesh",
            "ambient": 0.16,
            "diffuse": 1.0,
            "specular": 0.1,
            "specular_power": 12,
            "show_edges": self._edges,
            "edge_color": self._theme.edge,
            "copy_mesh": False,
            **_PASSIVE,
        }
        if paint is None:
            style["color"] = self._theme.clay
        else:
            self._set_values(paint)
            style |= {
                # Less shading, so that shadows do not look like dark colours.
                "ambient": 0.32,
                "diffuse": 0.72,
                "specular": 0.0,
                "scalars": "value",
                "preference": "point" if paint.on == "vertices" else "cell",
                "clim": paint.limits,
                "cmap": DIVERGING if paint.diverging else HEAT,
                "show_scalar_bar": False,
            }
        actor = self._plotter.add_mesh(data, **style)
        actor.prop.interpolation = "Phong" if self._smooth else "Flat"
        self._actors["mesh"] = actor
        if paint is None:
            self.bar.hide()
        else:
            self.bar.show(paint.title, actor.mapper, self._theme)


def _poly_data(vertices: NDArray, faces: NDArray) -> pv.PolyData:
    return pv.PolyData(np.array(vertices, dtype=np.float32), np.insert(faces, 0, 3, axis=1).ravel())
