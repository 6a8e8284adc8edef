"""Handling of Ctrl-C between the steps of a long computation, never within one."""

from __future__ import annotations

import signal
import threading


class DeferredInterrupt:
    """Within the block, Ctrl-C sets the flag `requested`; a second Ctrl-C interrupts at once."""

    def __enter__(self) -> DeferredInterrupt:
        """Replace the handling of Ctrl-C."""
        self.requested = False
        # Only the main thread can handle signals, and Ctrl-C always goes to it.
        self._main = threading.current_thread() is threading.main_thread()
        if self._main:
            self._previous = signal.signal(signal.SIGINT, self._request)
        return self

    def _request(self, number: int, frame: object) -> None:
        self.requested = True
        signal.signal(signal.SIGINT, self._previous)

    def __exit__(self, *error: object) -> None:
        """Restore the handling of Ctrl-C."""
        if self._main and not self.requested:
            signal.signal(signal.SIGINT, self._previous)
