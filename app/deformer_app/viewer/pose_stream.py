"""The stream of poses from the background solver of a model."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deformer import DeformationModel
from deformer_app.viewer.pose_worker import Answer, PoseWorker, Request
from deformer_app.viewer.worker import SolverThread

# Seconds after a frame that the next one waits for the pose it belongs to. During a drag a frame
# without it shows next to nothing, and delays the one that follows.
_LATE, _LATE_IN_DRAG = 0.03, 0.15


class PoseStream:
    """The newest pose of a model, and the latencies of poses.

    Args:
        model: the prior.
        notify: called on another thread when `poll` has something to fetch.

    Attributes:
        answer: the newest pose; None until the solver is prepared.
        latencies: seconds from a move of the mouse to the frame that shows its pose.
    """

    def __init__(self, model: DeformationModel, notify: Callable[[], None]) -> None:
        """Start the thread; the first request prepares the solver."""
        self.answer: Answer | None = None
        self.latencies: deque[float] = deque(maxlen=200)
        self._model = model
        self._thread = SolverThread(_prepared_at_first_request(model), notify)
        self._number = 0
        self._asked_at: dict[int, float] = {}

    @property
    def vertices(self) -> NDArray[np.float64]:
        """The newest surface (V, 3); the reference until there is a pose."""
        if self.answer is None:
            return self._model.reference.vertices
        return self.answer.pose.vertices

    @property
    def busy(self) -> bool:
        """True while an answer or a failure is pending or not yet fetched."""
        return self._thread.busy

    def ask(self, request: Request) -> None:
        """Send a request; a newer one replaces it if it has not been started."""
        self._number += 1
        self._asked_at[self._number] = time.perf_counter()
        self._thread.ask(replace(request, number=self._number))

    def poll(self) -> Answer | None:
        """Fetch the newest answer; None if there is no new one."""
        answer = self._thread.newest()
        if answer is not None:
            if self.answer is None:
                # Requests that waited for the preparation say nothing about drags.
                self._asked_at.clear()
            self.answer = answer
        return answer

    def errors(self) -> list[Exception]:
        """Return the failures of requests since the last call."""
        return [failure.error for failure in self._thread.failures()]

    def is_worth_waiting_for(self, seconds_since_frame: float, dragging: bool) -> bool:
        """Return True while a frame should wait for the pose that is being solved."""
        late = _LATE_IN_DRAG if dragging else _LATE
        return self._thread.busy and seconds_since_frame < late and self.answer is not None

    def note_drawn(self, answer: Answer) -> None:
        """Measure the latency of an answer whose frame has been drawn."""
        asked = self._asked_at.pop(answer.request.number, None)
        for number in [n for n in self._asked_at if n < answer.request.number]:
            del self._asked_at[number]
        if asked is not None and answer.request.moving:
            self.latencies.append(time.perf_counter() - asked)

    def close(self, seconds: float = 5.0) -> None:
        """End the thread after the current answer; wait for it at most `seconds`."""
        self._thread.close(seconds)


def _prepared_at_first_request(model: DeformationModel) -> Callable[[Request], Iterator[Answer]]:
    """Make a worker that is prepared with its first request, on the thread that asks."""
    ready: list[PoseWorker] = []

    def answer(request: Request) -> Iterator[Answer]:
        if not ready:
            worker = PoseWorker(model)
            worker.rehearse()
            ready.append(worker)
        return ready[0](request)

    return answer
