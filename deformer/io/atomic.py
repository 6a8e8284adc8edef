"""Whole-file reads, and writes that either finish or leave the old contents untouched."""

from __future__ import annotations

import os
import secrets
import shutil
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from deformer.errors import InputError

PathLike = str | os.PathLike[str]


def check_file(path: Path) -> None:
    """Check that `path` is a file with contents; reading a pipe or a device might never end.

    Raises:
        InputError: it is missing, out of reach, empty, or something other than a file.
    """
    try:
        status = path.stat()
    except FileNotFoundError:
        raise InputError(f"{path}: does not exist; check the path") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{path}: is a directory, pipe or device, expected a file; check the path")
    if status.st_size == 0:
        raise InputError(f"{path}: is empty, expected contents; export it again")


def read_bytes(path: Path) -> bytes:
    """Contents of the file `path`.

    Raises:
        InputError: the file is missing, not readable, empty, or no regular file.
    """
    check_file(path)
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error


def _temporary_name(target: Path) -> Path:
    """A free name in the directory of `target`; hidden, so that no loader reads it as data."""
    if not target.parent.is_dir():
        raise InputError(f"{target}: directory {target.parent} does not exist; create it first")
    if not os.access(target.parent, os.W_OK):
        raise InputError(f"{target}: directory {target.parent} is not writable; choose another")
    return target.parent / f".{target.stem}-{secrets.token_hex(4)}{target.suffix}"


@contextmanager
def atomic_path(path: PathLike) -> Iterator[Path]:
    """Yield a temporary file name beside `path`; rename it to `path` when the block succeeds.

    The temporary name has the suffix of `path`. When the block raises, the temporary file is
    removed and an old file at `path` stays as it was.

    Args:
        path: the file to write; its directory must exist.

    Raises:
        InputError: the directory is missing or not writable, or `path` is a directory.
        OSError: writing failed; its `filename` is `path`.
    """
    target = Path(path)
    if target.is_dir():
        raise InputError(f"{target}: is a directory, expected a file name; choose another name")
    temporary = _temporary_name(target)
    try:
        yield temporary
        temporary.replace(target)
    except OSError as error:
        _name_target(error, target, temporary)
        raise
    finally:
        temporary.unlink(missing_ok=True)


def check_directory(path: PathLike, replaceable: Callable[[Path], bool]) -> None:
    """Raise the InputError that `atomic_directory` would raise, before there is anything to write.

    Args:
        path, replaceable: as in `atomic_directory`.
    """
    _temporary_directory(_checked(path, replaceable)).rmdir()


@contextmanager
def atomic_directory(path: PathLike, replaceable: Callable[[Path], bool]) -> Iterator[Path]:
    """Yield a temporary directory beside `path`; rename it to `path` when the block succeeds.

    Args:
        path: the directory to write; its parent must exist.
        replaceable: true for an entry of an existing directory at `path` that may be lost. The old
            directory is replaced, as a whole, only if this is true for all its entries.

    Raises:
        InputError: the parent is missing or not writable, `path` is a file or a mount point, or
            an existing directory contains something else.
        OSError: writing failed; its `filename` is `path`.
    """
    target = _checked(path, replaceable)
    temporary = _temporary_directory(target)
    try:
        yield temporary
        if target.is_dir():
            old = _temporary_name(target)
            target.rename(old)
            try:
                temporary.rename(target)
            except OSError:
                old.rename(target)
                raise
            shutil.rmtree(old)
        else:
            temporary.rename(target)
    except OSError as error:
        _name_target(error, target, temporary)
        raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _checked(path: PathLike, replaceable: Callable[[Path], bool]) -> Path:
    """The directory `path` without links, trailing separator or dots, if it may be replaced."""
    target = Path(path)
    if target.exists() and not target.is_dir():
        raise InputError(f"{target}: is a file, expected a directory name; choose another name")
    if os.path.ismount(target):
        raise InputError(f"{target}: is a mount point; name a directory inside it")
    if target.is_dir():
        foreign = sorted(entry.name for entry in target.iterdir() if not replaceable(entry))
        if foreign:
            raise InputError(
                f"{target}: already holds {foreign[0]!r}, expected an empty directory or one "
                "written by the same command; choose another directory or move that file away"
            )
    return target.resolve()


def _temporary_directory(target: Path) -> Path:
    """A new directory beside `target`."""
    temporary = _temporary_name(target)
    try:
        temporary.mkdir()
    except OSError as error:  # a system that is read-only, full, or no place for directories
        raise InputError(
            f"{target}: cannot be created ({error.strerror}); choose another place"
        ) from error
    return temporary


def _name_target(error: OSError, target: Path, temporary: Path) -> None:
    """Make an error of writing to `temporary` one of `target`, for the reader of its message."""
    # A full disk is told without a file.
    if error.errno is not None and temporary.name in str(error.filename or temporary):
        error.filename = str(target)
