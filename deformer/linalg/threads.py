"""Compiled kernels on all cores.

The kernels are numba functions that release the GIL; Python threads share the work. Idle threads do
not spin, and so take no time from the threads of BLAS and torch.
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
    """Number of cores that this process may use.

    It is bounded by the affinity mask, by the cgroup's quota, and by the environment variables
    OMP_NUM_THREADS and NUMBA_NUM_THREADS.
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
        # There is no such file, or the quota is the word "max": no limit.
        pass
    return min(limits)


CORES = usable_cores()
Item = TypeVar("Item")
Result = TypeVar("Result")

# Below this many vertices a thread costs more (about 50 µs) than it saves.
_SMALLEST_SHARE = 2000


# `cores` is the number of threads that kernels may use which the calling thread runs: all without
# it, and one on the threads of `in_parallel`.
_thread = threading.local()


def _cores() -> int:
    return getattr(_thread, "cores", CORES)


def scratch(name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Uninitialised float32 array that the calling thread reuses.

    The next call with the same name on the same thread returns the same memory: mapping new pages
    costs more than filling them.

    Args:
        name: name of the memory.
        shape: shape of the array.
    """
    size = math.prod(shape)
    buffer = getattr(_thread, name, None)
    if buffer is None or buffer.size < size:
        buffer = np.empty(size, dtype=np.float32)
        setattr(_thread, name, buffer)
    return buffer[:size].reshape(shape)


class _WorkerMask:
    """Keeps worker threads off the core of the thread that wakes them.

    Linux on a virtual machine may treat halted cores as busy, and then runs a woken thread on the
    core of the thread that wakes it and waits for it: two threads took as long as one. The mask is
    set again only when the caller has moved to another core.
    """

    def __init__(self) -> None:
        self._workers: list[int] = []
        self._core = -1
        libc = ctypes.CDLL(None) if len(_ALLOWED) > 1 else None
        self._current: Callable[[], int] | None = getattr(libc, "sched_getcpu", None)

    def add_worker(self) -> None:
        """Register the calling thread, a worker that starts."""
        self._workers.append(threading.get_native_id())
        self._core = -1

    def exclude_current_core(self) -> None:
        """Keep workers off the caller's core; called before they are woken."""
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
    # The caller does one part of the work itself.
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
        initializer=use_cores,
        initargs=(1,),
    )


def use_cores(count: int) -> None:
    """Have kernels that the calling thread runs, from now on, use so many threads, itself one."""
    _thread.cores = count


def in_parallel(function: Callable[[Item], Result], items: Sequence[Item]) -> Iterator[Result]:
    """Call function(item) for all items, on all cores, and yield the results in order.

    The function may call `over_ranges`, `run_calls` and this one: they use one thread within it, or
    all cores if there is only one item.

    Args:
        function: called once an item, on any thread.
        items: its arguments.
    """
    if len(items) == 1 or _cores() == 1:
        yield from map(function, items)
    else:
        yield from _outer_pool().map(function, items)


def split(count: int) -> list[range]:
    """Consecutive ranges that cover 0…count − 1, one a core and none empty (for count > 0)."""
    parts = max(1, min(_cores(), count))
    bounds = [count * part // parts for part in range(parts + 1)]
    return [range(a, b) for a, b in pairwise(bounds)]


def over_parts(function: Callable[[range], None], count: int) -> None:
    """Call function(part) in parallel on the ranges of `split(count)`, and wait for all.

    Args:
        function: called as `in_parallel` calls its own; the parts must not depend on each other.
        count: length of what the parts cover.
    """
    for _ in in_parallel(function, split(count)):
        pass


def run_calls(kernel: Callable[..., None], calls: Sequence[tuple]) -> None:
    """Call kernel(*arguments) for all `calls` in parallel, and wait for them.

    Args:
        kernel: releases the GIL.
        calls: arguments of each call; at least one.
    """
    futures = start_calls(kernel, calls[1:])
    kernel(*calls[0])
    wait_for(futures)


def start_calls(kernel: Callable[..., None], calls: Sequence[tuple]) -> list[Future[None]]:
    """Start kernel(*arguments) for all `calls` on other threads.

    Args:
        kernel: releases the GIL.
        calls: arguments of each call.

    Returns:
        Futures for `wait_for`; none if the calls have been made on this thread.
    """
    if _cores() == 1:
        for arguments in calls:
            kernel(*arguments)
        return []
    if calls:
        _worker_mask().exclude_current_core()
    return [_pool().submit(kernel, *arguments) for arguments in calls]


def wait_for(futures: Sequence[Future[None]]) -> None:
    """Wait until all futures are done, and raise the first exception of their calls."""
    for future in futures:
        future.result()


def ranges(count: int, share: int = _SMALLEST_SHARE) -> list[tuple[int, int]]:
    """Consecutive ranges (start, stop) that cover 0…count − 1, at most one a core.

    Args:
        count: length of what the ranges cover.
        share: the least length of a range, unless it is the only one.
    """
    parts = max(1, min(_cores(), count // share))
    bounds = [count * part // parts for part in range(parts + 1)]
    return list(pairwise(bounds))


def over_ranges(
    kernel: Callable[..., None], count: int, *arguments: Any, share: int = _SMALLEST_SHARE
) -> None:
    """Call kernel(start, stop, *arguments) in parallel on ranges that cover 0…count − 1.

    Args:
        kernel: releases the GIL; the ranges must not depend on each other.
        count: length of what the ranges cover.
        arguments: further arguments, the same for all ranges.
        share: the least length of a range, unless it is the only one.
    """
    run_calls(kernel, [(*piece, *arguments) for piece in ranges(count, share)])


class _OneBlasThread:
    """The limit of `one_blas_thread`, which is that of the process.

    The first thread that asks for it sets it, and the last one that leaves takes it back.
    """

    def __init__(self) -> None:
        self._lock, self._users = threading.Lock(), 0
        self._controller = ThreadpoolController()

    def enter(self) -> None:
        with self._lock:
            if self._users == 0:
                self._limit = self._controller.limit(limits=1, user_api="blas")
            self._users += 1

    def leave(self) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0:
                self._limit.restore_original_limits()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread within the block: for small matrices, more only wait."""
    limit = _one_blas_thread()
    limit.enter()
    try:
        yield
    finally:
        limit.leave()


@cache
def _one_blas_thread() -> _OneBlasThread:
    return _OneBlasThread()
