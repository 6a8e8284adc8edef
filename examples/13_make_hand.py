"""Make the training set of the model "hand": a right hand in poses that hands take.

Source: the generic hand of the npm package `@webxr-input-profiles/assets` (MIT), a skinned mesh:

    npm pack @webxr-input-profiles/assets@1.0.20
    tar xzf webxr-input-profiles-assets-1.0.20.tgz
    python examples/13_make_hand.py package/dist/profiles/generic-hand/right.glb hand.npz

The mesh is subdivided once (Loop), and gets a forearm to bend at the wrist. Poses are drawn by the
code beside this file: single digits, fists, spread fingers, signs, pinches, grasps, bent wrists.

The NPZ holds `vertices` float32 (N, V, 3) in metres, z up along the fingers, the palm facing −y,
the palm at the same place in all shapes; shape 0 is the hand at rest. `faces` int32 (F, 3);
`names`, the pose family of every shape.
`14_name_components.py` names the components of a model that was trained from the set.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from hand.poses import schedule
from hand.quality import MOST_INSIDE, Inspector
from hand.rig import Hand, load_hand
from numpy.typing import NDArray
from rich.console import Console

import deformer
from deformer.io import write_npz

DRAWS = 40  # of one pose, until no digit is inside the rest of the hand


def make_set(hand: Hand, poses: int, seed: int) -> tuple[dict[str, NDArray], Counter]:
    """Generate the set.

    Args:
        hand: the hand at rest.
        poses: N, the number of shapes including the reference.
        seed: seed of the poses; the same seed gives the same set.

    Returns:
        The arrays of the NPZ file, and the number of rejected draws by pose family.

    Raises:
        ValueError: fewer than 2 poses.
    """
    if poses < 2:
        raise ValueError(f"poses: expected at least 2, got {poses}")
    inspector = Inspector(hand)
    shapes, names, rejected = [hand.vertices], ["rest"], Counter()
    for number, (family, extent) in enumerate(schedule(poses - 1)):
        rng = np.random.default_rng([seed, number])
        for _ in range(DRAWS):
            points = hand.skin(family(hand, rng, extent))
            if inspector.inside(points) <= MOST_INSIDE:
                break
            rejected[family.__name__] += 1
            extent *= 0.97
        else:
            raise RuntimeError(f"no sound pose of the family {family.__name__} in {DRAWS} draws")
        shapes.append(points)
        names.append(family.__name__)
    arrays = {
        "vertices": np.stack(shapes).astype(np.float32),
        "faces": hand.faces.astype(np.int32),
        "names": np.array(names),
    }
    return arrays, rejected


def main(
    source: Annotated[Path, typer.Argument(help="The file right.glb.")],
    out: Annotated[Path, typer.Argument(help="The NPZ file to write.")],
    poses: Annotated[
        int, typer.Option(help="Count of shapes, the reference included.", min=2)
    ] = 192,
    seed: Annotated[int, typer.Option(help="Seed of the poses.", min=0)] = 0,
) -> None:
    """Generate the hand training set from SOURCE and write it to OUT."""
    console = Console()
    try:
        hand = load_hand(source)
    except deformer.InputError as error:
        console.print(str(error), markup=False)
        raise typer.Exit(2) from None
    arrays, rejected = make_set(hand, poses, seed)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_npz(out, arrays)
    n, v, _ = arrays["vertices"].shape
    console.print(f"{out}: {n} shapes, {v} vertices, {len(arrays['faces'])} faces, z up")
    console.print(f"poses: {dict(Counter(arrays['names'].tolist()))}")
    console.print(f"rejected draws: {dict(rejected)}")


if __name__ == "__main__":
    typer.run(main)
