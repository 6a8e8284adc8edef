"""Translucent copies of the model's mesh in the picture: shapes to compare the pose with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkDataArray, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkPropAssembly, vtkRenderer

import deformer
from deformer_app.rendering.palette import Theme, Tint, rgb
from deformer_app.viewer.depth_offset import offset_depth

OPACITY = 0.28  # of a ghost alone in the picture
# Offset of a ghost's depth, about 0.3 % of the size of a body that fills the picture: where it
# nearly lies on the surface, it is behind it. Else it would tint the surface in speckles.
_BEHIND = 2.0, 0.15


class Ghosts:
    """Copies of one mesh, each with a name, a tint of the theme and an opacity.

    The surface hides what lies behind it of a ghost. A ghost hides nothing, cannot be picked, and
    dims no handle that lies behind it (see `primitives.Dots`).

    Args:
        renderer: that of the surface, which blends in the order of its props: a handle's dots have
            to be added after this object is made.
        theme: colours.
    """

    def __init__(self, renderer: vtkRenderer, theme: Theme) -> None:
        """Begin without a mesh."""
        self._theme = theme
        self._faces = np.empty((0, 3), dtype=np.int64)
        self._cells = vtkCellArray()
        self._ghosts: dict[str, _Ghost] = {}
        self._group = vtkPropAssembly()
        self._group.PickableOff()
        renderer.AddViewProp(self._group)

    @property
    def names(self) -> frozenset[str]:
        """Names of the ghosts that are shown."""
        return frozenset(name for name, ghost in self._ghosts.items() if ghost.is_shown)

    def vertices(self, name: str) -> NDArray[np.float32]:
        """Return the vertices (V, 3) of a ghost, as they were last shown."""
        return np.asarray(vtk_to_numpy(self._ghosts[name].points), dtype=np.float32)

    def set_faces(self, faces: NDArray) -> None:
        """Begin with another mesh's faces (F, 3), without a ghost."""
        for ghost in self._ghosts.values():
            self._group.RemovePart(ghost.actor)
        self._ghosts.clear()
        self._faces, self._cells = faces, vtkCellArray()
        corners = np.ascontiguousarray(faces, dtype=np.int64).ravel()
        starts = np.arange(0, len(corners) + 1, 3)
        self._cells.SetData(
            numpy_to_vtkIdTypeArray(starts, deep=True), numpy_to_vtkIdTypeArray(corners, deep=True)
        )

    def show(
        self, name: str, vertices: NDArray, tint: Tint = "ghost", opacity: float = OPACITY
    ) -> None:
        """Show a ghost, or change the one with this name; the caller has the picture drawn.

        Args:
            name: of the ghost; one that was hidden is used again.
            vertices: (V, 3) of the mesh whose faces were set.
            tint: its colour, as a role of the theme.
            opacity: from 0, invisible, to 1.
        """
        if name not in self._ghosts:
            self._ghosts[name] = ghost = _Ghost(self._cells)
            self._group.AddPart(ghost.actor)
        ghost = self._ghosts[name]
        ghost.fill(vertices, deformer.vertex_normals(vertices, self._faces))
        ghost.tint = tint
        ghost.colour(self._theme)
        ghost.actor.GetProperty().SetOpacity(opacity)
        ghost.actor.VisibilityOn()

    def hide(self, name: str) -> None:
        """Hide a ghost; without one of this name nothing happens."""
        if name in self._ghosts:
            self._ghosts[name].actor.VisibilityOff()

    def clear(self) -> None:
        """Hide all ghosts."""
        for name in self._ghosts:
            self.hide(name)

    def set_theme(self, theme: Theme) -> None:
        """Change the colours."""
        self._theme = theme
        for ghost in self._ghosts.values():
            ghost.colour(theme)


class _Ghost:
    """One copy; its arrays are VTK's, so that another shape of it costs two copies of numbers."""

    def __init__(self, cells: vtkCellArray) -> None:
        self._data, mapper, self.actor = vtkPolyData(), vtkPolyDataMapper(), vtkActor()
        self._data.SetPoints(vtkPoints())
        self._data.SetPolys(cells)
        mapper.SetInputData(self._data)
        offset_depth(mapper, *_BEHIND)
        self.actor.SetMapper(mapper)
        self.actor.PickableOff()
        # Even an opaque one comes after the surface, and before the handles.
        self.actor.ForceTranslucentOn()
        look = self.actor.GetProperty()
        look.SetInterpolationToPhong()
        look.SetAmbient(0.25)
        look.SetDiffuse(0.9)
        self.tint: Tint = "ghost"

    @property
    def is_shown(self) -> bool:
        return bool(self.actor.GetVisibility())

    @property
    def points(self) -> vtkDataArray:
        return self._data.GetPoints().GetData()

    def fill(self, vertices: NDArray, normals: NDArray) -> None:
        self._data.GetPoints().SetData(numpy_to_vtk(vertices.astype(np.float32), deep=True))
        self._data.GetPointData().SetNormals(numpy_to_vtk(normals.astype(np.float32), deep=True))
        self._data.GetPoints().Modified()
        self._data.Modified()

    def colour(self, theme: Theme) -> None:
        red, green, blue = (part / 255 for part in rgb(theme.tint(self.tint)))
        self.actor.GetProperty().SetColor(red, green, blue)
