"""Animations of what the window shows: drags as they happen, and turntables."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from deformer_app.rendering.animation import check_animation_path, save_animation
from deformer_app.rendering.camera import turntable
from deformer_app.rendering.offscreen import Picture
from deformer_app.viewer.changes import Change, FrameDrawn
from deformer_app.viewer.worker import in_background

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor

FPS = 25
_TURN = 72  # pictures of a turntable
_LONGEST = 1500  # frames of a recording: a minute


class Recorder:
    """Collects the frames that an editor draws, with their times.

    Args:
        editor: whose picture it is.
    """

    def __init__(self, editor: Editor) -> None:
        """Begin with what the picture shows now."""
        self._editor = editor
        # Compressed, because a minute of pictures would need gigabytes.
        self._frames: list[bytes] = []
        self._times: list[float] = []
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

    def stop(self) -> Sequence[Picture]:
        """End; return the frames at a steady rate, with pauses of at most half a second.

        Empty if nothing was drawn after the beginning.
        """
        self._editor.on_change.remove(self._hear)
        if len(self._frames) < 2:
            return []
        # The last frame may have come too soon after the one before it.
        self._add(time.perf_counter())
        gaps = np.minimum(np.diff(self._times), 0.5)
        at = np.concatenate([[0.0], np.cumsum(gaps)])
        steady = np.arange(0.0, at[-1] + 1.0 / FPS, 1.0 / FPS)
        shown = np.searchsorted(at, steady, side="right") - 1
        return _Film(self._frames, shown.tolist())


class _Film(Sequence[Picture]):
    """Compressed frames, unpacked one at a time; all of them as large as the last one.

    Args:
        frames: JPEG files.
        shown: index into `frames` of each picture of the film.
    """

    def __init__(self, frames: Sequence[bytes], shown: Sequence[int]) -> None:
        self._frames, self._shown = frames, shown

    def __len__(self) -> int:
        return len(self._shown)

    def __getitem__(self, index: Any) -> Any:
        if isinstance(index, slice):
            return _Film(self._frames, self._shown[index])
        picture = Image.open(BytesIO(self._frames[self._shown[index]]))
        size = Image.open(BytesIO(self._frames[-1])).size  # the window may have been resized
        return np.asarray(picture if picture.size == size else picture.resize(size))


def save_turntable(editor: Editor, path: Path) -> Iterator[None]:
    """Write a full turn about the model's up axis; a picture a step.

    Raises:
        InputError: the file's ending is neither .gif nor .mp4.
    """
    check_animation_path(path)
    state, pictures = editor.state, []
    first, view = state.camera, state.view
    try:
        for camera in turntable(first, _TURN, state.sky):
            view.look(camera)
            view.sharpen(True)
            view.overlays.show_gizmo(None, None)
            view.render()
            pictures.append(view.grab())
            yield
    finally:
        state.set_camera(first)
    yield from save_recording(editor, path, pictures)


def save_recording(editor: Editor, path: Path, pictures: Sequence[Picture]) -> Iterator[None]:
    """Write pictures in the background.

    Raises:
        InputError: see `save_animation`.
    """
    editor.note(f"Writing {path} …")
    yield from in_background(lambda: save_animation(path, pictures, FPS))
    editor.note(f"Wrote {path}")
