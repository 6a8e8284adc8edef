"""The picture of a layout: numbered handles, and the heat of what stays uncertain."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from deformer import DeformationModel, Layout, vertex_normals
from deformer_app.rendering.camera import aim
from deformer_app.rendering.offscreen import HandleGlyphs, Layer, Picture, contact_sheet, render
from deformer_app.rendering.palette import HEAT, INK

_SIZE, _BAR = (760, 860), 150  # pixels of a view, and of its width that the colour bar takes
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
    pictures = []
    for azimuth in _VIEWS.values():
        camera = aim(mesh.vertices, up=up, aspect=(_SIZE[0] - _BAR) / _SIZE[1], azimuth=azimuth)
        layer = Layer(
            mesh,
            scalars=layout.deviation,
            title="expected deviation",
            limits=(0.0, limit),
            colormap=HEAT,
        )
        image = Image.fromarray(render(layer, camera, _SIZE, HandleGlyphs(positions)))
        pen, font = ImageDraw.Draw(image), ImageFont.load_default(_TEXT)
        to_eye = np.subtract(camera.position, positions)
        facing = (normals * to_eye).sum(axis=1) > _FACING * np.sqrt((to_eye**2).sum(axis=1))
        for n in np.flatnonzero(facing):
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
    return contact_sheet(pictures, len(pictures), list(_VIEWS))
