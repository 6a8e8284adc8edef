"""Background work of the window, which never waits for it.

A thread answers the latest request; whatever was asked in between is forgotten. The window writes
one slot, the thread another: neither waits for the other, and a fast drag leaves no backlog.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from deformer import InputError

Request = TypeVar("Request")
Answer = TypeVar("Answer")
Result = TypeVar("Result")


def in_background(work: Callable[[], Result]) -> Generator[None, None, Result]:
    """Run `work` on a thread of its own; every step of the generator looks whether it is done.

    Returns:
        What `work` has returned.

    Raises:
        Exception: what `work` has raised.
    """
    results: list[Result] = []
    errors: list[Exception] = []

    def run() -> None:
        try:
            results.append(work())
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=run, name="background", daemon=True)
    thread.start()
    while thread.is_alive():
        yield
    if errors:
        raise errors[0]
    return results[0]


class Jobs:
    """Jobs on the window's thread, which run one step at a time in turn."""

    def __init__(self) -> None:
        """Begin without work."""
        self._jobs: list[Iterator[None]] = []

    def __bool__(self) -> bool:
        """Return True while there is work left."""
        return bool(self._jobs)

    def add(self, job: Iterator[None]) -> None:
        """Do a step of `job` with every `step`, until it ends."""
        self._jobs.append(job)

    def step(self) -> list[Exception]:
        """Do a step of every job; return what ended any of them by an exception."""
        errors: list[Exception] = []
        for job in tuple(self._jobs):
            try:
                next(job)
            except StopIteration:
                self._jobs.remove(job)
            except (InputError, OSError) as error:
                self._jobs.remove(job)
                errors.append(error)
        return errors


@dataclass(frozen=True, eq=False)
class Failure(Generic[Request]):
    """A failed request and its exception."""

    request: Request
    error: Exception


class SolverThread(Generic[Request, Answer]):
    """Runs `answer` on the newest request.

    Args:
        answer: yields answers to a request, each better than the last; the thread asks for no
            more of them once a newer request is there. It always runs on this one thread.
        notify: called on the thread when there is an answer or a failure; must return at once.
        patience: seconds to wait for a newer request before the first answer is improved on: a
            better pose while the mouse moves is never seen, and delays the next one.
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
        """True while an answer or a failure is pending or not yet fetched."""
        with self._changed:
            there = self._answered is not None or bool(self._failures)
            return there or self._working or self._pending is not None

    def ask(self, request: Request) -> None:
        """Send a request; it replaces one that has not been started."""
        with self._changed:
            self._pending = request
            self._changed.notify()

    def newest(self) -> Answer | None:
        """Return the newest answer, once; None if there is no new one."""
        with self._changed:
            answer, self._answered = self._answered, None
            return answer

    def failures(self) -> list[Failure[Request]]:
        """Return all failures since the last call."""
        with self._changed:
            failures, self._failures = self._failures, []
            return failures

    def close(self, seconds: float = 5.0) -> bool:
        """End the thread after the current answer; wait for it at most `seconds`.

        Returns:
            True if the thread has ended.
        """
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(seconds)
        return not self._thread.is_alive()

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
