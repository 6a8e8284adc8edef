"""Tasks side by side in threads of this process."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from typing import Any

from deformer.linalg import CORES, use_cores
from deformer.parallel.executor import Event, Function, InProcess, run_to_end
from deformer.parallel.inbox import Inbox


class Threads(InProcess):
    """Runs tasks that wait together side by side, with the cores divided among them.

    A task that waits alone runs in the thread that waits for it, on all cores. Tasks that are
    submitted meanwhile begin when the others have ended.

    Args:
        most: number of tasks that memory allows at once.
    """

    def __init__(self, most: int = CORES) -> None:
        """No thread is started before there are several tasks."""
        super().__init__()
        self._most, self._ended = min(most, CORES), False

    def __exit__(self, *_: object) -> None:
        """End tasks that run with their next part."""
        self._ended = True

    def as_completed(self) -> Iterator[Event]:
        """As in `Executor`."""
        while self._waiting:
            if len(self._waiting) == 1 or self._most == 1:
                yield from super().as_completed()
                continue
            inbox = Inbox()
            count = min(len(self._waiting), self._most)
            with ThreadPoolExecutor(count, "deformer-tasks", use_cores, (CORES // count,)) as pool:
                try:
                    while self._waiting:
                        task, function, arguments = self._waiting.popleft()
                        inbox.expect(task)
                        pool.submit(self._run, inbox, task, function, arguments)
                    yield from inbox.events()
                finally:
                    self._ended = True
            self._ended = False

    def _run(self, inbox: Inbox, task: int, function: Function, arguments: tuple[Any, ...]) -> None:
        def tell(number: int, part: Any) -> None:
            if self._ended:
                raise CancelledError
            inbox.put_part(task, number, part)

        if self._ended:
            return
        try:
            inbox.put_end(task, *run_to_end(function(*arguments), tell))
        except Exception as error:
            inbox.put_error(task, error)
