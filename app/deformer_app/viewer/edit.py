"""The input of a pose, as immutable values: the handles and the prior's mean."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from deformer import BODIES as BODIES, Body as Body

Point = tuple[float, float, float]
Orientation = tuple[Point, Point, Point]  # a rotation matrix by rows
Kind = Literal["soft", "exact", "pin"]
KINDS: tuple[Kind, ...] = ("soft", "exact", "pin")

NOISE = 0.007  # in bounding diagonals; larger than a marker's, because a hand is less precise


@dataclass(frozen=True)
class Handle:
    """A handle: a vertex, or a painted region with targets for a few of its vertices.

    Args:
        id: number that no other handle of the session has.
        vertices: the vertices that have targets; one, unless it is a region.
        targets: a point for each of them.
        kind: "soft" (close to its target), "exact" (on it) or "pin" (on it, and drags leave it).
        weight: factor on the squared distance of the code's shape from the targets.
        patch: all vertices of a region; empty otherwise.
        orientation: rotation that the surface around a single vertex shall have, relative to the
            reference; None leaves it free.
        orientation_weight: of the orientation of a soft handle, beside `weight`.
        gaps: for each target the vector to it from where the code's shape is to be, see
            deformer.Handle; empty for zeros.
        radius: of a pin of a disc around its first vertex, geodesic, in bounding diagonals; `patch`
            has the disc's vertices. 0 for all other handles.
        name: that the user has given; empty for that of its place.
    """

    id: int
    vertices: tuple[int, ...]
    targets: tuple[Point, ...]
    kind: Kind = "soft"
    weight: float = 1.0
    patch: tuple[int, ...] = ()
    orientation: Orientation | None = None
    orientation_weight: float = 1.0
    gaps: tuple[Point, ...] = ()
    radius: float = 0.0
    name: str = ""

    @property
    def centre(self) -> Point:
        """Mean (3,) of the targets."""
        return point(np.mean(self.targets, axis=0))

    @property
    def is_region(self) -> bool:
        """True for a painted region."""
        return bool(self.patch)

    def moved(self, motion: Callable[[ArrayLike], Any]) -> Handle:
        """Return the handle with its targets moved; gaps turn with them."""
        targets = motion(np.array(self.targets))
        gaps = motion(np.array(self.targets) + np.array(self.gaps)) - targets if self.gaps else ()
        return replace(self, targets=points(targets), gaps=points(gaps))

    def at(self, targets: ArrayLike, gaps: ArrayLike = ()) -> Handle:
        """Return the handle with targets (n, 3), and gaps (n, 3) or none."""
        gaps = np.asarray(gaps)
        return replace(self, targets=points(targets), gaps=points(gaps) if gaps.any() else ())

    def oriented(self, rotation: ArrayLike) -> Handle:
        """Return the handle with a rotation (3, 3) as its orientation."""
        x, y, z = (point(row) for row in np.asarray(rotation))
        return replace(self, orientation=(x, y, z))


@dataclass(frozen=True)
class Solution:
    """A solution of the solver, from which HandleSolver.restore computes the same pose again.

    Args:
        z: (K,) latent code.
        rotation: (3,) rotation vector of the rigid motion, in radians.
        translation: (3,) of the rigid motion.
        final: true if it is the pose at rest; else the solver goes on from it.
        contacts: vertices by which it stands on the floor.
    """

    z: tuple[float, ...]
    rotation: Point
    translation: Point
    final: bool = True
    contacts: tuple[int, ...] = ()

    @classmethod
    def of_code(cls, z: tuple[float, ...]) -> Solution:
        """The pose of a code alone, which no handle pulls and nothing moves."""
        return cls(z, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Edit:
    """Everything that a pose depends on.

    Args:
        base: (K,) latent code that is the prior's mean: the pose without handles.
        handles: what the user drags.
        noise: expected distance of handles from their targets, in bounding diagonals; small ones
            follow the handles, large ones the prior. See HandleSolver.
        body: whether the body may turn and travel as a whole: "moves", "stays", or "auto", which
            yields to strong pulls; see the freedom of HandleSolver.
        floor: height of the floor along the model's up axis, in the data's units; None without one.
    """

    base: tuple[float, ...]
    handles: tuple[Handle, ...] = ()
    noise: float = NOISE
    body: Body = "auto"
    floor: float | None = None

    @property
    def settings(self) -> tuple[float, Body, float | None]:
        """Noise, body and floor: what a pose depends on beside its base and handles."""
        return self.noise, self.body, self.floor

    def handle(self, number: int) -> Handle:
        """Return the handle with an id."""
        return next(handle for handle in self.handles if handle.id == number)

    def with_handles(self, changed: Iterable[Handle]) -> Edit:
        """Return the edit with handles replaced by their ids; those with new ids come last."""
        new = {handle.id: handle for handle in changed}
        kept = [new.pop(handle.id, handle) for handle in self.handles]
        return replace(self, handles=(*kept, *new.values()))

    def without(self, ids: Iterable[int]) -> Edit:
        """Return the edit without some handles."""
        gone = set(ids)
        return replace(self, handles=tuple(h for h in self.handles if h.id not in gone))

    def arrays(self) -> dict[str, list[Any]]:
        """Return the arguments of HandleSolver.set_handles, lists with an entry a vertex."""
        rows = [
            {
                "vertices": vertex,
                "targets": target,
                "weights": handle.weight,
                "kinds": handle.kind,
                "orientations": handle.orientation,
                "orientation_weights": handle.orientation_weight,
                "gaps": gap,
            }
            for handle in self.handles
            for vertex, target, gap in zip(
                handle.vertices,
                handle.targets,
                handle.gaps or [(0.0, 0.0, 0.0)] * len(handle.targets),
                strict=True,
            )
        ]
        names = ("vertices", "targets", "weights", "kinds", "orientations", "orientation_weights")
        return {name: [row[name] for row in rows] for name in (*names, "gaps")}


def points(values: Any) -> tuple[Point, ...]:
    """Return points (n, 3) as tuples of floats."""
    return tuple(point(value) for value in values)


def point(values: Any) -> Point:
    """Return three numbers as a tuple of floats."""
    x, y, z = (float(value) for value in values)
    return (x, y, z)
