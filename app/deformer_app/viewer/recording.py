"""Animations of what the window shows: drags as they happen, and turntables."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from deformer import SEQUENCE_SUFFIXES, InputError, MeshSequence, save_shapes
from deformer_app.rendering.animation import save_animation
from deformer_app.rendering.camera import turntable
from deformer_app.rendering.offscreen import Picture
from deformer_app.viewer.changes import Change, FrameDrawn
from deformer_app.viewer.worker import in_background

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor

FPS = 25
_TURN = 72  # pictures of a turntable
_LONGEST = 1500  # frames of a recording: a minute
_MOST_BYTES = 1_000_000_000  # of the shapes of a recording


class Recorder:
    """Collects the frames that an editor draws, with their times, without the orientation cube.

    Args:
        editor: whose picture it is.
    """

    def __init__(self, editor: Editor) -> None:
        """Begin with what the picture shows now."""
        self._editor = editor
        # Compressed, because a minute of pictures would need gigabytes.
        self._frames: list[bytes] = []
        self._times: list[float] = []
        self._model = editor.model
        # Vertices (V, 3) in single precision; None once they cannot be kept any more.
        self._shapes: list[NDArray] | None = []
        # The frames are those of the window, which has no cube meanwhile.
        editor.state.view.cube.show(False)
        editor.state.view.render()
        self._add(time.perf_counter())
        editor.on_change.append(self._hear)

    def _hear(self, change: Change) -> None:
        if not isinstance(change, FrameDrawn):
            return
        now = time.perf_counter()
        soon = now - self._times[-1] < 1.0 / FPS
        if not soon and len(self._frames) < _LONGEST:
            self._add(now)

    def _add(self, now: float) -> None:
        packed = BytesIO()
        Image.fromarray(self._editor.state.view.grab()).save(packed, "JPEG", quality=95)
        self._frames.append(packed.getvalue())
        self._times.append(now)
        shape = self._editor.vertices.astype(np.float32)
        full = (len(self._frames) * shape.nbytes) > _MOST_BYTES
        if full or self._editor.model is not self._model:
            self._shapes = None
        if self._shapes is not None:
            self._shapes.append(shape)

    def stop(self) -> Film:
        """End; return the frames at a steady rate, with pauses of at most half a second.

        Empty if nothing was drawn after the beginning.
        """
        self._editor.on_change.remove(self._hear)
        film = self._film()
        state = self._editor.state
        state.view.cube.show(state.look.cube)
        state.invalidate()
        return film

    def _film(self) -> Film:
        if len(self._frames) < 2:
            return Film([], [], None)
        # The last frame may have come too soon after the one before it.
        self._add(time.perf_counter())
        gaps = np.minimum(np.diff(self._times), 0.5)
        at = np.concatenate([[0.0], np.cumsum(gaps)])
        steady = np.arange(0.0, at[-1] + 1.0 / FPS, 1.0 / FPS)
        shown = np.searchsorted(at, steady, side="right") - 1
        return Film(self._frames, shown.tolist(), self._shapes)


class Film(Sequence[Picture]):
    """Compressed frames, unpacked one at a time; all of them as large as the last one.

    Args:
        frames: JPEG files.
        shown: index into `frames` of each picture of the film.
        shapes: vertices (V, 3) of each frame; None if the model changed, or they are too many.
    """

    def __init__(
        self, frames: Sequence[bytes], shown: Sequence[int], shapes: Sequence[NDArray] | None
    ) -> None:
        """Keep the frames."""
        self._frames, self._shown, self._shapes = frames, shown, shapes

    @property
    def shapes(self) -> NDArray | None:
        """Vertices (F, V, 3) of the pictures."""
        if self._shapes is None or not self._shown:
            return None
        return np.stack([self._shapes[n] for n in self._shown])

    def __len__(self) -> int:
        """Count the pictures."""
        return len(self._shown)

    def __getitem__(self, index: Any) -> Any:
        """One picture (height, width, 3), or a film of some of them."""
        if isinstance(index, slice):
            return Film(self._frames, self._shown[index], self._shapes)
        picture = Image.open(BytesIO(self._frames[self._shown[index]]))
        size = Image.open(BytesIO(self._frames[-1])).size  # the window may have been resized
        return np.asarray(picture if picture.size == size else picture.resize(size))


def save_turntable(editor: Editor, path: Path) -> Iterator[None]:
    """Write a full turn about the model's up axis; a picture a step.

    Raises:
        InputError: the file's ending is neither .gif nor .mp4.
    """
    yield from editor.filming.write(path, _turn(editor), _TURN, FPS)


def _turn(editor: Editor) -> Generator[Picture, None, None]:
    """Draw a full turn; the camera is where it was in the end."""
    state, model = editor.state, editor.model
    first, view = state.camera, state.view
    try:
        for camera in turntable(first, _TURN, state.viewpoint.sky):
            view.look(camera)
            view.overlays.show_gizmo(None, None)
            yield view.picture()
    finally:
        if editor.is_open and editor.model is model:
            state.viewpoint.set_camera(first)


def save_recording(editor: Editor, path: Path, pictures: Sequence[Picture]) -> Iterator[None]:
    """Write pictures in the background, or the shapes that they show where `path` is for shapes.

    Raises:
        InputError: see `save_animation` and `deformer.save_shapes`, or the shapes were not kept.
    """
    editor.note(f"Writing {path} …")
    if path.suffix.lower() not in SEQUENCE_SUFFIXES:
        yield from in_background(lambda: save_animation(path, pictures, FPS))
        editor.note(f"Wrote {path}")
        return
    shapes = pictures.shapes if isinstance(pictures, Film) else None
    if shapes is None:
        raise InputError(
            f"{path}: the recording has no shapes, for nothing was drawn, another model was opened "
            "or it is too long; record a shorter drag, or write .gif or .mp4"
        )
    model = editor.model
    sequence = MeshSequence(shapes, model.reference.faces)
    up = model.up
    yield from in_background(lambda: save_shapes(path, sequence, like=model, fps=FPS, up=up))
    editor.note(f"Wrote {path}")
