"""The picture of a layout: numbered handles, and the heat of what stays uncertain."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from deformer import DeformationModel, Layout, vertex_normals
from deformer_app.rendering.camera import aim
from deformer_app.rendering.framing import trimmed, with_bar
from deformer_app.rendering.offscreen import HandleGlyphs, Layer, Picture, contact_sheet, render
from deformer_app.rendering.palette import HEAT, INK

_SIZE = (760, 860)  # pixels of a view
_VIEWS = {"front": 20.0, "back": 200.0}  # azimuths in degrees
_TEXT = 17  # height of a number in pixels
_FACING = 0.15  # least cosine between a numbered handle's normal and the line of sight


def draw_layout(model: DeformationModel, layout: Layout) -> Picture:
    """Front and back of a model's reference, coloured by expected deviation, handles numbered.

    Args:
        model: the prior.
        layout: its layout; the numbers count from 1, in the order of `Layout.vertices`.
    """
    mesh = model.reference
    positions = mesh.vertices[layout.vertices]
    normals = vertex_normals(mesh.vertices, mesh.faces)[layout.vertices]
    up = str(model.summary.get("up", "y"))
    limit = max(float(np.quantile(layout.deviation, 0.99)), 1e-12)
    aspect = _SIZE[0] / _SIZE[1]
    cameras = [aim(mesh.vertices, up=up, aspect=aspect, azimuth=a) for a in _VIEWS.values()]
    eyes = np.array([camera.position for camera in cameras])
    layer = Layer(
        mesh,
        scalars=layout.deviation,
        title="expected deviation",
        limits=(0.0, limit),
        colormap=HEAT,
        bar=False,
    )
    pictures = []
    for camera, shown in zip(cameras, numbered(eyes, positions, normals), strict=True):
        image = Image.fromarray(render(layer, camera, _SIZE, HandleGlyphs(positions)))
        pen, font = ImageDraw.Draw(image), ImageFont.load_default(_TEXT)
        for n in np.flatnonzero(shown):
            x, y = camera.project(positions[n, None], _SIZE)[0]
            pen.text(
                (x + 9, y - 9),
                str(n + 1),
                fill=INK,
                font=font,
                anchor="lb",
                stroke_width=3,
                stroke_fill="white",
            )
        pictures.append(np.asarray(image))
    return with_bar(contact_sheet(trimmed(pictures), len(pictures), list(_VIEWS)), layer)


def numbered(
    eyes: NDArray[np.float64], positions: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """True (v, n) where a view has the number of a handle: those that face it.

    A handle on a side faces no view; it has its number in the one that shows most of it.

    Args:
        eyes: (v, 3) positions of the cameras.
        positions, normals: (n, 3) of the handles.
    """
    sight = eyes[:, None] - positions
    facing = (normals * sight).sum(axis=2) / np.sqrt((sight**2).sum(axis=2))
    return (facing > _FACING) | (facing == facing.max(axis=0))
