"""Ctrl-C between two steps of long work, and never within one."""

from __future__ import annotations

import signal
import threading


class DeferredInterrupt:
    """Turns Ctrl-C into a flag, so that a step is never cut in half; a second one is immediate."""

    def __enter__(self) -> DeferredInterrupt:
        """Begin to listen."""
        self.asked = False
        # Signals can only be handled in the main thread; elsewhere Ctrl-C goes to that one anyway.
        self._main = threading.current_thread() is threading.main_thread()
        if self._main:
            self._previous = signal.signal(signal.SIGINT, self._ask)
        return self

    def _ask(self, number: int, frame: object) -> None:
        self.asked = True
        signal.signal(signal.SIGINT, self._previous)

    def __exit__(self, *error: object) -> None:
        """Leave the handling of Ctrl-C as it was."""
        if self._main and not self.asked:
            signal.signal(signal.SIGINT, self._previous)
