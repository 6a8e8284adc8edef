"""Handles, which ask for positions of vertices, and the pose that a solver finds for them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer.checks import (
    LARGEST,
    as_array,
    checked_array,
    checked_choice,
    checked_flag,
    checked_indices,
    checked_instance,
    checked_integer,
    checked_number,
    rounded,
    shortened,
)
from deformer.errors import InputError
from deformer.geometry import (
    MOST_ORIENTATION_WEIGHT,
    FloatArray,
    SurfacePoint,
    checked_rotations,
    plain_point,
)
from deformer.model import DeformationModel

# "soft" handles are close to their targets, "exact" ones and pins are on them; drags leave pins.
Kind = Literal["soft", "exact", "pin"]
KINDS: tuple[Kind, ...] = ("soft", "exact", "pin")
# A handle's place on the mesh: a vertex, or a point of the surface.
Point = int | SurfacePoint

# Targets farther away, in bounding diagonals, would overflow in single precision.
FARTHEST = 1e10
# Least noise of a sequence, in bounding diagonals: with less the descent over all frames stalls.
LEAST_SEQUENCE_NOISE = 0.007


@dataclass(frozen=True)
class Handle:
    """A vertex, or a point of the surface, that the user controls.

    Args:
        vertex: index of the vertex, or the point.
        target: (3,) its target position, in the data's units.
        weight: factor on its squared distance from the target.
        kind: "soft" for near the target, "exact" for on it, "pin" for on it, and never dragged.
        orientation: rotation of the surface around the vertex, relative to the reference, as a
            unit quaternion (w, x, y, z) or a matrix (3, 3); None leaves it free.
        orientation_weight: factor on the squared error of the orientation, beside `weight`.
        gap: (3,) vector from where the code's shape is to be to the target. Exact handles deform
            the code's shape: a handle that is set on the deformed surface changes nothing with the
            gap that it finds there (`surface_gaps`), and a handle that becomes a pin where the
            surface is goes on to pull as before.

    Raises:
        InputError: a vertex that is neither an index nor a `SurfacePoint`, a target or gap that is
            not three finite numbers, a weight that is not positive, a kind that is none, or an
            orientation that is no rotation.
    """

    vertex: Point
    target: tuple[float, float, float]
    weight: float = 1.0
    kind: Kind = "soft"
    orientation: ArrayLike | None = None
    orientation_weight: float = 1.0
    gap: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        """Check the arguments, and make plain numbers of numpy's."""
        vertex = self.vertex
        if not isinstance(vertex, SurfacePoint):
            remedy = "give the index of a vertex, or a SurfacePoint"
            vertex = checked_integer(vertex, "vertex", least=0, remedy=remedy)
        target = checked_array(self.target, "target", (3,)).tolist()
        weight = checked_number(self.weight, "weight", above=0, most=LARGEST)
        checked_choice(self.kind, "kind", KINDS)
        rows = None
        if self.orientation is not None:
            turn = checked_rotations(self.orientation, "orientation", ())
            rows = None if np.isnan(turn).any() else tuple(map(tuple, turn.tolist()))
        name, most = "orientation_weight", MOST_ORIENTATION_WEIGHT
        factor = checked_number(self.orientation_weight, name, above=0, most=most)
        gap = tuple(checked_array(self.gap, "gap", (3,), largest=LARGEST).tolist())
        plain = {"vertex": vertex, "target": tuple(target), "weight": weight, "orientation": rows}
        for field, value in {**plain, name: factor, "gap": gap}.items():
            object.__setattr__(self, field, value)

    @property
    def hard(self) -> bool:
        """True if the vertex is at the target exactly."""
        return self.kind != "soft"


@dataclass(frozen=True, eq=False)
class Pose:
    """The solution of a handle fit. Lengths are in the data's units, arrays float64.

    Args:
        vertices: (V, 3) positions.
        z: (K,) latent code.
        rotation: (3,) rotation vector of the rigid motion about the reference's centroid, radians.
        translation: (3,) translation of the rigid motion.
        residual: (H,) distances from handle to target, in the order of the handles.
        orientation_residual: (H,) angles from the surface's rotation around each handle to its
            orientation, in radians; NaN for handles without one.
        iterations: Gauss–Newton steps taken, summed over all starts.
        milliseconds: time of the solve.
        prior_distance: Mahalanobis distance of z from the prior's mean.
        energy: value of `HandleEnergy` at the solution.
        contacts: vertices by which the shape stands on the floor, if there is one.
    """

    vertices: FloatArray
    z: FloatArray
    rotation: FloatArray
    translation: FloatArray
    residual: FloatArray
    orientation_residual: FloatArray
    iterations: int
    milliseconds: float
    prior_distance: float
    energy: float
    contacts: tuple[int, ...] = ()


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
            f"{name} {target.tolist()} is {rounded(away)} bounding diagonals away from the model, "
            f"expected at most {FARTHEST:g}; check its units"
        )


