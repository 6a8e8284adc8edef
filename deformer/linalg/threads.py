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
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

_ALLOWED = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
CORES = len(_ALLOWED) or os.cpu_count() or 1
# Below this many vertices a thread costs more (about 50 µs) than it saves.
_SMALLEST_SHARE = 2000


# Whether this thread is one of several that `each` has started.
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


class _Elsewhere:
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

    def enter(self) -> None:
        """Called by every worker as it starts."""
        self._workers.append(threading.get_native_id())
        self._core = -1

    def __call__(self) -> None:
        """Called before workers are woken."""
        core = self._current() if self._current else -1
        if core != self._core:
            self._core = core
            for worker in self._workers:
                os.sched_setaffinity(worker, _ALLOWED - {core})


@cache
def _elsewhere() -> _Elsewhere:
    return _Elsewhere()


@cache
def _pool() -> ThreadPoolExecutor:
    # The caller takes a share, too.
    return ThreadPoolExecutor(
        max_workers=max(1, CORES - 1),
        thread_name_prefix="deformer",
        initializer=_elsewhere().enter,
    )


@cache
def _outer_pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(
        max_workers=CORES,
        thread_name_prefix="deformer-each",
        initializer=lambda: setattr(_thread, "alone", True),
    )


def each(function: Callable[[range], None], count: int) -> None:
    """Call function(part) for ranges that cover 0…count, on all cores.

    Unlike a kernel the function may use the kernels itself: within it they run on one thread.
    """
    if count == 1:
        function(range(1))
        return
    parts = max(1, min(CORES, count))
    bounds = [count * part // parts for part in range(parts + 1)]
    list(_outer_pool().map(function, [range(a, b) for a, b in pairwise(bounds)]))


def together(kernel: Callable[..., None], calls: Sequence[tuple]) -> None:
    """Call kernel(*arguments) for all `calls` at once, and wait for them."""
    futures = begin(kernel, calls[1:])
    kernel(*calls[0])
    finish(futures)


def begin(kernel: Callable[..., None], calls: Sequence[tuple]) -> list[Future[None]]:
    """Call kernel(*arguments) for all `calls` while the caller goes on."""
    if getattr(_thread, "alone", False):
        for arguments in calls:
            kernel(*arguments)
        return []
    if calls:
        _elsewhere()()
    return [_pool().submit(kernel, *arguments) for arguments in calls]


def finish(futures: Sequence[Future[None]]) -> None:
    """Wait for what `begin` has begun."""
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
        count: what there is.
        arguments: the same for all.
        share: a range is not shorter than this, unless it is the only one.
    """
    together(kernel, [(*piece, *arguments) for piece in ranges(count, share)])


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """The matrices of a solve are small: more BLAS threads only wait for each other."""
    with _blas().limit(limits=1, user_api="blas"):
        yield


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()
