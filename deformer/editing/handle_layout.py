"""Which vertices to use as handles: those that tell most about all others, by what was learned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer.checks import (
    as_array,
    check_memory,
    checked_flag,
    checked_indices,
    checked_instance,
    checked_integer,
    checked_number,
)
from deformer.editing.misfit_field import MisfitField
from deformer.editing.position_field import PositionField, variance_reductions
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, Mesh, edges, farthest_rows, most_symmetric
from deformer.linalg import one_blas_thread
from deformer.model import DeformationModel

# Vertices that stand for all: at least so many, and so many for each handle.
_SITES, _SITES_A_HANDLE = 700, 4
# Share of the handle fit's noise that exact targets are assumed to have: without any, the best
# second handle is often right beside the first.
_LEAST_NOISE = 1.0 / 3.0
# Rounds in which each handle may move.
_ROUNDS = 2
# A handle moves only where the gain grows by this share: rounding must not decide.
_LEAST_GAIN = 1e-6
# Greatest `Symmetry.error` of a symmetric body; training shapes among which the most symmetric one
# is looked for; candidates on the plane of symmetry.
_SYMMETRIC, _POSES, _MIDDLE = 0.02, 16, 100


@dataclass(frozen=True, eq=False)
class Layout:
    """Handle vertices of a model, and what they leave uncertain. Lengths are in the data's units.

    Args:
        vertices: (N,) int64 the handles' vertices. With several counts asked for, the first n are
            the layout for n.
        deviation: (V,) float64 standard deviation of each vertex's position if those of the handles
            are known: the root of the summed variances of x, y and z.
        pairs: (P, 2) int64 indices into `vertices`: left and right.
        region: (V,) int64 index into `vertices` of the handle nearest over the surface.
        spacing: (N,) float64 distance over the surface from each handle to the nearest other one.
        expected: count → root mean square of `deviation` with so many handles, for every count.
    """

    vertices: IntArray
    deviation: FloatArray
    pairs: IntArray
    region: IntArray
    spacing: FloatArray
    expected: dict[int, float]

    @property
    def region_deviation(self) -> FloatArray:
        """Root mean square (N,) of `deviation` over each handle's region."""
        count = len(self.vertices)
        size = np.maximum(np.bincount(self.region, minlength=count), 1)
        return np.sqrt(np.bincount(self.region, self.deviation**2, count) / size)


def layout(
    model: DeformationModel,
    count: int | Sequence[int],
    *,
    symmetric: bool = False,
    fixed: ArrayLike = (),
    exclude: ArrayLike = (),
    noise: float = 0.0,
) -> Layout:
    """Choose the vertices whose positions tell most about the positions of all vertices.

    Before any handle is known, positions have the Gaussian distribution of `PositionField`. Handles
    are added one by one where they reduce the summed variance of all vertices most; then each in
    turn is moved to where it does. Only what the model has learned is used, no shape.

    Args:
        model: the prior.
        count: number of handles; or several, for one nested layout: the handles for each count are
            the first ones of those for the next.
        symmetric: true for handles in left/right pairs or on the plane of symmetry.
        fixed: (n,) vertices that are handles in any case; they count.
        exclude: (m,) vertices that must not be handles.
        noise: standard deviation, per axis, that the handles' positions will have in use, in
            bounding diagonals of the reference; 0 for exact ones.

    Raises:
        InputError: a count below 1, below the number of fixed vertices or above the number of
            vertices that may be handles, an index out of range or given twice, a vertex both fixed
            and excluded, a body without symmetry, or a noise that is negative.
    """
    checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
    V = len(model.reference.vertices)
    given = [count] if np.ndim(as_array(count, "count")) == 0 else list(count)  # pyright: ignore
    counts = sorted({checked_integer(n, "count", least=1) for n in given})
    checked_flag(symmetric, "symmetric")
    checked_number(noise, "noise", least=0, most=1)
    kept = _distinct(fixed, "fixed", V)
    banned = _distinct(exclude, "exclude", V)
    # Vertices at one place in all shapes are one.
    seams = model.seams
    allowed = np.ones(len(seams.first), dtype=bool)
    allowed[seams.closed[banned]] = False
    both = kept[~allowed[seams.closed[kept]]]
    if len(both):
        raise InputError(f"fixed: vertex {both[0]} is excluded, too; leave it out of one of them")
    again = np.setdiff1d(np.arange(len(kept)), _firsts(seams.closed[kept]))
    if len(again):
        raise InputError(
            f"fixed: vertex {kept[again[0]]} lies on another one; leave one of them out"
        )
    if not counts or counts[0] < max(len(kept), 1):
        raise InputError(
            f"count: expected at least {max(len(kept), 1)}, the number of fixed vertices, got "
            f"{counts[0] if counts else 'none'}; ask for more handles"
        )
    if counts[-1] > allowed.sum():
        raise InputError(
            f"count: expected at most {allowed.sum()}, the number of vertices that may be handles, "
            f"got {counts[-1]}; ask for fewer"
        )
    with one_blas_thread():
        found = _layout(model.closed, counts, symmetric, seams.closed[kept], allowed, noise)
    vertices = seams.first[found.vertices]
    vertices[: len(kept)] = kept
    return replace(
        found,
        vertices=vertices,
        deviation=found.deviation[seams.closed],
        region=found.region[seams.closed],
    )


