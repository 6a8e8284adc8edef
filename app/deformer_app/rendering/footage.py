"""Pictures over time: one picture, a folder of pictures, or a video, frame by frame."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from deformer import InputError, io

PICTURES = (".png", ".jpg", ".jpeg")
VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".gif")
FOLDER_FPS = 25.0  # frames a second of a folder of pictures


@dataclass(frozen=True, eq=False)
class Footage:
    """Frames of one size in time.

    Args:
        path: absolute path of the file or folder.
        sha256: checksum in hexadecimal digits: of the file, or of the names and sizes of a
            folder's pictures.
        count: number of frames.
        fps: frames a second; of a single picture it has no meaning.
        size: width and height of a frame in pixels.
        frame: returns the n-th frame, (height, width, 4) uint8, red, green, blue and opacity; it
            may take a second of a long video, and must not be called by two threads at once.
    """

    path: str
    sha256: str
    count: int
    fps: float
    size: tuple[int, int]
    frame: Callable[[int], NDArray[np.uint8]]

    def index_at(self, seconds: float) -> int:
        """Return the frame that is shown at a time, the first or last one outside of the footage.

        Args:
            seconds: from the beginning.
        """
        # A time that is a multiple of the frame's duration belongs to the frame that begins there.
        return int(np.clip(np.floor(seconds * self.fps + 1e-6), 0, self.count - 1))


def open_footage(path: str | Path) -> Footage:
    """Open a picture, a folder of pictures (in natural order of their names), or a video.

    Raises:
        InputError: no such file, a damaged one, a folder without pictures, or a format that is
            not read.
    """
    file = Path(path).resolve()
    if file.is_dir():
        return _folder(file)
    suffix = file.suffix.lower()
    if suffix not in PICTURES + VIDEOS:
        raise io.wrong_kind(path, "picture") or InputError(
            f"{path}: got ending {file.suffix!r}, expected a picture ({', '.join(PICTURES)}), a "
            f"video ({', '.join(VIDEOS)}) or a folder of pictures"
        )
    if not file.is_file():
        raise InputError(f"{path}: there is no such file; choose another one")
    with file.open("rb") as opened:
        digest = hashlib.file_digest(opened, "sha256").hexdigest()
    if suffix == ".gif":
        return _gif(file, digest)
    if suffix in VIDEOS:
        return _video(file, digest)
    picture = _read(file)
    return Footage(str(file), digest, 1, FOLDER_FPS, _size(picture), lambda n: picture)


def _folder(folder: Path) -> Footage:
    found = (file for file in folder.iterdir() if file.suffix.lower() in PICTURES)
    files = sorted(found, key=lambda file: _natural(file.name))
    if not files:
        raise InputError(f"{folder}: no picture in it; expected {', '.join(PICTURES)} files")
    listing = "\n".join(f"{f.name} {f.stat().st_size}" for f in files)
    digest = hashlib.sha256(listing.encode()).hexdigest()
    size = _size(_read(files[0]))

    def frame(n: int) -> NDArray[np.uint8]:
        picture = _read(files[n])
        if _size(picture) != size:
            raise InputError(
                f"{files[n]}: {_size(picture)[0]} × {_size(picture)[1]} pixels, expected "
                f"{size[0]} × {size[1]} as {files[0].name} has"
            )
        return picture

    return Footage(str(folder), digest, len(files), FOLDER_FPS, size, frame)


def _natural(name: str) -> list[tuple[int, str]]:
    """Return a key by which frame2 comes before frame10."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def _gif(file: Path, digest: str) -> Footage:
    try:
        picture = Image.open(file)
        count = int(getattr(picture, "n_frames", 1))
    except (OSError, UnidentifiedImageError, SyntaxError) as error:
        raise InputError(f"{file}: cannot be read as a picture: {error}") from error

    def frame(n: int) -> NDArray[np.uint8]:
        try:
            picture.seek(n)
            return np.asarray(picture.convert("RGBA"))
        except (OSError, EOFError, SyntaxError) as error:
            raise InputError(f"{file}: frame {n} cannot be read: {error}") from error

    fps = 1000.0 / (picture.info.get("duration") or 1000.0 / FOLDER_FPS)
    return Footage(str(file), digest, count, fps, picture.size, frame)


def _video(file: Path, digest: str) -> Footage:
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise InputError(
            f"{file}: videos need imageio-ffmpeg; pip install imageio-ffmpeg, or choose a folder "
            "of pictures"
        ) from error
    try:
        count, _ = imageio_ffmpeg.count_frames_and_secs(str(file))
        decoder = imageio_ffmpeg.read_frames(str(file))
        facts: Any = next(decoder)
        decoder.close()
    except (OSError, ValueError, RuntimeError, KeyError, StopIteration) as error:
        reason = " ".join(str(error).split())[:200] or "it has no frame"
        raise InputError(f"{file}: cannot be read as a video: {reason}") from error
    size, fps = tuple(facts["size"]), float(facts["fps"])
    return Footage(
        str(file), digest, max(count or 1, 1), fps, size, _Decoder(file, size, fps).frame
    )


class _Decoder:
    """Frames of a video: the next one at once, another one by a search from its beginning."""

    def __init__(self, file: Path, size: tuple[int, int], fps: float) -> None:
        self._file, self._size, self._fps = file, size, fps
        self._frames: Any = None
        self._next = -1

    def frame(self, n: int) -> NDArray[np.uint8]:
        import imageio_ffmpeg

        try:
            if n != self._next:
                if self._frames is not None:
                    self._frames.close()
                # A little before the frame, so that rounding does not skip it.
                start = max(n - 0.25, 0.0) / self._fps
                self._frames = imageio_ffmpeg.read_frames(
                    str(self._file), input_params=["-ss", f"{start:.6f}"]
                )
                next(self._frames)  # the facts
            pixels, self._next = next(self._frames), n + 1
        except (OSError, RuntimeError, StopIteration) as error:
            self._next = -1
            raise InputError(f"{self._file}: frame {n} cannot be read") from error
        width, height = self._size
        picture = np.frombuffer(pixels, dtype=np.uint8).reshape(height, width, 3)
        return np.dstack([picture, np.full((height, width), 255, dtype=np.uint8)])


def _read(file: Path) -> NDArray[np.uint8]:
    try:
        with Image.open(file) as picture:
            return np.asarray(picture.convert("RGBA"))
    except (OSError, UnidentifiedImageError, SyntaxError) as error:
        raise InputError(f"{file}: cannot be read as a picture: {error}") from error


def _size(picture: NDArray) -> tuple[int, int]:
    return picture.shape[1], picture.shape[0]
