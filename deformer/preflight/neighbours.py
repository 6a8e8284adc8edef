"""Shapes that differ from quiet neighbours in the order of the set, such as one moved far away."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from deformer.geometry import FloatArray, IntArray, ShapeSequence
from deformer.preflight.report import Finding, Labels
from deformer.workspace import blocks

# Neighbours on either side; at the ends of the set, as many in all.
_SIDE = 3
# Neighbours are quiet if none differs from the next by more than this part of the odd shape's
# distance from all of them.
_QUIET = 0.5
# Where more than this part of the shapes is odd, the set moves so.
_FEW = 0.3
# Distance, in bounding diagonals, from which on a shape is moved away.
_AWAY = 1.0

# Distances (n,) of shapes (n,) from others (n,).
Distance = Callable[[IntArray, IntArray], FloatArray]


def around(shapes: IntArray, n: int) -> IntArray:
    """The neighbours of n among `shapes`, which are in order; all if there are few."""
    others = shapes[shapes != n]
    most = 2 * _SIDE
    first = np.clip(np.searchsorted(others, n) - _SIDE, 0, max(len(others) - most, 0))
    return others[first : first + most]


def beside(neighbours: IntArray, n: int) -> IntArray:
    """The neighbours next to n, given in order: one on either side, or one at an end."""
    place = int(np.searchsorted(neighbours, n))
    return neighbours[max(place - 1, 0) : place + 1]


def are_quiet(neighbours: IntArray, n: int, distance: Distance, least: float) -> bool:
    """True if n is farther than `least` from all neighbours, and each of them near the next."""
    if len(neighbours) < 3:
        return False
    away = distance(np.full(len(neighbours), n), neighbours).min()
    steps = distance(neighbours[:-1], neighbours[1:])
    return bool(away > least and steps.max() < _QUIET * away)


def odd_ones(shapes: IntArray, distance: Distance, least: float) -> dict[int, IntArray]:
    """Shapes unlike all their neighbours, which are like each other, and these neighbours.

    A set that moves steadily, or far for more than one shape, has none.

    Args:
        shapes: (n,) in order.
        distance: between shapes.
        least: distance from which on a shape is unlike another.
    """
    if len(shapes) < 4:
        return {}
    # The two beside each shape; at the ends the next two.
    pair = np.clip(np.arange(len(shapes)), 1, len(shapes) - 2)[:, None] + [-1, 1]
    pair[[0, -1]] = [[1, 2], [len(shapes) - 3, len(shapes) - 2]]
    before, after = shapes[pair].T
    nearest = np.minimum(distance(shapes, before), distance(shapes, after))
    odd = shapes[(nearest > least) & (distance(before, after) < _QUIET * nearest)]
    if len(odd) > _FEW * len(shapes):
        return {}
    rest = np.setdiff1d(shapes, odd)
    near = {n: around(rest, n) for n in odd.tolist()}
    return {n: m for n, m in near.items() if are_quiet(m, n, distance, least)}


def moved(
    shapes: ShapeSequence, diagonals: FloatArray, excluded: set[int], label: Labels
) -> list[Finding]:
    """Warnings of shapes far away from neighbours that lie near each other.

    Args:
        shapes: the set.
        diagonals: (N,) of the bounding boxes.
        excluded: shapes that something else is wrong with.
        label: names shapes.
    """
    kept = np.array([n for n in range(len(shapes)) if n not in excluded], dtype=np.int64)
    vertices = shapes.vertices
    centres = np.concatenate([vertices[part].mean(axis=1) for part in blocks(vertices)])
    size = max(float(np.median(diagonals)), 1e-300)

    def distance(one: IntArray, other: IntArray) -> FloatArray:
        return np.linalg.norm(centres[one] - centres[other], axis=1) / size

    findings = []
    for n, near in odd_ones(kept, distance, _AWAY).items():
        back = centres[beside(near, n)].mean(axis=0) - centres[n]
        away = distance(np.full(len(near), n), near).min()
        steps = distance(near[:-1], near[1:]).max()
        findings.append(
            Finding(
                "warning",
                "moved",
                f"{label([n])} lies {away:.3g} bounding diagonals away from its neighbours, which "
                f"lie within {steps:.2g} of each other, expected a place near theirs; move it by "
                f"{[float(f'{x:.6g}') for x in back]}",
                (n,),
                values={"by": back.tolist()},
            )
        )
    return findings
