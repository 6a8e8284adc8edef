"""Animations of what the window shows: drags as they happen, and turntables."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PIL import Image

from deformer import InputError, io
from deformer_app.rendering.offscreen import Picture, save_gif
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


def turntable(editor: Editor, path: Path) -> Iterator[None]:
    """Write a full turn about the model's up axis; a picture a step.

    Raises:
        InputError: the file's ending is neither .gif nor .mp4.
    """
    _check(path)
    first, pictures = editor.camera, []
    try:
        for n in range(_TURN):
            editor.camera = first.orbited(360.0 * n / _TURN, 0.0, editor.sky)
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
    yield from beside(lambda: save_animation(path, pictures))
    editor.note(f"Wrote {path}")


def save_animation(path: Path, pictures: Sequence[Picture]) -> None:
    """Write pictures as .gif or .mp4.

    Raises:
        InputError: another ending, no pictures, or MP4 without imageio-ffmpeg.
    """
    _check(path)
    if not pictures:
        raise InputError(f"{path}: nothing was drawn, so there is nothing to write")
    height, width = (2 * (n // 2) for n in pictures[0].shape[:2])  # H.264 wants even sizes
    with io.atomic_path(path) as temporary:
        if path.suffix.lower() == ".gif":
            save_gif(temporary, pictures, FPS)
            return
        try:
            import imageio_ffmpeg
        except ImportError as error:
            raise InputError(
                f"{path}: MP4 needs imageio-ffmpeg; pip install imageio-ffmpeg, or write a .gif"
            ) from error
        writer = imageio_ffmpeg.write_frames(
            str(temporary), (width, height), fps=FPS, quality=7, macro_block_size=2
        )
        writer.send(None)
        for picture in pictures:
            writer.send(np.ascontiguousarray(picture[:height, :width]))
        writer.close()


def _check(path: Path) -> None:
    if path.suffix.lower() not in (".gif", ".mp4"):
        raise InputError(f"{path}: got ending {path.suffix!r}, expected .gif or .mp4")
