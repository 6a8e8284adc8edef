"""Background computation of a pose with its normals and colours from an edit."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import DeformationModel, Floor, HandleSolver, Pose
from deformer_app.viewer.colouring import Colouring, Paint
from deformer_app.viewer.edit import Edit, Handle, Solution, point
from deformer_app.viewer.session import Session


@dataclass(frozen=True, eq=False)
class Request:
    """A request for a pose and its colours.

    Args:
        edit: the state.
        solution: a pose found earlier for it, to be shown as it was, and gone on from unless it is
            final; None solves from the last.
        moving: more requests are about to follow, so that nothing needs to be finished.
        colour: name of a colouring, see `Colouring`.
        target: (V, 3) a shape to compare with.
        activations: supports of the components to colour by, once they are known.
        component_label: name of the component to colour by, for people.
        number: counts requests, for timing.
    """

    edit: Edit
    solution: Solution | None = None
    moving: bool = False
    colour: str = "plain"
    target: NDArray[np.float64] | None = None
    activations: deformer.Activations | None = None
    component_label: str = ""
    number: int = 0


@dataclass(frozen=True, eq=False)
class Answer:
    """A pose with its normals, colours and measures.

    Args:
        request: the request that is answered.
        pose: of the handles' vertices, in the order of `Edit.arrays`.
        normals: (V, 3).
        paint: colours; None keeps the previous ones.
        off_data: how far the code is from the examples, as `Familiarity.percentile`.
        error: E_rms against the target, nothing aligned, if there is one.
        suggestion: vertex of the next handle, if the colouring is that of uncertainty.
        final: true if no better pose will follow.
    """

    request: Request
    pose: Pose
    normals: NDArray[np.float64]
    paint: Paint | None
    off_data: float
    error: float | None
    suggestion: int | None
    final: bool

    @property
    def solution(self) -> Solution:
        """The pose's code and motion."""
        pose = self.pose
        motion = point(pose.rotation), point(pose.translation)
        return Solution(tuple(pose.z.tolist()), *motion, self.final, pose.contacts)


class PoseWorker:
    """A solver that follows edits.

    Args:
        model: the prior.
    """

    def __init__(self, model: DeformationModel) -> None:
        """Prepare the solver."""
        self._model = model
        self._solver = HandleSolver(model)
        self._familiarity = deformer.Familiarity(model)
        self.colouring = Colouring(model)
        self._edit: Edit | None = None

    def rehearse(self) -> None:
        """Solve for a handle of each kind, so that no user's first drag waits for a compiler.

        The first answer calls all that is compiled. The first time after an installation this takes
        a minute or two, later a fraction of a second.
        """
        base, reference = tuple(self._model.codes[0].tolist()), self._model.reference
        aside = point(reference.vertices[0] + 0.02 * reference.bounding_diagonal)
        for kind in ("soft", "exact"):
            next(self(Request(Edit(base, (Handle(1, (0,), (aside,), kind),)))))
        turned = Handle(1, (int(reference.faces[0, 0]),), (aside,), "exact").oriented(np.eye(3))
        with contextlib.suppress(deformer.InputError):  # there is no surface that could turn
            next(self(Request(Edit(base, (turned,)))))
        self._edit = None

    def __call__(self, request: Request) -> Iterator[Answer]:
        """Yield successively better poses of a request; the last is final unless it is moving."""
        pose, known = self.begin(request.edit, request.solution), request.solution
        if not request.edit.handles or (known is not None and known.final):
            yield self._answer(request, pose, True)
            return
        yield self._answer(request, pose, False)
        for pose in deformer.poses_to_rest(self._solver):
            if self._solver.at_rest:
                break
            yield self._answer(request, pose, False)
        yield self._answer(request, pose, not request.moving)

    def begin(self, edit: Edit, solution: Solution | None = None) -> Pose:
        """Return the pose of an edit: a known one, or one step from the last."""
        fresh = self._edit is None
        self._follow(edit)
        solver = self._solver
        if solution is not None:
            motion = solution.rotation, solution.translation
            return solver.restore(solution.z, *motion, solution.contacts)
        if not edit.handles:
            return solver.restore(edit.base, np.zeros(3), np.zeros(3))
        if fresh:
            solver.restore(edit.base, np.zeros(3), np.zeros(3))
        return solver.solve(warm=True)

    def final_pose(self, edit: Edit, solution: Solution | None = None) -> Pose:
        """Return the pose of an edit that a window shows after the mouse is released."""
        return list(self(Request(edit, solution)))[-1].pose

    def _follow(self, edit: Edit) -> None:
        """Pass the changes since the last edit to the solver."""
        last, self._edit = self._edit, None
        if last is None or last.base != edit.base:
            self._solver.set_prior(mean=edit.base)
        if last is None or (last.noise, last.body) != (edit.noise, edit.body):
            self._solver.set_prior(noise=edit.noise, freedom=edit.body)
        if last is None or last.floor != edit.floor:
            self._solver.set_floor(self._floor(edit.floor))
        if last is None or last.handles != edit.handles:
            # The window tells of other units where targets come from a file; those of a drag are
            # the model's.
            self._solver.set_handles(**edit.arrays(), check_units=False)
        self._edit = edit

    def _floor(self, height: float | None) -> Floor | None:
        return None if height is None else Floor.at(self._model, height)

    def _answer(self, request: Request, pose: Pose, final: bool) -> Answer:
        reference = self._model.reference
        target = request.target
        paint = self.colouring(
            request.colour, pose, target, request.activations, request.component_label
        )
        suggestion = None
        if request.colour == "uncertainty" and final:
            found = deformer.uncertainty(self._solver)
            paint, suggestion = self.colouring.of_uncertainty(found), found.suggestion
        return Answer(
            request,
            pose,
            deformer.vertex_normals(pose.vertices, reference.faces),
            paint,
            self._familiarity.percentile(pose.z),
            None if target is None else deformer.e_rms(target, pose.vertices, "none"),
            suggestion,
            final,
        )


def replay(session: Session, model: DeformationModel) -> Pose:
    """Return the pose that a session shows."""
    return PoseWorker(model).final_pose(session.entry.edit, session.entry.solution)
