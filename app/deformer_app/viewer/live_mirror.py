"""Both sides at once: what is done to a handle is done to its mirror partner, too."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deformer import Symmetry
from deformer_app.viewer.edit import Edit, Handle
from deformer_app.viewer.handle_changes import image
from deformer_app.viewer.handle_names import opposite_name
from deformer_app.viewer.mirror_plane import MirrorPlane

# Distance of a handle from another's mirror image, in bounding diagonals, up to which the two are
# partners although their vertices are not opposite: a hand is seldom pressed at the same vertex.
_NEAR = 0.06
# What a partner takes over besides places and turns, once it changes.
_OPTIONS = ("kind", "weight", "orientation_weight", "radius")


class LiveMirror:
    """Completes changes of handles by those of the other side, while it is on.

    Partners are found by the sides of the rest shape, so that the pose may be asymmetric. Moves and
    turns are mirrored relative to where the partner was: nothing jumps when a pose is not
    symmetric; `handle_changes.mirrored` makes it so. Of a handle on the plane, its own partner, the
    part of a change that leaves it there is kept: moves within the plane, turns about its normal.

    Args:
        plane: the mirror plane.

    Attributes:
        on: true while changes are mirrored.
    """

    def __init__(self, plane: MirrorPlane) -> None:
        """Start switched off."""
        self.on = False
        self.plane = plane

    def switch(self) -> str | None:
        """Switch on or off; return why it cannot be switched on, if so."""
        if not self.on and not self.plane.is_symmetric:
            off = self.plane.symmetry.error
            return (
                f"This body has no two like sides to pose at once: mirror images are {off:.1%} of "
                "its size off; name a plane in the menu Handles"
            )
        self.on = not self.on
        return None

    def partner(self, handle: Handle, handles: Iterable[Handle]) -> Handle | None:
        """Return the partner of a handle among `handles`; itself if it is on the plane.

        The partner has an opposite vertex. Without such a handle, it is the one near the mirror
        image, if each of the two is the nearest one to the other's image.
        """
        handles = list(handles)
        opposite = self.plane.symmetry.opposite
        there = _vertices_opposite(handle, opposite)
        own = set(handle.vertices)
        if own & there:
            return handle
        for other in handles:
            if other.id != handle.id and (
                there & set(other.vertices) or own & _vertices_opposite(other, opposite)
            ):
                return other
        near = self._nearest(handle, handles)
        if near is None or self._nearest(near, handles) is not handle:
            return None
        # A drag of a soft handle does not release a pin beside its mirror image.
        return None if near.kind == "pin" and handle.kind != "pin" else near

    def _nearest(self, handle: Handle, handles: Iterable[Handle]) -> Handle | None:
        """The handle near the mirror image of another; painted regions are near none."""
        if _is_painted(handle):
            return None
        side, apart = self.plane.side, self.plane.apart
        across = [
            (apart(handle.vertices, other.vertices), other.id, other)
            for other in handles
            if not _is_painted(other) and side(handle.vertices) * side(other.vertices) < 0
        ]
        distance, _, other = min(across, default=(np.inf, 0, None))
        return other if distance <= _NEAR else None

    def with_partner(self, handle: Handle, handles: Iterable[Handle]) -> list[Handle]:
        """Return a handle and, while the mirror is on, its partner on the other side."""
        partner = self.partner(handle, handles) if self.on else None
        return [handle] if partner is None or partner is handle else [handle, partner]

    def pairs(self, handles: Iterable[Handle]) -> list[tuple[Handle, Handle]]:
        """Return each handle that has a partner, with it; nothing while the mirror is off."""
        every = list(handles)
        found = [(handle, self.partner(handle, every)) for handle in every] if self.on else []
        return [(handle, partner) for handle, partner in found if partner is not None]

    def completed(
        self,
        before: Edit,
        after: Edit,
        on_surface: Callable[[Handle], Handle],
        lead: Handle | None = None,
    ) -> Edit:
        """Return a changed state with the same changes of the other side.

        Args:
            before: the state before.
            after: the changed state.
            on_surface: puts a handle on the shown surface: new ones and pins are there.
            lead: while it is dragged, handles on its side lead and their partners follow. Without
                one, partners that have both been changed stay as they are.
        """
        if not self.on:
            return after
        old = {handle.id: handle for handle in before.handles}
        new = {handle.id: handle for handle in after.handles}
        for handle in before.handles:
            if handle.id not in new:
                partner = self.partner(handle, before.handles)
                if partner is not None:
                    after = after.without([partner.id])
        changed = [h for h in after.handles if h != old.get(h.id)]
        ids = {handle.id for handle in changed}
        number = max([*old, *new], default=0) + 1
        for handle in changed:
            was, partner = old.get(handle.id), self.partner(handle, after.handles)
            if partner is handle:
                after = after.with_handles([self._on_plane(was, handle)])
            elif partner is None:
                after = after.with_handles([self._new(handle, number, on_surface)])
                number += 1
            elif partner.id not in ids or (lead is not None and self._leads(handle, lead)):
                start = old.get(partner.id, partner)
                after = after.with_handles([self._follower(was, handle, start, on_surface)])
        return after

    def _leads(self, handle: Handle, lead: Handle) -> bool:
        """True if a handle is on the side of the rest on which `lead` is."""
        if handle.id == lead.id:
            return True
        side = self.plane.side
        return side(handle.vertices) * side(lead.vertices) > 0

    def _new(self, handle: Handle, number: int, on_surface: Callable[[Handle], Handle]) -> Handle:
        """The partner of a new handle, as far from its vertices as that is."""
        symmetry = self.plane.symmetry
        name = opposite_name(handle.name)
        other = replace(image(handle, symmetry), id=number, name=name)
        away = np.subtract(handle.targets, on_surface(handle).targets)
        return _shifted(on_surface(other), symmetry.mirror_directions(away))

    def _follower(
        self,
        was: Handle | None,
        now: Handle,
        partner: Handle,
        on_surface: Callable[[Handle], Handle],
    ) -> Handle:
        """The partner after the change of a handle from `was` to `now`."""
        symmetry = self.plane.symmetry
        other = replace(image(now, symmetry), name=partner.name)
        if was is None and not _vertices_opposite(now, symmetry.opposite) & set(partner.vertices):
            return partner  # it is near the mirror image, and moves from where it is
        if was is None or was.vertices != now.vertices or was.patch != now.patch:
            # Pinned, freed or resized: the partner's vertices change alike, where they are.
            return on_surface(replace(other, id=partner.id))
        options = {name: getattr(now, name) for name in _OPTIONS}
        changed = {name: to for name, to in options.items() if getattr(was, name) != to}
        partner = replace(partner, **changed)
        if now.kind == "pin" and was.kind != "pin":
            partner = on_surface(partner)
        elif was.targets != now.targets:
            moved = symmetry.mirror_directions(np.subtract(now.targets, was.targets))
            same = partner.vertices == other.vertices
            shift = moved if same else moved.mean(axis=0)
            partner = _shifted(partner, shift)
        if now.orientation is None:
            return replace(partner, orientation=None)
        if was.orientation is None or partner.orientation is None:
            return partner.oriented(np.array(other.orientation))
        turn = np.array(now.orientation) @ np.array(was.orientation).T
        return partner.oriented(symmetry.mirror_rotations(turn) @ np.array(partner.orientation))

    def _on_plane(self, was: Handle | None, now: Handle) -> Handle:
        """A handle on the plane with the symmetric part of its change."""
        if was is None or was.vertices != now.vertices:
            return now
        return _symmetric_part(self.plane.symmetry, was, now)


def _symmetric_part(symmetry: Symmetry, was: Handle, now: Handle) -> Handle:
    moved = np.subtract(now.targets, was.targets)
    across = moved.mean(axis=0)
    across = 0.5 * (across - symmetry.mirror_directions(across))
    found = _shifted(now, -across)
    if now.orientation is None or was.orientation is None:
        return found
    turn = symmetry.symmetric_rotations(np.array(now.orientation) @ np.array(was.orientation).T)
    return found.oriented(turn @ np.array(was.orientation))


def _is_painted(handle: Handle) -> bool:
    return handle.is_region and not handle.radius


def _vertices_opposite(handle: Handle, opposite: NDArray[np.int64]) -> set[int]:
    return set(opposite[list(handle.vertices)].tolist())


def _shifted(handle: Handle, shift: NDArray[np.float64]) -> Handle:
    return handle.moved(lambda p: np.asarray(p) + shift)
