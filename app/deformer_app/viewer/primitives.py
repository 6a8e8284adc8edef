"""Dots and strokes: VTK actors that are created once and refilled within microseconds."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkRenderer

from deformer_app.rendering.palette import rgb


class _Primitives:
    """An actor of points that belong to cells, each cell with a colour."""

    def __init__(self, renderer: vtkRenderer) -> None:
        self._data, self._mapper, self.actor = vtkPolyData(), vtkPolyDataMapper(), vtkActor()
        self._mapper.SetInputData(self._data)
        self._mapper.SetScalarModeToUseCellData()
        self._mapper.SetColorModeToDirectScalars()
        self.actor.SetMapper(self._mapper)
        self.actor.PickableOff()
        self.actor.VisibilityOff()
        renderer.AddActor(self.actor)

    def clear(self) -> None:
        """Draw nothing."""
        self.actor.VisibilityOff()

    def _fill(self, points: ArrayLike, cells: NDArray, colours: Sequence[str]) -> vtkCellArray:
        """Set points (n, 3) and m colours; give the cells (m, k) of the points' numbers to VTK."""
        coordinates = vtkPoints()
        coordinates.SetData(numpy_to_vtk(np.array(points, dtype=np.float32), deep=True))
        self._data.SetPoints(coordinates)
        count, width = cells.shape
        array = vtkCellArray()
        array.SetData(
            numpy_to_vtkIdTypeArray(np.arange(0, (count + 1) * width, width), deep=True),
            numpy_to_vtkIdTypeArray(np.ascontiguousarray(cells, dtype=np.int64).ravel(), deep=True),
        )
        shades = np.array([rgb(colour) for colour in colours], dtype=np.uint8)
        self._data.GetCellData().SetScalars(numpy_to_vtk(shades, deep=True))
        self.actor.VisibilityOn()
        return array


class Dots(_Primitives):
    """Balls of one size in pixels, which no translucent surface dims.

    What is translucent blends over all that is opaque behind it. Therefore the balls are drawn a
    second time, after translucent props that were added earlier, wherever they are in front of
    everything opaque.

    Args:
        renderer: where they are drawn.
        size: diameter in pixels.
    """

    def __init__(self, renderer: vtkRenderer, size: int) -> None:
        """Start with none."""
        super().__init__(renderer)
        self._size = size
        look = self.actor.GetProperty()
        self.magnify(1.0)
        look.SetRenderPointsAsSpheres(True)
        look.SetAmbient(0.45)
        look.SetDiffuse(0.6)
        self._again = vtkActor()
        self._again.SetMapper(self._mapper)
        self._again.SetProperty(look)
        self._again.PickableOff()
        self._again.ForceTranslucentOn()
        renderer.AddActor(self._again)
        self.clear()

    def clear(self) -> None:
        """Draw nothing."""
        super().clear()
        self._again.VisibilityOff()

    def magnify(self, factor: float) -> None:
        """Set the factor from the picture's pixels to VTK's."""
        self.actor.GetProperty().SetPointSize(factor * self._size)

    def show(self, points: NDArray, colours: Sequence[str]) -> None:
        """Draw points (n, 3), each in its colour."""
        if len(points):
            self._data.SetVerts(self._fill(points, np.arange(len(points))[:, None], colours))
            self._again.VisibilityOn()
        else:
            self.clear()


class Strokes(_Primitives):
    """Lines of one width in pixels, without light.

    Args:
        renderer: where they are drawn.
        width: in pixels.
    """

    def __init__(self, renderer: vtkRenderer, width: float) -> None:
        """Start with none."""
        super().__init__(renderer)
        self._width = width
        self.magnify(1.0)
        self.actor.GetProperty().SetLighting(False)

    def magnify(self, factor: float) -> None:
        """Set the factor on the width."""
        self.actor.GetProperty().SetLineWidth(factor * self._width)

    def show(self, lines: Sequence[NDArray], colours: Sequence[str]) -> None:
        """Draw polylines, each (n, 3) in its colour."""
        if not len(lines):
            self.clear()
            return
        cells, shades, start = [], [], 0
        for line, colour in zip(lines, colours, strict=True):
            first = np.arange(start, start + len(line) - 1)
            cells.append(np.column_stack([first, first + 1]))
            shades += [colour] * len(first)
            start += len(line)
        self._data.SetLines(self._fill(np.concatenate(lines), np.concatenate(cells), shades))
