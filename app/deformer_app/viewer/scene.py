"""The picture: a surface and drawings over it, on any pyvista plotter.

The view draws what it is told and says what lies under a pixel; it decides nothing. Pixels count
from the top left corner and are those that a person aims at: of a dense screen, each is several of
VTK's. Everything here runs on the thread of the window.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import ArrayLike, NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkRenderingCore import vtkCellPicker, vtkRenderer, vtkWindowToImageFilter

from deformer_app.rendering.camera import Camera, upright_axes
from deformer_app.rendering.offscreen import LIGHTS, Picture
from deformer_app.rendering.palette import LIGHT, Theme
from deformer_app.viewer.cube_drawing import CubeDrawing
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.ghosts import Ghosts
from deformer_app.viewer.overlays import Overlays
from deformer_app.viewer.picture_plane import PicturePlane
from deformer_app.viewer.surface import Surface

_BACK = 0.98  # depth of a reference picture, as a share of what the camera reaches
_SUPERSAMPLING = 2.0  # pixels of VTK's pass along each side of one of the picture


class MeshView:
    """One surface, the drawings over it, and the camera.

    Args:
        plotter: of any kind; its lights and its interactor's style are replaced.
        theme: colours.
        density: gives the number of VTK's pixels along each side of one that a person aims at;
            asked again with every use, as a window may be moved to another screen.

    Attributes:
        surface, overlays, ghosts, plane, cube: what is drawn.
        frame: rows (3, 3) of the shape's left, up and front, for the orientation cube.
    """

    def __init__(
        self, plotter: Any, theme: Theme = LIGHT, density: Callable[[], float] = lambda: 1.0
    ) -> None:
        """Set up lights, layers and picking; there is no mesh yet."""
        self.plotter = plotter
        self.theme = theme
        self.frame_milliseconds = 0.0
        self.camera: Camera | None = None
        self._sharp = False
        self._screen, self._density = density, 1.0
        self._picker = vtkCellPicker()
        self._picker.SetTolerance(0.0)
        self._picker.PickFromListOn()
        plotter.remove_all_lights()
        for position, color, strength in LIGHTS:
            light = pv.Light(color=color, intensity=strength, light_type="camera light")
            light.position = position
            plotter.add_light(light)
        self._above = self._add_layer()
        self.frame = upright_axes()
        self._far = 1.0
        self.cube = CubeDrawing(plotter.render_window, 2)
        self.surface = Surface(plotter, theme)
        self.plane = PicturePlane(plotter.renderer, self._above)
        self.ghosts = Ghosts(plotter.renderer, theme)
        self.overlays = Overlays(plotter.renderer, self._above, lambda: self.size)
        for renderer in (plotter.renderer, self._above, self.cube.renderer):
            # VTK's weighted blending of translucent faces ignores their order, which ghosts and
            # dots need, and a single translucent dot makes it as slow as all other drawing.
            renderer.SetUseOIT(False)
        self.set_theme(theme)

    def _add_layer(self) -> vtkRenderer:
        """Add a layer that nothing hides: for manipulator, targets, outlines."""
        layer = vtkRenderer()
        layer.SetLayer(1)
        layer.InteractiveOff()
        layer.SetActiveCamera(self.plotter.renderer.GetActiveCamera())
        window = self.plotter.render_window
        window.SetMultiSamples(0)
        window.SetNumberOfLayers(3)
        window.AddRenderer(layer)
        return layer

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the picture in pixels."""
        width, height = self.plotter.render_window.GetSize()
        return max(round(width / self.density), 1), max(round(height / self.density), 1)

    @property
    def density(self) -> float:
        """VTK's pixels along each side of one of the picture."""
        return self._screen()

    def set_theme(self, theme: Theme) -> None:
        """Change the colours."""
        self.theme = theme
        self.plotter.set_background(theme.background, top=theme.horizon)
        self.surface.set_theme(theme)
        self.ghosts.set_theme(theme)
        self.cube.set_theme(theme)
        self.overlays.set_theme(theme)

    def look(self, camera: Camera) -> None:
        """Set the camera."""
        self.camera = camera
        self.overlays.look(camera)
        lens = self.plotter.renderer.GetActiveCamera()
        # Wide enough that motion between two frames cuts no actor off.
        reach = np.sqrt(((self.surface.vertices - camera.position) ** 2).sum(axis=1))
        far = 2.0 * float(reach.max(initial=1e-3)) + camera.distance
        # VTK cuts off what is behind an eye, which an orthographic camera of ours shows.
        back = far if camera.is_orthographic else 0.0
        lens.SetPosition(*(camera.position + back * camera.axes()[2]))
        lens.SetFocalPoint(*camera.focal)
        lens.SetViewUp(*camera.up)
        lens.SetViewAngle(camera.view_angle)
        lens.SetParallelProjection(camera.is_orthographic)
        if camera.height is not None:
            lens.SetParallelScale(camera.height / 2)
        lens.SetClippingRange(1e-3 * far, far + back)
        self._above.SetActiveCamera(lens)
        self._far = far
        self.cube.look(camera.axes() @ self.frame.T)

    # What is under a pixel.

    def vertex_at(self, pixel: Pixel) -> int | None:
        """Return the corner nearest to a pixel of the face that is seen there."""
        picked = self._pick(pixel)
        if picked is None or self.camera is None:
            return None
        corners = self.surface.faces[picked[0]]
        apart = self.camera.project(self.surface.vertices[corners], self.size) - pixel
        return int(corners[(apart**2).sum(axis=1).argmin()])

    def vertex_near(self, pixel: Pixel, reach: float) -> int | None:
        """Return the vertex at a pixel of the surface, or the nearest one that is seen beside it.

        Args:
            pixel: of the picture.
            reach: distance in pixels from the surface's outline up to which a pixel counts.
        """
        vertex = self.vertex_at(pixel)
        if vertex is not None or self.camera is None or self.surface.actor is None:
            return vertex
        surface = self.surface
        at = self.camera.project(surface.vertices, self.size)
        if (pixel < at.min(axis=0) - reach).any() or (pixel > at.max(axis=0) + reach).any():
            return None
        # Nothing hides the outline's edge that is nearest to a pixel of the background.
        a, b = at[surface.edges[:, 0]], at[surface.edges[:, 1]]
        near = (np.minimum(a, b) <= np.add(pixel, reach)).all(axis=1)
        near &= (np.maximum(a, b) >= np.subtract(pixel, reach)).all(axis=1)
        near &= self._ahead(surface.vertices)[surface.edges].all(axis=1)
        if not near.any():
            return None
        a, b, edges = a[near], b[near], surface.edges[near]
        along = ((pixel - a) * (b - a)).sum(axis=1) / np.maximum(((b - a) ** 2).sum(axis=1), 1e-12)
        along = np.clip(along, 0.0, 1.0)
        apart = ((a + along[:, None] * (b - a) - pixel) ** 2).sum(axis=1)
        edge = int(apart.argmin())
        return int(edges[edge, round(float(along[edge]))]) if apart[edge] <= reach**2 else None

    def depth_at(self, pixel: Pixel) -> float:
        """Return the depth along the view of the surface at a pixel.

        Where no surface is seen, that of the vertex which is seen nearest to the pixel.
        """
        assert self.camera is not None, "there is no camera yet"
        picked = self._pick(pixel)
        if picked is not None:
            return float(self.camera.depths([picked[1]])[0])
        depths = self.camera.depths(self.surface.vertices)
        ahead = np.flatnonzero(self._ahead(self.surface.vertices))
        if not len(ahead):
            return float(self.camera.depths([self.camera.focal])[0])
        apart = self.camera.project(self.surface.vertices[ahead], self.size) - pixel
        return float(depths[ahead[(apart**2).sum(axis=1).argmin()]])

    def _ahead(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return True (n,) for points (n, 3) that the camera does not have behind it."""
        assert self.camera is not None
        return (self.camera.depths(points) > 0) | self.camera.is_orthographic

    def sees(self, point: ArrayLike) -> bool:
        """Return True if the surface does not hide a point (3,)."""
        if self.surface.actor is None or self.camera is None:
            return False
        picked = self._pick(self.camera.project(np.array([point]), self.size)[0])
        if picked is None:
            return True
        there, here = self.camera.depths(np.array([picked[1], point]))
        return bool(here < there + 8 * self.camera.pixel_size(point, self.size))

    def _pick(self, pixel: Any) -> tuple[int, NDArray[np.float64]] | None:
        """Return the visible face at a pixel, and its point (3,) there."""
        actor = self.surface.actor
        if actor is None:
            return None
        self._picker.InitializePickList()
        self._picker.AddPickList(actor)
        x, y = np.asarray(pixel) * self.density
        _, height = self.plotter.render_window.GetSize()
        self._picker.Pick(x, height - y, 0.0, self.plotter.renderer)
        face = self._picker.GetCellId()
        return None if face < 0 else (face, np.array(self._picker.GetPickPosition()))

    # Drawing.

    def render(self) -> None:
        """Draw a frame."""
        begun = time.perf_counter()
        if self._density != self.density:
            self._density = self.density
            self._magnify()
        size = self.size
        self.cube.place(size)
        self.surface.bar.place(self.plotter.render_window.GetSize(), self._density)
        if self.camera is not None:
            self.plane.place(self.camera, _BACK * self._far, size)
        self.plotter.render()
        self.frame_milliseconds = 1000.0 * (time.perf_counter() - begun)

    def sharpen(self, sharp: bool) -> bool:
        """Switch anti-aliasing, which costs more than all else; return False if it was so."""
        if sharp == self._sharp:
            return False
        self._sharp = sharp
        if sharp:
            self.plotter.enable_anti_aliasing("ssaa")
        else:
            self.plotter.disable_anti_aliasing()
        self._magnify()
        self._above.SetUseFXAA(sharp)
        self.cube.renderer.SetUseFXAA(sharp)
        return True

    def _magnify(self) -> None:
        scene = self._density * (_SUPERSAMPLING if self._sharp else 1.0)
        self.overlays.magnify(scene, self._density)

    @property
    def is_sharp(self) -> bool:
        """True while anti-aliasing is on."""
        return self._sharp

    def grab(self) -> Picture:
        """Return the frame that was drawn last, (height, width, 3)."""
        return grabbed(self.plotter.render_window)

    def picture(self) -> Picture:
        """Draw a sharp frame and return it, (height, width, 3), without the orientation cube."""
        self.sharpen(True)
        with self.cube.left_out():
            self.render()
            return self.grab()


def grabbed(window: Any, opacity: bool = False) -> Picture:
    """Return the frame that a render window has drawn last.

    Args:
        window: VTK's.
        opacity: true for (height, width, 4) with the opacity last; else (height, width, 3).
    """
    reader = vtkWindowToImageFilter()
    reader.SetInput(window)
    if opacity:
        reader.SetInputBufferTypeToRGBA()
    else:
        reader.SetInputBufferTypeToRGB()
    reader.ReadFrontBufferOff()
    reader.ShouldRerenderOff()
    reader.Update()
    image = reader.GetOutput()
    width, height, _ = image.GetDimensions()
    pixels = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, -1)
    return np.ascontiguousarray(pixels[::-1])
