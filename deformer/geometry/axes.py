"""Signed permutations of the axes, and points whose axes are other ones than a reference's."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np

from deformer.geometry.mesh import FloatArray

# Points are turned by an axis permutation if undoing it leaves less than this share of their
# distance from the reference, and what is left of the turn is less than so many degrees.
_MUCH_NEARER = 0.75
_LEFT_OVER = 25.0
# Second singular value of points that determine a rotation, as a share of the first one.
_FLAT = 0.05


def _signed_axes() -> FloatArray:
    """The proper signed permutations (24, 3, 3), the identity first."""
    found = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    proper = [P for P in found if np.linalg.det(P) > 0]
    return np.array(sorted(proper, key=lambda P: -np.trace(P)))


PROPER_AXES = _signed_axes()


def axes_text(P: FloatArray) -> str:
    """A signed permutation as the coordinates it gives: "-x, y, z" for the mirror image in x."""
    words = []
    for row in P:
        axis = int(np.abs(row).argmax())
        words.append(("-" if row[axis] < 0 else "") + "xyz"[axis])
    return ", ".join(words)


def axis_turn(shapes: FloatArray, references: FloatArray) -> FloatArray | None:
    """The axis permutation P (3, 3) that brings all shapes, p → P p, to where a reference is.

    Shapes and references are compared about their centroids, each shape with the nearest of the
    references. None where turning the shapes brings them hardly nearer, where no P is the turn
    between them, or where too few points are seen to tell.

    Args:
        shapes: (F, n, 3) positions of the same points in one or more poses, NaN where not seen.
        references: (R, n, 3) positions of the points as they may be; the turn is from the
            first.
    """
    from deformer.geometry.rotations import closest_rotations  # not to read a mesh: numba

    seen = np.atleast_2d(np.isfinite(shapes).all(axis=2))
    pairs = [
        (q[s] - q[s].mean(axis=0), references[:, s] - references[:, s].mean(axis=1, keepdims=True))
        for q, s in zip(shapes, seen, strict=True)
        if s.sum() >= 4
    ]
    if not pairs:
        return None
    spread = np.linalg.svd(np.concatenate([r[0] for _, r in pairs]), compute_uv=False)
    if not spread[1] > _FLAT * spread[0]:
        return None
    R = closest_rotations(sum(r[0].T @ q for q, r in pairs))
    P = PROPER_AXES[np.einsum("kij,ij->k", PROPER_AXES, R).argmax()]
    cosine = np.clip((np.trace(R @ P.T) - 1) / 2, -1.0, 1.0)
    if np.array_equal(P, np.eye(3)) or np.degrees(np.arccos(cosine)) > _LEFT_OVER:
        return None
    off = sum(((q @ P.T - r) ** 2).sum(axis=(1, 2)).min() for q, r in pairs)
    as_is = sum(((q - r) ** 2).sum(axis=(1, 2)).min() for q, r in pairs)
    return P if off < _MUCH_NEARER**2 * as_is else None
