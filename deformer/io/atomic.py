"""Whole-file reads, and writes that either finish or leave the old contents untouched."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import re
import secrets
import shutil
import stat
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from deformer.checks import check_path_length, checked_path
from deformer.errors import InputError
from deformer.io import system_names

PathLike = str | os.PathLike[str]

# Age from which a temporary file that another system has begun is taken to be abandoned.
_ABANDONED_SECONDS = 3600.0


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Make an InputError of what the system refuses within the block, which reads a file."""
    try:
        yield
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error


def check_file(path: Path) -> None:
    """Check that `path` is a file with contents; reading a pipe or a device might never end.

    Raises:
        InputError: it is missing, out of reach, empty, or something other than a file.
    """
    with reading(path):
        try:
            status = path.stat()
        except FileNotFoundError:
            link = path.is_symlink()
            what = "is a link to a file that does not exist" if link else "does not exist"
            raise InputError(f"{path}: {what}; check the path") from None
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: is a directory, pipe or device, expected a file; check the path")
    if status.st_size == 0:
        raise InputError(f"{path}: is empty, expected contents; export it again")


def read_bytes(path: PathLike) -> bytes:
    """Contents of the file `path`.

    Raises:
        InputError: the file is missing, not readable, empty, or no regular file.
    """
    path = checked_path(path)
    check_file(path)
    with reading(path):
        return path.read_bytes()


def check_parent(target: Path) -> None:
    """Raise InputError unless the directory of `target` can be written to."""
    if not target.parent.is_dir():
        raise InputError(f"{target}: directory {target.parent} does not exist; create it first")
    if not os.access(target.parent, os.W_OK):
        raise InputError(f"{target}: directory {target.parent} is not writable; choose another")


def temporary_name(target: Path) -> Path:
    """A free name in the directory of `target`; hidden, so that no loader reads it as data."""
    check_parent(target)
    fault = system_names.windows_fault(target.name) if system_names.WINDOWS else None
    if fault is not None:
        raise InputError(f"{target}: {target.name} {fault}; choose another name")
    name = f".{target.stem}-{_system()}-{os.getpid()}-{secrets.token_hex(4)}{target.suffix}"
    check_path_length(target.parent / name, "path, as that of a temporary file")
    return target.parent / name


@functools.cache
def _system() -> str:
    """Six digits that differ where process numbers do not compare: machines, containers, boots."""
    parts = [platform.node()]
    with contextlib.suppress(OSError):  # Linux
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text())
        parts.append(str(Path("/proc/self/ns/pid").readlink()))
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:6]


def remove_abandoned(target: Path) -> None:
    """Remove temporary files and directories of `target` whose process was killed.

    Called once `target` is written: before, one of them may be the only version.
    """
    name = re.compile(
        rf"\.{re.escape(target.stem)}-([\da-f]{{6}})-(\d+)-[\da-f]{{8}}{re.escape(target.suffix)}"
    )
    with contextlib.suppress(OSError):  # what cannot be listed or removed stays
        for path in target.parent.iterdir():
            found = name.fullmatch(path.name)
            if found is None or not _is_abandoned(path, found[1], int(found[2])):
                continue
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()


def _is_abandoned(path: Path, system: str, process: int) -> bool:
    """True if the process that wrote `path` has ended, as far as this system knows."""
    if system != _system():
        return time.time() - path.stat().st_mtime > _ABANDONED_SECONDS
    if os.name == "nt":  # has no harmless way to ask
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return True
    except (PermissionError, OverflowError):
        pass
    return False


def check_output_file(path: PathLike) -> None:
    """Raise the InputError that `atomic_path` would raise, before there is anything to write."""
    target = checked_path(path, "path")
    if target.is_dir():
        raise InputError(f"{target}: is a directory, expected a file name; choose another name")
    if target.exists() and not target.is_file():
        raise InputError(
            f"{target}: is a pipe, socket or device, expected a file name; choose another name"
        )
    temporary_name(_behind_links(target))


def _behind_links(path: Path) -> Path:
    """The file that a symbolic link leads to; the suffix stays, for writers go by it."""
    return path.resolve().with_suffix(path.suffix) if path.is_symlink() else path


@contextmanager
def atomic_path(path: PathLike) -> Iterator[Path]:
    """Yield a temporary file name beside `path`; rename it to `path` when the block succeeds.

    A symbolic link stays: the file that it points to is written.

    The temporary name has the suffix of `path`. When the block raises, the temporary file is
    removed and an old file at `path` stays as it was.

    Args:
        path: the file to write; its directory must exist.

    Raises:
        InputError: the directory is missing or not writable, or `path` is a directory,
            pipe or device.
        OSError: writing failed; its `filename` is `path`.
    """
    check_output_file(path)
    temporary = temporary_name(_behind_links(Path(path)))
    target = Path(path).resolve() if Path(path).is_symlink() else Path(path)
    try:
        yield temporary
        temporary.replace(target)
    except OSError as error:
        name_target(error, target, temporary)
        raise
    finally:
        temporary.unlink(missing_ok=True)
    remove_abandoned(target)


def name_target(error: OSError, target: Path, temporary: Path) -> None:
    """Make an error of writing to `temporary` one of `target`, for the reader of its message."""
    # A full disk is told without a file.
    if error.errno is not None and temporary.name in str(error.filename or temporary):
        error.filename = str(target)
