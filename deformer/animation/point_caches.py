"""Point caches: the positions of all vertices at every frame, without a mesh."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from deformer.documents import single_precision
from deformer.workspace import Rows


def write_mdd(path: Path, vertices: Rows, fps: float) -> None:
    """Write a LightWave MDD file: big endian, with the time of each frame in seconds.

    Args:
        path: the file.
        vertices: (F, V, 3) positions, rounded to single precision.
        fps: frames a second.

    Raises:
        InputError: a position too large for single precision.

    Source: LightWave Motion Designer, "MDD file format": counts of frames and points as 32-bit
        integers, times, and then frame by frame x, y, z of each point.
    """
    frames, points = vertices.shape[:2]
    with path.open("wb") as stream:
        stream.write(np.array([frames, points], ">i4").tobytes())
        stream.write((np.arange(frames) / fps).astype(">f4").tobytes())
        for shape in vertices:
            stream.write(single_precision(shape, path.suffix).astype(">f4").tobytes())


def write_pc2(path: Path, vertices: Rows) -> None:
    """Write a PC2 file: little endian, a sample a frame from frame 0 on; it knows no seconds.

    Args:
        path: the file.
        vertices: (F, V, 3) positions, rounded to single precision.

    Raises:
        InputError: a position too large for single precision.

    Source: the header of 3ds Max' Point Cache 2: the text POINTCACHE2 and a zero byte, version 1,
        number of points, first frame, frames between samples, number of samples.
    """
    frames, points = vertices.shape[:2]
    with path.open("wb") as stream:
        stream.write(b"POINTCACHE2\0" + np.array([1, points], "<i4").tobytes())
        stream.write(np.array([0.0, 1.0], "<f4").tobytes() + np.array([frames], "<i4").tobytes())
        for shape in vertices:
            stream.write(single_precision(shape, path.suffix).astype("<f4").tobytes())
