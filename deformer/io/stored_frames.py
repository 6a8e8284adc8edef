"""Frames of handles that memory need not hold."""

from __future__ import annotations

import pickle
from array import array
from collections.abc import Sequence
from functools import cached_property
from typing import IO, TYPE_CHECKING, overload

from deformer.errors import InputError
from deformer.workspace import Workspace

if TYPE_CHECKING:
    from deformer.io.handle_files import HandleTarget

    Frame = tuple[HandleTarget, ...]


class StoredFrames(Sequence["Frame"]):
    """Frames in a temporary file of this process, eight bytes of each in memory.

    The file has no name, and no other process reads it, so that its format is nobody's concern.

    Args:
        workspace: says where the file is.
    """

    def __init__(self, workspace: Workspace) -> None:
        """Start without frames."""
        self._workspace, self._starts = workspace, array("q", [0])

    @cached_property
    def _file(self) -> IO[bytes]:
        """The file; frames of one pose need none."""
        return self._workspace.growing()

    def append(self, frame: Frame) -> None:
        """Add a frame at the end.

        Raises:
            InputError: the folder has no room for it.
        """
        try:
            self._file.seek(self._starts[-1])
            self._starts.append(self._starts[-1] + self._file.write(pickle.dumps(frame)))
        except OSError as error:
            # Left to whoever reads the handles, it would be told as a fault of their file.
            raise InputError(
                f"{self._workspace.place}: a temporary file cannot be written ({error.strerror}); "
                "make room or name another folder for the cache"
            ) from error

    def __len__(self) -> int:
        """Count the frames."""
        return len(self._starts) - 1

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...

    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        """Read a frame, or those of a slice."""
        if isinstance(index, slice):
            return [self[n] for n in range(*index.indices(len(self)))]
        n = range(len(self))[index]
        self._file.seek(self._starts[n])
        return pickle.loads(self._file.read(self._starts[n + 1] - self._starts[n]))
