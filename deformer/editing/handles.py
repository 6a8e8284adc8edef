"""Handles, which ask for positions of vertices, and the pose that a solver finds for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer.checks import LARGEST, as_array, checked_array, checked_indices, shortened
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.model import DeformationModel

# Targets farther away, in bounding diagonals, would overflow in single precision.
FARTHEST = 1e10


@dataclass(frozen=True)
class Handle:
    """A vertex that the user controls.

    Args:
        vertex: index of the vertex.
        target: (3,) its target position, in the data's units.
        weight: factor on its squared distance from the target.
        hard: true if the vertex is at the target exactly.
    """

    vertex: int
    target: tuple[float, float, float]
    weight: float = 1.0
    hard: bool = False


@dataclass(frozen=True, eq=False)
class Pose:
    """The solution of a handle fit. Lengths are in the data's units, arrays float64.

    Args:
        vertices: (V, 3) positions.
        z: (K,) latent code.
        rotation: (3,) rotation vector of the rigid motion about the reference's centroid, radians.
        translation: (3,) translation of the rigid motion.
        residual: (H,) distances from handle to target, in the order of the handles.
        iterations: Gauss–Newton steps taken, summed over all starts.
        milliseconds: time of the solve.
        prior_distance: Mahalanobis distance of z from the prior's mean.
        energy: value of `HandleEnergy` at the solution.
    """

    vertices: FloatArray
    z: FloatArray
    rotation: FloatArray
    translation: FloatArray
    residual: FloatArray
    iterations: int
    milliseconds: float
    prior_distance: float
    energy: float


def check_target(
    target: FloatArray, centroid: FloatArray, diagonal: float, name: str = "position:"
) -> None:
    """Refuse a target that is not finite, or that no solve in single precision can serve.

    Args:
        target: (3,) position, in the data's units.
        centroid: (3,) of the model's reference.
        diagonal: the reference's bounding diagonal.
        name: what the message calls the target.

    Raises:
        InputError: a number that is not finite, or a distance of more than `FARTHEST` diagonals.
    """
    if not np.isfinite(target).all():
        raise InputError(f"{name} {target.tolist()} is not finite")
    away = np.abs(target - centroid).max() / diagonal
    if away > FARTHEST:
        raise InputError(
            f"{name} {target.tolist()} is {away:.3g} bounding diagonals away from the model, "
            f"expected at most {FARTHEST:g}; check its units"
        )


def check_handles(
    model: DeformationModel,
    vertices: ArrayLike,
    targets: ArrayLike,
    weights: ArrayLike | None,
    hard: ArrayLike,
) -> tuple[IntArray, FloatArray, FloatArray, NDArray[np.bool_]]:
    """Check handles and return them as arrays.

    Args:
        model: the model whose vertices they are.
        vertices: (H,) vertex indices.
        targets: (H, 3) positions.
        weights: (H,) positive factors, or None for ones.
        hard: one for all, or (H,): true for exact handles.

    Returns:
        Vertices (H,) integers, targets (H, 3) float64, weights (H,) float64, hard (H,) bool.

    Raises:
        InputError: an index out of range, a target that `check_target` refuses, a weight that is
            not positive, or lengths that differ.
    """
    index, goals = as_array(vertices, "vertices"), checked_array(targets, "targets", finite=False)
    if index.size == 0:
        index, goals = index.reshape(0), goals.reshape(-1, 3)
    index = checked_indices(index, "vertices", len(model.reference.vertices))
    H = len(index)
    if goals.shape != (H, 3):
        raise InputError(f"targets: expected ({H}, 3), one a handle, got {goals.shape}")
    factors = np.ones(H) if weights is None else checked_array(weights, "weights", finite=False)
    exact = as_array(hard, "hard")
    if exact.dtype != bool and exact.size:
        raise InputError(f"hard: expected true or false, got {shortened(hard)}; give one or (H,)")
    exact = exact.astype(bool)
    if exact.ndim == 0:
        exact = np.broadcast_to(exact, (H,))
    for name, array in (("weights", factors), ("hard", exact)):
        if array.shape != (H,):
            raise InputError(f"{name}: expected ({H},), one a handle, got {array.shape}")
    centroid, diagonal = model.poisson.centroid, model.reference.bounding_diagonal
    for h in range(H):
        check_target(goals[h], centroid, diagonal, f"handle {h}: target")
        if not 0 < factors[h] <= LARGEST:
            raise InputError(
                f"handle {h}: weight {factors[h]} is not a positive number up to {LARGEST:g}"
            )
    return index, goals, factors, exact
