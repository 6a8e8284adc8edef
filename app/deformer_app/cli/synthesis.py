"""`deformer synthesize`, `interpolate` and `encode`: new shapes as files."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import (
    BlendSpace,
    DeformationModel,
    InputError,
    MeshSequence,
    ShapePath,
    Synthesis,
    check_blend_space,
    io,
    vertex_errors,
)
from deformer_app.cli import outputs
from deformer_app.cli.arguments import MOST_SHAPES, words
from deformer_app.cli.folders import output_folder
from deformer_app.rendering.animation import save_animation, side_by_side, there_and_back
from deformer_app.rendering.framing import trimmed
from deformer_app.rendering.offscreen import contact_sheet
from deformer_app.rendering.sheets import draw, save_sheet, sheet

Progress = Callable[[int, int], None]
FPS = 12  # of animations
_LONGEST_NUMBER = 20  # digits
_SYNTHESIZED = r"sweep-\d+\.(npz|gif)|shapes\.npz|sheet\.png"
_INTERPOLATED = r"(latent|features|linear)\.npz|sheet\.png|path\.gif|lengths\.json"


@dataclass(frozen=True)
class Request:
    """Arguments of `deformer synthesize`; see its help."""

    model: str
    output: Path
    weights: str | None = None
    sweeps: tuple[str, ...] = ()
    random: int | None = None
    seed: int = 0
    bound: float = 1.0
    start: str = "reference"
    spaces: str = "latent"
    onto: str | None = None
    bare: bool = False
    timing: outputs.Timing = field(default_factory=outputs.Timing)

    @property
    def makes_several(self) -> bool:
        """True if the output is a directory, or a sequence of shapes in one file."""
        return self.random is not None or bool(self.sweeps)


def run(request: Request, progress: Progress) -> dict[str, Any]:
    """Synthesise shapes and write them; returns their codes and files."""
    spaces = _spaces(request.spaces)
    _check(request, spaces)
    if not request.makes_several:
        return _one_shape(request, spaces[0])
    if outputs.is_sequence_file(request.output):
        return _one_sequence(request, spaces[0])
    with output_folder(request.output, _SYNTHESIZED) as folder:
        write = _sweeps if request.random is None else _random_shapes
        return write(request, folder, spaces, progress)


def _models(request: Request) -> tuple[DeformationModel, DeformationModel]:
    """The model whose codes are chosen, and the one that decodes them."""
    model = deformer.load_model(request.model)
    return model, model if request.onto is None else deformer.load_model(request.onto)


def _one_shape(request: Request, space: BlendSpace) -> dict[str, Any]:
    """Write one shape."""
    model, goal = _models(request)
    weights = _weights(request.weights) if request.weights else {}
    synthesis = Synthesis(model, start_code(model, request.start))
    z = synthesis.code(weights)
    vertices = synthesis.shape(weights, space) if goal is model else _decoded(model, goal, z)
    outputs.save(request.output, goal, vertices, request.bare)
    return {
        "output": str(request.output),
        "space": space,
        "z": z,
        "off_data": deformer.Familiarity(model).percentile(z),
    }


def between(
    model_name: str,
    keys: list[str],
    output: Path,
    steps: int,
    spaces: str | None,
    bare: bool,
    timing: outputs.Timing,
    progress: Progress,
) -> dict[str, Any]:
    """Interpolate shapes in several spaces; write a sequence for each, a sheet and an animation.

    A file gets one sequence alone, in latent codes if no space is named; else there are all spaces.
    """
    one_file = outputs.is_sequence_file(output)
    chosen = _spaces(spaces or ("latent" if one_file else "latent,features,linear"))
    if len(keys) < 2:
        raise InputError(f"interpolate: got {len(keys)} shape, expected two or more")
    if one_file:
        outputs.check_one(output, len(chosen))
        model = deformer.load_model(model_name)
        shapes = np.stack([_shape(model, key) for key in keys])
        path = deformer.interpolate(model, shapes, steps, chosen[0])
        saved = outputs.save(output, model, path.vertices, bare, timing)
        return {"model": model_name, "keys": keys, "spaces": {chosen[0]: _lengths(path)}, **saved}
    with output_folder(output, _INTERPOLATED) as folder:
        model = deformer.load_model(model_name)
        shapes = np.stack([_shape(model, key) for key in keys])
        paths = {space: deformer.interpolate(model, shapes, steps, space) for space in chosen}
        faces = model.reference.faces
        for space, path in paths.items():
            io.save_shapes(folder / f"{space}.npz", MeshSequence(path.vertices, faces))
        drawn = draw({space: p.vertices for space, p in paths.items()}, faces, _up(model), progress)
        titles = {space: [f"{space}, {t:.2f}" for t in path.times] for space, path in paths.items()}
        save_sheet(folder / "sheet.png", sheet(drawn, titles))
        save_animation(folder / "path.gif", there_and_back(side_by_side(drawn)), FPS)
        record = {space: _lengths(path) for space, path in paths.items()}
        result = {"model": model_name, "keys": keys, "spaces": record}
        io.write_json(folder / "lengths.json", result)
    return {
        **result,
        "files": _files(output, "sheet.png", "path.gif", *(f"{w}.npz" for w in chosen)),
    }


def _lengths(path: ShapePath) -> dict[str, float]:
    """How much shorter edges get on the way than between the shapes they lie between, at least."""
    return {
        "shortest_total": float(path.length_ratios().min()),
        "edges_5_percent": float(np.quantile(path.edge_ratios(), 0.05, axis=1).min()),
    }


def encode(
    model_name: str, shape: Path, output: Path | None, quick: bool, bare: bool
) -> dict[str, Any]:
    """Code of a shape, and the distances of the decoded shape from it."""
    if output is not None and output.suffix.lower() == ".json":
        io.check_output_file(output)
    elif output is not None:
        outputs.check_output(output, is_sequence=False)
    model = deformer.load_model(model_name)
    vertices = _loaded(model, shape)
    z = model.encode(vertices) if quick else model.fit(vertices)
    found = model.decode(z)
    found += vertices.mean(axis=0) - found.mean(axis=0)
    result = {
        "z": z,
        "e_rms": deformer.e_rms(vertices, found),
        "e_rms_aligned": deformer.e_rms(vertices, found, "rigid"),
        "e_rms_of_encoder": deformer.e_rms(vertices, model.decode(model.encode(vertices))),
        "largest_distance": float(vertex_errors(vertices, found).max()),
        "off_data": deformer.Familiarity(model).percentile(z),
    }
    if output is None:
        return result
    if output.suffix.lower() == ".json":
        io.write_json(output, result)
    else:
        outputs.save(output, model, found, bare)
    return {**result, "output": str(output)}


def start_code(model: DeformationModel, text: str) -> NDArray | None:
    """Code (K,) of a shape named on the command line; None is the reference.

    Raises:
        InputError: no such training shape or file, or a mesh of another connectivity.
    """
    if text == "reference":
        return None
    if text.isdecimal() or text.lower().endswith(".json"):
        return _stored_code(model, text)
    return model.fit(_loaded(model, Path(text)))


def _stored_code(model: DeformationModel, text: str) -> NDArray:
    """Code (K,) of a training shape by its number, or from a JSON file."""
    if text.isdecimal():
        rows = model.split["train"]
        number = int(text) if len(text) < _LONGEST_NUMBER else -1
        if number not in rows:
            raise InputError(
                f"shape {text[:_LONGEST_NUMBER]}: not one that the model was trained on (of "
                f"{min(rows)}…{max(rows)})"
            )
        return model.codes[rows.index(number)]
    with io.expecting(text, "code"):
        return np.array(io.read_value(text)["z"].numbers(model.components, largest=io.LARGEST))


def _shape(model: DeformationModel, text: str) -> NDArray:
    """Vertices (V, 3) of a shape named on the command line; a mesh file is not encoded."""
    if text == "reference":
        return model.reference.vertices
    if text.isdecimal() or text.lower().endswith(".json"):
        return model.decode(_stored_code(model, text))
    return _loaded(model, Path(text))


def _loaded(model: DeformationModel, path: Path) -> NDArray:
    return deformer.load_mesh(path, like=model.reference).vertices


def _check(request: Request, spaces: tuple[BlendSpace, ...]) -> None:
    """Raise InputError, before any work, for options that exclude each other."""
    if request.random is not None and (request.weights or request.sweeps):
        raise InputError("synthesize: --random goes without --weights and --sweep; leave them out")
    if request.random is None and not request.weights and not request.sweeps:
        raise InputError("synthesize: got none of --weights, --sweep, --random; give one")
    if spaces != ("latent",) and (request.onto or request.random is not None):
        raise InputError(
            "synthesize: --onto and --random know the space latent only; drop --spaces"
        )
    if not request.makes_several:
        if len(spaces) > 1:
            raise InputError(
                f"synthesize: one shape is made in one space, got {request.spaces}; choose one"
            )
        outputs.check_output(request.output, is_sequence=False)
    elif outputs.is_sequence_file(request.output):
        outputs.check_one(request.output, max(1, len(request.sweeps)) * len(spaces))
    elif request.output.suffix.lower() in io.MESH_SUFFIXES:
        raise InputError(f"{request.output}: names one mesh file; name a directory for many shapes")


def _spaces(text: str) -> tuple[BlendSpace, ...]:
    found = words(text) or ()
    for space in found:
        check_blend_space(space)
    return cast(tuple[BlendSpace, ...], found)


def _weights(text: str) -> dict[int | str, float]:
    """Weights by component of a text such as "3=0.8,nod=1.2"."""
    weights: dict[int | str, float] = {}
    for part in text.split(","):
        key, sign, value = part.partition("=")
        try:
            weight = float(value)
        except ValueError:
            sign, weight = "", 0.0
        if not sign:
            raise InputError(f"--weights: got {part[:60]!r}, expected COMPONENT=NUMBER, as 3=0.8")
        if key.strip() in weights:
            raise InputError(f"--weights: component {key.strip()} is given twice; give it once")
        weights[key.strip()] = weight
    return weights


def _sweep(text: str) -> tuple[str, NDArray]:
    """Component and weights of a text such as "3=-1:1:9"."""
    key, _, span = text.partition("=")
    try:
        first, last, count = span.split(":")
        low, high, number = float(first), float(last), int(count)
    except ValueError:
        low, high, number = 0.0, 0.0, 0
    if number < 1 or max(abs(low), abs(high)) > io.LARGEST or low != low or high != high:
        raise InputError(
            f"--sweep: got {text[:60]!r}, expected COMPONENT=FIRST:LAST:COUNT, as 3=-1:1:9"
        )
    if number > MOST_SHAPES:
        raise InputError(f"--sweep: expected a COUNT of 1…{MOST_SHAPES}, got {text[:60]!r}")
    return key.strip(), np.linspace(low, high, number)


def _decoded(model: DeformationModel, goal: DeformationModel, z: NDArray) -> NDArray:
    return model.decode(z) if goal is model else deformer.transfer(model, goal, z)


def _up(model: DeformationModel) -> str:
    return str(model.summary.get("up", "y"))


def _one_sequence(request: Request, space: BlendSpace) -> dict[str, Any]:
    """Write one sweep, or shapes drawn from the latent prior, as one file."""
    model, goal = _models(request)
    if request.random is not None:
        shapes = _drawn(request, model, goal)[1]
    else:
        (shapes,) = _rows(request, model, goal, (space,))[0].values()
    with io.locked(request.output):
        saved = outputs.save(request.output, goal, shapes, request.bare, request.timing)
    return {"output": str(request.output), "shapes": len(shapes), **saved}


def _rows(
    request: Request,
    model: DeformationModel,
    goal: DeformationModel,
    spaces: tuple[BlendSpace, ...],
) -> tuple[dict[str, NDArray], dict[str, list[str]]]:
    """Shapes (n, V, 3) and their titles for every sweep and space."""
    synthesis = Synthesis(model, start_code(model, request.start))
    weights = _weights(request.weights) if request.weights else {}
    rows: dict[str, NDArray] = {}
    titles: dict[str, list[str]] = {}
    fixed = {model.component(key): weight for key, weight in weights.items()}
    for text in request.sweeps:
        component, values = _sweep(text)
        k = model.component(component)
        for space in spaces:
            row = model.label(k) if len(spaces) == 1 else f"{model.label(k)}, {space}"
            titles[row] = [f"{row}: {w:g}" for w in values]
            if goal is model:
                rows[row] = synthesis.sweep(k, values, fixed, space)
            else:
                codes = [synthesis.code({**fixed, k: float(w)}) for w in values]
                rows[row] = np.stack([_decoded(model, goal, z) for z in codes])
    return rows, titles


def _drawn(
    request: Request, model: DeformationModel, goal: DeformationModel
) -> tuple[NDArray, NDArray]:
    """Codes (n, K) drawn from the latent prior, and their shapes (n, V, 3)."""
    codes = deformer.draw_codes(model, request.random or 0, request.seed, request.bound)
    return codes, np.stack([_decoded(model, goal, z) for z in codes])


def _sweeps(
    request: Request, folder: Path, spaces: tuple[BlendSpace, ...], progress: Progress
) -> dict[str, Any]:
    """Write an NPZ and a GIF for every sweep and space, and one sheet with a row for each."""
    model, goal = _models(request)
    rows, titles = _rows(request, model, goal, spaces)
    output, faces = request.output, goal.reference.faces
    drawn = draw(rows, faces, _up(goal), progress)
    save_sheet(folder / "sheet.png", sheet(drawn, titles))
    files = ["sheet.png"]
    for n, (row, shapes) in enumerate(rows.items()):
        io.save_shapes(folder / f"sweep-{n}.npz", MeshSequence(shapes, faces))
        frames = there_and_back(side_by_side({row: drawn[row]}))
        save_animation(folder / f"sweep-{n}.gif", frames, FPS)
        files += [f"sweep-{n}.npz", f"sweep-{n}.gif"]
    return {"output": str(output), "rows": list(rows), "files": _files(output, *files)}


def _random_shapes(
    request: Request, folder: Path, spaces: tuple[BlendSpace, ...], progress: Progress
) -> dict[str, Any]:
    """Write shapes drawn from the latent prior, and a sheet of them."""
    model, goal = _models(request)
    codes, shapes = _drawn(request, model, goal)
    familiarity = deformer.Familiarity(model)
    off_data = [familiarity.percentile(z) for z in codes]
    output, faces = request.output, goal.reference.faces
    io.save_shapes(folder / "shapes.npz", MeshSequence(shapes, faces))
    pictures = draw({"": shapes}, faces, _up(goal), progress)[""]
    titles = [f"{n}: {percentile:.0f} % off data" for n, percentile in enumerate(off_data)]
    columns = min(len(pictures), 6)
    tiles = trimmed(pictures, columns)
    save_sheet(folder / "sheet.png", contact_sheet(tiles, columns, titles))
    return {
        "output": str(output),
        "codes": codes,
        "off_data": off_data,
        "files": _files(output, "shapes.npz", "sheet.png"),
    }


def _files(folder: Path, *names: str) -> list[str]:
    return [str(folder / name) for name in names]
