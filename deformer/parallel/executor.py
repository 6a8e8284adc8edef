"""The protocol of executors, and the one that runs its tasks in this process."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from typing import Any, Protocol, Self

# A function of a module: it yields parts of its result (JSON values) as they are finished, which
# the caller receives at once, and returns the rest.
Function = Callable[..., Generator[Any, None, Any]]


@dataclass(frozen=True)
class Part:
    """A task has yielded `value`."""

    task: int
    value: Any


@dataclass(frozen=True)
class Done:
    """A task has returned `result`; all of its parts came before."""

    task: int
    result: Any


@dataclass(frozen=True)
class Failed:
    """A task has raised `error`, or its worker was lost; it ends here."""

    task: int
    error: Exception


Event = Part | Done | Failed


class WorkerLost(Exception):
    """The process that ran a task ended before the task did."""


class Executor(Protocol):
    """Runs tasks, in an order and a number at a time of its own.

    It is used in a `with` block. Whatever ends the block ends the tasks that still run.
    """

    @property
    def shares_files(self) -> bool:
        """True if tasks read and write the same files as this process."""
        ...

    @property
    def wanted(self) -> int:
        """Number of tasks, of those that use all cores they find, that keep it busy."""
        ...

    def __enter__(self) -> Self:
        """Make ready for tasks."""
        ...

    def __exit__(self, *_: object) -> None:
        """End the tasks that are left."""
        ...

    def share(self, value: Any) -> Any:
        """A stand-in for `value` among the arguments of tasks.

        It travels to each worker once, and not with every task.
        """
        ...

    def submit(self, function: Function, *arguments: Any) -> int:
        """Have a function called.

        Args:
            function: of a module that workers can import.
            arguments: what `pickle` can send: arrays, JSON values, dataclasses of the project.

        Returns:
            The number of the task, which its events have.
        """
        ...

    def keep(self, function: Function, *arguments: Any) -> int:
        """As `submit`, but what the function returns stays where it was computed, if it can.

        The result of the task is a stand-in for it among the arguments of later tasks. A worker
        that dies with it makes no difference: it is computed anew, from its arguments.

        Args:
            function: changes none of its arguments.
            arguments: as of `submit`, and stand-ins.
        """
        ...

    def as_completed(self) -> Iterator[Event]:
        """What happens, until no task is left; more tasks can be submitted meanwhile."""
        ...


def results(
    executor: Executor, tasks: Sequence[int], told: Callable[[Any], None] | None = None
) -> list[Any]:
    """What tasks return, in their order; they are all that the executor has.

    Args:
        executor: runs the tasks.
        tasks: their numbers.
        told: called with each part, as soon as there is one.

    Raises:
        Exception: the error of the first task that fails.
    """
    found = dict(ended(executor, told))
    return [found[task] for task in tasks]


def ended(
    executor: Executor, told: Callable[[Any], None] | None = None
) -> Iterator[tuple[int, Any]]:
    """Tasks as they end; more can be submitted meanwhile.

    Args:
        executor: runs the tasks.
        told: called with each part, as soon as there is one.

    Yields:
        Number of the task, and its result.

    Raises:
        Exception: the error of a task that fails.
    """
    for event in executor.as_completed():
        if isinstance(event, Failed):
            raise event.error
        if isinstance(event, Done):
            yield event.task, event.result
        elif told is not None:
            told(event.value)


def run_to_end(
    calls: Generator[Any, None, Any], tell: Callable[[int, Any], None] | None = None
) -> tuple[list[Any], Any]:
    """Run a task where it was sent to.

    Args:
        calls: the running function.
        tell: called with the number of a part and the part, as soon as there is one.

    Returns:
        All parts, in case one is lost on its way, and what the function returns.
    """
    parts: list[Any] = []
    with closing(calls):
        while True:
            try:
                part = next(calls)
            except StopIteration as end:
                return parts, end.value
            if tell is not None:
                tell(len(parts), part)
            parts.append(part)


def stream(
    executor: Executor,
    calls: Iterable[tuple[Any, ...]],
    told: Callable[[Any], None] | None = None,
) -> Iterator[tuple[int, Any]]:
    """What many tasks return, as they end; few wait at a time, since their arguments take memory.

    Args:
        executor: has no other tasks.
        calls: function and arguments of each task.
        told: called with each part, as soon as there is one.

    Yields:
        Number of the call, from 0, and its result.

    Raises:
        Exception: the error of a task that fails.
    """
    waiting, numbers = enumerate(calls), dict[int, int]()

    def submit(count: int) -> None:
        for n, call in islice(waiting, count):
            numbers[executor.submit(*call)] = n

    submit(executor.wanted)
    for task, result in ended(executor, told):
        submit(1)
        yield numbers[task], result


class Queue:
    """What the executors of this machine have in common: tasks that wait in order."""

    shares_files, wanted = True, 1

    def __init__(self) -> None:
        """No task is there yet."""
        self._waiting: deque[tuple[int, Function, tuple[Any, ...]]] = deque()
        self._count = 0

    def __enter__(self) -> Self:
        """Do nothing."""
        return self

    def share(self, value: Any) -> Any:
        """The value itself; to another process it goes with each task."""
        return value

    def submit(self, function: Function, *arguments: Any) -> int:
        """As in `Executor`."""
        task, self._count = self._count, self._count + 1
        self._waiting.append((task, function, arguments))
        return task

    def keep(self, function: Function, *arguments: Any) -> int:
        """As in `Executor`; the result is the value itself."""
        return self.submit(function, *arguments)


class InProcess(Queue):
    """Runs tasks in this process, one after the other, in `as_completed`."""

    def __exit__(self, *_: object) -> None:
        """Do nothing: no task runs outside of `as_completed`."""

    def as_completed(self) -> Iterator[Event]:
        """As in `Executor`."""
        while self._waiting:
            task, function, arguments = self._waiting.popleft()
            try:
                calls = function(*arguments)
                while True:
                    part = next(calls)
                    yield Part(task, part)
            except StopIteration as end:
                yield Done(task, end.value)
            except Exception as error:
                yield Failed(task, error)
