"""How many components suit a number of shapes."""

from __future__ import annotations

MOST = 50  # components, unless the user asks for more: the default of `deformer train`
# Training adds the mirror images of a symmetric body's shapes, so that there are twice as many.
_EACH = 2


def suggested_components(shapes: int) -> int:
    """Return the number of components for a number of shapes, if the user does not choose."""
    return max(1, min(MOST, _EACH * shapes))


def comment(components: int, shapes: int) -> str:
    """Return what to tell of a choice of components; empty if they suit the shapes."""
    enough = _EACH * shapes
    if components <= enough:
        return ""
    return (
        f"{components} components for {shapes} shapes: {enough} can tell the shapes and their "
        "mirror images apart; more find little to learn."
    )
