"""Small pictures of a model's shapes, drawn in the background: one at a time, between two ticks.

Shapes are decoded on a thread. VTK draws on the window's thread, into a picture of its own off the
screen; it waits while the user drags or a pose is being solved.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyvista as pv
from numpy.typing import NDArray
from PIL import Image

import deformer
from deformer import DeformationModel
from deformer_app.rendering.camera import Camera, aim
from deformer_app.rendering.offscreen import LIGHTS, Picture
from deformer_app.rendering.palette import Theme
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.scene import grabbed
from deformer_app.viewer.worker import in_background

SIDE = 96  # pixels of a picture along each side
_SUPERSAMPLING = 2
_KEPT = 1000  # pictures in the cache, about 40 kB each
_WAITING = 64  # requests; older ones have most likely been scrolled out of sight
_ACTS = 0.1  # a component acts on vertices with at least this share of its largest weight

Code = tuple[float, ...]


@dataclass(frozen=True)
class Subject:
    """What one or several pictures show, all seen by one camera.

    Args:
        codes: latent codes (K,), one for each picture.
        component: the pictures show the part of the surface that it acts on; None shows all.
    """

    codes: tuple[Code, ...]
    component: int | None = None


@dataclass(frozen=True)
class _Request:
    """A subject of a model in a theme."""

    fingerprint: str
    subject: Subject
    theme: Theme


def hidden_plotter(size: tuple[int, int]) -> pv.Plotter:
    """Make a plotter that draws off the screen, beside windows on the same display.

    Args:
        size: width and height in pixels.
    """
    # Like the windows it uses the display: a context of EGL and one of GLX, in turn on one
    # thread, leave VTK 9.7.2 with empty pictures.
    return pv.Plotter(off_screen=True, window_size=list(size), lighting="none")


class Thumbnails:
    """Pictures of shapes, drawn when they are first asked for, and cached by what they show.

    Args:
        editor: the model, and the ticks in which pictures are drawn.
        make_plotter: makes a plotter off the screen, of a size in pixels, without lights.
        density: pixels of a picture along each side of one that a person sees.

    Attributes:
        on_drawn: called with every subject whose pictures are ready.
    """

    def __init__(
        self,
        editor: Editor,
        make_plotter: Callable[[tuple[int, int]], Any] = hidden_plotter,
        density: float = 1.0,
    ) -> None:
        """Begin without pictures; the plotter is made for the first one."""
        self.on_drawn: list[Callable[[Subject], Any]] = []
        self._editor = editor
        self._make_plotter = make_plotter
        self._pixels = round(SIDE * density)
        self._drawing: _Drawing | None = None
        self._cache: OrderedDict[_Request, tuple[Picture, ...]] = OrderedDict()
        self._waiting: OrderedDict[_Request, None] = OrderedDict()
        self._running = self._failed = self._closed = False

    def pictures(self, subject: Subject) -> tuple[Picture, ...] | None:
        """Return the pictures (n, n, 4) of a subject, one a code, with a transparent background.

        Returns:
            None until they are drawn, and without a model; `on_drawn` tells when. Asking again
            keeps a request among those that are drawn: of many, the oldest are dropped.
        """
        editor = self._editor
        if not editor.is_open:
            return None
        request = _Request(editor.model.fingerprint, subject, editor.state.view.theme)
        found = self._cache.get(request)
        if found is not None:
            self._cache.move_to_end(request)
            return found
        if self._failed or self._closed:
            return None
        self._waiting.setdefault(request)
        while len(self._waiting) > _WAITING:
            self._waiting.popitem(last=False)
        if not self._running:
            self._running = True
            editor.run(self._work())
        return None

    @property
    def waiting(self) -> int:
        """Number of subjects that are still to be drawn."""
        return len(self._waiting)

    def close(self) -> None:
        """Drop what waits, and free the plotter."""
        self._closed = True
        self._waiting.clear()
        if self._drawing is not None:
            self._drawing.close()
            self._drawing = None

    def _work(self) -> Iterator[None]:
        """Draw what waits: in one step at most one picture."""
        try:
            while self._waiting:
                if not self._editor.at_rest:
                    yield
                    continue
                request = next(iter(self._waiting))
                if request.fingerprint == self._editor.model.fingerprint:
                    yield from self._draw(request)
                self._waiting.pop(request, None)
        finally:
            # What is left could not be drawn; the end of this job tells the user why, once.
            self._failed = bool(self._waiting)
            self._waiting.clear()
            self._running = False

    def _draw(self, request: _Request) -> Iterator[None]:
        editor, subject = self._editor, request.subject
        model, activations = editor.model, editor.activations
        if subject.component is not None and activations is None:
            return  # asked for again once the components are measured
        shapes = yield from in_background(lambda: model.decode(np.array(subject.codes)))
        seen = shapes
        if subject.component is not None and activations is not None:
            seen = shapes[:, activations.support(subject.component) >= _ACTS]
        camera = aim(seen, up=editor.state.viewpoint.up, azimuth=25, elevation=8, margin=0.06)
        pictures = []
        for vertices in shapes:
            while not editor.at_rest:
                yield
            if self._closed:
                return
            if self._drawing is None:
                side = _SUPERSAMPLING * self._pixels
                plotter = self._make_plotter((side, side))
                self._drawing = _Drawing(plotter)
            pictures.append(self._drawing.picture(model, vertices, camera, request.theme))
            yield
        self._cache[request] = tuple(pictures)
        while len(self._cache) > _KEPT:
            self._cache.popitem(last=False)
        for listener in tuple(self.on_drawn):
            listener(subject)


class _Drawing:
    """One surface on a plotter off the screen.

    Args:
        plotter: without lights; its side is `_SUPERSAMPLING` times that of the pictures.
    """

    def __init__(self, plotter: Any) -> None:
        """Set up the lights."""
        self._plotter = plotter
        self._data: pv.PolyData | None = None
        self._actor: Any = None
        self._fingerprint = ""
        for position, color, strength in LIGHTS:
            light = pv.Light(color=color, intensity=strength, light_type="camera light")
            light.position = position
            plotter.add_light(light)
        plotter.render_window.AlphaBitPlanesOn()

    def picture(
        self,
        model: DeformationModel,
        vertices: NDArray[np.float64],
        camera: Camera,
        theme: Theme,
    ) -> Picture:
        """Return a picture (n, n, 4) of a shape (V, 3) of a model."""
        plotter = self._plotter
        data = self._mesh(model, theme)
        np.asarray(data.points)[:] = vertices
        data.GetPoints().GetData().Modified()
        normals = deformer.vertex_normals(vertices, model.reference.faces)
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
        small = image.convert("RGBa").reduce(_SUPERSAMPLING).convert("RGBA")
        return np.asarray(small)

    def _mesh(self, model: DeformationModel, theme: Theme) -> pv.PolyData:
        if self._data is None or self._fingerprint != model.fingerprint:
            if self._actor is not None:
                self._plotter.remove_actor(self._actor, reset_camera=False, render=False)
            mesh = model.reference
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
            self._fingerprint = model.fingerprint
        return self._data

    def close(self) -> None:
        """Free the plotter."""
        self._plotter.close()
