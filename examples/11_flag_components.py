"""Components of a noisy flag: an autoencoder's against SPLOCS on edge lengths and angles.

The paper's experiment on robustness (Tan et al., AAAI 2018, "Flag Dataset"): both methods learn 20
components from frames whose noise is largest at the free corners; the four strongest of each should
be the swing of the flag, not the noise. Every fifth frame is a training shape; the other frames are
for the measurements, against the same frames without noise.

    python examples/10_make_flag.py flag.npz
    python examples/10_make_flag.py noisy.npz --noise 0.001
    python examples/11_flag_components.py flag.npz noisy.npz -o flag-components

Writes `components.png` (key frames; each method's four strongest components, coloured by their
support, over the flat flag, and all four together), `results.json`, and the autoencoder in `model`,
which a later run loads.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from flag.comparison import (
    Components,
    EdgeComponents,
    NetworkComponents,
    corner_shares,
    explained,
    motion_shares,
    on_pole,
    rebuilt,
    strongest,
    swing_explained,
)
from flag.noise import CORNER_GAIN, noise_profile
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress, track
from rich.table import Table

import deformer
from deformer import Mesh, MeshSequence
from deformer.baselines import EdgeSplocs
from deformer_app.rendering.camera import aim
from deformer_app.rendering.framing import trimmed, with_bar
from deformer_app.rendering.offscreen import Layer, contact_sheet, render, save_picture
from deformer_app.rendering.palette import GHOST, HEAT

TRAINED = 5  # one frame in so many is a training shape
SHOWN = 4  # number of strongest components
TOGETHER = 0.5  # share of its extreme that each component has when all four are combined
SIZE = (420, 340)


def split_of(count: int) -> dict[str, list[int]]:
    """The reference and every fifth frame for training, the others for testing."""
    train = range(0, count, TRAINED)
    return {"train": list(train), "test": [n for n in range(count) if n % TRAINED]}


def trained(
    path: Path, noisy: MeshSequence, components: int, epochs: int | None, seed: int
) -> deformer.DeformationModel:
    """The autoencoder of the noisy frames, loaded from `path`, or else trained and saved there."""
    if path.is_dir():
        return deformer.load_model(path)
    with Progress() as bar:
        task = bar.add_task("training")
        model = deformer.train(
            noisy,
            components,
            epochs=epochs,
            split=split_of(len(noisy)),
            seed=seed,
            up="z",
            on_progress=lambda p: bar.update(
                task, description=p.stage, completed=p.done, total=p.total
            ),
        )
    model.save(path)
    return model


def measure(
    components: Components, clean: NDArray, noisy: NDArray, rest: NDArray, stills: int
) -> dict[str, Any]:
    """Measurements of the strongest components, and the share of the motion that they reconstruct.

    Args:
        components: components learned with noise.
        clean, noisy: (N, V, 3) test frames without and with noise.
        rest: (V, 3) the flat flag.
        stills: number of frames to reconstruct.
    """
    first = strongest(components, SHOWN)
    shares, corners = motion_shares(components, clean, noisy), corner_shares(components, rest)
    centres = [rest[components.support(int(k)).argmax()].tolist() for k in first]
    some = np.linspace(0, len(clean) - 1, stills).round().astype(int)
    everything = np.arange(len(components.strengths))
    rows = int((rest[:, 0] == rest[0, 0]).sum())
    swing = swing_explained(components, clean, noisy, first, (len(rest) // rows, rows))
    parts = {}
    for name, kept in (("four", first), ("all", everything)):
        shapes = [
            rebuilt(components, noisy[n : n + 1], kept)[0]
            for n in track(some, f"{components.name}, {name}")
        ]
        for rigid in (False, True):
            share = explained(clean[some], np.array(shapes), rest, rigid)
            parts[f"{'shape' if rigid else 'deformation'}_explained_by_{name}"] = share
    return {
        "components": first.tolist(),
        "strengths": components.strengths[first].tolist(),
        "centres": centres,
        "motion": shares[first].tolist(),
        "motion_of_all": shares.tolist(),
        "corners": corners[first].tolist(),
        "swing_explained_by_four": swing,
        **parts,
    }


def picture(learned: list[Components], noisy: MeshSequence) -> NDArray[np.uint8]:
    """Key frames; below, for each method, its four strongest components and their combination."""
    rest, faces = noisy.vertices[0], noisy.faces
    keys = np.linspace(0, len(noisy) - 1, SHOWN + 2).round().astype(int)[1:]
    layers = [[Layer(noisy.mesh(int(n)))] for n in keys]
    titles = [f"frame {n}" for n in keys]
    ghost = Layer(Mesh(rest, faces), color=GHOST, opacity=0.2)
    scale = Layer(
        ghost.mesh, limits=(0.0, 1.0), title="share of the largest weight", colormap=HEAT, bar=False
    )
    for components in learned:
        first = strongest(components, SHOWN)
        codes = np.tile(components.reference, (SHOWN + 1, 1))
        codes[np.arange(SHOWN), first] = components.extremes[first]
        codes[SHOWN, first] += TOGETHER * (components.extremes - components.reference)[first]
        for n, shape in enumerate(on_pole(components.shapes(codes), rest)):
            laid = Mesh(shape, faces)
            if n < SHOWN:
                support = components.support(int(first[n]))
                coloured = replace(scale, mesh=laid, scalars=support)
                layers.append([ghost, coloured])
                titles.append(f"{components.name} {n + 1}")
            else:
                layers.append([ghost, Layer(laid)])
                titles.append("together, by half")
    everywhere = np.stack([drawn[-1].mesh.vertices for drawn in layers])
    camera = aim(everywhere, up="z", azimuth=-30, elevation=15, aspect=SIZE[0] / SIZE[1])
    pictures = trimmed([render(drawn, camera, SIZE) for drawn in layers], SHOWN + 1)
    return with_bar(contact_sheet(pictures, SHOWN + 1, titles), scale)


def show(results: dict[str, dict[str, Any]], console: Console) -> None:
    """Print the measurements with a column for each method."""
    table = Table("", *results)
    for n in range(SHOWN):
        for name, label in (("motion", "motion in the activation"), ("corners", "in corners")):
            values = [f"{100 * row[name][n]:.0f} %" for row in results.values()]
            table.add_row(f"component {n + 1}: {label}", *values)
    for name, label in (
        ("swing_explained_by_four", "swing angle told by the first four"),
        ("deformation_explained_by_four", "deformation rebuilt from the first four"),
        ("deformation_explained_by_all", "deformation rebuilt from all"),
        ("shape_explained_by_four", "without rigid motion, the first four"),
        ("shape_explained_by_all", "without rigid motion, all"),
    ):
        table.add_row(label, *(f"{100 * row[name]:.0f} %" for row in results.values()))
    console.print(table)


def main(
    clean: Annotated[Path, typer.Argument(help="NPZ of the frames without noise.")],
    noisy: Annotated[Path, typer.Argument(help="NPZ of the same frames with noise.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder to write to.")],
    components: Annotated[int, typer.Option(help="How many both learn.", min=SHOWN)] = 20,
    epochs: Annotated[int | None, typer.Option(help="Of the autoencoder.", min=1)] = None,
    seed: Annotated[int, typer.Option(help="Of the autoencoder.", min=0)] = 0,
    stills: Annotated[int, typer.Option(help="Frames left out to rebuild.", min=2)] = 8,
) -> None:
    """Train both methods on NOISY, and measure and draw their strongest components."""
    console = Console()
    frames, disturbed = deformer.load_shapes(clean), deformer.load_shapes(noisy)
    if frames.vertices.shape != disturbed.vertices.shape:
        raise typer.BadParameter(
            f"{noisy} has shapes {disturbed.vertices.shape}, {clean} {frames.vertices.shape}; "
            "make both with the same --frames"
        )
    split = split_of(len(frames))
    out.mkdir(parents=True, exist_ok=True)
    model = trained(out / "model", disturbed, components, epochs, seed)
    console.print(f"autoencoder: {model.summary['epochs']} epochs, {model.summary['seconds']} s")
    training = disturbed.subset(split["train"])
    edges = EdgeSplocs(noise=0.03)  # σ of handle fits, which are not used here
    with console.status("SPLOCS on edges"):
        edges.fit(training, components)
    learned = [NetworkComponents(model), EdgeComponents(edges, training.vertices)]
    test = split["test"]
    rest = frames.vertices[0]
    corner = (noise_profile(rest) > CORNER_GAIN / 2).mean()
    console.print(f"the corners are {100 * corner:.0f} % of the vertices")
    results = {
        one.name: measure(one, frames.vertices[test], disturbed.vertices[test], rest, stills)
        for one in learned
    }
    show(results, console)
    (out / "results.json").write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    save_picture(out / "components.png", picture(learned, disturbed))
    console.print(f"wrote {out / 'components.png'} and {out / 'results.json'}")


if __name__ == "__main__":
    typer.run(main)