def target_noise(model: DeformationModel, deviation: float, *, sequence: bool = False) -> float:
    """Noise for `HandleSolver` and `fit_sequence` where targets have errors of a known size.

    Soft handles miss their targets by two errors that do not depend on each other: the targets' own
    one, and that of the model, for which its `handle_noise` was chosen. Their variances add up.

    Args:
        model: the model.
        deviation: standard deviation of each of the targets' coordinates, in the data's units.
        sequence: true for `fit_sequence`, which needs a noise of at least `LEAST_SEQUENCE_NOISE`.

    Returns:
        σ, in bounding diagonals of the model's reference.

    Raises:
        InputError: a deviation that is not a finite number above 0.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    checked_number(deviation, "deviation", above=0, most=LARGEST)
    checked_flag(sequence, "sequence")
    own = max(model.handle_noise, LEAST_SEQUENCE_NOISE if sequence else 0.0)
    found = float(np.hypot(own, deviation / model.reference.bounding_diagonal))
    return checked_number(found, "deviation: its share of the bounding diagonal", most=LARGEST)


def check_points(model: DeformationModel, vertices: ArrayLike | Sequence[Point]) -> list[Point]:
    """Check the places of handles.

    Args:
        model: the model whose vertices they are.
        vertices: (H,) vertex indices, `SurfacePoint`s, or both.

    Returns:
        Vertices as integers; also points that are one.

    Raises:
        InputError: an index out of range.
    """
    V = len(model.reference.vertices)
    given = list(vertices) if isinstance(vertices, list | tuple) else vertices
    if isinstance(given, SurfacePoint):
        raise InputError("vertices: expected a list of points, got one; put it into a list")
    if not isinstance(given, list) or not any(isinstance(p, SurfacePoint) for p in given):
        index = as_array(given, "vertices")
        index = index.reshape(0) if index.size == 0 else index
        return checked_indices(index, "vertices", V).tolist()
    points: list[Point] = []
    for h, point in enumerate(given):
        name = f"vertices[{h}]"
        if isinstance(point, SurfacePoint):
            checked_indices(point.vertices, name, V)
            points.append(plain_point(point))
        else:
            points += checked_indices([point], name, V).tolist()
    return points


def closed_point(model: DeformationModel, point: Point) -> Point:
    """A checked point of a model's reference as one of its surface without seams."""
    return plain_point(model.seams.close_point(point))


def check_handles(
    model: DeformationModel,
    vertices: ArrayLike | Sequence[Point],
    targets: ArrayLike,
    weights: ArrayLike | None,
    hard: ArrayLike,
    kinds: Kind | Sequence[Kind] | None = None,
) -> tuple[list[Point], FloatArray, FloatArray, list[Kind]]:
    """Check handles and return them as lists and arrays.

    Args:
        model: the model whose vertices they are.
        vertices: (H,) as in `check_points`.
        targets: (H, 3) positions.
        weights: (H,) positive factors, or None for ones.
        hard: one for all, or (H,): true for exact handles.
        kinds: one for all, or (H,), in place of `hard`.

    Returns:
        Points H, targets (H, 3) float64, weights (H,) float64, kinds H.

    Raises:
        InputError: an index out of range, a target that `check_target` refuses, a weight that is
            not positive, a kind that is none, kinds and `hard` at once, or lengths that differ.
    """
    points, goals = check_points(model, vertices), checked_array(targets, "targets", finite=False)
    H = len(points)
    if not H:
        goals = goals.reshape(-1, 3)
    if goals.shape != (H, 3):
        raise InputError(f"targets: expected ({H}, 3), one a handle, got {goals.shape}")
    factors = np.ones(H) if weights is None else checked_array(weights, "weights", finite=False)
    if factors.shape != (H,):
        raise InputError(f"weights: expected ({H},), one a handle, got {factors.shape}")
    chosen = check_kinds(hard, kinds, (H,))
    centroid, diagonal = model.poisson.centroid, model.reference.bounding_diagonal
    for h in range(H):
        check_target(goals[h], centroid, diagonal, f"handle {h}: target")
        if not 0 < factors[h] <= LARGEST:
            raise InputError(
                f"handle {h}: weight {factors[h]} is not a positive number up to {LARGEST:g}"
            )
    return points, goals, factors, chosen.tolist()


def check_kinds(
    hard: ArrayLike, kinds: Kind | Sequence[Kind] | None, shape: tuple[int, ...]
) -> NDArray:
    """Kinds of handles, of a shape (..., H).

    Args:
        hard: true for "exact", false for "soft": one for all, (H,), or of the shape.
        kinds: one for all, or (H,), in place of `hard`.
        shape: of the result.

    Raises:
        InputError: other values, other shapes, or both given.
    """
    H = shape[-1]
    exact = as_array(hard, "hard")
    if exact.dtype != bool and exact.size:
        raise InputError(f"hard: expected true or false, got {shortened(hard)}; give one or (H,)")
    if kinds is None:
        name, chosen = "hard", np.where(exact.astype(bool), "exact", "soft")
    elif exact.any():
        raise InputError("kinds: expected them or hard=True, got both; leave one out")
    else:
        several = isinstance(kinds, Iterable) and not isinstance(kinds, str)
        each = np.atleast_1d(as_array(kinds, "kinds")).tolist() if several else [kinds]
        for kind in each:
            checked_choice(kind, "kinds", KINDS)
        name, chosen = "kinds", np.array(each if several else kinds)
    if chosen.shape not in ((), (H,), shape):
        raise InputError(f"{name}: expected ({H},), one a handle, got {chosen.shape}")
    return np.broadcast_to(chosen, shape)
