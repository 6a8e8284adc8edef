"""Error measures between shapes and their reconstructions."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from deformer.errors import InputError
from deformer.mesh import FloatArray
from deformer.rotations import procrustes

Alignment = Literal["none", "centroid", "rigid"]


def e_rms(truth: ArrayLike, estimate: ArrayLike, align: Alignment = "centroid") -> float:
    """E_rms = 1000 · sqrt(Σ ‖p − p̂‖² / (3·V·N)) in the data's own units (Kavan et al. 2010).

    Args:
        truth: (N, V, 3) or (V, 3) true positions.
        estimate: same shape; reconstructed positions.
        align: what is taken out of each shape before: its centroid ("centroid", the paper's
            order of magnitude), the best rigid motion ("rigid"), or nothing ("none", right where
            control points fix the frame).

    Raises:
        InputError: the shapes of the arrays differ, or `align` is unknown.
    """
    return 1000.0 * float(np.sqrt((_differences(truth, estimate, align) ** 2).mean()))


def vertex_errors(truth: ArrayLike, estimate: ArrayLike, align: Alignment = "none") -> FloatArray:
    """Distances (N, V) or (V,) between true and estimated positions, in the data's own units."""
    distances = np.linalg.norm(_differences(truth, estimate, align), axis=-1)
    return distances.reshape(np.asarray(truth).shape[:-1])


def _differences(truth: ArrayLike, estimate: ArrayLike, align: Alignment) -> FloatArray:
    p = np.asarray(truth, dtype=np.float64)
    e = np.asarray(estimate, dtype=np.float64)
    if p.shape != e.shape or p.ndim not in (2, 3) or p.shape[-1] != 3:
        raise InputError(
            f"truth and estimate: expected equal shapes (N, V, 3) or (V, 3), got {p.shape} "
            f"and {e.shape}"
        )
    p, e = p.reshape(-1, *p.shape[-2:]), e.reshape(-1, *e.shape[-2:])
    if align == "none":
        return p - e
    if align == "centroid":
        return (p - p.mean(1, keepdims=True)) - (e - e.mean(1, keepdims=True))
    if align == "rigid":
        moved = np.empty_like(e)
        for n in range(len(e)):
            R, t = procrustes(e[n], p[n])
            moved[n] = e[n] @ R.T + t
        return p - moved
    raise InputError(f"align: expected 'none', 'centroid' or 'rigid', got {align!r}")
