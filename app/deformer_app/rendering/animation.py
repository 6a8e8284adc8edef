"""Animations as files: GIF, and MP4 where imageio-ffmpeg is installed."""

from __future__ import annotations

import errno
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from PIL import Image

from deformer import InputError, io
from deformer_app.rendering.offscreen import Picture, contact_sheet


def check_animation_path(path: Path) -> None:
    """Raise InputError, before any work, unless `path` ends in .gif, or .mp4 with ffmpeg."""
    if path.suffix.lower() not in (".gif", ".mp4"):
        raise InputError(f"{path}: got ending {path.suffix!r}, expected .gif or .mp4")
    if path.suffix.lower() == ".mp4" and find_spec("imageio_ffmpeg") is None:
        raise InputError(
            f"{path}: MP4 needs imageio-ffmpeg; pip install imageio-ffmpeg, or write a .gif"
        )


def save_animation(path: Path, frames: Sequence[Picture], fps: int) -> None:
    """Write pictures as an animation; the file is complete or absent.

    Args:
        path: file that ends in .gif, which loops for ever, or .mp4.
        frames: pictures (height, width, 3) uint8 of one size; may be a lazy sequence.
        fps: frames a second.

    Raises:
        InputError: another ending, no frames, or MP4 without imageio-ffmpeg.
        OSError: writing failed; it names `path`.
    """
    check_animation_path(path)
    if not len(frames):
        raise InputError(f"{path}: nothing was drawn, so there is nothing to write")
    write = _write_gif if path.suffix.lower() == ".gif" else _write_mp4
    with io.atomic_path(path) as temporary:
        try:
            write(temporary, frames, fps)
        except _Incomplete:
            raise OSError(errno.EIO, "ffmpeg could not write all of it", str(path)) from None


def side_by_side(rows: Mapping[str, Sequence[Picture]]) -> list[Picture]:
    """Frames that show those of several rows beside each other, each above its label.

    Args:
        rows: label → frames, equally many in every row.

    Raises:
        ValueError: rows of different lengths.
    """
    labels = list(rows)
    return [
        contact_sheet(list(moment), len(labels), labels)
        for moment in zip(*rows.values(), strict=True)
    ]


def there_and_back(frames: Sequence[Picture]) -> list[Picture]:
    """Frames from the first to the last and back, each end once."""
    return [*frames, *frames[-2:0:-1]]


def _write_gif(path: Path, frames: Sequence[Picture], fps: int) -> None:
    """Write an endless GIF with one palette, so that still parts do not flicker."""
    # The palette comes from a few frames spread over the animation, set side by side.
    samples = [Image.fromarray(frame) for frame in frames[:: max(1, len(frames) // 8)]]
    width, height = samples[0].size
    strip = Image.new("RGB", (width * len(samples), height))
    for index, sample in enumerate(samples):
        strip.paste(sample, (index * width, 0))
    palette = strip.quantize(255, method=Image.Quantize.MEDIANCUT)
    # Converted one at a time: a minute of a large window would need gigabytes.
    indexed = (
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE)
        for frame in frames
    )
    next(indexed).save(
        path,
        save_all=True,
        append_images=indexed,
        duration=max(20, round(1000 / fps)),
        loop=0,
        optimize=False,
    )


class _Incomplete(Exception):
    """ffmpeg has ended before the end of a film."""


def _write_mp4(path: Path, frames: Sequence[Picture], fps: int) -> None:
    import imageio_ffmpeg

    height, width = (2 * (n // 2) for n in frames[0].shape[:2])  # H.264 wants even sizes
    # What ffmpeg itself says would name the temporary file.
    writer = imageio_ffmpeg.write_frames(
        str(path),
        (width, height),
        fps=fps,
        quality=7,
        macro_block_size=2,
        ffmpeg_log_level="quiet",
    )
    writer.send(None)
    for frame in frames:
        try:
            writer.send(np.ascontiguousarray(frame[:height, :width]))
        except OSError as error:
            raise _Incomplete from error
    writer.close()
    # imageio-ffmpeg 0.6 does not say whether ffmpeg has failed at the end, as on a full disk.
    try:
        written, _ = imageio_ffmpeg.count_frames_and_secs(str(path))
    except RuntimeError as error:
        raise _Incomplete from error
    if written != len(frames):
        raise _Incomplete
