"""Whether kernels are being compiled right now; asking does not load numba."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

_lock = threading.Lock()
_running = 0  # compilations that have begun and not ended


def compiling() -> bool:
    """Return True while this process compiles a kernel, or waits for processes that do.

    Kernels are compiled once for a version of numba and a processor, mostly after an installation;
    a program can tell its user what takes so long.
    """
    return _running > 0


def begin_compiling() -> None:
    """Count a compilation that begins."""
    _count(1)


def end_compiling() -> None:
    """Count a compilation that ends."""
    _count(-1)


@contextmanager
def counted_as_compiling() -> Iterator[None]:
    """Count a block as one compilation."""
    begin_compiling()
    try:
        yield
    finally:
        end_compiling()


def _count(change: int) -> None:
    global _running
    with _lock:
        _running += change
