"""What tasks that run elsewhere tell, put into order."""

from __future__ import annotations

import queue
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from deformer.parallel.executor import Done, Event, Failed, Part

# Seconds after which a wait begins anew: on Windows, Ctrl-C ends no wait without a limit.
_WAIT = 0.5


@dataclass(frozen=True)
class _End:
    parts: list[Any]
    event: Done | Failed


class Inbox:
    """Events of tasks: each part once and in order, even if it is told twice or never.

    Threads that listen to workers put in what they hear; `events` is for the thread that waits.
    """

    def __init__(self) -> None:
        """No task is expected yet."""
        self._queue: queue.SimpleQueue[tuple[int, tuple[int, Any] | _End]]
        self._queue = queue.SimpleQueue()
        self._received: dict[int, int] = {}  # number of parts of each task
        self._open: set[int] = set()

    def expect(self, task: int) -> None:
        """Wait for a task, or once more for one that failed and is run again."""
        self._received.setdefault(task, 0)
        self._open.add(task)

    def put_part(self, task: int, number: int, value: Any) -> None:
        """Part `number`, from 0, of a task; a task that is run again tells it again."""
        self._queue.put((task, (number, value)))

    def put_end(self, task: int, parts: list[Any], result: Any) -> None:
        """The end of a task, with all of its parts: one may still be on its way."""
        self._queue.put((task, _End(parts, Done(task, result))))

    def put_error(self, task: int, error: Exception, parts: Iterable[Any] = ()) -> None:
        """The end of a task that failed, with its parts before that, as far as they are known."""
        self._queue.put((task, _End(list(parts), Failed(task, error))))

    def events(self) -> Iterator[Event]:
        """Events of the tasks, until all expected ones have ended."""
        while self._open:
            try:
                task, message = self._queue.get(timeout=_WAIT)
            except queue.Empty:
                continue
            if task not in self._open:  # a part that comes after the end
                continue
            if isinstance(message, _End):
                self._open.remove(task)
                rest = message.parts[self._received[task] :]
                yield from (Part(task, value) for value in rest)
                yield message.event
            elif message[0] == self._received[task]:
                self._received[task] += 1
                yield Part(task, message[1])
