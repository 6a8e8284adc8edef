"""Keys, tracks and clips, as immutable values; and the state of every frame."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

import deformer
from deformer_app.viewer.edit import Edit, Handle, Orientation, Point, point, points
from deformer_app.viewer.timeline.interpolation import Curve

Ease = Literal["ease", "linear"]
EASES: tuple[Ease, ...] = ("ease", "linear")
Code = tuple[float, ...]
# The sliders' track, beside those of handles, which are named by the handle's id.
SLIDERS = -1
# A key's name: the track's owner (a handle's id, or SLIDERS) and the frame.
KeyName = tuple[int, int]
RATES = (12, 24, 25, 30, 60)
LONGEST = 20_000


@dataclass(frozen=True)
class Placement:
    """Where a handle is.

    Args:
        targets: a point for each of its vertices.
        orientation: of the handle, or None.
        gaps: of the handle, a vector for each target, or empty for zeros; None leaves the handle's.
    """

    targets: tuple[Point, ...]
    orientation: Orientation | None = None
    gaps: tuple[Point, ...] | None = None

    @classmethod
    def of(cls, handle: Handle) -> Placement:
        """The placement of a handle."""
        return cls(handle.targets, handle.orientation, handle.gaps)

    @property
    def of_first_vertex(self) -> Placement:
        """The placement of the first of several vertices."""
        return replace(self, targets=self.targets[:1], gaps=self.gaps and self.gaps[:1])

    @property
    def rows(self) -> list[list[float]]:
        """Targets, and behind them gaps (2n, 3)."""
        gaps = self.gaps or [(0.0, 0.0, 0.0)] * len(self.targets)
        return [list(p) for p in (*self.targets, *gaps)]


@dataclass(frozen=True)
class Key:
    """A value at a frame.

    Args:
        frame: from 0.
        value: a handle's placement, or the prior's mean (K,).
        ease: how the value goes on to the next key: "ease" or "linear".
    """

    frame: int
    value: Placement | Code
    ease: Ease = "ease"


@dataclass(frozen=True)
class Track:
    """The keys of one handle or of the sliders.

    Args:
        owner: the handle's id, or SLIDERS.
        keys: in ascending order of frames, all different; at least one.
        measured: true for keys that are measurements: in a frame without one the handle is not
            seen, and the fit does not follow what is between keys.
    """

    owner: int
    keys: tuple[Key, ...]
    measured: bool = False

    @property
    def frames(self) -> list[int]:
        """Frames that have a key."""
        return [key.frame for key in self.keys]

    def sees(self, frame: int) -> bool:
        """True if a fit follows the track at a frame."""
        return not self.measured or frame in self._frames

    @cached_property
    def _frames(self) -> frozenset[int]:
        return frozenset(self.frames)

    def with_keys(self, keys: Iterable[Key]) -> Track:
        """Return the track with keys added; one at the same frame is replaced."""
        by_frame = {key.frame: key for key in (*self.keys, *keys)}
        return replace(self, keys=tuple(by_frame[frame] for frame in sorted(by_frame)))

    @cached_property
    def _curve(self) -> Curve:
        places = [key.value for key in self.keys if isinstance(key.value, Placement)]
        rows: list[Sequence[float]] = [np.ravel(place.rows).tolist() for place in places]
        if len({len(row) for row in rows}) > 1:  # keyed with other vertices: the first one leads
            rows = [np.ravel(place.of_first_vertex.rows).tolist() for place in places]
        if not places:
            rows = [key.value for key in self.keys if not isinstance(key.value, Placement)]
        return Curve(self.frames, rows, [key.ease == "linear" for key in self.keys])

    def code(self, frame: int) -> Code:
        """The sliders' code (K,) at a frame."""
        return tuple(self._curve([frame])[0].tolist())

    def placement(self, frame: int) -> Placement:
        """The handle's placement at a frame: points and gaps on the curve, orientations by slerp.

        Between two keys of which one has no orientation it is that of the key before.
        """
        targets, vectors = self._curve([frame])[0].reshape(2, -1, 3)
        gaps = points(vectors) if vectors.any() else ()
        places = [key.value for key in self.keys if isinstance(key.value, Placement)]
        kept = any(place.gaps is None for place in places)
        return Placement(points(targets), self._orientation(frame), None if kept else gaps)

    def _orientation(self, frame: int) -> Orientation | None:
        before, share = self._curve.shares([frame])
        start, end = (self.keys[min(int(before[0]) + n, len(self.keys) - 1)].value for n in (0, 1))
        assert isinstance(start, Placement) and isinstance(end, Placement)
        if start.orientation is None or end.orientation is None or start == end:
            return start.orientation
        R = deformer.interpolate_rotations(
            np.array(start.orientation), np.array(end.orientation), float(share[0])
        )
        x, y, z = (point(row) for row in R)
        return (x, y, z)


