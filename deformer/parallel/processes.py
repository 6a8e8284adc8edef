"""Tasks in processes of this machine."""

from __future__ import annotations

import os
import signal
import threading
import traceback
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, TypeAlias

from deformer.parallel.executor import Event, Function, Part, Queue, WorkerLost, run_to_end
from deformer.parallel.inbox import Inbox


class Processes(Queue):
    """Runs tasks in processes, which end with the block or with this process, however it ends.

    A process that dies fails its own task only, and another takes its place. Each process is a pool
    of one for that reason: a larger pool does not tell whose task was the cause.

    Args:
        count: number of processes, and of tasks at a time.
    """

    def __init__(self, count: int) -> None:
        """No process is started before the first task."""
        super().__init__()
        self._limit = self.wanted = count
        self._inbox = Inbox()
        self._idle: list[_Worker] = []
        self._busy: dict[int, _Worker] = {}

    def __exit__(self, *_: object) -> None:
        """End all processes, at once if they are at work."""
        self._waiting.clear()
        for worker in (*self._busy.values(), *self._idle):
            worker.end()

    def submit(self, function: Function, *arguments: Any) -> int:
        """As in `Executor`."""
        task = super().submit(function, *arguments)
        self._inbox.expect(task)
        self._start_waiting()
        return task

    def as_completed(self) -> Iterator[Event]:
        """As in `Executor`."""
        for event in self._inbox.events():
            if not isinstance(event, Part):
                worker = self._busy.pop(event.task)
                if worker.lost:
                    worker.end()
                else:
                    self._idle.append(worker)
                self._start_waiting()
            yield event

    def _start_waiting(self) -> None:
        while self._waiting and len(self._busy) < self._limit:
            task, function, arguments = self._waiting.popleft()
            worker = self._idle.pop() if self._idle else _Worker(self._inbox)
            try:
                worker.run(task, function, arguments)
            except BrokenProcessPool:  # it ended while it had nothing to do
                worker.end()
                worker = _Worker(self._inbox)
                worker.run(task, function, arguments)
            self._busy[task] = worker


class _Worker:
    """A process, as a pool of one, and the pipes to it.

    Attributes:
        lost: true once the process has ended by itself.
    """

    def __init__(self, inbox: Inbox) -> None:
        # Spawned, because the threads of PyTorch and numba do not survive a fork.
        context = get_context("spawn")
        self.lost = False
        self._inbox = inbox
        self._parts, parts = context.Pipe(duplex=False)
        life, self._life = context.Pipe(duplex=False)
        self._given = (life, parts)
        self._pool = ProcessPoolExecutor(1, context, _begin, self._given)
        self._listener: threading.Thread | None = None

    def run(self, task: int, function: Function, arguments: tuple[Any, ...]) -> None:
        """Start a task; the inbox is told of it."""
        future = self._pool.submit(_run, task, function, arguments)
        if self._listener is None:
            # The process has its ends by now. It must be the only one with them: pipes close when
            # the last end does.
            for end in self._given:
                end.close()
            self._listener = threading.Thread(target=self._listen, daemon=True)
            self._listener.start()
        future.add_done_callback(lambda done: self._finish(task, done))

    def end(self) -> None:
        """End the process, and wait until it has; files are written in one step, so it may."""
        self._life.close()
        self._pool.shutdown(wait=True)
        if self._listener is not None:
            self._listener.join()
        for pipe in (self._parts, *self._given):
            pipe.close()

    def _listen(self) -> None:
        """Hand on parts until the process ends."""
        try:
            while True:
                self._inbox.put_part(*self._parts.recv())
        except (EOFError, OSError):
            return

    def _finish(self, task: int, future: Future[_Ended]) -> None:
        error = future.exception()
        if error is None:
            parts, result, refused = future.result()
            if refused is None:
                self._inbox.put_end(task, parts, result)
            else:
                self._inbox.put_error(task, refused, parts)
        elif isinstance(error, BrokenProcessPool):
            self.lost = True
            self._inbox.put_error(task, WorkerLost("the process ended; out of memory?"))
        elif isinstance(error, Exception):
            self._inbox.put_error(task, error)
        else:
            self._inbox.put_error(task, WorkerLost(f"the task ended with {error!r}"))


# Parts of a task, and its result or what it raised.
_Ended: TypeAlias = tuple[list[Any], Any, Exception | None]
# Of a worker process: where it sends its parts.
_parts: Connection | None = None


def _begin(life: Connection, parts: Connection) -> None:
    """First call in a worker process."""
    global _parts
    _parts = parts
    # Ctrl-C reaches all processes of a terminal; only the parent handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(life,), daemon=True).start()


def _end_with(life: Connection) -> None:
    """End this process when the other end of a pipe closes, as it does when the parent ends."""
    try:
        life.recv()
    except (EOFError, OSError):
        os._exit(1)


def _run(task: int, function: Function, arguments: tuple[Any, ...]) -> _Ended:
    pipe, parts = _parts, []
    assert pipe is not None

    def tell(number: int, part: Any) -> None:
        parts.append(part)
        pipe.send((task, number, part))

    try:
        return *run_to_end(function(*arguments), tell), None
    except Exception as error:
        # Returned, because an error that is raised may come before the parts in the pipe.
        error.add_note(traceback.format_exc())
        return parts, None, error
