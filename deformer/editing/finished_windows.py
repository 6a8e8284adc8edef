"""Windows of a long sequence that are fitted, kept so that a killed process is gone on from."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deformer.checks import checked_path
from deformer.geometry import FloatArray
from deformer.io import (
    begins_with,
    check_directory,
    read_metadata,
    read_tensors,
    write_tensors,
)

_FORMAT = 2
_NAME = re.compile(r"(\.?)fit-\d+-window-\d{6,}(-[\da-f-]+)?\.safetensors")
_BEGINNING = rb'.{8}\{"__metadata__":\{"identity":'


@dataclass(frozen=True, eq=False)
class SolvedWindow:
    """What was found for the m frames of a window and after it.

    Args:
        X: (m, K+6) unknowns.
        noise: (m,) σ of each frame.
        steps: taken.
    """

    X: FloatArray
    noise: FloatArray
    steps: int


class FinishedWindows:
    """Unknowns of windows that are fitted, each in a file of a folder.

    Args:
        folder: created with the first window; None keeps nothing.
        identity: JSON values that have to be equal for a window to be used again: all that the
            fit depends on. Windows of another fit are replaced.
    """

    def __init__(self, folder: Path | None, identity: dict[str, Any]) -> None:
        """Nothing is read yet."""
        self._folder, self._identity = folder, {"format": _FORMAT, **identity}

    def load(self, attempt: int, number: int) -> SolvedWindow | None:
        """What was found for a window; None without.

        Args:
            attempt: as of `WindowFits.run`.
            number: of the window.

        Raises:
            InputError: its file is damaged.
        """
        if self._folder is None or not (where := self._file(attempt, number)).is_file():
            return None
        if read_metadata(where, "identity").value != self._identity:
            return None
        arrays = read_tensors(where)
        return SolvedWindow(arrays["X"], arrays["noise"], int(arrays["steps"][0]))

    def save(self, attempt: int, number: int, found: SolvedWindow) -> None:
        """Keep a window, as it is loaded."""
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        arrays = {"X": found.X, "noise": found.noise, "steps": np.array([found.steps])}
        metadata = {"identity": json.dumps(self._identity)}
        write_tensors(self._file(attempt, number), arrays, metadata)

    def _file(self, attempt: int, number: int) -> Path:
        assert self._folder is not None
        return self._folder / f"fit-{attempt}-window-{number:06d}.safetensors"


def check_windows(folder: str | Path) -> None:
    """Check, before work starts, that windows of a sequence's fit can be kept in a folder.

    Raises:
        InputError: it holds other files, is a file, or cannot be created.
    """
    check_directory(folder, _is_window, manifest=None)


def remove_windows(folder: str | Path) -> None:
    """Remove the windows that `fit_sequence_parts` has kept, and the folder if that was all.

    Args:
        folder: as of `fit_sequence_parts`; one that does not exist is left.
    """
    folder = checked_path(folder, "folder")
    if not folder.is_dir():
        return
    for path in filter(_is_window, list(folder.iterdir())):
        path.unlink()
    if not any(folder.iterdir()) and not folder.is_symlink():
        folder.rmdir()


def _is_window(path: Path) -> bool:
    """True for the file of a window, and for what a killed process has left of one."""
    found = _NAME.fullmatch(path.name)
    return found is not None and (bool(found[1]) or begins_with(path, _BEGINNING))
