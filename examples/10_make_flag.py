"""Make the training set of the model "flag": cloth on a pole in turbulent wind.

It replaces the flag set of Tan et al. (AAAI 2018), which was not published. Extended position-based
dynamics simulate stretch, shear, bending, self-collision and the pressure of a divergence-free
turbulent wind on every face; `flag/` has the code.

    python examples/10_make_flag.py flag.npz --frames 300 --seed 0
    python examples/10_make_flag.py noisy.npz --frames 300 --seed 0 --noise 0.001

The same seed gives the same motion, with and without noise. The NPZ holds `vertices` float32
(N, V, 3) in metres, z up, the pole at x = 0, the wind blowing along +x: shape 0 is the flat flag
at rest, the reference; the others are frames in order. `faces` int32 (F, 3).
`14_name_components.py` names the components of a model that was trained from the set.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from flag.cloth import Cloth, Simulation, rectangle
from flag.noise import add_noise
from flag.quality import count_intersections, edges_of, stretches, swing_angles
from flag.wind import turbulent_wind
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from deformer.io import write_npz

RATE = 30  # frames a second
WARM_UP = 1.5  # seconds from the flat start to the first frame


def make_set(
    frames: int, seed: int, noise: float = 0.0, cloth: Cloth | None = None, progress: bool = False
) -> dict[str, NDArray]:
    """Simulate the set.

    Args:
        frames: number of frames after the reference.
        seed: seed of the wind and the noise; the same seed gives the same set.
        noise: standard deviation of the noise in the middle of the flag, in metres.
        cloth: the flag; None is the full-size one of 61 by 41 vertices.
        progress: true to show a bar.

    Returns:
        The arrays of the NPZ file.

    Raises:
        ValueError: no frames, or a negative noise.
    """
    if frames < 1:
        raise ValueError(f"frames: expected at least 1, got {frames}")
    if not noise >= 0.0:
        raise ValueError(f"noise: expected metres, 0 or more, got {noise}")
    cloth = cloth or rectangle()
    simulation = Simulation(cloth, turbulent_wind(np.random.default_rng([seed, 0])))
    simulation.run(WARM_UP)
    shapes = [cloth.rest]
    for _ in track(range(frames), "simulating") if progress else range(frames):
        simulation.run(1.0 / RATE)
        shapes.append(simulation.x.copy())
    vertices = add_noise(np.stack(shapes), noise, np.random.default_rng([seed, 1]))
    return {"vertices": vertices.astype(np.float32), "faces": cloth.faces.astype(np.int32)}


def describe(arrays: dict[str, NDArray], cloth: Cloth, progress: bool = False) -> str:
    """Swing, stretch and self-intersections of the frames, as lines of text."""
    rest, frames = arrays["vertices"][0], arrays["vertices"][1:]
    angles = swing_angles(frames, cloth.shape)
    stretch = stretches(frames, edges_of(arrays["faces"]), rest)
    low, middle, high = np.percentile(stretch, [1, 50, 99])
    cuts = [
        count_intersections(p, arrays["faces"])
        for p in (track(frames, "checking") if progress else frames)
    ]
    return (
        f"free edge: {angles.min():.0f}° to {angles.max():.0f}° about the pole, "
        f"deviation {angles.std():.0f}°\n"
        f"edge length over rest: 1st percentile {low:.4f}, median {middle:.4f}, "
        f"99th {high:.4f}; {stretch.min():.3f} to {stretch.max():.3f}\n"
        f"self-intersections: {sum(cuts)} (edge, face) pairs in "
        f"{np.count_nonzero(cuts)} of {len(cuts)} frames"
    )


def main(
    out: Annotated[Path, typer.Argument(help="The NPZ file to write.")],
    frames: Annotated[int, typer.Option(help="Count of frames after the reference.", min=1)] = 300,
    seed: Annotated[int, typer.Option(help="Seed of the wind and the noise.", min=0)] = 0,
    noise: Annotated[
        float,
        typer.Option(help="Standard deviation of the noise in metres; 4 times at corners.", min=0),
    ] = 0.0,
) -> None:
    """Simulate the flag training set and write it to OUT."""
    console = Console()
    cloth = rectangle()
    arrays = make_set(frames, seed, noise, cloth, progress=True)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_npz(out, arrays)
    n, v, _ = arrays["vertices"].shape
    console.print(f"{out}: {n} shapes, {v} vertices, {len(arrays['faces'])} faces, z up")
    console.print(describe(arrays, cloth, progress=True))


if __name__ == "__main__":
    typer.run(main)
