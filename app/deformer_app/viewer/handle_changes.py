"""Changes of handles: pure functions from an `Edit` or `Handle` to the next one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer import DeformationModel, Mesh, Symmetry, local_rotations, spread
from deformer_app.viewer.edit import Edit, Handle, Kind, Solution, point, points
from deformer_app.viewer.gizmo import Motion
from deformer_app.viewer.handle_names import opposite_name
from deformer_app.viewer.mirror_plane import MirrorPlane

_REGION_TARGETS = 8  # vertices of a painted region that have targets
# Vertices of a pin's disc that have targets, its centre first: enough that the others keep their
# places within a thousandth of the body's size.
_PIN_TARGETS = 14
# Shorter gaps, in bounding diagonals, are rounding.
_LEAST_GAP = 1e-5


def with_kind(handles: Iterable[Handle], kind: Kind, vertices: NDArray) -> list[Handle]:
    """Make handles soft, exact or pins.

    A pin's targets are where its vertices are; it goes on to pull the prior to where they were, so
    that the pose stays. A soft handle has no gaps but those that it was placed with.

    Args:
        handles: to change.
        kind: of all of them.
        vertices: (V, 3) the surface that is shown.
    """
    return [_of_kind(handle, kind, vertices) for handle in handles]


def _of_kind(handle: Handle, kind: Kind, vertices: NDArray) -> Handle:
    if kind == "pin":
        here = vertices[list(handle.vertices)]
        return replace(handle, kind=kind).at(
            here, gaps_of(handle) + here - np.array(handle.targets)
        )
    handle = _without_disc(handle)
    softened = kind == "soft" != handle.kind
    return replace(handle, kind=kind, gaps=() if softened else handle.gaps)


def gaps_of(handle: Handle) -> NDArray:
    """Return the gaps (n, 3) of a handle, zeros where it has none."""
    return np.array(handle.gaps) if handle.gaps else np.zeros((len(handle.targets), 3))


def pulling(pin: Handle, pull: NDArray) -> Handle:
    """Return a pin whose centre alone takes over the pull (n, 3) of another on the prior.

    Shared by its vertices, the pull would move the pose.
    """
    gaps = gaps_of(pin)
    gaps[0] += pull.sum(axis=0)
    return pin.at(pin.targets, gaps)


def with_disc(handle: Handle, radius: float, model: DeformationModel) -> Handle:
    """Return a pin with the disc around its first vertex as its patch; targets are the reference's.

    Args:
        handle: a single vertex, or a pin with another disc.
        radius: geodesic, in bounding diagonals of the reference.
        model: the model, on whose reference distances are measured.
    """
    centre, rest = handle.vertices[0], model.reference.vertices
    inside = model.distances(centre) <= radius * model.reference.bounding_diagonal
    patch = np.flatnonzero(inside)
    # Far from the centre and from each other: the rim, in all directions.
    chosen = patch[spread(rest[patch] - rest[centre], _PIN_TARGETS)].tolist()
    vertices = (centre, *(v for v in chosen if v != centre))
    disc = replace(
        handle,
        vertices=vertices,
        patch=tuple(patch.tolist()),
        radius=radius,
        orientation=None,
    )
    return disc.at(rest[list(vertices)])


def _without_disc(handle: Handle) -> Handle:
    """Return the handle of the first vertex of a pin with a disc; others as they are."""
    if not handle.radius:
        return handle
    return replace(
        handle,
        vertices=handle.vertices[:1],
        targets=handle.targets[:1],
        patch=(),
        radius=0.0,
        gaps=handle.gaps[:1],
    )


def centred_at(handles: Sequence[Handle], centre: ArrayLike) -> list[Handle]:
    """Shift handles together so that the mean of their centres is a point (3,)."""
    before = np.mean([handle.centre for handle in handles], axis=0)
    shift = np.asarray(centre, dtype=np.float64) - before
    return [handle.moved(lambda p: p + shift) for handle in handles]


def on_shape(
    handle: Handle, model: DeformationModel, shape: NDArray, code_shape: NDArray
) -> Handle:
    """Return a handle on a surface that is shown, where it changes nothing.

    Args:
        handle: at any place.
        model: the model.
        shape: (V, 3) the surface.
        code_shape: (V, 3) the shape of its code, which exact handles have deformed to the surface.

    Returns:
        The handle with its targets at its vertices, with gaps from the code's shape, and with the
        orientation that the surface has there if it has one.
    """
    at = list(handle.vertices)
    gaps = shape[at] - code_shape[at]
    long = np.abs(gaps).max(axis=1) > _LEAST_GAP * model.reference.bounding_diagonal
    placed = handle.at(shape[at], np.where(long[:, None], gaps, 0.0))
    if handle.orientation is None:
        return placed
    return placed.oriented(local_rotations(model, at[:1], shape)[0])


def surroundings(handles: Iterable[Handle], shown: NDArray, reach: float) -> NDArray:
    """Return the corners of what is around handles.

    Args:
        handles: their targets, vertices and patches are what is surrounded.
        shown: (V, 3) the surface that is shown.
        reach: distance from a point of the handles that belongs to its surroundings.

    Returns:
        (n, 3) points at that distance along the axes; none without handles.
    """
    own = [p for h in handles for p in (*h.targets, *shown[[*h.vertices, *h.patch]])]
    points = np.reshape(own, (-1, 1, 3))
    return (points + reach * np.vstack([np.eye(3), -np.eye(3)])).reshape(-1, 3)


def turned(handles: Iterable[Handle], motion: Motion) -> list[Handle]:
    """Turn the orientations of handles, where they have one, by a motion; targets stay."""
    return [
        h if h.orientation is None else h.oriented(motion.matrix @ np.array(h.orientation))
        for h in handles
    ]


def region_handle(number: int, region: Iterable[int], reference: Mesh) -> Handle:
    """Make one handle of a region; a few of its vertices, far from each other, have targets.

    The targets are where the reference has these vertices.

    Args:
        number: id of the handle.
        region: its vertices.
        reference: the undeformed mesh, on which distances are measured.
    """
    patch = np.array(sorted(region), dtype=np.int64)
    rest = reference.vertices[patch]
    chosen = patch[spread(rest - rest.mean(axis=0), _REGION_TARGETS)]
    return Handle(
        number,
        tuple(chosen.tolist()),
        points(reference.vertices[chosen]),
        patch=tuple(patch.tolist()),
    )


def image(handle: Handle, symmetry: Symmetry) -> Handle:
    """Return the mirror image of a handle, with its id: opposite vertices, mirrored targets.

    A name changes sides, too; one without a side stays.
    """
    mirrored = replace(
        handle,
        vertices=tuple(symmetry.opposite[list(handle.vertices)].tolist()),
        targets=points(symmetry.mirror(handle.targets)),
        patch=tuple(sorted(set(symmetry.opposite[list(handle.patch)].tolist()))),
        gaps=points(symmetry.mirror_directions(gaps_of(handle))) if handle.gaps else (),
        name=opposite_name(handle.name) or handle.name,
    )
    if handle.orientation is None:
        return mirrored
    return mirrored.oriented(symmetry.mirror_rotations(handle.orientation))


def mirrored(
    edit: Edit, sources: Iterable[Handle], symmetry: Symmetry, number: int
) -> list[Handle]:
    """Copy handles to the other side; a handle that is there already gets the copy's targets.

    Args:
        edit: the state with all handles.
        sources: handles to copy; one on the plane, its own mirror image, is left out.
        symmetry: the plane, and the vertex opposite each vertex.
        number: id of the first new handle; the next ones count on.
    """
    changed = []
    for handle in sources:
        copy = image(handle, symmetry)
        there = [h for h in edit.handles if set(h.vertices) & set(copy.vertices)]
        if any(h.id == handle.id for h in there):
            continue
        name = there[0].name if there else opposite_name(handle.name)
        changed.append(replace(copy, id=there[0].id if there else number, name=name))
        number += not there
    return changed


def mirrored_edit(edit: Edit, plane: MirrorPlane) -> Edit:
    """Return the mirror image of a whole state: its handles, under their ids, and its base.

    Handles on the plane are mirrored, too.
    """
    handles = tuple(image(handle, plane.symmetry) for handle in edit.handles)
    return replace(edit, base=plane.mirrored_code(edit.base), handles=handles)


def mirrored_solution(solution: Solution, plane: MirrorPlane) -> Solution:
    """Return the mirror image of a solution, for the solver to go on from."""
    symmetry = plane.symmetry
    turn = point(-symmetry.mirror_directions(solution.rotation))
    translation = point(symmetry.mirror_directions(solution.translation))
    return Solution(plane.mirrored_code(solution.z), turn, translation, final=False)
