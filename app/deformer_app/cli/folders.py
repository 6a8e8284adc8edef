"""Directories that commands write: whole, by one process at a time, never over foreign files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from deformer import io


@contextmanager
def output_folder(output: Path, written: str) -> Iterator[Path]:
    """Yield a temporary directory that replaces `output` when the block succeeds.

    Args:
        output: the directory; its parents are created.
        written: regular expression of the names of files that the command writes. An older
            directory is replaced if it contains no others.

    Raises:
        InputError: before the block, if `output` cannot be written or another process writes it.
    """
    if output.name in ("", ".."):  # as of "."
        output = output.resolve()

    def replaceable(entry: Path) -> bool:
        return entry.is_file() and re.fullmatch(written, entry.name) is not None

    output.parent.mkdir(parents=True, exist_ok=True)
    io.check_directory(output, replaceable)
    with io.locked(output), io.atomic_directory(output, replaceable) as folder:
        yield folder
