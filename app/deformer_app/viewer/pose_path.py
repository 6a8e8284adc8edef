"""The way from one pose to another, as states of the editor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import DeformationModel
from deformer_app.viewer.edit import Edit, Handle, Solution
from deformer_app.viewer.handle_changes import gaps_of, on_shape
from deformer_app.viewer.poses import SavedPose


@dataclass(frozen=True, eq=False)
class _Offset:
    """Where a handle is, relative to the shape of a state without handles.

    Args:
        targets: (n, 3) vectors to its targets from where that shape has its vertices.
        gaps: (n, 3) of the handle.
        turn: (3, 3) rotation to its orientation from that of the shape around it.
    """

    targets: NDArray[np.float64]
    gaps: NDArray[np.float64]
    turn: NDArray[np.float64]


class PosePath:
    """States between one and the one of a saved pose, as the timeline has them between two keys.

    The prior's mean is on the path between those of the two ends, and handles go along with its
    shape: as far from it as at the start, at first, and as at the end, at last. There, handles that
    the end has not are where its shape is, and pull nothing. To an end without handles, pins of the
    start stay where they are; they move the end to where they are on average.

    Args:
        model: the model.
        start: the state at the share 0.
        end: the pose at the share 1.
        added: handles of the end that the start has not, on its surface.
        shown: (V, 3) the end's surface; None takes the shape of its code for it.
    """

    def __init__(
        self,
        model: DeformationModel,
        start: Edit,
        end: SavedPose,
        added: Sequence[Handle] = (),
        shown: NDArray[np.float64] | None = None,
    ) -> None:
        """Measure where the handles are at both ends."""
        self._model, self._start, self._end = model, start, end
        self._handles = (*start.handles, *added)
        pins = [n for n, handle in enumerate(start.handles) if handle.kind == "pin"]
        self._held = [] if end.handles else pins
        there = {handle.vertices: handle for handle in end.handles}
        self._common = all(handle.vertices in there for handle in self._handles)
        code_shape = _shape(model, end.shown)
        shape = code_shape if shown is None else shown
        last = [
            there.get(h.vertices) or on_shape(h, model, shape, code_shape) for h in self._handles
        ]
        self._before = self._offsets(self._handles, start.base)
        self._after = self._offsets(last, end.edit.base)
        self._shift = np.zeros(3)
        if self._held:
            away = [
                np.array(self._handles[n].targets) - np.array(last[n].targets) for n in self._held
            ]
            self._shift = np.concatenate(away).mean(axis=0)

    def at(self, share: float) -> tuple[Edit, Solution | None]:
        """Return the state at a share of the end, and its solution if it needs no solver."""
        if share == 0.0:
            return self._start, None
        bases = np.array([self._start.base, self._end.edit.base])
        base = tuple(deformer.interpolate_codes(bases, share).tolist())
        shape = self._model.decode(np.array(base))
        turns = _rotations(self._model, self._handles, shape)
        handles = tuple(
            self._placed(n, _mixed(before, after, share), shape, R, share)
            for n, (before, after, R) in enumerate(
                zip(self._before, self._after, turns, strict=True)
            )
        )
        edit = replace(self._start, base=base, handles=handles)
        return edit, self._known(edit, share)

    def _placed(
        self,
        n: int,
        offset: _Offset,
        shape: NDArray[np.float64],
        around: NDArray[np.float64],
        share: float,
    ) -> Handle:
        """A handle at an offset from a shape, which has a rotation (3, 3) around it."""
        handle = self._handles[n]
        targets = shape[list(handle.vertices)] + offset.targets + share * self._shift
        placed = handle.at(handle.targets if n in self._held else targets, offset.gaps)
        return placed if handle.orientation is None else placed.oriented(offset.turn @ around)

    def _known(self, edit: Edit, share: float) -> Solution | None:
        """The solution of a state on the path, if it is that of the end or of a code alone."""
        if not edit.handles:
            return Solution.of_code(edit.base)
        end = self._end.edit
        alike = edit.settings == end.settings
        ended = share == 1.0 and not self._held
        return self._end.shown if ended and (not end.handles or (alike and self._common)) else None

    def _offsets(self, handles: Sequence[Handle], base: Sequence[float]) -> list[_Offset]:
        shape = self._model.decode(np.array(base))
        turns = _rotations(self._model, handles, shape)
        return [
            _Offset(
                np.array(handle.targets) - shape[list(handle.vertices)],
                gaps_of(handle),
                np.eye(3) if handle.orientation is None else np.array(handle.orientation) @ R.T,
            )
            for handle, R in zip(handles, turns, strict=True)
        ]


def _mixed(before: _Offset, after: _Offset, share: float) -> _Offset:
    return _Offset(
        (1.0 - share) * before.targets + share * after.targets,
        (1.0 - share) * before.gaps + share * after.gaps,
        deformer.interpolate_rotations(before.turn, after.turn, share),
    )


def _shape(model: DeformationModel, solution: Solution) -> NDArray[np.float64]:
    return deformer.posed_shape(model, solution.z, solution.rotation, solution.translation)


def _rotations(
    model: DeformationModel, handles: Sequence[Handle], shape: NDArray[np.float64]
) -> list[NDArray[np.float64]]:
    """Rotations (3, 3) of the shape around handles that have an orientation, and identities."""
    turned = [handle.vertices[0] for handle in handles if handle.orientation is not None]
    found = iter(deformer.local_rotations(model, turned, shape) if turned else ())
    return [np.eye(3) if handle.orientation is None else next(found) for handle in handles]
