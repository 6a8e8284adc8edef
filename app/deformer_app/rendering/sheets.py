"""Rows of shapes drawn with one camera, and their contact sheet."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deformer import Mesh, io
from deformer_app.rendering.camera import aim
from deformer_app.rendering.framing import trimmed
from deformer_app.rendering.offscreen import Picture, contact_sheet, render, save_picture

TILE = (300, 360)  # width and height of a picture
COLUMNS = 9  # most pictures in a row of a sheet


def draw(
    rows: Mapping[str, NDArray],
    faces: NDArray,
    up: str,
    progress: Callable[[int, int], None] = lambda done, total: None,
    size: tuple[int, int] = TILE,
    azimuth: float = 30.0,
) -> dict[str, list[Picture]]:
    """Pictures of rows of shapes, all drawn with one camera that shows every shape.

    Args:
        rows: label → shapes (n, V, 3).
        faces: (F, 3) int64, the same for all shapes.
        up: axis that points up.
        progress: called with the pictures done and their number.
        size: width and height of a picture in pixels.
        azimuth: azimuth of the camera in degrees, see `camera.aim`.
    """
    everything = np.concatenate(list(rows.values()))
    camera = aim(everything, up=up, aspect=size[0] / size[1], azimuth=azimuth)
    drawn: dict[str, list[Picture]] = {}
    done = 0
    for label, shapes in rows.items():
        drawn[label] = []
        for vertices in shapes:
            drawn[label].append(render(Mesh(vertices, faces), camera, size))
            done += 1
            progress(done, len(everything))
    return drawn


def sheet(drawn: Mapping[str, Sequence[Picture]], titles: Mapping[str, Sequence[str]]) -> Picture:
    """Contact sheet of rows of pictures: at most `COLUMNS` of each, evenly chosen, with titles.

    Cells are as large as what they show; all have one scale.
    """
    count = max(len(row) for row in drawn.values())
    columns = min(count, COLUMNS)
    pictures, captions = [], []
    for label, row in drawn.items():
        shown = np.linspace(0, len(row) - 1, columns).round().astype(int)
        pictures += [row[n] for n in shown]
        captions += [titles[label][n] for n in shown]
    return contact_sheet(trimmed(pictures), columns, captions)


def save_sheet(path: Path, picture: Picture) -> None:
    """Write a picture; the file is complete or absent."""
    with io.atomic_path(path) as temporary:
        save_picture(temporary, picture)


def save_rows(
    path: Path,
    rows: Mapping[str, NDArray],
    faces: NDArray,
    up: str,
    titles: Mapping[str, Sequence[str]],
) -> None:
    """Draw rows of shapes (n, V, 3) and write their contact sheet; arguments as for `draw`."""
    save_sheet(path, sheet(draw(rows, faces, up), titles))
