"""Compiled kernels on all cores.

The kernels are numba functions without the GIL; plain threads share the work. They neither spin
nor clash with the threads of BLAS and torch.
"""

from __future__ import annotations

import ctypes
import math
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

_ALLOWED = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()


def usable_cores() -> int:
    """Cores that this process may use: of its affinity mask, its cgroup and the environment.

    OMP_NUM_THREADS and NUMBA_NUM_THREADS bound the number, as they do for others' threads.
    """
    limits = [len(_ALLOWED) or os.cpu_count() or 1]
    for name in ("OMP_NUM_THREADS", "NUMBA_NUM_THREADS"):
        value = os.environ.get(name, "")
        if value.isdigit() and int(value) > 0:
            limits.append(int(value))
    try:
        quota, period = Path("/sys/fs/cgroup/cpu.max").read_text().split()
        limits.append(max(1, math.ceil(int(quota) / int(period))))
    except (OSError, ValueError):
        # No such file, or the quota is the word "max": no limit.
        pass
    return min(limits)


CORES = usable_cores()
Item = TypeVar("Item")
Result = TypeVar("Result")

# Below this many vertices a thread costs more (about 50 µs) than it saves.
_SMALLEST_SHARE = 2000


# `alone` is set on threads of `in_parallel`, on which kernels do not start threads of their own.
_thread = threading.local()


def scratch(name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Memory of this thread that keeps its pages: fresh pages cost more than what fills them.

    The next call by the same name on the same thread gives the same memory.
    """
    size = math.prod(shape)
    kept = getattr(_thread, name, None)
    if kept is None or kept.size < size:
        kept = np.empty(size, dtype=np.float32)
        setattr(_thread, name, kept)
    return kept[:size].reshape(shape)


class _WorkerMask:
    """Keeps worker threads off the core of the thread that wakes them.

    Linux on a virtual machine takes halted cores for busy ones, and runs a woken thread on the
    core of its waker, which then waits for it: two threads took as long as one. The mask is set
    again only when the caller has moved to another core.
    """

    def __init__(self) -> None:
        self._workers: list[int] = []
        self._core = -1
        libc = ctypes.CDLL(None) if len(_ALLOWED) > 1 else None
        self._current: Callable[[], int] | None = getattr(libc, "sched_getcpu", None)

    def add_worker(self) -> None:
        """Called by every worker as it starts."""
        self._workers.append(threading.get_native_id())
        self._core = -1

    def exclude_current_core(self) -> None:
        """Called before workers are woken."""
        core = self._current() if self._current else -1
        if core != self._core:
            self._core = core
            for worker in self._workers:
                os.sched_setaffinity(worker, _ALLOWED - {core})


@cache
def _worker_mask() -> _WorkerMask:
    return _WorkerMask()


@cache
def _pool() -> ThreadPoolExecutor:
    # The caller takes a share, too.
    return ThreadPoolExecutor(
        max_workers=max(1, CORES - 1),
        thread_name_prefix="deformer",
        initializer=_worker_mask().add_worker,
    )


@cache
def _outer_pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(
        max_workers=CORES,
        thread_name_prefix="deformer-parallel",
        initializer=lambda: setattr(_thread, "alone", True),
    )


def in_parallel(function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """Call function(item) for all items, on all cores, and yield the results in order.

    Unlike a kernel the function may use the kernels itself: within it they run on one thread,
    unless there is one item only.
    """
    if len(items) == 1:
        yield function(items[0])
    else:
        yield from _outer_pool().map(function, items)


def split(count: int) -> list[range]:
    """Ranges that cover 0…count, one a core and none empty."""
    parts = max(1, min(CORES, count))
    bounds = [count * part // parts for part in range(parts + 1)]
    return [range(a, b) for a, b in pairwise(bounds)]


def run_calls(kernel: Callable[..., None], calls: Sequence[tuple]) -> None:
    """Call kernel(*arguments) for all `calls` at once, and wait for them."""
    futures = start_calls(kernel, calls[1:])
    kernel(*calls[0])
    wait_for(futures)


def start_calls(kernel: Callable[..., None], calls: Sequence[tuple]) -> list[Future[None]]:
    """Call kernel(*arguments) for all `calls` while the caller goes on; `wait_for` the futures."""
    if getattr(_thread, "alone", False):
        for arguments in calls:
            kernel(*arguments)
        return []
    if calls:
        _worker_mask().exclude_current_core()
    return [_pool().submit(kernel, *arguments) for arguments in calls]


def wait_for(futures: Sequence[Future[None]]) -> None:
    """Wait until all futures are done; what one of them raised is raised here."""
    for future in futures:
        future.result()


def ranges(count: int, share: int = _SMALLEST_SHARE) -> list[tuple[int, int]]:
    """Consecutive ranges (start, stop) that cover 0…count: one a core, none below `share`."""
    parts = 1 if getattr(_thread, "alone", False) else max(1, min(CORES, count // share))
    bounds = [count * part // parts for part in range(parts + 1)]
    return list(pairwise(bounds))


def over_ranges(
    kernel: Callable[..., None], count: int, *arguments: Any, share: int = _SMALLEST_SHARE
) -> None:
    """Call kernel(start, stop, *arguments) on consecutive ranges that cover 0…count.

    Args:
        kernel: of ranges that do not depend on each other.
        count: length of what the ranges cover.
        arguments: the same for all ranges.
        share: the least length of a range, unless it is the only one.
    """
    run_calls(kernel, [(*piece, *arguments) for piece in ranges(count, share)])


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """The matrices of a solve are small: more BLAS threads only wait for each other."""
    with _blas().limit(limits=1, user_api="blas"):
        yield


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
