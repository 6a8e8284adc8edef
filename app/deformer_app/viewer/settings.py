"""Persistent settings: recent files, the tour, autosaves for recovery after a crash."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer
from filelock import FileLock, Timeout

from deformer import InputError, io

_RECENT = 10
_THUMBNAILS = "thumbnails"  # folder of the pictures of recent files
_MODELS = 50  # whose favourite components are remembered


class EditInterrupted(KeyboardInterrupt):
    """Ctrl-C in the terminal of a window.

    Args:
        kept: the autosave with the unsaved session; None if nothing was unsaved.
    """

    def __init__(self, kept: Path | None) -> None:
        """Store the path."""
        super().__init__()
        self.kept = kept


class Settings:
    """Settings and autosaves in the program's own folder.

    Args:
        folder: by default the one that the system has for settings.
    """

    def __init__(self, folder: Path | None = None) -> None:
        """Create the folder, and reserve a name for this run's autosave."""
        self.folder = folder or Path(
            os.environ.get("DEFORMER_SETTINGS") or typer.get_app_dir("deformer")
        )
        (self.folder / _THUMBNAILS).mkdir(parents=True, exist_ok=True)
        self._file = self.folder / "settings.json"
        # The system releases a lock when its process ends, however it ends.
        self._lock: FileLock | None = None
        self.autosave = self.folder / "autosave.json"
        for number in range(1000):
            self.autosave = self.folder / f"autosave-{number}.json"
            lock = FileLock(f"{self.autosave}.lock")
            try:
                lock.acquire(timeout=0)
            except Timeout:
                continue
            if self.autosave.exists():  # left by a crash; kept until the user decides
                lock.release()
                continue
            self._lock = lock
            break

    def _read(self) -> dict[str, Any]:
        if not self._file.is_file():
            return {}
        try:
            return io.read_json(self._file)
        except InputError:
            return {}  # damaged settings are replaced by defaults; they hold no work

    def _write(self, **changes: Any) -> None:
        io.write_json(self._file, {**self._read(), **changes})

    @property
    def recent(self) -> list[str]:
        """Paths of the models and sessions opened last, the latest first."""
        return [str(name) for name in self._read().get("recent", [])]

    def remember(self, path: str, model: str = "") -> None:
        """Put a model, or a session of `model`, first among the recent ones."""
        paths = [path, *(name for name in self.recent if name != path)][:_RECENT]
        models = {**self._models(), path: model}
        self._write(recent=paths, models={name: models.get(name, "") for name in paths})
        kept = {self.thumbnail(name).name for name in paths}
        for picture in (self.folder / _THUMBNAILS).glob("*.png"):
            if picture.name not in kept:
                picture.unlink(missing_ok=True)

    def _models(self) -> dict[str, str]:
        found = self._read().get("models", {})
        return found if isinstance(found, dict) else {}

    def model_of(self, path: str) -> str:
        """Return the model that a recent path is, or is a session of; empty if not known."""
        return str(self._models().get(path, ""))

    def thumbnail(self, path: str) -> Path:
        """Return the file of the picture of a recent path; it may be missing."""
        name = hashlib.sha256(path.encode()).hexdigest()[:24]
        return self.folder / _THUMBNAILS / f"{name}.png"

    @property
    def layout(self) -> tuple[str, str]:
        """Geometry of the window and of its docks, as the window has noted it; empty at first."""
        geometry, docks = self._read().get("layout", ("", ""))
        return str(geometry), str(docks)

    def note_layout(self, geometry: str, docks: str) -> None:
        """Remember the geometry of the window and of its docks."""
        self._write(layout=[geometry, docks])

    @property
    def dark(self) -> bool | None:
        """True for the dark theme, False for the light one, None for the system's."""
        chosen = self._read().get("dark")
        return chosen if isinstance(chosen, bool) else None

    def note_dark(self, dark: bool | None) -> None:
        """Remember the theme; None follows the system."""
        self._write(dark=dark)

    @property
    def component_order(self) -> str:
        """Order in which components are listed, as the panel has noted it; empty at first."""
        return str(self._read().get("component_order", ""))

    def note_component_order(self, order: str) -> None:
        """Remember the order in which components are listed."""
        self._write(component_order=order)

    def favourites(self, fingerprint: str) -> list[int]:
        """Favourite components of the model with a fingerprint, in the order of choosing."""
        found = self._favourites().get(fingerprint, [])
        return [k for k in found if type(k) is int and k >= 0] if isinstance(found, list) else []

    def note_favourites(self, fingerprint: str, components: Sequence[int]) -> None:
        """Remember the favourite components of a model."""
        others = {key: value for key, value in self._favourites().items() if key != fingerprint}
        newest = {fingerprint: list(components)} if components else {}
        self._write(pinned=dict([*others.items(), *newest.items()][-_MODELS:]))

    def _favourites(self) -> dict[str, Any]:
        found = self._read().get("pinned", {})
        return found if isinstance(found, dict) else {}

    @property
    def tour_seen(self) -> bool:
        """True once the tour has been shown."""
        return bool(self._read().get("tour_seen"))

    def note_tour(self) -> None:
        """Remember that the tour has been shown."""
        self._write(tour_seen=True)

    def left_by_crash(self) -> Path | None:
        """Return the newest autosave of a run that has crashed, or None."""
        found = []
        for path in self.folder.glob("autosave-*.json"):
            lock = FileLock(f"{path}.lock")
            try:
                with lock.acquire(timeout=0):
                    found.append(path)
            except Timeout:
                continue  # another window writes it
        own = [path for path in found if path != self.autosave]
        return max(own, key=lambda path: path.stat().st_mtime, default=None)

    def forget(self, path: Path) -> None:
        """Delete an autosave and its picture."""
        path.unlink(missing_ok=True)
        path.with_suffix(".png").unlink(missing_ok=True)

    def close(self, keep: bool = False) -> None:
        """Release this run's autosave, and delete it at a regular end.

        Args:
            keep: true to keep the autosave, as a crash does; the next window offers it.
        """
        if not keep:
            self.forget(self.autosave)
        if self._lock is not None:
            self._lock.release()
            Path(self._lock.lock_file).unlink(missing_ok=True)
            self._lock = None
