"""What a trained model's summary says of shapes and pieces that its codes do not tell well."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from deformer import DeformationModel

# Distance, in bounding diagonals, from which a shape or piece is named.
_FAR = 0.02


def advice(model: DeformationModel, names: list[str] | None) -> list[str]:
    """Lines about the training shape and the piece that the codes put far from where they were.

    Args:
        model: just trained.
        names: the file of each shape that was read; None if one file has all.
    """
    summary, K = model.summary, model.components
    most = len(model.codes) * (2 if summary.get("mirrored") else 1) - 1
    remedy = "add shapes" if most <= K else f"ask for more, e.g. --components {min(2 * K, most)}"

    def named(shape: int) -> str:
        return f"training shape {shape}" + (f" ({names[shape]})" if names else "")

    found = []
    if (far := summary.get("worst_place_distance", 0.0)) > _FAR:
        found.append(
            f"{named(summary['worst_place'])} comes back {far:.1%} of the bounding diagonal beside "
            "its place: the form of these shapes does not tell where they stand"
        )
    off = []
    if (far := summary.get("worst_shape_rms", 0.0)) > _FAR:
        off.append((named(summary["worst_shape"]), far))
    if (far := summary.get("worst_piece_rms", 0.0)) > _FAR:
        off.append((f"the piece of vertex {summary['worst_piece_vertex']}", far))
    return found + [
        f"{what} comes back from its code {far:.1%} of the bounding diagonal off: {K} components "
        f"do not tell it; {remedy}"
        for what, far in off
    ]
