"""A picture behind or in front of the model, fixed to the image plane of the camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkImageData, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkRenderer, vtkTexture

from deformer_app.rendering.camera import Camera

_CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])  # of texture, from below


class PicturePlane:
    """A rectangle with a picture on it, always seen straight on.

    It is drawn as far away as the camera sees. Behind the model it belongs to the model's own
    layer, and must be added before what is translucent there; in front of the model, to the layer
    above.

    Args:
        scene: renderer of the surface.
        above: renderer of the layer that nothing hides.
    """

    def __init__(self, scene: vtkRenderer, above: vtkRenderer) -> None:
        """Begin without a picture."""
        self._data, self._image, self._texture = vtkPolyData(), vtkImageData(), vtkTexture()
        self._data.SetPoints(vtkPoints())
        cells = vtkCellArray()
        cells.InsertNextCell(4, range(4))
        self._data.SetPolys(cells)
        self._data.GetPointData().SetTCoords(numpy_to_vtk(_CORNERS.astype(np.float32), deep=True))
        self._texture.SetInputData(self._image)
        self._texture.InterpolateOn()
        mapper = vtkPolyDataMapper()
        mapper.SetInputData(self._data)
        self._actors = []
        for renderer in (scene, above):
            actor = vtkActor()
            actor.SetMapper(mapper)
            actor.SetTexture(self._texture)
            actor.GetProperty().LightingOff()
            actor.ForceTranslucentOn()
            actor.PickableOff()
            actor.VisibilityOff()
            renderer.AddActor(actor)
            self._actors.append(actor)
        self._aspect = 1.0
        self._middle, self._height = (0.0, 0.0), 1.0

    @property
    def is_shown(self) -> bool:
        """True while a picture is shown."""
        return any(actor.GetVisibility() for actor in self._actors)

    def fill(self, picture: NDArray[np.uint8]) -> None:
        """Set the picture (height, width, 4), red, green, blue and opacity."""
        height, width, _ = picture.shape
        self._aspect = width / height
        pixels = np.ascontiguousarray(picture[::-1]).reshape(-1, 4)
        self._image.SetDimensions(width, height, 1)
        self._image.GetPointData().SetScalars(numpy_to_vtk(pixels, deep=True))
        self._image.Modified()

    def show(
        self, middle: tuple[float, float], height: float, opacity: float, in_front: bool
    ) -> None:
        """Show the picture.

        Args:
            middle: its middle, right and up from the middle of the view, in heights of the view.
            height: its height, in heights of the view.
            opacity: from 0, invisible, to 1.
            in_front: true for in front of the model.
        """
        self._middle, self._height = middle, height
        for actor, here in zip(self._actors, (not in_front, in_front), strict=True):
            actor.GetProperty().SetOpacity(opacity)
            actor.SetVisibility(here)

    def hide(self) -> None:
        """Show no picture."""
        for actor in self._actors:
            actor.VisibilityOff()

    def place(self, camera: Camera, depth: float, size: tuple[int, int]) -> None:
        """Keep the picture where it is seen.

        Args:
            camera: that of the view.
            depth: of the plane along the view, nearly as far as the view reaches.
            size: width and height of the view in pixels.
        """
        if not self.is_shown:
            return
        (x, y), rows = self._middle, size[1]
        half = 0.5 * self._height * rows * np.array([self._aspect, -1.0])
        middle = np.array([size[0] / 2 + x * rows, rows / 2 - y * rows])
        pixels = middle + (2.0 * _CORNERS - 1.0) * half
        corners = np.array([camera.unproject(pixel, depth, size) for pixel in pixels])
        points = self._data.GetPoints()
        points.SetData(numpy_to_vtk(corners.astype(np.float32), deep=True))
        points.Modified()
        self._data.Modified()
