"""Tasks on the workers of a Dask cluster: other machines, or processes of this one."""

from __future__ import annotations

import json
import logging
import threading
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import ExitStack, suppress
from typing import Any, Self

import dask.config
import distributed
from distributed.scheduler import KilledWorker
from distributed.utils import silence_logging_cmgr

from deformer.checks import shortened
from deformer.errors import InputError
from deformer.parallel.executor import Event, Failed, Function, Part, WorkerLost, run_to_end
from deformer.parallel.inbox import Inbox
from deformer.parallel.versions import differences, versions

# Seconds to wait for a scheduler and its first worker.
_PATIENCE = 60
_LOCAL = "local:"
# Most workers of `local:N`.
_MOST_LOCAL = 1000
_SETTINGS = {
    "distributed.admin.large-graph-warning-threshold": "1TB",
    # Dask gives up a local worker that died if the next one takes longer than 15 s to start, as on
    # a busy machine. With the last one given up, no task would ever end.
    "distributed.deploy.lost-worker-timeout": "1 day",
}

_log = logging.getLogger("deformer")


class Cluster:
    """Runs tasks on a Dask cluster. Of a task whose worker dies another worker makes the whole.

    Args:
        address: of a scheduler, such as "tcp://10.0.0.1:8786"; or "local:2" for two workers on
            this machine, which end with the block.

    Raises:
        InputError: no such address.
    """

    shares_files = False

    def __init__(self, address: str) -> None:
        """Nothing is started before the `with` block."""
        self._address, self._local = address, None
        if address.startswith(_LOCAL):
            count = address.removeprefix(_LOCAL)
            if not count.isdecimal() or not 1 <= int(count[:9]) <= _MOST_LOCAL:
                raise InputError(
                    f"cluster: expected local:1 to local:{_MOST_LOCAL}, got {shortened(address)}; "
                    "correct it"
                )
            self._local = int(count)
        self._name = f"deformer-{uuid.uuid4().hex}"
        self._inbox = Inbox()
        self._stack = ExitStack()
        self._futures: dict[int, distributed.Future] = {}
        self._shared: list[distributed.Future] = []
        # Function and arguments of each task, by its number, until it has ended.
        self._calls: list[tuple[Callable[..., Any], Function, tuple[Any, ...]] | None] = []

    def __enter__(self) -> Self:
        """Connect.

        Raises:
            InputError: no scheduler answers, it has no worker, or a worker has other versions of
                the program.
        """
        with self._stack as stack:
            # What concerns the user is told here, in one line.
            stack.enter_context(silence_logging_cmgr(logging.CRITICAL))
            stack.enter_context(dask.config.set(_SETTINGS))
            # Its methods are declared as what they are in asynchronous code.
            self._client: Any = stack.enter_context(self._connected(stack))
            self._check_workers()
            self._client.subscribe_topic(self._name, self._receive)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Take back what is not finished, and leave the cluster.

        Workers elsewhere end a task that runs with its next part.
        """
        with self._stack:
            if self._futures and self._local is None:
                with suppress(Exception):  # a worker may be gone
                    self._client.run(_stop, self._name, on_error="ignore")
            self._client.cancel(list(self._futures.values()))
            self._futures.clear()
            self._shared.clear()

    @property
    def wanted(self) -> int:
        """Two tasks a worker: one computes while the next is on its way."""
        return 2 * max(1, len(self._client.scheduler_info(n_workers=-1)["workers"]))

    def share(self, value: Any) -> Any:
        """As in `Executor`; the scheduler has it too, so that it outlives the workers."""
        key = f"{self._name}-shared-{len(self._shared)}"
        self._shared.append(self._client.submit(_same, value, key=key))
        return self._shared[-1]

    def submit(self, function: Function, *arguments: Any) -> int:
        """As in `Executor`."""
        return self._add(_run, function, arguments)

    def keep(self, function: Function, *arguments: Any) -> int:
        """As in `Executor`: a future of Dask's is the stand-in."""
        return self._add(_run_and_keep, function, arguments)

    def _add(self, run: Callable[..., Any], function: Function, arguments: tuple[Any, ...]) -> int:
        task = len(self._calls)
        self._calls.append((run, function, arguments))
        self._start(task)
        return task

    def as_completed(self) -> Iterator[Event]:
        """As in `Executor`.

        Dask gives a task up that was on its way to several workers which died, although another
        task may have been the cause. It is run again when no other runs: what then fails is it.
        """
        suspects: list[int] = []
        alone: set[int] = set()
        for event in self._inbox.events():
            task = event.task
            if isinstance(event, Part):
                yield event
                continue
            del self._futures[task]  # the workers need not keep the result
            lost = isinstance(event, Failed) and isinstance(event.error, WorkerLost)
            if lost and task not in alone:
                suspects.append(task)
                self._inbox.expect(task)
            else:
                self._calls[task] = None
                yield event
            if suspects and not self._futures:
                alone.add(suspects[0])
                self._start(suspects.pop(0))

    def _start(self, task: int) -> None:
        call = self._calls[task]
        assert call is not None
        run, function, arguments = call
        self._inbox.expect(task)
        key = f"{self._name}-{task}-{uuid.uuid4().hex}"
        future = self._client.submit(run, self._name, task, function, *arguments, key=key)
        self._futures[task] = future
        future.add_done_callback(lambda done: self._finish(task, done, run is _run_and_keep))

    def _connected(self, stack: ExitStack) -> distributed.Client:
        if self._local is not None:
            options: dict[str, Any] = {
                "n_workers": self._local,
                "threads_per_worker": 1,
                "memory_limit": 0,
                "dashboard_address": "127.0.0.1:0",  # a free port: several can run at once
                "silence_logs": logging.CRITICAL,
            }
            cluster = stack.enter_context(distributed.LocalCluster(**options))
            client = distributed.Client(cluster, timeout=_PATIENCE)
            client.register_plugin(_IgnoresInterrupts())
            return client
        try:
            return distributed.Client(self._address, timeout=_PATIENCE)
        # Of an address that cannot be one, Dask's own assertions fail now and then, without a word.
        except (OSError, ValueError, TimeoutError, AssertionError) as error:
            reason = " ".join(str(error).split()) or "no address of one"
            raise InputError(
                f"cluster: no scheduler answers at {shortened(self._address)} ({reason}); start "
                "one with `dask scheduler` and give the address that it prints, or local:2"
            ) from error

    def _check_workers(self) -> None:
        try:
            self._client.wait_for_workers(1, timeout=_PATIENCE)
        except TimeoutError as error:
            raise InputError(
                f"cluster: {self._address} has no workers; start some with `dask worker "
                f"{self._address} --nthreads 1`"
            ) from error
        here = versions()
        for worker, there in self._client.run(versions, on_error="return").items():
            if isinstance(there, BaseException):
                reason = " ".join(f"{type(there).__name__}: {there}".split())
                raise InputError(
                    f"cluster: worker {worker} cannot run deformer ({reason}); install version "
                    f"{here['deformer']} there"
                )
            unlike, rounding = differences(here, there)
            if unlike:
                raise InputError(
                    f"cluster: worker {worker} has {unlike}; install the same versions"
                )
            if rounding:
                _log.warning(
                    "cluster: worker %s has %s; its numbers may differ in the last digits",
                    worker,
                    rounding,
                )

    def _receive(self, event: tuple[float, Any]) -> None:
        task, number, text = event[1]
        self._inbox.put_part(task, number, json.loads(text))

    def _finish(self, task: int, future: distributed.Future, kept: bool) -> None:
        """Called in a thread of the client's when a task has ended."""
        try:
            if kept and future.status == "finished":
                # Its parts may come later than this, or, if one is lost on its way, never.
                self._inbox.put_end(task, [], future)
            else:
                self._inbox.put_end(task, *future.result())
        except KilledWorker as error:
            times = error.allowed_failures + 1
            self._inbox.put_error(
                task, WorkerLost(f"{times} workers ended while they ran it; out of memory?")
            )
        except CancelledError:  # this client's own, or what becomes of a lost connection
            self._inbox.put_error(
                task,
                InputError(
                    f"cluster: {self._address}: the connection to the scheduler was lost; see that "
                    "it runs and give the command again"
                ),
            )
        except Exception as error:
            self._inbox.put_error(task, error)


class _IgnoresInterrupts(distributed.WorkerPlugin):
    """Ctrl-C reaches all processes of a terminal; only the client handles it."""

    def setup(self, worker: distributed.Worker) -> None:
        import signal

        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, signal.SIG_IGN)


# Of a worker. A worker may have several threads, but the library's settings of threads are those
# of the whole process: one task at a time.
_alone = threading.Lock()
# Names of clients that want no more results.
_stopped: set[str] = set()


def _stop(name: str) -> None:
    _stopped.add(name)


def _same(value: Any) -> Any:
    return value


def _run_and_keep(name: str, task: int, function: Function, *arguments: Any) -> Any:
    return _run(name, task, function, *arguments)[1]


def _run(name: str, task: int, function: Function, *arguments: Any) -> tuple[list[Any], Any]:
    worker = distributed.get_worker()

    def tell(number: int, part: Any) -> None:
        if name in _stopped:
            raise CancelledError
        worker.log_event(name, (task, number, json.dumps(part)))

    with _alone:
        return run_to_end(function(*arguments), tell)
