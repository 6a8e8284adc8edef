"""`deformer components` and `deformer name`: component analysis as files, and names."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

import deformer
from deformer import Component, ComponentAnalysis, Mesh, io
from deformer_app import console
from deformer_app.cli.folders import output_folder
from deformer_app.rendering.animation import save_animation
from deformer_app.rendering.camera import Camera, aim, turntable, upright_axes
from deformer_app.rendering.framing import trimmed, with_bar
from deformer_app.rendering.offscreen import Layer, Picture, contact_sheet, render
from deformer_app.rendering.palette import HEAT
from deformer_app.rendering.sheets import save_sheet

TILE = (360, 420)  # pixels of a picture, without its bar
TURN = (240, 300)  # pixels of a turntable
COLUMNS = 5
FPS = 8
CAPTION = "feature change"
_WRITTEN = r"component-\d+\.(ply|obj|glb|png|gif)|components\.(csv|json)|sheet\.png"


def run(
    model_name: str,
    output: Path,
    top: int | None,
    extreme_count: int,
    turn: int,
    bare: bool,
    progress: Callable[[int, int], None],
) -> dict[str, Any]:
    """Analyse a model's components, and write meshes, pictures and tables.

    Args:
        model_name: name of a shipped model, or a path.
        output: directory; an older one of this command is replaced.
        top: number of components, the strongest first; None is all.
        extreme_count: number of training shapes to name for each component.
        turn: number of pictures of a turntable for each component; 0 writes none.
        bare: write meshes as PLY of positions and triangles alone, and not like the model's
            document, in its format.
        progress: called with the pictures done and their number.

    Returns:
        The table's rows, the correlations of activations, and the files.
    """
    with output_folder(output, _WRITTEN) as folder:
        model = deformer.load_model(model_name)
        analysis = ComponentAnalysis(model, extreme_count)
        found = analysis.ranked(top)
        document = None if bare else model.document
        suffix = document.suffix if document else ".ply"
        stems = [f"component-{c.index:02d}" for c in found]
        for c, stem in zip(found, stems, strict=True):
            mesh = analysis.shape(c.index)
            deformer.save_mesh(folder / f"{stem}{suffix}", mesh, like=document)
        total = len(found) * (1 + turn)
        up = str(model.summary.get("up", "y"))
        layers = heat_layers(analysis, found)
        tiles = []
        for stem, picture in zip(stems, heat_maps(layers, up), strict=True):
            save_sheet(folder / f"{stem}.png", with_bar(picture, layers[0]))
            tiles.append(picture)
            progress(len(tiles), total)
        titles = [title(component) for component in found]
        save_sheet(folder / "sheet.png", heat_sheet(layers, tiles, COLUMNS, titles))
        if turn:
            _turntables(analysis, found, up, turn, [folder / f"{s}.gif" for s in stems], progress)
        rows = [asdict(c) for c in found]
        _save_table(folder / "components.csv", rows)
        result = {"model": model_name, "components": rows, "correlations": analysis.correlations}
        io.write_json(folder / "components.json", console.plain(result))
        files = sorted(output / entry.name for entry in folder.iterdir())
    return {**result, "files": files}


def write_keys(
    model_name: str, path: Path, top: int | None, tolerance: float, bare: bool
) -> dict[str, Any]:
    """Write components as shape keys of a GLB file.

    Args:
        model_name: name of a shipped model, or a path.
        path: the file.
        top: number of components, the strongest first; None is all.
        tolerance: as of `deformer.component_keys`.
        bare: write positions and triangles alone, and not like the model's document.

    Returns:
        the number of keys and the error of each component.
    """
    if path.suffix.lower() != ".glb":
        raise deformer.InputError(f"{path}: got suffix {path.suffix!r}, expected .glb; correct it")
    io.check_output_file(path)
    model = deformer.load_model(model_name)
    chosen = deformer.Activations(model).order[:top].tolist()
    keys = deformer.component_keys(model, chosen, tolerance)
    keys.save(path, bare)
    return {
        "file": str(path),
        "keys": len(keys.names),
        "components": [
            {"index": k, "label": model.label(k), "keys": keys.components.count(k), "error": error}
            for k, error in keys.errors.items()
        ],
    }


def show_keys(result: dict[str, Any]) -> None:
    """Print the result of `write_keys`."""
    rows = [
        [_key(c["index"], c["label"]), str(c["keys"]), f"{c['error']:.2g}"]
        for c in result["components"]
    ]
    console.show_table(
        f"Shape keys in {result['file']}; errors as shares of the diagonal",
        ["component", "keys", "largest error"],
        rows,
    )


def heat_maps(layers: Sequence[Layer], up: str, size: tuple[int, int] = TILE) -> Iterator[Picture]:
    """Pictures of `heat_layers`, with one camera and without colour bars.

    Args:
        layers: the representative shapes.
        up: axis that points up.
        size: width and height of a picture in pixels.
    """
    shapes = np.stack([layer.mesh.vertices for layer in layers])
    camera = aim(shapes, up=up, aspect=size[0] / size[1], margin=0.02)
    for layer in layers:
        yield render(replace(layer, bar=False), camera, size)


def heat_sheet(
    layers: Sequence[Layer], pictures: Sequence[Picture], columns: int, titles: Sequence[str]
) -> Picture:
    """The pictures of `heat_maps` in rows, with one colour bar for all."""
    return with_bar(contact_sheet(trimmed(pictures, columns), columns, titles), layers[0])


def title(component: Component) -> str:
    """Caption of a picture."""
    return f"{_key(component.index, component.label)}: strength {component.strength:.1f}"


def rename(model_name: str, assignments: list[str], output: Path | None) -> dict[str, Any]:
    """Name components by assignments such as "3=left arm up", in place or in a copy.

    Returns:
        The model's path or name, and all its component names.

    Raises:
        InputError: a text that is no assignment, or a name that `deformer.save_names` refuses.
    """
    names: dict[int, str] = {}
    if output is not None:
        deformer.check_model_folder(output)
    model = deformer.load_model(model_name)
    for text in assignments:
        key, sign, name = text.partition("=")
        if not sign:
            raise deformer.InputError(f'name: got {text!r}, expected COMPONENT=NAME, as 3="nod"')
        names[model.component(key)] = name
    if output is None:
        named = deformer.save_names(model_name, names)
    else:
        named = model.with_component_names(names)
        named.save(output)
    return {
        "model": str(output or model_name),
        "names": {str(k): n for k, n in named.component_names.items()},
    }


def show(result: dict[str, Any]) -> None:
    """Print the result of `run`."""
    rows = [
        [
            _key(c["index"], c["label"]),
            f"{c['strength']:.2f}",
            f"{c['motion']:.3g}",
            str(c["support"]),
            f"{c['extent']:.2f}",
            str(c["centre"]),
            f"{c['partner_correlation']:+.2f} {c['partner']}" if c["partner"] >= 0 else "none",
            " ".join(map(str, c["extreme_shapes"])),
        ]
        for c in result["components"]
    ]
    console.show_table(
        f"Components of {result['model']}, the strongest first",
        ["k", "strength", "motion", "support", "extent", "centre", "correlation", "extreme in"],
        rows,
    )
    console.note(f"Wrote {len(result['files'])} files to {result['files'][0].parent}")


def _key(index: int, label: str) -> str:
    """The index, followed by the name if there is one: "3" or "3 left arm up"."""
    return f"{index}" if label == f"component {index}" else f"{index} {label}"


def heat_layers(analysis: ComponentAnalysis, found: list[Component]) -> list[Layer]:
    """Representative shapes of components, coloured by the change of features on one scale."""
    heats = [analysis.activations.displacement(c.index) for c in found]
    # A few vertices of one component would otherwise stretch the scale for all.
    limit = max(float(np.quantile(np.stack(heats), 0.999)), 1e-9)
    return [
        Layer(
            analysis.shape(c.index),
            scalars=heat,
            limits=(0.0, limit),
            title=CAPTION,
            colormap=HEAT,
        )
        for c, heat in zip(found, heats, strict=True)
    ]


def _turntables(
    analysis: ComponentAnalysis,
    found: list[Component],
    up: str,
    count: int,
    files: list[Path],
    progress: Callable[[int, int], None],
) -> None:
    sky = upright_axes(up)[1]
    done = len(found)
    for layer, file in zip(heat_layers(analysis, found), files, strict=True):
        bare = replace(layer, bar=False)
        frames = []
        for camera in _around(layer.mesh, up, sky, count):
            frames.append(render(bare, camera, TURN))
            done += 1
            progress(done, len(found) * (1 + count))
        save_animation(file, frames, FPS)


def _around(mesh: Mesh, up: str, sky: Any, count: int) -> list[Camera]:
    """Cameras of a full turn, at the distance that the widest view needs."""
    aspect = TURN[0] / TURN[1]
    views = [aim(mesh.vertices, up=up, aspect=aspect, azimuth=a) for a in range(0, 360, 30)]
    far = max(views, key=lambda c: float(np.sum(np.subtract(c.position, c.focal) ** 2)))
    middle = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    eye = middle + np.subtract(far.position, far.focal)
    first = Camera(tuple(eye.tolist()), tuple(middle.tolist()), far.up)
    return turntable(first, count, sky)


def _save_table(path: Path, rows: list[dict[str, Any]]) -> None:
    with io.atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as f:
        table = csv.DictWriter(f, rows[0].keys())
        table.writeheader()
        for row in rows:
            table.writerow({**row, "extreme_shapes": " ".join(map(str, row["extreme_shapes"]))})
