"""Small pictures of a model's shapes, drawn in the background: one at a time, between two ticks.

Shapes are decoded on a thread. VTK draws on the window's thread, into a picture of its own off the
screen; it waits while the user drags or a pose is being solved.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformer_app.rendering.camera import Camera, aim
from deformer_app.rendering.offscreen import Picture
from deformer_app.rendering.palette import DARK, LIGHT, Theme
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.shape_drawing import SUPERSAMPLING, ShapeDrawing, hidden_plotter
from deformer_app.viewer.worker import in_background

SIDE = 96  # pixels of a picture along each side
_MARGIN = 0.02  # of a picture, left empty on each side of the largest shape
_KEPT = 1000  # pictures in the cache, about 40 kB each
_WAITING = 64  # requests; older ones have most likely been scrolled out of sight
_ACTS = 0.1  # a component acts on vertices with at least this share of its largest weight

Code = tuple[float, ...]


@dataclass(frozen=True)
class Subject:
    """What one or several pictures show, all from one side and at one scale.

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
        self._drawing: ShapeDrawing | None = None
        self._cache: OrderedDict[_Request, tuple[Picture, ...]] = OrderedDict()
        self._waiting: OrderedDict[_Request, None] = OrderedDict()
        self._running = self._failed = self._closed = False

    def pictures(self, subject: Subject) -> tuple[Picture, ...] | None:
        """Return the pictures (n, n, 4) of a subject, one a code, with a transparent background.

        Returns:
            Those of another theme, if there are any, or else None, until they are drawn; None
            without a model. `on_drawn` tells when. Asking again keeps a request among those that
            are drawn: of many, the oldest are dropped.
        """
        editor = self._editor
        if not editor.is_open:
            return None
        request = _Request(editor.model.fingerprint, subject, editor.state.view.theme)
        found = self._cache.get(request)
        if found is not None:
            self._cache.move_to_end(request)
            return found
        others = (replace(request, theme=theme) for theme in (LIGHT, DARK))
        before = next((self._cache[other] for other in others if other in self._cache), None)
        if self._failed or self._closed:
            return before
        self._waiting.setdefault(request)
        while len(self._waiting) > _WAITING:
            self._waiting.popitem(last=False)
        if not self._running:
            self._running = True
            editor.run(self._work())
        return before

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
        cameras = _alike(seen, editor.state.viewpoint.up)
        pictures = []
        for vertices, camera in zip(shapes, cameras, strict=True):
            while not editor.at_rest:
                yield
            if self._closed:
                return
            if self._drawing is None:
                side = SUPERSAMPLING * self._pixels
                plotter = self._make_plotter((side, side))
                self._drawing = ShapeDrawing(plotter)
            pictures.append(self._drawing.picture(model.reference, vertices, camera, request.theme))
            yield
        self._cache[request] = tuple(pictures)
        while len(self._cache) > _KEPT:
            self._cache.popitem(last=False)
        for listener in tuple(self.on_drawn):
            listener(subject)


def _alike(shapes: NDArray[np.float64], up: str) -> list[Camera]:
    """Cameras that show each of several shapes (n, V, 3) in the middle, all at one scale.

    Where the shapes are beside each other, one camera for all would show them small.
    """
    cameras = [aim(p, up=up, azimuth=25, elevation=8, margin=_MARGIN) for p in shapes]
    farthest = max(camera.distance for camera in cameras)
    return [camera.from_distance(farthest) for camera in cameras]
