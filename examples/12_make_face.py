"""Make the training set of the model "face": expressions of a face, and mixtures of them.

Source: ICT-FaceKit (University of Southern California, Institute for Creative Technologies; MIT):

    git clone https://github.com/ICT-VGL/ICT-FaceKit
    python examples/12_make_face.py ICT-FaceKit/FaceXModel face.npz --mixtures 120 --seed 0

An NPZ with the neutral face and the 55 expressions in the order of their file names may stand for
the folder. The skin of face, head and neck is reduced to about 4,400 of its own vertices, the same
on both sides, most of them where expressions strain it. Shape 0 is the neutral face; then come the
single expressions, the two-sided ones on both sides, and drawn mixtures.

The NPZ holds `vertices` float32 (N, V, 3) in centimetres, y up, looking along +z; `faces` int32
(F, 3); `names`, what every shape is.
`14_name_components.py` names the components of a model that was trained from the set.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from face.expressions import mix, schedule
from face.kit import Face, load_face
from face.reduction import reduce_face
from numpy.typing import NDArray
from rich.console import Console

import deformer
from deformer.io import write_npz

VERTICES = 4400


def make_set(
    face: Face, mixtures: int, seed: int, vertex_count: int | None = VERTICES
) -> dict[str, NDArray]:
    """Generate the set.

    Args:
        face: the kit's face.
        mixtures: number of drawn mixtures after the kit's own expressions.
        seed: seed of the mixtures; the same seed gives the same set.
        vertex_count: V of the reduced mesh, about; None keeps all vertices.

    Returns:
        The arrays of the NPZ file.

    Raises:
        deformer.InputError: the neutral face is not symmetric.
        ValueError: a negative number of mixtures, or the face cannot be reduced so far.
    """
    if mixtures < 0:
        raise ValueError(f"mixtures: expected 0 or more, got {mixtures}")
    if vertex_count is not None:
        face = reduce_face(face, vertex_count)
    plan = schedule(mixtures, seed)
    return {
        "vertices": np.stack([mix(face, weights) for _, weights in plan]).astype(np.float32),
        "faces": face.faces.astype(np.int32),
        "names": np.array([name for name, _ in plan]),
    }


def main(
    source: Annotated[Path, typer.Argument(help="The kit's folder FaceXModel, or an NPZ.")],
    out: Annotated[Path, typer.Argument(help="The NPZ file to write.")],
    mixtures: Annotated[int, typer.Option(help="Count of drawn mixtures.", min=0)] = 120,
    seed: Annotated[int, typer.Option(help="Seed of the mixtures.", min=0)] = 0,
) -> None:
    """Generate the face training set from SOURCE and write it to OUT."""
    console = Console()
    try:
        arrays = make_set(load_face(source), mixtures, seed)
    except deformer.InputError as error:
        console.print(str(error), markup=False)
        raise typer.Exit(2) from None
    out.parent.mkdir(parents=True, exist_ok=True)
    write_npz(out, arrays)
    n, v, _ = arrays["vertices"].shape
    console.print(f"{out}: {n} shapes, {v} vertices, {len(arrays['faces'])} faces, y up")


if __name__ == "__main__":
    typer.run(main)
