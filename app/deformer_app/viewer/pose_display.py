"""The picture of a session's pose, updated with the poses of the background solver."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import Activations, DeformationModel
from deformer_app.viewer.changes import (
    Change,
    ComponentsMeasured,
    FrameDrawn,
    MistakeMade,
    PoseChanged,
)
from deformer_app.viewer.edit import Solution
from deformer_app.viewer.pose_stream import PoseStream
from deformer_app.viewer.pose_worker import Answer, Request
from deformer_app.viewer.session import Session
from deformer_app.viewer.view_state import ViewState
from deformer_app.viewer.worker import Jobs, in_background

_TRANSITION = 0.12  # seconds from the last pose of a drag to the final one


class PoseDisplay:
    """Solves for a session's handles and draws the poses.

    Args:
        model: the prior.
        session: session whose current state is solved.
        state: state of the picture apart from the pose.
        jobs: queue of jobs that need several ticks.
        announce: called with every change.
        wake: called, also on other threads, when `tick` has something to do.

    Attributes:
        poses: the newest pose, and the latencies of poses.
        activations: strengths and limits of the components, once they have been measured.
    """

    def __init__(
        self,
        model: DeformationModel,
        session: Session,
        state: ViewState,
        jobs: Jobs,
        announce: Callable[[Change], Any],
        wake: Callable[[], None],
    ) -> None:
        """Start the solver's thread; the first request prepares the solver."""
        self.poses = PoseStream(model, wake)
        self.activations: Activations | None = None
        self._model, self._session, self._state = model, session, state
        self._jobs, self._announce = jobs, announce
        self._closed = False

    @property
    def busy(self) -> bool:
        """True while a pose or a frame is pending."""
        return self.poses.busy or self._state.is_stale

    def close(self, seconds: float = 5.0) -> None:
        """End the solver's thread after the pose under way; wait for that at most so long."""
        self._closed = True
        self.poses.close(seconds)

    def ask(self, solution: Solution | None = None, moving: bool = False) -> None:
        """Have the session's present state solved.

        Args:
            solution: a pose found earlier for it, to be shown as it was.
            moving: more is about to follow, so that nothing needs to be finished.
        """
        target = self._state.target_mesh
        self.poses.ask(
            Request(
                self._session.edit,
                solution,
                moving,
                self._state.look.colour,
                None if target is None else target.vertices,
                self.activations,
            )
        )
        self._state.invalidate()

    def ask_for_colours(self) -> None:
        """Request new colours of the pose; a final pose is not solved again."""
        answer = self.poses.answer
        if answer is not None and answer.final and answer.request.edit == self._session.edit:
            self.ask(answer.solution)
        else:
            self.ask()

    def tick(self, dragging: bool) -> None:
        """Fetch what the solver has, draw what has changed; never waits.

        Args:
            dragging: true while a button of the mouse is down.
        """
        answer = self._fetch()
        state = self._state
        wait = self.poses.is_worth_waiting_for(state.seconds_since_frame, self._session.under_way)
        if state.is_stale and (answer is not None or not wait):
            state.draw(self.poses.vertices, self._session.edit.handles)
            if answer is not None:
                self.poses.note_drawn(answer)
            self._announce(FrameDrawn())
        elif not dragging:
            state.sharpen_at_rest()

    def wait_for_pose(self, seconds: float = math.inf) -> None:
        """Wait at most so long for the pose last asked for, most often a fraction of a second."""
        end = time.monotonic() + seconds
        while self.poses.busy and time.monotonic() < end:
            self._fetch()
            time.sleep(0.001)

    def _fetch(self) -> Answer | None:
        """Fetch what the solver has; the newest answer, if there is a new one."""
        for error in self.poses.errors():
            self._announce(MistakeMade.of(error))
        before = self.poses.answer
        answer = self.poses.poll()
        if answer is not None:
            self._show(before, answer)
        return answer

    def _show(self, before: Answer | None, answer: Answer) -> None:
        """Show an answer; `before` is the previous one."""
        if before is None:
            self._jobs.add(self._measure_components())
        if before is not None and answer.final and before.request.edit == answer.request.edit:
            self._jobs.add(self._transition(before.pose.vertices, answer))
        else:
            self._state.view.surface.move(answer.pose.vertices, answer.normals)
        if answer.paint is not None:
            self._state.show_paint(answer.paint)
        if answer.final and answer.request.solution is None:
            self._session.solved(answer.request.edit, answer.solution)
        self._state.invalidate()
        self._announce(PoseChanged())

    def _transition(self, start: NDArray[np.float64], answer: Answer) -> Iterator[None]:
        """Go from what a drag has shown to the final pose in a few frames.

        Rigid relaxation of exact handles depends on the path of a drag and is done afresh at its
        end: a difference of a per cent or two, which would look like a jump.
        """
        surface, end, reference = (
            self._state.view.surface,
            answer.pose.vertices,
            self._model.reference,
        )
        begun = time.perf_counter()
        if np.abs(end - start).max() < 1e-4 * reference.bounding_diagonal:
            begun -= _TRANSITION
        while (share := (time.perf_counter() - begun) / _TRANSITION) < 1.0:
            between = start + share * (end - start)
            surface.move(between, deformer.vertex_normals(between, reference.faces))
            self._state.invalidate()
            yield
            if self._closed or self.poses.answer is not answer:
                return
        surface.move(end, answer.normals)
        self._state.invalidate()

    def _measure_components(self) -> Iterator[None]:
        """Measure the components on a thread, because it takes seconds on a large mesh."""
        found = yield from in_background(lambda: Activations(self._model))
        if not self._closed:
            self.activations = found
            if self._state.look.colour.startswith("component"):
                self.ask_for_colours()
            self._announce(ComponentsMeasured())