@dataclass(frozen=True)
class Clip:
    """The keys of all handles and of the sliders. A handle without keys stays where it is.

    Args:
        length: number of frames.
        fps: frames a second.
        smoothness: of the fit, see `deformer.fit_sequence`; 0 keeps every key's pose.
        tracks: at most one an owner.
    """

    length: int = 48
    fps: int = 24
    smoothness: float = 0.0
    tracks: tuple[Track, ...] = ()

    def track(self, owner: int) -> Track | None:
        """The track of an owner, if it has keys."""
        return next((track for track in self.tracks if track.owner == owner), None)

    def key(self, name: KeyName) -> Key | None:
        """The key of a name, if there is one."""
        track = self.track(name[0])
        return next((k for k in track.keys if k.frame == name[1]), None) if track else None

    @property
    def names(self) -> list[KeyName]:
        """Names of all keys."""
        return [(track.owner, frame) for track in self.tracks for frame in track.frames]

    @cached_property
    def by_frame(self) -> dict[int, list[KeyName]]:
        """Names of all keys, by their frames."""
        found: dict[int, list[KeyName]] = {}
        for name in self.names:
            found.setdefault(name[1], []).append(name)
        return found

    @cached_property
    def linear(self) -> frozenset[KeyName]:
        """Names of the keys that go on to the next one straight."""
        return frozenset(
            (track.owner, key.frame)
            for track in self.tracks
            for key in track.keys
            if key.ease == "linear"
        )

    @property
    def posed_frames(self) -> list[int]:
        """Frames that have a key that is no measurement, in ascending order."""
        set_by_hand = [track for track in self.tracks if not track.measured]
        return sorted({frame for track in set_by_hand for frame in track.frames})

    def with_keys(self, keys: Iterable[tuple[int, Key]]) -> Clip:
        """Return the clip with keys added, each with its owner; it becomes as long as they need."""
        given: dict[int, list[Key]] = {}
        for owner, key in keys:
            given.setdefault(owner, []).append(key)
        owners = dict.fromkeys((*(track.owner for track in self.tracks), *given))
        tracks = tuple(
            (self.track(owner) or Track(owner, ())).with_keys(given.get(owner, ()))
            for owner in owners
        )
        last = max((key.frame for keys in given.values() for key in keys), default=0)
        return replace(self, tracks=tracks, length=max(self.length, last + 1))

    def without(self, names: Iterable[KeyName]) -> Clip:
        """Return the clip without some keys."""
        gone = set(names)
        kept = [
            replace(
                track, keys=tuple(key for key in track.keys if (track.owner, key.frame) not in gone)
            )
            for track in self.tracks
        ]
        return replace(self, tracks=tuple(track for track in kept if track.keys))

    def copied(self, names: Iterable[KeyName]) -> list[tuple[int, Key]]:
        """The keys of some names with their owners, for `with_keys`."""
        keys = [(name[0], self.key(name)) for name in sorted(names)]
        return [(owner, key) for owner, key in keys if key is not None]

    def moved(self, names: Iterable[KeyName], by: int) -> Clip:
        """Return the clip with some keys moved in time; keys where they come to are replaced.

        Args:
            names: of the keys.
            by: number of frames; the first key stops at frame 0.
        """
        keys = self.copied(names)
        by = shift_within(keys, by)
        moved = [(owner, replace(key, frame=key.frame + by)) for owner, key in keys]
        return self.without(names).with_keys(moved)

    def eased(self, names: Iterable[KeyName], ease: Ease) -> Clip:
        """Return the clip with some keys leading to the next ones in another way."""
        return self.with_keys((o, replace(key, ease=ease)) for o, key in self.copied(names))

    def next_key(self, frame: int, step: int) -> int | None:
        """The frame of the next key after (`step` 1) or before (−1) a frame; None if none is."""
        if step > 0:
            return min((f for f in self.by_frame if f > frame), default=None)
        return max((f for f in self.by_frame if f < frame), default=None)

    def at(self, edit: Edit, frame: int) -> Edit:
        """Return the state of a frame: a state's handles and sliders, the keyed ones placed."""
        handles = []
        for handle in edit.handles:
            track = self.track(handle.id)
            if track is not None:
                handle = placed(handle, track.placement(frame))
            handles.append(handle)
        sliders = self.track(SLIDERS)
        base = edit.base if sliders is None else sliders.code(frame)
        return replace(edit, base=base, handles=tuple(handles))


