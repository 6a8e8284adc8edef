"""Compiled kernels over ranges of vertices, on all cores.

The kernels are numba functions without the GIL that take (start, stop, …); plain threads share
the range. They neither spin nor clash with the threads of BLAS and torch.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

# Below this many vertices a thread costs more (about 50 µs) than it saves.
_SMALLEST_SHARE = 2000
_CORES = os.cpu_count() or 1


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(max_workers=_CORES, thread_name_prefix="deformer")


def over_ranges(kernel: Callable[..., None], count: int, *arguments: Any) -> None:
    """Call kernel(start, stop, *arguments) on consecutive ranges that cover 0…count."""
    parts = max(1, min(_CORES, count // _SMALLEST_SHARE))
    bounds = [count * part // parts for part in range(parts + 1)]
    futures = [
        _pool().submit(kernel, bounds[part], bounds[part + 1], *arguments)
        for part in range(1, parts)
    ]
    kernel(bounds[0], bounds[1], *arguments)
    for future in futures:
        future.result()
