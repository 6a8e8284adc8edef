"""The orientation cube as VTK draws it, in a layer over a corner of the picture."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkImageData, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkRenderer, vtkTexture

from deformer_app.rendering.palette import SELECTED, Theme, rgb
from deformer_app.viewer.view_cube import FACES, HALF, REACH, Side, Size, centre, outlines

_TEXTURE = 256  # pixels along each side of a face's picture
_FADED = 0.25  # opacity while the manipulator is behind the cube
_RAISED = 1.004  # half an edge of what is drawn on the cube


class CubeDrawing:
    """The cube with words on its faces, turned as the camera is.

    Args:
        window: VTK's, to which the layer is added.
        layer: number of the layer.
    """

    def __init__(self, window: object, layer: int) -> None:
        """Add the layer, without colours yet."""
        self.renderer = vtkRenderer()
        self.renderer.SetLayer(layer)
        self.renderer.InteractiveOff()
        window.AddRenderer(self.renderer)  # pyright: ignore[reportAttributeAccessIssue]
        lens = self.renderer.GetActiveCamera()
        lens.ParallelProjectionOn()
        lens.SetParallelScale(REACH / HALF)
        # One prop with all faces, because each prop takes time in every frame.
        self._texture = vtkTexture()
        self._texture.InterpolateOn()
        self._texture.MipmapOn()
        self._faces = faces = _actor([_face(side) for side in FACES], np.concatenate(_cells()))
        faces.SetTexture(self._texture)
        faces.GetProperty().BackfaceCullingOn()
        self.renderer.AddActor(faces)
        self._lit: Side | None = None
        self._light: vtkActor | None = None

    def set_theme(self, theme: Theme) -> None:
        """Change the colours."""
        self._texture.SetInputData(_image(theme))

    def show(self, shown: bool) -> None:
        """Draw the cube, or leave it out."""
        self.renderer.SetDraw(shown)

    def fade(self, faded: bool) -> None:
        """Let what is behind the cube be seen through it, or not."""
        self._faces.GetProperty().SetOpacity(_FADED if faded else 1.0)

    @property
    def shown(self) -> bool:
        """True unless the cube is left out."""
        return bool(self.renderer.GetDraw())

    @contextmanager
    def left_out(self) -> Iterator[None]:
        """Leave the cube out of the frames that are drawn within the block."""
        before = self.renderer.GetDraw()
        self.renderer.DrawOff()
        try:
            yield
        finally:
            self.renderer.SetDraw(before)

    def look(self, axes: ArrayLike) -> None:
        """Turn the cube: rows (3, 3), see `side_at`."""
        _, up, backward = np.asarray(axes, dtype=np.float64)
        lens = self.renderer.GetActiveCamera()
        lens.SetPosition(*(10.0 * backward))
        lens.SetFocalPoint(0.0, 0.0, 0.0)
        lens.SetViewUp(*up)
        lens.SetClippingRange(5.0, 15.0)

    def place(self, size: Size) -> None:
        """Put the cube into its corner of a picture of `size` (width, height)."""
        x, y = centre(size)
        low = np.array([x - REACH, size[1] - y - REACH]) / size
        high = np.array([x + REACH, size[1] - y + REACH]) / size
        self.renderer.SetViewport(*low, *high)

    def light(self, side: Side | None) -> None:
        """Highlight a part of the cube, or none."""
        if side == self._lit:
            return
        if self._light is not None:
            self.renderer.RemoveActor(self._light)
        self._lit, self._light = side, None
        if side is not None:
            self._light = _actor([_RAISED * square for square in outlines(side)])
            look = self._light.GetProperty()
            look.SetColor(*(part / 255 for part in rgb(SELECTED)))
            look.SetOpacity(0.6)
            self.renderer.AddActor(self._light)


def _face(side: Side) -> NDArray[np.float64]:
    """Corners (4, 3) of a face as it is seen from outside: bottom left, right, top right, left."""
    normal = np.array(side, dtype=np.float64)
    up = np.array([0, 1, 0]) if side[1] == 0 else np.array([0, 0, -side[1]])
    right = np.cross(up, normal)
    return normal + np.array([-right - up, right - up, right + up, up - right])


def _cells() -> list[NDArray[np.float64]]:
    """Corners (4, 2) of each face in the texture, where they are in a row."""
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return [(corners + np.array([n, 0.0])) / [len(FACES), 1.0] for n in range(len(FACES))]


def _actor(squares: list[NDArray[np.float64]], texture: NDArray | None = None) -> vtkActor:
    data, points, cells = vtkPolyData(), vtkPoints(), vtkCellArray()
    points.SetData(numpy_to_vtk(np.concatenate(squares).astype(np.float32), deep=True))
    for n in range(len(squares)):
        cells.InsertNextCell(4, range(4 * n, 4 * n + 4))
    data.SetPoints(points)
    data.SetPolys(cells)
    if texture is not None:
        data.GetPointData().SetTCoords(numpy_to_vtk(texture.astype(np.float32), deep=True))
    mapper, actor = vtkPolyDataMapper(), vtkActor()
    mapper.SetInputData(data)
    actor.SetMapper(mapper)
    actor.GetProperty().LightingOff()
    actor.PickableOff()
    return actor


def _image(theme: Theme) -> vtkImageData:
    """Return the picture of the faces: a word within a border each."""
    width = len(FACES) * _TEXTURE
    picture = Image.new("RGB", (width, _TEXTURE), dict(theme.widgets)["Button"])
    pen = ImageDraw.Draw(picture)
    font = ImageFont.load_default(_TEXTURE // 4)
    for n, word in enumerate(FACES.values()):
        left = n * _TEXTURE
        border = (left, 0, left + _TEXTURE - 1, _TEXTURE - 1)
        pen.rectangle(border, outline=theme.disabled, width=8)
        middle = (left + _TEXTURE / 2, _TEXTURE / 2)
        pen.text(middle, word, fill=theme.ink, font=font, anchor="mm", stroke_width=2,
                 stroke_fill=theme.ink)  # fmt: skip
    pixels = np.asarray(picture)[::-1].reshape(-1, 3)
    image = vtkImageData()
    image.SetDimensions(width, _TEXTURE, 1)
    image.GetPointData().SetScalars(numpy_to_vtk(np.ascontiguousarray(pixels), deep=True))
    return image
