"""Recognises handle targets whose axes are other ones than the model's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import checked_array, checked_instance
from deformer.editing.handles import Point, check_points
from deformer.geometry import SurfacePoints, axes_text, axis_turn
from deformer.model import DeformationModel

# Poses of the training with which targets are compared, and frames of a sequence.
_EXAMPLES, _FRAMES = 24, 25


def axis_warning(
    model: DeformationModel, vertices: ArrayLike | Sequence[Point], targets: ArrayLike
) -> str | None:
    """A warning if the targets are turned from the model by 90° or 180° as a whole; else None.

    Files of programs with another axis up are so. The turn must be about the coordinate axes, and
    undoing it must bring the targets much nearer to the model's reference and examples. So for a
    model whose examples turn, turned targets are no reason to warn.

    Args:
        model: the model whose vertices they are.
        vertices: (H,) vertex indices, `SurfacePoint`s, or both; at least four.
        targets: (H, 3) positions, or (F, H, 3) in F frames, NaN where a handle is not seen.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    chosen = SurfacePoints(check_points(model, vertices), model.reference.faces)
    H = len(chosen.at(model.reference.vertices))
    frames = checked_array(targets, "targets", (H, 3), ("F", H, 3), finite=False)
    frames = frames.reshape(-1, H, 3)
    if H < 4 or not len(frames):
        return None
    frames = frames[np.unique(np.linspace(0, len(frames) - 1, _FRAMES).astype(int))]
    rest = chosen.at(model.reference.vertices)[None]
    # Most targets are not turned, and poses of the examples take time.
    if axis_turn(frames, rest) is None:
        return None
    codes = model.codes
    spaced = np.unique(np.linspace(0, len(codes) - 1, min(_EXAMPLES, len(codes))).astype(int))
    examples = [chosen.at(model.decode(codes[n])) for n in spaced]
    P = axis_turn(frames, np.concatenate([rest, np.array(examples).reshape(-1, H, 3)]))
    if P is None:
        return None
    return (
        "the targets are turned from the model as a whole, as if another axis pointed up; if so, "
        f"give them the model's axes: {axes_text(P)} in place of x, y, z"
    )
