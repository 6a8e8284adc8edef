"""Locks that keep two processes from writing the same output."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from deformer.checks import LARGEST, checked_number, checked_path
from deformer.errors import InputError
from deformer.io.atomic import PathLike, check_parent

_held: set[tuple[int, Path]] = set()  # thread and output


@contextmanager
def locked(path: PathLike, wait: float = 0.0) -> Iterator[None]:
    """Keep other processes, and other threads, from writing `path` while the block runs.

    Only writers that ask for the lock are kept out; readers need none. The system releases the lock
    when its process ends, however it ends. The lock is an empty hidden file beside `path`, removed
    after the block; where only `path` itself can be written to, as to a mounted directory, it is
    inside. A thread that has the lock may enter another block for the same output.

    Args:
        path: the file or directory; its parent must exist.
        wait: seconds to wait for another process.

    Raises:
        InputError: another process has the lock, or there is no place for it.
    """
    from filelock import FileLock, Timeout  # imports asyncio

    target = checked_path(path, "path").resolve()
    checked_number(wait, "wait", least=0, most=LARGEST)
    key = threading.get_ident(), target
    if key in _held:
        yield
        return
    inside = target.is_dir() and not os.access(target.parent, os.W_OK)
    file = target / ".lock" if inside else target.parent / f".{target.name}.lock"
    check_parent(file)
    lock = FileLock(file)
    try:
        lock.acquire(timeout=wait)
    except Timeout:
        raise InputError(
            f"{path}: another process is writing it; wait until it has ended, or choose another "
            "output"
        ) from None
    except OSError as error:
        raise InputError(
            f"{path}: cannot be locked ({error.strerror or error}); choose another place"
        ) from error
    _held.add(key)
    try:
        yield
    finally:
        _held.discard(key)
        # Before the release, so that a process that waits finds the file gone and makes another.
        with contextlib.suppress(OSError):
            file.unlink()
        lock.release()
