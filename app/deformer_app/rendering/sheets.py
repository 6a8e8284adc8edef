"""Rows of shapes drawn with one camera, and their contact sheet."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deformer import Mesh, io
from deformer_app.rendering.camera import aim
from deformer_app.rendering.framing import trimmed, with_bar
from deformer_app.rendering.offscreen import Layer, Picture, contact_sheet, render, save_picture
from deformer_app.rendering.palette import HEAT

TILE = (300, 360)  # width and height of a picture
COLUMNS = 9  # most pictures in a row of a sheet


def draw(
    rows: Mapping[str, NDArray],
    faces: NDArray,
    up: str,
    progress: Callable[[int, int], None] = lambda done, total: None,
    size: tuple[int, int] = TILE,
    azimuth: float = 30.0,
    scalars: Mapping[str, NDArray] | None = None,
) -> dict[str, list[Picture]]:
    """Pictures of rows of shapes, all drawn with one camera that shows every shape.

    Args:
        rows: label → shapes (n, V, 3).
        faces: (F, 3) int64, the same for all shapes.
        up: axis that points up.
        progress: called with the pictures done and their number.
        size: width and height of a picture in pixels.
        azimuth: azimuth of the camera in degrees, see `camera.aim`.
        scalars: label → values (n, V), 0 or more, that colour the shapes of a row; all rows have
            one scale, from 0 to the largest value.
    """
    everything = np.concatenate(list(rows.values()))
    camera = aim(everything, up=up, aspect=size[0] / size[1], azimuth=azimuth)
    drawn: dict[str, list[Picture]] = {}
    done = 0
    for label, shapes in rows.items():
        drawn[label] = []
        for n, vertices in enumerate(shapes):
            layer = Layer(Mesh(vertices, faces))
            if scalars is not None and label in scalars:
                layer = _coloured(layer.mesh, scalars[label][n], scalars)
            drawn[label].append(render(layer, camera, size))
            done += 1
            progress(done, len(everything))
    return drawn


def _coloured(mesh: Mesh, values: NDArray, scalars: Mapping[str, NDArray], title="") -> Layer:
    """A mesh coloured by values, on the scale of all."""
    most = max(float(np.max(row)) for row in scalars.values())
    return Layer(mesh, scalars=values, limits=(0.0, most), colormap=HEAT, bar=False, title=title)


def sheet(drawn: Mapping[str, Sequence[Picture]], titles: Mapping[str, Sequence[str]]) -> Picture:
    """Contact sheet of rows of pictures: at most `COLUMNS` of each, evenly chosen, with titles.

    Columns are as wide and rows as high as what they show; all pictures have one scale.
    """
    count = max(len(row) for row in drawn.values())
    columns = min(count, COLUMNS)
    pictures, captions = [], []
    for label, row in drawn.items():
        shown = np.linspace(0, len(row) - 1, columns).round().astype(int)
        pictures += [row[n] for n in shown]
        captions += [titles[label][n] for n in shown]
    return contact_sheet(trimmed(pictures, columns), columns, captions)


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
    scalars: Mapping[str, NDArray] | None = None,
    bar: str = "",
) -> None:
    """Draw rows of shapes (n, V, 3) and write their contact sheet; arguments as for `draw`.

    Args:
        path: the picture to write.
        rows, faces, up, scalars: as for `draw`.
        titles: as for `sheet`.
        bar: what `scalars` are, and their unit: the title of the colour bar that all have.
    """
    picture = sheet(draw(rows, faces, up, scalars=scalars), titles)
    if scalars:
        label, values = next(iter(scalars.items()))
        layer = _coloured(Mesh(rows[label][0], faces), values[0], scalars, bar)
        picture = with_bar(picture, layer)
    save_sheet(path, picture)
