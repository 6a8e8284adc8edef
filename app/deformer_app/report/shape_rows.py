"""Pictures of a report: an unseen shape, each method's estimate, and the distances between them."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from deformer import load_mesh, vertex_errors
from deformer_app.rendering.camera import aim
from deformer_app.rendering.framing import trimmed
from deformer_app.rendering.offscreen import Layer, contact_sheet, draw_bar, render
from deformer_app.rendering.palette import BACKGROUND

_SIZE = (300, 340)


def sheet(folder: Path, what: str, methods: list[str], up: str) -> bytes | None:
    """Draw the true shape and every method's estimate, with the distances below, from one camera.

    Args:
        folder: directory with truth.ply and METHOD-WHAT.ply; methods without a file are left out.
        what: "encoder" or "sparse_control".
        methods: names of methods, in the order of the pictures.
        up: axis that points up.

    Returns:
        A WebP file; None if there is nothing to draw.

    Raises:
        InputError: the machine cannot render.
    """
    files = {m: file for m in methods if (file := folder / f"{m}-{what}.ply").is_file()}
    if not files:
        return None
    truth = load_mesh(folder / "truth.ply")
    shapes = {method: load_mesh(file) for method, file in files.items()}
    errors = {m: vertex_errors(truth.vertices, mesh.vertices) for m, mesh in shapes.items()}
    # One method with large errors would otherwise flatten the colours of all others.
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
    columns = 1 + len(shapes)
    image = contact_sheet(trimmed([*above, *below], columns), columns, titles, gap=4)
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="WEBP", quality=88)
    return buffer.getvalue()
