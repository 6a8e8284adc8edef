"""The picture of a session's pose, updated with the poses of the background solver."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import Activations, ComponentRegion, DeformationModel
from deformer_app.viewer.changes import (
    Change,
    ComponentsMeasured,
    FrameDrawn,
    MistakeMade,
    PoseChanged,
)
from deformer_app.viewer.eased_offset import EasedOffset
from deformer_app.viewer.edit import Edit, Solution
from deformer_app.viewer.pose_stream import PoseStream
from deformer_app.viewer.pose_worker import Answer, Request
from deformer_app.viewer.session import Session
from deformer_app.viewer.view_state import ViewState
from deformer_app.viewer.worker import Jobs, in_background


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
        regions: groups of the components by where they act, measured with the activations.
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
        self.regions: list[ComponentRegion] = []
        self._model, self._session, self._state = model, session, state
        self._jobs, self._announce = jobs, announce
        self._closed = False
        self._shape: NDArray[np.float64] | None = None
        self._offset = EasedOffset(model.reference.bounding_diagonal)
        self._easing = False
        self._eased_to: Edit | None = None

    @property
    def vertices(self) -> NDArray[np.float64]:
        """The surface (V, 3) that is shown: the newest pose, or a shape in its place."""
        return self.poses.vertices if self._shape is None else self._shape

    def show(self, shape: NDArray[np.float64]) -> None:
        """Show a shape (V, 3) in place of the pose, until the present state is solved."""
        self._shape = shape
        self._offset.clear()
        normals = deformer.vertex_normals(shape, self._model.reference.faces)
        self._state.view.surface.move(shape, normals)
        self._state.invalidate()

    def show_stored(self, solution: Solution) -> None:
        """Show the shape of a solution until the solver is prepared.

        What exact handles and the floor add to it comes with the first pose.
        """
        model = self._model
        self.show(deformer.posed_shape(model, solution.z, solution.rotation, solution.translation))

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
        kind, _, number = self._state.look.colour.partition(":")
        self.poses.ask(
            Request(
                self._session.edit,
                solution,
                moving,
                self._state.look.colour,
                None if target is None else target.vertices,
                self.activations,
                self._model.label(int(number)) if kind == "component" and number else "",
            )
        )
        self._state.invalidate()

    def ease(self) -> None:
        """Go smoothly to the pose of the present state, where it would else be shown at once."""
        self._eased_to = self._session.edit

    def rename_components(self, model: DeformationModel) -> None:
        """Go on with the same model, in which components have other names."""
        self._model = model
        if self._state.look.colour.startswith("component"):
            self.ask_for_colours()

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
            state.draw(self.vertices, self._session.edit.handles)
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
        shape, late = self._shape, answer.request.edit != self._session.edit
        if shape is not None and late:
            return
        self._shape = None
        now = time.perf_counter()
        if shape is not None:
            self._offset.add(shape - answer.pose.vertices, now)
        elif before is not None and answer.request.edit in (before.request.edit, self._eased_to):
            self._offset.add(before.pose.vertices - answer.pose.vertices, now)
        elif answer.request.moving:
            self._offset.advance(now)
        else:
            self._offset.clear()
        self._draw(answer)
        if self._offset and not self._easing:
            self._easing = True
            self._jobs.add(self._ease())
        self._state.note_pose(
            answer.request.edit, answer.pose.vertices, answer.final and not self._session.under_way
        )
        if answer.paint is not None:
            self._state.show_paint(answer.paint)
        known = answer.request.solution
        if answer.final and (known is None or not known.final):
            self._session.solved(answer.request.edit, answer.solution)
        self._state.invalidate()
        self._announce(PoseChanged())

    def _draw(self, answer: Answer) -> None:
        """Move the surface to a pose, or on its way there."""
        vertices, normals = answer.pose.vertices, answer.normals
        if self._offset:
            vertices = self._offset.added_to(vertices)
            normals = deformer.vertex_normals(vertices, self._model.reference.faces)
        self._state.view.surface.move(vertices, normals)
        self._state.invalidate()

    def _ease(self) -> Iterator[None]:
        """Go to the newest pose in a few frames.

        Better poses for the same handles follow the first one while the mouse rests: refined, with
        a full rigid relaxation, or of a lower minimum elsewhere. At once they would be jumps.
        """
        while self._offset and not self._closed:
            yield
            self._offset.advance(time.perf_counter())
            answer = self.poses.answer
            if self._shape is None and answer is not None and not self._closed:
                self._draw(answer)
        self._easing = False

    def _measure_components(self) -> Iterator[None]:
        """Measure the components on a thread, because it takes seconds on a large mesh."""
        model = self._model

        def measure() -> tuple[Activations, list[ComponentRegion]]:
            model.distances(0)  # prepared once, so that the brush's first circle does not wait
            activations = Activations(model)
            return activations, deformer.component_regions(model, activations)

        found, regions = yield from in_background(measure)
        if not self._closed:
            self.activations, self.regions = found, regions
            if self._state.look.colour.startswith("component"):
                self.ask_for_colours()
            self._announce(ComponentsMeasured())
