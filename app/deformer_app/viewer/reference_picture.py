"""The picture or video that a person poses by: which one, where, how strong, at which time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from deformer import InputError, io
from deformer_app.rendering.footage import Footage, open_footage
from deformer_app.viewer.picture_plane import PicturePlane
from deformer_app.viewer.worker import in_background


@dataclass(frozen=True)
class Placement:
    """How a reference picture is shown.

    Args:
        x, y: its middle, right and up from the middle of the view, in heights of the view.
        scale: its height, in heights of the view.
        opacity: from 0, invisible, to 1.
        in_front: true for in front of the model.
    """

    x: float = 0.0
    y: float = 0.0
    scale: float = 1.0
    opacity: float = 0.6
    in_front: bool = False


class ReferencePicture:
    """At most one picture, folder of pictures or video at the camera's image plane.

    Frames are read in the background; while one is being read, the last one stays.

    Args:
        plane: draws it.
        run: runs a job step by step.
        changed: called when the view must be drawn again.
    """

    def __init__(
        self,
        plane: PicturePlane,
        run: Callable[[Iterator[None]], Any],
        changed: Callable[[], Any],
    ) -> None:
        """Begin without a picture."""
        self._plane, self._run, self._changed = plane, run, changed
        self._footage: Footage | None = None
        self._missing: dict[str, Any] | None = None  # the session's entry of a file that is gone
        self._placement = Placement()
        self._seconds = 0.0
        self._wanted = self._shown = -1
        self._reading = False

    @property
    def footage(self) -> Footage | None:
        """What is shown, if anything is."""
        return self._footage

    @property
    def placement(self) -> Placement:
        """How it is shown."""
        return self._placement

    @property
    def seconds(self) -> float:
        """The time whose frame is shown."""
        return self._seconds

    @property
    def frame(self) -> int:
        """Number of the frame that is shown; -1 before the first one has been read."""
        return self._shown

    def open(self, path: str | Path) -> None:
        """Show a picture, the first of a folder of pictures, or the first frame of a video.

        Raises:
            InputError: see `open_footage`.
        """
        footage = open_footage(path)
        first = footage.frame(0)
        self._begin(footage)
        self._fill(0, first)

    def close(self) -> None:
        """Show no picture."""
        self._begin(None)
        self._changed()

    def place(self, **changes: Any) -> None:
        """Change how the picture is shown; see `Placement`."""
        self._placement = replace(self._placement, **changes)
        self._draw()

    def set_frame(self, seconds: float) -> None:
        """Show the frame of a time in seconds from the beginning, once it has been read."""
        self._seconds = seconds
        if self._footage is None:
            return
        self._wanted = self._footage.index_at(seconds)
        if self._wanted != self._shown and not self._reading:
            self._reading = True
            self._run(self._read(self._footage))

    def _begin(self, footage: Footage | None) -> None:
        self._footage, self._missing = footage, None
        self._seconds, self._wanted, self._shown = 0.0, -1, -1
        self._reading = False
        self._plane.hide()

    def _read(self, footage: Footage) -> Iterator[None]:
        """Read frames until the one that is wanted is there; skip those in between."""
        try:
            while self._footage is footage and self._wanted != self._shown:
                n = self._wanted
                picture = yield from in_background(lambda n=n: footage.frame(n))
                if self._footage is footage:
                    self._fill(n, picture)
        finally:
            if self._footage is footage:
                self._reading = False

    def _fill(self, n: int, picture: Any) -> None:
        self._shown = n
        if self._wanted < 0:
            self._wanted = n
        self._plane.fill(picture)
        self._draw()

    def _draw(self) -> None:
        if self._footage is not None and self._shown >= 0:
            p = self._placement
            self._plane.show((p.x, p.y), p.scale, p.opacity, p.in_front)
        self._changed()

    # In a session.

    def as_json(self) -> dict[str, Any] | None:
        """Return the picture's entry in a session; None without a picture."""
        if self._footage is None:
            return self._missing
        named = {"path": self._footage.path, "sha256": self._footage.sha256}
        return {**named, "seconds": self._seconds, "placement": asdict(self._placement)}

    def restore(self, entry: io.JsonValue) -> str:
        """Show the picture of a session's entry, or none.

        Returns:
            A message for the user: the file is gone, damaged or another one; or an empty text. The
            entry of a file that is gone is kept.

        Raises:
            InputError: the entry is damaged.
        """
        self.close()
        if entry.value is None:
            self._placement = Placement()
            return ""
        path, digest = entry["path"].text(), entry["sha256"].text()
        seconds = entry["seconds"].number(most=io.LARGEST)
        self._placement = _placement(entry["placement"])
        try:
            self.open(path)
        except (InputError, OSError) as error:
            self._missing = entry.value
            return f"The reference picture of this session cannot be shown: {error}"
        self.set_frame(seconds)
        assert self._footage is not None
        same = self._footage.sha256 == digest
        return "" if same else f"{path}: the reference picture has changed since it was saved"


def _placement(value: io.JsonValue) -> Placement:
    numbers = {name: value[name].number(most=io.LARGEST) for name in ("x", "y")}
    return Placement(
        **numbers,
        scale=value["scale"].number(above=0, most=io.LARGEST),
        opacity=value["opacity"].number(most=1),
        in_front=value["in_front"].flag(),
    )
