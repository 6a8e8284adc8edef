"""The edited surface, its colours and a translucent mesh to compare, as VTK actors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkActor

from deformer import Mesh
from deformer_app.rendering.palette import DIVERGING, HEAT, REGION, Theme
from deformer_app.viewer.colouring import Paint

# Options of every actor: the view alone decides when to draw, and the camera.
_PASSIVE: dict[str, Any] = {"render": False, "reset_camera": False}


class Surface:
    """Actors of one mesh on a plotter.

    Args:
        plotter: of any kind.
        theme: colours.
    """

    def __init__(self, plotter: Any, theme: Theme) -> None:
        """Begin without a mesh."""
        self._plotter, self._theme = plotter, theme
        self._data: pv.PolyData | None = None
        self._actors: dict[str, Any] = {}
        self._paint: Paint | None = None
        self._smooth, self._edges = True, False
        self.faces = np.empty((0, 3), dtype=np.int64)
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
        self._data = _poly_data(vertices, faces)
        self._data.point_data["Normals"] = normals.astype(np.float32)
        self._data.point_data.active_normals_name = "Normals"
        self._paint = None
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
        if "region" in self._actors:
            self._actors["region"].mapper.dataset.points = self._data.points

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
        if "ghost" in self._actors:
            self._actors["ghost"].prop.color = theme.ghost

    def show_ghost(self, mesh: Mesh | None) -> None:
        """Show another mesh translucently, or none."""
        self._remove("ghost")
        if mesh is not None:
            self._actors["ghost"] = self._plotter.add_mesh(
                _poly_data(mesh.vertices, mesh.faces),
                name="ghost",
                color=self._theme.ghost,
                opacity=0.28,
                smooth_shading=True,
                pickable=False,
                **_PASSIVE,
            )

    def show_region(self, vertices: Sequence[int]) -> None:
        """Colour the faces whose corners are all among `vertices`."""
        self._remove("region")
        if not len(vertices) or self._data is None:
            return
        inside = np.zeros(len(self.vertices), dtype=bool)
        inside[list(vertices)] = True
        faces = self.faces[inside[self.faces].all(axis=1)]
        if not len(faces):
            return
        actor = self._plotter.add_mesh(
            pv.PolyData(self._data.points, np.insert(faces, 0, 3, axis=1).ravel()),
            name="region",
            color=REGION,
            opacity=0.75,
            lighting=False,
            pickable=False,
            copy_mesh=False,
            **_PASSIVE,
        )
        actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
        actor.mapper.SetRelativeCoincidentTopologyPolygonOffsetParameters(-2, -2)
        self._actors["region"] = actor

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
        self._add_bar()

    def _add_bar(self) -> None:
        """Draw a colour bar for what the mesh is coloured by, and no other."""
        for title in list(self._plotter.scalar_bars.keys()):
            self._plotter.remove_scalar_bar(title, render=False)
        if self._paint is None:
            return
        bar = self._plotter.add_scalar_bar(
            self._paint.title,
            mapper=self._actors["mesh"].mapper,
            vertical=True,
            width=0.04,
            height=0.36,
            position_x=0.84,
            position_y=0.3,
            n_labels=3,
            fmt="%.2g",
            title_font_size=14,
            label_font_size=13,
            color=self._theme.ink,
            render=False,
        )
        bar.SetVerticalTitleSeparation(10)


def _poly_data(vertices: NDArray, faces: NDArray) -> pv.PolyData:
    return pv.PolyData(np.array(vertices, dtype=np.float32), np.insert(faces, 0, 3, axis=1).ravel())
