"""Directories that are written whole, and never over what this program has not written."""

from __future__ import annotations

import ctypes
import hashlib
import os
import re
import shutil
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from deformer.checks import checked_path
from deformer.errors import InputError
from deformer.io.atomic import PathLike, name_target, remove_abandoned, temporary_name
from deformer.io.json_files import read_json, write_json

# Hidden file of a directory, with the checksums of the files that were written with it.
MANIFEST = ".deformer.json"
# Bytes at the beginning of a file in which its format's marks are.
_HEAD = 1000
# Arguments of Linux's renameat2: paths are relative to the working directory; exchange the two.
_HERE, _EXCHANGE = -100, 2
_LINUX = sys.platform == "linux"


def digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def begins_with(path: Path, pattern: bytes) -> bool:
    """True if the first thousand bytes of a regular file begin with a regular expression."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return re.match(pattern, file.read(_HEAD), re.DOTALL) is not None


def check_directory(
    path: PathLike,
    replaceable: Callable[[Path], bool],
    manifest: str | None = MANIFEST,
    kept: Collection[str] = (),
) -> None:
    """Raise the InputError that `atomic_directory` would raise, before there is anything to write.

    Args:
        path: as in `atomic_directory`.
        replaceable: as in `atomic_directory`.
        manifest: as there; None where `replaceable` looks at the contents itself.
        kept: as in `atomic_directory`.
    """
    _temporary_directory(_checked(path, replaceable, manifest, kept)).rmdir()


@contextmanager
def atomic_directory(
    path: PathLike,
    replaceable: Callable[[Path], bool],
    manifest: str = MANIFEST,
    kept: Collection[str] = (),
) -> Iterator[Path]:
    """Yield a temporary directory beside `path`; rename it to `path` when the block succeeds.

    On Linux an old directory is exchanged for the new one in one step; elsewhere there is a moment
    without one. Whatever ends the block or the renaming, `path` is the old or the new directory.

    Args:
        path: the directory to write; its parent must exist.
        replaceable: true for an entry of an existing directory at `path` that has a name which the
            caller writes. The old directory is replaced, as a whole, only if this is true for all
            its entries, and they are the files of its manifest, unchanged.
        manifest: name of a JSON file in the directory with an object "sha256", name → checksum;
            written after the block, unless the block writes it.
        kept: names of files of others that the new directory has as the old one had them.

    Raises:
        InputError: the parent is missing or not writable, `path` is a file or a mount point, or
            an existing directory contains something else.
        OSError: writing failed; its `filename` is `path`.
    """
    target = _checked(path, replaceable, manifest, kept)
    temporary = _temporary_directory(target)
    try:
        yield temporary
        if not (temporary / manifest).exists():
            sums = {entry.name: digest(entry) for entry in sorted(temporary.iterdir())}
            write_json(temporary / manifest, {"sha256": sums})
        for name in kept:
            if (target / name).is_file():
                shutil.copy2(target / name, temporary / name)
        _put_in_place(temporary, target)
    except OSError as error:
        name_target(error, target, temporary)
        raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    remove_abandoned(target)


def _put_in_place(temporary: Path, target: Path) -> None:
    """Give a directory the name `target`; what had that name is then `temporary`, or gone."""
    if not target.is_dir():
        temporary.rename(target)
        return
    if _exchange(temporary, target):
        return
    # Between two renames there is no `target`: any exception and interrupt brings one back.
    old = temporary_name(target)
    try:
        target.rename(old)
        temporary.rename(target)
    finally:
        if target.is_dir():
            shutil.rmtree(old, ignore_errors=True)
        else:
            old.rename(target)


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two names in one step; false where the system cannot."""
    renameat2 = getattr(ctypes.CDLL(None), "renameat2", None) if _LINUX else None
    paths = os.fsencode(one), os.fsencode(other)
    return renameat2 is not None and not renameat2(_HERE, paths[0], _HERE, paths[1], _EXCHANGE)


def _checked(
    path: PathLike,
    replaceable: Callable[[Path], bool],
    manifest: str | None,
    kept: Collection[str],
) -> Path:
    """The directory `path` without links, trailing separator or dots, if it may be replaced."""
    target = checked_path(path, "path")
    if target.exists() and not target.is_dir():
        raise InputError(f"{target}: is a file, expected a directory name; choose another name")
    if os.path.ismount(target):
        raise InputError(f"{target}: is a mount point; name a directory inside it")
    if target.is_dir():
        written = _written(target, manifest) if manifest else {}
        for entry in sorted(target.iterdir()):
            if entry.is_file() and (entry.name in kept or (written and entry.name == manifest)):
                continue
            if not entry.is_file() or not replaceable(entry):
                fault = "which this program does not write there"
            elif manifest and entry.name not in written:
                fault = "which this program has not written"
            elif manifest and written[entry.name] != digest(entry):
                fault = "which has changed since it was written"
            else:
                continue
            raise InputError(
                f"{target}: already holds {entry.name!r}, {fault}; choose another directory or "
                "move that file away"
            )
    return target.resolve()


def _written(folder: Path, manifest: str) -> dict[str, str]:
    """Checksums of the files that were written with a manifest; none where there is no manifest."""
    try:
        sums = read_json(folder / manifest).get("sha256")
    except InputError:
        return {}
    return sums if isinstance(sums, dict) else {}


def _temporary_directory(target: Path) -> Path:
    """A new directory beside `target`."""
    temporary = temporary_name(target)
    try:
        temporary.mkdir()
    except OSError as error:  # a system that is read-only, full, or no place for directories
        raise InputError(
            f"{target}: cannot be created ({error.strerror}); choose another place"
        ) from error
    return temporary
