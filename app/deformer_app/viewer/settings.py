"""Persistent settings: recent files, the tour, autosaves for recovery after a crash."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import typer
from filelock import FileLock, Timeout

from deformer import InputError, io

_RECENT = 10


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
        self.folder.mkdir(parents=True, exist_ok=True)
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

    def remember(self, path: str) -> None:
        """Put a model or session first among the recent ones."""
        others = [name for name in self.recent if name != path]
        self._write(recent=[path, *others][:_RECENT])

    @property
    def layout(self) -> tuple[str, str]:
        """Geometry of the window and of its docks, as the window has noted it; empty at first."""
        geometry, docks = self._read().get("layout", ("", ""))
        return str(geometry), str(docks)

    def note_layout(self, geometry: str, docks: str) -> None:
        """Remember the geometry of the window and of its docks."""
        self._write(layout=[geometry, docks])

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
        """Delete an autosave."""
        path.unlink(missing_ok=True)

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
