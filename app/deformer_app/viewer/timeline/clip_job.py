"""The fit of a clip in the background: its progress, and a flag to stop it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import DeformationModel, Floor
from deformer_app.viewer.edit import Edit, Handle, Solution, point
from deformer_app.viewer.handle_changes import on_shape
from deformer_app.viewer.timeline.keys import Clip

# Rounds of rigid relaxation a frame: as many as a pose has that is solved for alone, so that a
# frame that is keyed is about that pose again.
RELAXATION = 20


@dataclass(frozen=True)
class Request:
    """What a fit depends on.

    Args:
        clip: the keys.
        edit: the state of the clip's first frame: handles without keys, noise, body, floor. Its
            handles have no names: a new one is no reason for another fit.
    """

    clip: Clip
    edit: Edit

    @classmethod
    def of(cls, clip: Clip, edit: Edit) -> Request:
        """The request of a clip and a state of any of its frames."""
        first = clip.at(edit, 0)
        return cls(clip, first.with_handles(replace(h, name="") for h in first.handles))


@dataclass(frozen=True, eq=False)
class FittedClip:
    """The shapes of a clip.

    Args:
        request: what was fitted.
        vertices: (F, V, 3) the shapes.
        z: (F, K) their codes.
        rotation, translation: (F, 3) rigid motions, as in `deformer.Pose`.
    """

    request: Request
    vertices: NDArray[np.float64]
    z: NDArray[np.float64]
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]

    def on_surface(self, model: DeformationModel, handle: Handle, frame: int) -> Handle:
        """Return a handle on the shape of a frame, where it changes nothing."""
        shape, motion = self.vertices[frame], (self.rotation[frame], self.translation[frame])
        code_shape = deformer.posed_shape(model, self.z[frame], *motion)
        return on_shape(handle, model, shape, code_shape)

    def solution(self, frame: int) -> Solution:
        """Code and rigid motion of a frame."""
        return Solution(
            tuple(self.z[frame].tolist()),
            point(self.rotation[frame]),
            point(self.translation[frame]),
        )


def fit_clip(
    model: DeformationModel, request: Request, on_progress: Callable[[int, int], None]
) -> FittedClip:
    """Fit the frames of a clip, with the parameters that the pose in the window has.

    Args:
        model: the prior.
        request: what is fitted.
        on_progress: as in `deformer.fit_sequence`.

    Raises:
        InputError: see `deformer.fit_sequence`.
    """
    clip, edit = request.clip, request.edit
    frames = [clip.at(edit, frame) for frame in range(clip.length)]
    codes = np.array([frame.base for frame in frames])
    if not edit.handles:
        still = np.zeros((len(frames), 3))
        return FittedClip(request, model.decode(codes), codes, still, still)
    kept, seen = _seen_rows(clip, edit)
    rows = [_rows(frame, kept) for frame in frames]
    first = rows[0]
    weights = np.array([row["weights"] for row in rows], dtype=np.float64)
    found = deformer.fit_sequence(
        model,
        first["vertices"],
        np.array([row["targets"] for row in rows], dtype=np.float64),
        weights=np.where(seen, weights, 0.0),
        kinds=first["kinds"],
        orientations=[
            [turn if here else None for turn, here in zip(row["orientations"], saw, strict=True)]
            for row, saw in zip(rows, seen, strict=True)
        ],
        orientation_weights=first["orientation_weights"],
        gaps=np.array([row["gaps"] for row in rows], dtype=np.float64),
        floor=None if edit.floor is None else Floor.at(model, edit.floor),
        smoothness=clip.smoothness,
        key_frames=clip.posed_frames,
        noise=edit.noise,
        mean=codes,
        freedom=edit.body,
        relaxation=RELAXATION,
        on_progress=on_progress,
    )
    return FittedClip(request, found.vertices, found.z, found.rotation, found.translation)


def _rows(edit: Edit, kept: list[int]) -> dict[str, list[Any]]:
    """Some rows of `Edit.arrays`."""
    return {name: [values[n] for n in kept] for name, values in edit.arrays().items()}


def _seen_rows(clip: Clip, edit: Edit) -> tuple[list[int], NDArray[np.bool_]]:
    """Rows of `Edit.arrays` that any frame sees, one a vertex, and which frames see them (F, H).

    They are in the order in which `deformer fit` reads the exported frames: sums depend on it in
    their last digits.
    """
    once = list({vertex: n for n, vertex in enumerate(edit.arrays()["vertices"])}.values())
    owners = [handle.id for handle in edit.handles for _ in handle.vertices]
    tracks = [clip.track(owners[n]) for n in once]
    seen = np.array(
        [[t is None or t.sees(frame) for t in tracks] for frame in range(clip.length)], dtype=bool
    )
    by_first = np.argsort(seen.argmax(axis=0), kind="stable").tolist()
    order = [n for n in by_first if seen[:, n].any()]
    return [once[n] for n in order], seen[:, order]


class _Cancelled(Exception):
    """Ends a fit that is no longer wanted."""


class ClipJob:
    """Fits a clip on a thread of its own.

    Args:
        model: the prior.
        request: what is fitted.

    Attributes:
        request: as given.
        progress: numbers of frames done and of all frames.
        result: the fitted clip, once it is there.
        error: what ended the fit, unless it was cancelled.
    """

    def __init__(self, model: DeformationModel, request: Request) -> None:
        """Start."""
        self.request = request
        self.progress = (0, request.clip.length)
        self.result: FittedClip | None = None
        self.error: Exception | None = None
        self._stop = False
        self._thread = threading.Thread(target=self._run, args=(model,), name="clip", daemon=True)
        self._thread.start()

    @property
    def done(self) -> bool:
        """True once there is a result or an error, or the fit has been cancelled."""
        return not self._thread.is_alive()

    def cancel(self) -> None:
        """Stop after the current step; there is no result."""
        self._stop = True

    def join(self, seconds: float) -> None:
        """Wait for the end at most so long."""
        self._thread.join(seconds)

    def _run(self, model: DeformationModel) -> None:
        try:
            self.result = fit_clip(model, self.request, self._report)
        except _Cancelled:
            pass
        except Exception as error:  # the window shows it
            self.error = error

    def _report(self, done: int, total: int) -> None:
        self.progress = (done, total)
        if self._stop:
            raise _Cancelled
