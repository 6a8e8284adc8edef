"""Clips in the file of a session."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from typing import Any

from deformer import InputError, io
from deformer_app.viewer.edit import point
from deformer_app.viewer.edit_json import read_gaps
from deformer_app.viewer.timeline.keys import (
    EASES,
    LONGEST,
    RATES,
    SLIDERS,
    Clip,
    Key,
    Placement,
    Track,
)


def clips_as_json(clips: Iterable[Clip]) -> dict[str, Any]:
    """Return what `read_clips` reads: each track once, and clips with their indices."""
    tracks: dict[Track, int] = {}
    rows = [
        {
            "length": clip.length,
            "fps": clip.fps,
            "smoothness": clip.smoothness,
            "tracks": [tracks.setdefault(track, len(tracks)) for track in clip.tracks],
        }
        for clip in clips
    ]
    return {"tracks": [_track_as_json(track) for track in tracks], "clips": rows}


def _track_as_json(track: Track) -> dict[str, Any]:
    keys = [_key_as_json(key) for key in track.keys]
    return {"owner": track.owner, "measured": track.measured, "keys": keys}


def _key_as_json(key: Key) -> dict[str, Any]:
    value = asdict(key.value) if isinstance(key.value, Placement) else {"code": key.value}
    return {"frame": key.frame, "ease": key.ease, **value}


def read_clips(data: io.JsonValue) -> list[Clip]:
    """Read the clips of a session; none from one of an earlier version, without a timeline.

    Raises:
        InputError: a part is missing or damaged; the message names it.
    """
    if "clips" not in data:
        return []
    tracks = [_track(item) for item in data["tracks"].items()]
    return [_clip(item, tracks) for item in data["clips"].items()]


def _clip(item: io.JsonValue, tracks: Sequence[Track]) -> Clip:
    chosen = [tracks[n] for n in item["tracks"].integers(0, len(tracks) - 1)]
    if len({track.owner for track in chosen}) < len(chosen):
        raise item["tracks"].error("one track an owner", "restore the file")
    fps = item["fps"].integer()
    if fps not in RATES:
        raise item["fps"].error(f"one of {', '.join(map(str, RATES))}", "restore the file")
    length = item["length"].integer(1, LONGEST)
    smoothness = item["smoothness"].number(least=0, most=io.LARGEST)
    return Clip(length, fps, smoothness, tuple(chosen))


def _track(item: io.JsonValue) -> Track:
    owner = item["owner"].integer(least=SLIDERS)
    keys = [_key(entry, owner) for entry in item["keys"].items()]
    frames = [key.frame for key in keys]
    if not keys or frames != sorted(set(frames)):
        raise item["keys"].error("keys at ascending frames, at least one", "restore the file")
    return Track(owner, tuple(keys), item["measured"].flag())


def _key(item: io.JsonValue, owner: int) -> Key:
    frame, ease = item["frame"].integer(0, LONGEST - 1), item["ease"].choice(EASES)
    if owner == SLIDERS:
        return Key(frame, item["code"].numbers(largest=io.LARGEST), ease)
    targets = tuple(point(p.numbers(3, largest=io.LARGEST)) for p in item["targets"].items())
    if not targets:
        raise item["targets"].error("at least one point", "restore the file")
    orientation = None
    if item["orientation"].value is not None:
        x, y, z = (point(row) for row in item["orientation"].rotation())
        orientation = (x, y, z)
    # In sessions of earlier versions gaps were the handles'.
    keyed = "gaps" in item and item["gaps"].value is not None
    gaps = read_gaps(item, len(targets)) if keyed else None
    return Key(frame, Placement(targets, orientation, gaps), ease)


def check_clip_fits(clip: Clip, components: int, where: str) -> None:
    """Raise InputError unless a clip's codes are of a model.

    Args:
        clip: the clip.
        components: dimensions K of the model's codes.
        where: begins the message.
    """
    for track in clip.tracks:
        for key in track.keys:
            if not isinstance(key.value, Placement) and len(key.value) != components:
                raise InputError(
                    f"{where}: the key at frame {key.frame} has {len(key.value)} numbers of a "
                    f"code, expected {components}; restore the file"
                )
