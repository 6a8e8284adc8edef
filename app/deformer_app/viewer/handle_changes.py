"""Changes of handles: pure functions from an `Edit` or `Handle` to the next one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer import Mesh, Symmetry, spread
from deformer_app.viewer.edit import Edit, Handle, Kind, point
from deformer_app.viewer.gizmo import Motion

_REGION_TARGETS = 8  # vertices of a painted region that have targets


def with_kind(handles: Iterable[Handle], kind: Kind, vertices: NDArray) -> list[Handle]:
    """Make handles soft, exact or pins; a pin's targets are where its vertices are.

    Args:
        handles: to change.
        kind: of all of them.
        vertices: (V, 3) the surface that is shown.
    """
    if kind != "pin":
        return [replace(handle, kind=kind) for handle in handles]
    return [
        replace(h, kind=kind, targets=tuple(point(p) for p in vertices[list(h.vertices)]))
        for h in handles
    ]


def centred_at(handles: Sequence[Handle], centre: ArrayLike) -> list[Handle]:
    """Shift handles together so that the mean of their centres is a point (3,)."""
    before = np.mean([handle.centre for handle in handles], axis=0)
    shift = np.asarray(centre, dtype=np.float64) - before
    return [handle.moved(lambda p: p + shift) for handle in handles]


def turned(handles: Iterable[Handle], motion: Motion) -> list[Handle]:
    """Turn the orientations of handles, where they have one, by a motion; targets stay."""
    return [
        h if h.orientation is None else h.oriented(motion.matrix @ np.array(h.orientation))
        for h in handles
    ]


def region_handle(number: int, region: Iterable[int], reference: Mesh, shown: NDArray) -> Handle:
    """Make one handle of a region; a few of its vertices, far from each other, have targets.

    Args:
        number: id of the handle.
        region: its vertices.
        reference: the undeformed mesh, on which distances are measured.
        shown: (V, 3) the surface that is shown; targets are where the vertices are now.
    """
    patch = np.array(sorted(region), dtype=np.int64)
    rest = reference.vertices[patch]
    chosen = patch[spread(rest - rest.mean(axis=0), _REGION_TARGETS)]
    return Handle(
        number,
        tuple(chosen.tolist()),
        tuple(point(p) for p in shown[chosen]),
        patch=tuple(patch.tolist()),
    )


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
    flip = np.eye(3) - 2.0 * np.outer(symmetry.normal, symmetry.normal)
    for handle in sources:
        vertices = tuple(symmetry.opposite[list(handle.vertices)].tolist())
        patch = tuple(sorted(set(symmetry.opposite[list(handle.patch)].tolist())))
        there = [h for h in edit.handles if set(h.vertices) & set(vertices)]
        if any(h.id == handle.id for h in there):
            continue
        copy = replace(
            handle,
            id=there[0].id if there else number,
            vertices=vertices,
            targets=tuple(point(p) for p in symmetry.mirror(handle.targets)),
            patch=patch,
        )
        if handle.orientation is not None:
            copy = copy.oriented(flip @ np.array(handle.orientation) @ flip)
        number += not there
        changed.append(copy)
    return changed
