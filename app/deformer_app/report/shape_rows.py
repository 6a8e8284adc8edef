"""Picture rows of a report: one unseen shape, what each method makes of it, and where it errs."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from deformer import load_mesh, vertex_errors
from deformer_app.rendering.camera import aim
from deformer_app.rendering.offscreen import Layer, contact_sheet, draw_bar, render
from deformer_app.rendering.palette import BACKGROUND

_SIZE = (300, 340)


def sheet(folder: Path, what: str, methods: list[str], up: str) -> bytes | None:
    """The true shape and every method's, and below them the errors, all from one camera, as WebP.

    Args:
        folder: truth.ply and METHOD-WHAT.ply; methods without a file are left out.
        what: "encoder" or "sparse_control".
        methods: in the order of the pictures.
        up: axis that points up.

    Returns:
        None if there is nothing to draw.

    Raises:
        InputError: the machine cannot render.
    """
    files = {m: file for m in methods if (file := folder / f"{m}-{what}.ply").is_file()}
    if not files:
        return None
    truth = load_mesh(folder / "truth.ply")
    shapes = {method: load_mesh(file) for method, file in files.items()}
    errors = {m: vertex_errors(truth.vertices, mesh.vertices) for m, mesh in shapes.items()}
    # A method that went far astray shall not take the colours from all others.
    limit = float(np.median([np.percentile(e, 99) for e in errors.values()])) * 1.5 or 1.0
    camera = aim(truth.vertices, up=up, aspect=_SIZE[0] / _SIZE[1], margin=0.14)
    above = [render(truth, camera, _SIZE), *(render(m, camera, _SIZE) for m in shapes.values())]
    maps = [
        Layer(mesh, scalars=errors[method], limits=(0.0, limit), title="distance", bar=False)
        for method, mesh in shapes.items()
    ]
    empty = np.asarray(Image.new("RGB", _SIZE, BACKGROUND))
    below = [draw_bar(empty, maps[0]), *(render(layer, camera, _SIZE) for layer in maps)]
    titles = ["true shape", *shapes, "", *("" for _ in shapes)]
    image = contact_sheet([*above, *below], 1 + len(shapes), titles, gap=4)
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="WEBP", quality=88)
    return buffer.getvalue()