NO_KEYS = Clip()


def placed(handle: Handle, place: Placement) -> Handle:
    """Return a handle at a placement.

    One that had other vertices when it was keyed, such as a pin of another size, goes with its
    first vertex.
    """
    targets, gaps = place.targets, place.gaps
    if len(targets) != len(handle.targets):
        shift = np.array(targets[0]) - handle.targets[0]
        targets, gaps = points(np.array(handle.targets) + shift), handle.gaps
    gaps = handle.gaps if gaps is None else gaps
    return replace(handle, targets=targets, orientation=place.orientation, gaps=gaps)


def shift_within(keys: Sequence[tuple[int, Key]], by: int) -> int:
    """Number of frames that keys can be moved by, as near to `by` as 0…LONGEST − 1 allows."""
    frames = [key.frame for _, key in keys] or [0]
    return max(-min(frames), min(by, LONGEST - 1 - max(frames)))


def keys_of(edit: Edit, frame: int, owners: Iterable[int]) -> list[tuple[int, Key]]:
    """Keys of a state's handles and sliders, for `Clip.with_keys`.

    Args:
        edit: the state.
        frame: of the keys.
        owners: ids of handles, and SLIDERS for the prior's mean.
    """
    chosen = set(owners)
    keys = [
        (handle.id, Key(frame, Placement.of(handle)))
        for handle in edit.handles
        if handle.id in chosen
    ]
    return [*keys, *([(SLIDERS, Key(frame, edit.base))] if SLIDERS in chosen else [])]


def changed_owners(before: Edit, after: Edit) -> list[int]:
    """Owners of what is elsewhere in one state than in another: handles, new ones too, sliders."""
    known = {handle.id: Placement.of(handle) for handle in before.handles}
    moved = [h.id for h in after.handles if known.get(h.id) != Placement.of(h)]
    return [*moved, *([SLIDERS] if before.base != after.base else [])]


def continued(clip: Clip, keys: Iterable[tuple[int, Key]]) -> list[tuple[int, Key]]:
    """Return keys that go on to the next as those that they replace, or those before them, do.

    Args:
        clip: has the keys that are there.
        keys: owners and their new keys.
    """
    found = []
    for owner, key in keys:
        track = clip.track(owner)
        before = [k.ease for k in track.keys if k.frame <= key.frame] if track else []
        found.append((owner, replace(key, ease=before[-1] if before else key.ease)))
    return found
