"""`deformer layout`: handles chosen for a model, their file, their picture and their table."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import deformer
from deformer import io
from deformer_app import console

if TYPE_CHECKING:
    from deformer import DeformationModel, Layout

PICTURES = (".png", ".jpg", ".jpeg")


def run(
    model_name: str,
    counts: tuple[int, ...],
    exclude: Path | tuple[int, ...],
    output: Path | None,
    picture: Path | None,
    **options: Any,
) -> dict[str, Any]:
    """Choose handles; write their file and their picture.

    Args:
        model_name: name of a shipped model, or a path.
        counts: numbers of handles.
        exclude: vertices that must not be handles, or the JSON file that lists them.
        output: JSON file, or None.
        picture: PNG or JPEG file, or None.
        options: `symmetric`, `fixed` and `noise`, as in `deformer.layout`.

    Returns:
        What is expected by count, a row for each handle, and the files.

    Raises:
        InputError: an output that cannot be written, a file that lists no vertices, or what
            `deformer.layout` refuses.
    """
    if output is not None:
        io.check_output_file(output)
    if picture is not None:
        if picture.suffix.lower() not in PICTURES:
            raise deformer.InputError(
                f"{picture}: got suffix {picture.suffix!r}, expected one of {', '.join(PICTURES)}"
            )
        io.check_output_file(picture)
    model = deformer.load_model(model_name)
    if isinstance(exclude, Path):
        with io.expecting(exclude, "vertices"):
            exclude = tuple(io.read_value(exclude)["vertices"].integers(0))
    found = deformer.layout(model, counts, exclude=exclude, **options)
    if output is not None:
        io.write_json(output, handles_file(model, found))
    if picture is not None:
        from deformer_app.rendering.layout_picture import draw_layout
        from deformer_app.rendering.sheets import save_sheet

        save_sheet(picture, draw_layout(model, found))
    files = [path for path in (output, picture) if path is not None]
    return {"model": model_name, **describe(model, found), "files": files}


def handles_file(model: DeformationModel, found: Layout) -> dict[str, Any]:
    """The handles of a layout on the reference, as `deformer fit` reads them."""
    vertices = model.reference.vertices
    return {
        "handles": [{"vertex": int(v), "position": vertices[v].tolist()} for v in found.vertices]
    }


def describe(model: DeformationModel, found: Layout) -> dict[str, Any]:
    """What is expected by count, in the data's units and as E_rms; and a row for each handle."""
    partner = dict(found.pairs.tolist()) | {b: a for a, b in found.pairs.tolist()}
    rows = [
        {
            "vertex": int(vertex),
            "position": model.reference.vertices[vertex].tolist(),
            "deviation": float(found.region_deviation[n]),
            "spacing": float(found.spacing[n]) if math.isfinite(found.spacing[n]) else None,
            "pair": int(found.vertices[partner[n]]) if n in partner else None,
        }
        for n, vertex in enumerate(found.vertices)
    ]
    return {
        "expected": [
            {"count": count, "deviation": value, "E_rms": 1000.0 * value / math.sqrt(3.0)}
            for count, value in found.expected.items()
        ],
        "handles": rows,
    }


def show(result: dict[str, Any]) -> None:
    """Print the result of `run`."""
    rows = [
        [
            str(n),
            str(handle["vertex"]),
            "" if handle["pair"] is None else str(handle["pair"]),
            console.brief(handle["deviation"]),
            "" if handle["spacing"] is None else console.brief(handle["spacing"]),
        ]
        for n, handle in enumerate(result["handles"], 1)
    ]
    console.show_table(
        f"Handles of {result['model']}: deviation expected around each, distance to the next",
        ["", "vertex", "pair", "deviation", "spacing"],
        rows,
    )
    console.show_table(
        "Expected over all vertices",
        ["handles", "deviation", "E_rms"],
        [
            [str(entry["count"]), console.brief(entry["deviation"]), console.brief(entry["E_rms"])]
            for entry in result["expected"]
        ],
    )
    for path in result["files"]:
        console.note(f"Wrote {path}.")
