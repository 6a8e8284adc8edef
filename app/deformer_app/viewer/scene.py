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

from deformer_app.rendering.camera import Camera
from deformer_app.rendering.offscreen import LIGHTS, Picture
from deformer_app.rendering.palette import LIGHT, Theme
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.overlays import Overlays
from deformer_app.viewer.surface import Surface

_SUPERSAMPLING = 2.0  # pixels of VTK's pass along each side of one of the picture


class MeshView:
    """One surface, the drawings over it, and the camera.

    Args:
        plotter: of any kind; its lights and its interactor's style are replaced.
        theme: colours.
        density: gives the number of VTK's pixels along each side of one that a person aims at;
            asked again with every use, as a window may be moved to another screen.
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
        self.surface = Surface(plotter, theme)
        self.overlays = Overlays(plotter.renderer, self._above, lambda: self.size)
        self.set_theme(theme)

    def _add_layer(self) -> vtkRenderer:
        """Add a layer that nothing hides: for manipulator, targets, outlines."""
        layer = vtkRenderer()
        layer.SetLayer(1)
        layer.InteractiveOff()
        layer.SetActiveCamera(self.plotter.renderer.GetActiveCamera())
        window = self.plotter.render_window
        window.SetMultiSamples(0)
        window.SetNumberOfLayers(2)
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
        self.overlays.set_theme(theme)

    def look(self, camera: Camera) -> None:
        """Set the camera."""
        self.camera = camera
        self.overlays.look(camera)
        lens = self.plotter.renderer.GetActiveCamera()
        lens.SetPosition(*camera.position)
        lens.SetFocalPoint(*camera.focal)
        lens.SetViewUp(*camera.up)
        lens.SetViewAngle(camera.view_angle)
        # Wide enough that motion between two frames cuts no actor off.
        reach = np.sqrt(((self.surface.vertices - camera.position) ** 2).sum(axis=1))
        far = 2.0 * float(reach.max(initial=1e-3)) + float(camera.depths([camera.focal])[0])
        lens.SetClippingRange(1e-3 * far, far)
        self._above.SetActiveCamera(lens)

    # What is under a pixel.

    def vertex_at(self, pixel: Pixel) -> int | None:
        """Return the corner nearest to a pixel of the face that is seen there."""
        picked = self._pick(pixel)
        if picked is None or self.camera is None:
            return None
        corners = self.surface.faces[picked[0]]
        apart = self.camera.project(self.surface.vertices[corners], self.size) - pixel
        return int(corners[(apart**2).sum(axis=1).argmin()])

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
        reader = vtkWindowToImageFilter()
        reader.SetInput(self.plotter.render_window)
        reader.SetInputBufferTypeToRGB()
        reader.ReadFrontBufferOff()
        reader.ShouldRerenderOff()
        reader.Update()
        image = reader.GetOutput()
        width, height, _ = image.GetDimensions()
        pixels = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, 3)
        return np.ascontiguousarray(pixels[::-1])

    def picture(self) -> Picture:
        """Draw a sharp frame and return it, (height, width, 3)."""
        self.sharpen(True)
        self.render()
        return self.grab()
