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
from deformer_app.viewer.worker import beside

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor

FPS = 25
_TURN = 72  # pictures of a turntable
_LONGEST = 1500  # frames of a recording: a minute


class Recorder:
    """Keeps the frames that an editor draws, with their times.

    Args:
        editor: whose picture it is.
    """

    def __init__(self, editor: Editor) -> None:
        """Begin with the next frame."""
        self._editor = editor
        # Compressed: a minute of pictures would fill gigabytes.
        self._frames: list[bytes] = []
        self._times: list[float] = []
        editor.on_frame = self._take

    def _take(self) -> None:
        now = time.perf_counter()
        soon = bool(self._times) and now - self._times[-1] < 1.0 / FPS
        if not soon and len(self._frames) < _LONGEST:
            self._keep(now)

    def _keep(self, now: float) -> None:
        packed = BytesIO()
        Image.fromarray(self._editor.view.grab()).save(packed, "JPEG", quality=95)
        self._frames.append(packed.getvalue())
        self._times.append(now)

    def stop(self) -> Sequence[Picture]:
        """The frames at a steady rate; a pause lasts at most half a second."""
        self._editor.on_frame = None
        if not self._frames:
            return []
        # What came too soon to be kept may have been the last.
        self._keep(time.perf_counter())
        gaps = np.minimum(np.diff(self._times), 0.5)
        at = np.concatenate([[0.0], np.cumsum(gaps)])
        steady = np.arange(0.0, at[-1] + 1.0 / FPS, 1.0 / FPS)
        shown = np.searchsorted(at, steady, side="right") - 1
        return _Film(self._frames, shown.tolist())


class _Film(Sequence[Picture]):
    """Compressed pictures, by the number of each to show; all as large as the last one."""

    def __init__(self, frames: Sequence[bytes], shown: Sequence[int]) -> None:
        self._frames, self._shown = frames, shown

    def __len__(self) -> int:
        return len(self._shown)

    def __getitem__(self, place: Any) -> Any:
        if isinstance(place, slice):
            return _Film(self._frames, self._shown[place])
        picture = Image.open(BytesIO(self._frames[self._shown[place]]))
        size = Image.open(BytesIO(self._frames[-1])).size  # the window may have been resized
        return np.asarray(picture if picture.size == size else picture.resize(size))


def save_turntable(editor: Editor, path: Path) -> Iterator[None]:
    """Write a full turn about the model's up axis; a picture a step.

    Raises:
        InputError: the file's ending is neither .gif nor .mp4.
    """
    check_animation_path(path)
    first, pictures = editor.camera, []
    try:
        for camera in turntable(first, _TURN, editor.sky):
            editor.camera = camera
            editor.view.look(editor.camera)
            editor.view.sharpen(True)
            editor.view.show_gizmo(None, None)
            editor.view.render()
            pictures.append(editor.view.grab())
            yield
    finally:
        editor.camera = first
        editor.camera_moved()
    yield from saving(editor, path, pictures)


def saving(editor: Editor, path: Path, pictures: Sequence[Picture]) -> Iterator[None]:
    """Write pictures beside the window.

    Raises:
        InputError: see `save_animation`.
    """
    editor.note(f"Writing {path} …")
    yield from beside(lambda: save_animation(path, pictures, FPS))
    editor.note(f"Wrote {path}")
