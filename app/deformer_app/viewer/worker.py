"""Work beside the window, which never waits for it.

A thread answers the latest request; whatever was asked in between is forgotten. The window writes
one slot, the thread another: neither waits for the other, and a fast drag leaves no backlog.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

Request = TypeVar("Request")
Answer = TypeVar("Answer")
Result = TypeVar("Result")


def beside(work: Callable[[], Result]) -> Generator[None, None, Result]:
    """Run `work` on a thread of its own; every step looks whether it is done.

    Returns:
        What `work` has returned, or its exception is raised.
    """
    results: list[Result] = []
    errors: list[Exception] = []

    def run() -> None:
        try:
            results.append(work())
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=run, name="work", daemon=True)
    thread.start()
    while thread.is_alive():
        yield
    if errors:
        raise errors[0]
    return results[0]


@dataclass(frozen=True, eq=False)
class Failure(Generic[Request]):
    """A request that could not be answered, and why."""

    request: Request
    error: Exception


class SolverThread(Generic[Request, Answer]):
    """Runs `answer` on the newest request.

    Args:
        answer: gives the answers to a request, one better than the other; they stop being asked
            for when a newer request is there. It always runs on this one thread.
        notify: called on the thread when there is something to `take`; it must return at once.
        patience: seconds to wait for a newer request before the first answer is improved on: what
            is improved while the mouse moves is never seen, and is in the way.
    """

    def __init__(
        self,
        answer: Callable[[Request], Iterator[Answer]],
        notify: Callable[[], None] = lambda: None,
        patience: float = 0.04,
    ) -> None:
        """Start the thread; it ends with `close`, or with the program."""
        self._answer, self._notify, self._patience = answer, notify, patience
        self._changed = threading.Condition()
        self._pending: Request | None = None
        self._working = self._closed = False
        self._answered: Answer | None = None
        self._failures: list[Failure[Request]] = []
        self._thread = threading.Thread(target=self._run, name="solver", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether an answer or a failure is still to come or to be taken."""
        with self._changed:
            there = self._answered is not None or bool(self._failures)
            return there or self._working or self._pending is not None

    def ask(self, request: Request) -> None:
        """Put a request in the place of one that has not been begun."""
        with self._changed:
            self._pending = request
            self._changed.notify()

    def take(self) -> Answer | None:
        """The newest answer, once."""
        with self._changed:
            answer, self._answered = self._answered, None
            return answer

    def failures(self) -> list[Failure[Request]]:
        """All failures since the last call."""
        with self._changed:
            failures, self._failures = self._failures, []
            return failures

    def close(self, seconds: float = 5.0) -> None:
        """End the thread after the answer under way; wait for it at most so long."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(seconds)

    def _run(self) -> None:
        while True:
            with self._changed:
                self._working = False
                self._changed.wait_for(self._superseded)
                if self._closed:
                    return
                request, self._pending = self._pending, None
                self._working = True
            assert request is not None
            try:
                self._serve(request)
            except Exception as error:  # whatever it is, the window must tell the user
                with self._changed:
                    self._failures.append(Failure(request, error))
                    self._working = False
                self._notify()

    def _serve(self, request: Request) -> None:
        patience = self._patience
        for answer in self._answer(request):
            with self._changed:
                self._answered = answer
            self._notify()
            with self._changed:
                if self._changed.wait_for(self._superseded, patience):
                    return
            patience = 0.0

    def _superseded(self) -> bool:
        return self._closed or self._pending is not None
