"""Pictures drawn one after another and written as an animation, with progress, until given up."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deformer import InputError
from deformer_app.rendering.animation import check_animation_path, save_animation
from deformer_app.rendering.offscreen import Picture
from deformer_app.viewer.changes import WaitBegun, WaitEnded
from deformer_app.viewer.worker import in_background

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor


class Filming:
    """Draws and writes one animation at a time.

    Args:
        editor: whose user is told of the progress.
    """

    def __init__(self, editor: Editor) -> None:
        """Begin without an animation."""
        self._editor = editor
        self._path: Path | None = None
        self._given_up = False

    @property
    def running(self) -> bool:
        """True while an animation is being drawn or written."""
        return self._path is not None

    def give_up(self) -> bool:
        """Stop the animation, which leaves no file; return False if there is none."""
        self._given_up = self.running
        return self.running

    def write(
        self, path: Path, pictures: Generator[Picture, None, None], count: int, fps: int
    ) -> Generator[None, None, None]:
        """Draw pictures, one a step, and write them on a thread; a job of the editor.

        Args:
            path: file that ends in .gif or .mp4.
            pictures: draws the next picture (height, width, 3); closed at the end.
            count: number of the pictures.
            fps: frames a second.

        Raises:
            InputError: see `save_animation`, or another animation is being written.
        """
        check_animation_path(path)
        if self._path is not None:
            raise InputError(
                f"{path}: {self._path.name} is still being written; wait for it, or press Esc"
            )
        editor, model, drawn = self._editor, self._editor.model, []
        self._path, self._given_up = path, False
        try:
            for picture in pictures:
                drawn.append(picture)
                self._tell(f"Drawing {path.name}", len(drawn), count)
                yield
                if not (editor.is_open and editor.model is model):
                    self._given_up = True
                if self._given_up:
                    break
            else:
                yield from self._save(path, drawn, fps)
            editor.note(f"{path.name} was given up" if self._given_up else f"Wrote {path}")
        finally:
            pictures.close()
            self._path = None
            editor.announce(WaitEnded())

    def _save(self, path: Path, drawn: Sequence[Picture], fps: int) -> Generator[None, None, None]:
        """Write pictures on a thread, unless the user gives up."""
        watched = _Watched(drawn, lambda: self._given_up)
        try:
            for _ in in_background(lambda: save_animation(path, watched, fps)):
                self._tell(f"Writing {path.name}", watched.reached, len(drawn))
                yield
        except _GivenUp:
            pass

    def _tell(self, text: str, number: int, count: int) -> None:
        self._editor.announce(WaitBegun(f"{text}: frame {number} of {count}. Esc cancels."))


class _GivenUp(Exception):
    """Ends the writing of an animation that is no longer wanted."""


class _Watched(Sequence[Picture]):
    """Pictures that tell how far they have been read, and can be withdrawn."""

    def __init__(self, pictures: Sequence[Picture], given_up: Callable[[], bool]) -> None:
        self._pictures, self._given_up = pictures, given_up
        self.reached = 0

    def __len__(self) -> int:
        return len(self._pictures)

    def __getitem__(self, index: Any) -> Any:
        if self._given_up():
            raise _GivenUp
        if isinstance(index, int) and index < len(self):
            self.reached = index + 1
        return self._pictures[index]