def _layout(
    model: DeformationModel,
    counts: list[int],
    symmetric: bool,
    fixed: IntArray,
    allowed: NDArray[np.bool_],
    noise: float,
) -> Layout:
    v, D = model.reference.vertices, model.reference.bounding_diagonal
    most = min(len(v), max(_SITES, _SITES_A_HANDLE * counts[-1]))
    check_memory(4 * 8 * (3 * most) ** 2, f"count: {counts[-1]} handles")
    spread = farthest_rows(v, most)[0]
    groups = [spread[allowed[spread], None]]
    if len(groups[0]) < min(most, allowed.sum()):
        # Excluded vertices leave too few of the sites to choose from.
        rest = np.flatnonzero(allowed)
        groups = [rest[farthest_rows(v[rest], min(len(rest), most // 2))[0], None]]
        spread = np.concatenate([spread, groups[0][:, 0]])
    if symmetric:
        groups = _mirrored_groups(model, groups[0][:, 0], allowed)
        spread = spread if len(groups[1]) < most // 4 else groups[1].ravel()
    sites = np.unique(np.concatenate([fixed, spread, *(group.ravel() for group in groups)]))
    misfit = MisfitField(model, sites)
    field = PositionField.of_prior(model, misfit)
    spread_noise = D * max(noise, _LEAST_NOISE * model.handle_noise)
    choice = _Choice(
        field.covariance(),
        misfit.weights,
        spread_noise**2,
        [np.searchsorted(sites, group) for group in groups],
        np.searchsorted(sites, fixed),
    )
    deviations: dict[int, FloatArray] = {}
    for n in counts:
        handles = choice.extend(n)
        deviations[n] = field.deviation(field.observed(sites[handles], spread_noise))
    vertices = sites[np.concatenate(choice.chosen)]
    pairs, at = [], 0
    for group in choice.chosen:
        if len(group) == 2:
            pairs.append((at, at + 1))
        at += len(group)
    distance = np.stack([model.geodesics.row(int(vertex)) for vertex in vertices])
    apart = distance[:, vertices] + np.diag(np.full(len(vertices), np.inf))
    return Layout(
        vertices,
        deviations[counts[-1]],
        np.array(pairs, dtype=np.int64).reshape(-1, 2),
        distance.argmin(axis=0),
        apart.min(axis=1),
        {n: float(np.sqrt(np.mean(found**2))) for n, found in deviations.items()},
    )


class _Choice:
    """A choice of handles among sites, and the covariance of all sites given the handles.

    Args:
        covariance: C (3S, 3S) of the sites before any handle is known.
        weights: (S,) of the sites in the summed variance.
        noise: variance of a handle's position per axis; positive.
        candidates: sites (n, 1) and (m, 2) that are chosen alone and in pairs.
        fixed: (f,) sites that are handles in any case.
    """

    def __init__(
        self,
        covariance: FloatArray,
        weights: FloatArray,
        noise: float,
        candidates: list[IntArray],
        fixed: IntArray,
    ) -> None:
        """Choose the fixed sites."""
        self._C, self._weights, self._noise = covariance, np.repeat(weights, 3), noise
        self._candidates = [group for group in candidates if len(group)]
        self._index = [_coordinates(group) for group in self._candidates]
        self.chosen = [np.array([site]) for site in fixed]
        self._condition()

    def extend(self, count: int) -> IntArray:
        """Choose handles until there are `count`; those chosen by earlier calls stay.

        Returns:
            (count,) sites.

        Raises:
            InputError: there are not so many candidates.
        """
        first = len(self.chosen)
        while (missing := count - self._size) > 0:
            best, _ = self._best(missing)
            self.chosen.append(best)
            self._observe(best)
        for _ in range(_ROUNDS):
            if not any([self._move(n) for n in range(first, len(self.chosen))]):
                break
            self._condition()
        return np.concatenate(self.chosen)

    @property
    def _size(self) -> int:
        return sum(len(group) for group in self.chosen)

    def _move(self, n: int) -> bool:
        """Move handle or pair n to where it reduces the variance most; False if it is there."""
        group = self.chosen[n]
        self._release(n)
        best, moved = self._best(len(group), len(group), group)
        self.chosen.insert(n, best)
        self._observe(best)
        return moved

    def _best(
        self, most: int, least: int = 1, now: IntArray | None = None
    ) -> tuple[IntArray, bool]:
        """The free candidate of `least` to `most` sites that gains most a site, and True.

        `now` and False if no other gains more than `now`.

        Raises:
            InputError: no candidate is free.
        """
        taken = np.zeros(len(self._C) // 3, dtype=bool)
        taken[np.concatenate([np.empty(0, dtype=np.int64), *self.chosen])] = True
        best, highest, reached = now, -np.inf, -np.inf
        for groups, gains in zip(self._candidates, self._gains(), strict=True):
            if not least <= groups.shape[1] <= most:
                continue
            gains = np.where(taken[groups].any(axis=1), -np.inf, gains / groups.shape[1])
            if now is not None:
                reached = gains[(groups == now).all(axis=1)].max(initial=-np.inf)
            if gains.max() > max(highest, reached + _LEAST_GAIN * abs(reached)):
                best, highest = groups[gains.argmax()], gains.max()
        if best is None:
            raise InputError(
                f"count: expected at most {self._size} handles, for no more vertices are left to "
                "choose from, got more; ask for fewer"
            )
        return best, best is not now

    def _gains(self) -> list[FloatArray]:
        """Reductions (n,) of the summed variance by a handle at each candidate."""
        return [
            variance_reductions(own, reduced, self._noise)
            for own, reduced in zip(self._own, self._reduced, strict=True)
        ]

    def _condition(self) -> None:
        """The covariance given the chosen handles, anew: rounding of updates does not add up."""
        self._P = self._C.copy()
        self._own, self._reduced = [], []
        for index in self._index:
            rows = self._P[index]
            self._own.append(np.take_along_axis(rows, index[:, None, :], axis=2))
            self._reduced.append((rows * self._weights) @ rows.transpose(0, 2, 1))
        for group in self.chosen:
            self._observe(group)

    def _observe(self, group: IntArray) -> None:
        """Condition the covariance on handles at a group (m,)."""
        index = _coordinates(group[None])[0]
        V = self._P[:, index]
        self._update(V, _inverse(V[index] + self._noise * np.eye(len(index))))

    def _release(self, n: int) -> None:
        """Take group n of the chosen ones back.

        With the precision A = (C_hh + noise I)⁻¹ of all handles h and its columns A_g of the group,
        P changes by V A_gg⁻¹ Vᵀ, V = C_h A_g.
        """
        index = _coordinates(np.concatenate(self.chosen)[:, None]).ravel()
        A = _inverse(self._C[np.ix_(index, index)] + self._noise * np.eye(len(index)))
        first = 3 * sum(len(group) for group in self.chosen[:n])
        own = slice(first, first + 3 * len(self.chosen.pop(n)))
        self._update(self._C[:, index] @ A[:, own], -_inverse(A[own, own]))

    def _update(self, V: FloatArray, S: FloatArray) -> None:
        """Change P to P − V S Vᵀ, and with it the blocks P_gg and P_g W P_gᵀ of all candidates."""
        weighted = self._weights[:, None] * V
        across, square = self._P @ weighted, V.T @ weighted
        VS = V @ S
        self._P -= VS @ V.T
        for n, rows in enumerate(self._index):
            own, solved = V[rows], VS[rows]
            self._own[n] -= solved @ own.transpose(0, 2, 1)
            mixed = solved @ across[rows].transpose(0, 2, 1)
            self._reduced[n] += solved @ square @ solved.transpose(0, 2, 1)
            self._reduced[n] -= mixed + mixed.transpose(0, 2, 1)


def _inverse(A: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(A), dtype=np.float64)


def _coordinates(groups: IntArray) -> IntArray:
    """Rows (n, 3m) of the x, y, z of groups (n, m) of sites."""
    return (3 * groups[..., None] + np.arange(3)).reshape(len(groups), -1)


def _firsts(values: IntArray) -> IntArray:
    """Index of the first of each of the values (n,)."""
    return np.unique(values, return_index=True)[1]


def _distinct(values: ArrayLike, name: str, count: int) -> IntArray:
    found = checked_indices(np.atleast_1d(as_array(values, name)), name, count)
    unique, times = np.unique(found, return_counts=True)
    if len(unique) < len(found):
        raise InputError(
            f"{name}: vertex {unique[times > 1][0]} is given twice; leave one of them out"
        )
    return found


def _mirrored_groups(
    model: DeformationModel, sites: IntArray, allowed: NDArray[np.bool_]
) -> list[IntArray]:
    """Candidates (n, 1) on the plane of symmetry, and pairs (m, 2) of left and right.

    The plane is that of the most symmetric of the reference and some training shapes.

    Args:
        model: the prior.
        sites: vertices spread over the mesh; those of one side are paired with their opposites.
        allowed: (V,) true for vertices that may be handles.
    """
    N, faces = len(model.codes), model.reference.faces
    poses = np.unique(np.linspace(0, N - 1, min(N, _POSES)).round().astype(int))
    shapes = [model.reference, *(Mesh(p, faces) for p in model.decode(model.codes[poses]))]
    symmetry, n = most_symmetric(shapes)
    if symmetry.error > _SYMMETRIC:
        raise InputError(
            f"symmetric: mirrored, even the most symmetric training shape is off by "
            f"{symmetry.error:.1%} of its size, expected at most {_SYMMETRIC:.0%}; leave symmetric "
            "out"
        )
    v = shapes[n].vertices
    height = (v - symmetry.point) @ symmetry.normal
    length = np.linalg.norm(np.subtract(*v[edges(faces).T]), axis=1)
    on_plane = np.abs(height) <= 0.5 * np.median(length)
    if not (on_plane & allowed).any():
        on_plane[np.where(allowed, np.abs(height), np.inf).argmin()] = True
    left = sites[(height[sites] > 0) & ~on_plane[sites]]
    pairs = np.stack([left, symmetry.opposite[left]], axis=1)
    pairs = pairs[allowed[pairs].all(axis=1) & ~on_plane[pairs[:, 1]]]
    # Two vertices of one side may have the same opposite.
    pairs = pairs[np.unique(pairs[:, 1], return_index=True)[1]]
    if not len(pairs):
        raise InputError(
            "symmetric: no two vertices that may be handles lie opposite each other; leave "
            "symmetric out"
        )
    middle = np.flatnonzero(on_plane & allowed)
    spread = farthest_rows(model.reference.vertices[middle], min(len(middle), _MIDDLE))[0]
    return [middle[spread, None], pairs]
