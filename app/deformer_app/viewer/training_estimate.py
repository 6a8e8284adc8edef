"""How far a training is over all its stages, and how long it will still take."""

from __future__ import annotations

import time
from collections.abc import Callable

from deformer import TrainingProgress

# Where each stage begins and ends on the scale of the whole training. A training of the default
# configuration spends most of its time in the last two; one of another skips some of them.
_STAGES = {
    "loading": (0.0, 0.05),
    "features": (0.05, 0.25),
    "cross-validation": (0.25, 0.65),
    "training": (0.65, 1.0),
}
_KNOWN = 0.02  # share of the whole from which on the rest can be estimated


class TrainingEstimate:
    """Follows the progress of one training.

    Args:
        clock: gives seconds, of any beginning.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start the time."""
        self._clock, self._begun = clock, clock()
        self._done = self._held = 0.0
        self._held_since: float | None = None

    def follow(self, progress: TrainingProgress) -> None:
        """Take the newest progress; the share never falls."""
        first, last = _STAGES.get(progress.stage, (self._done, self._done))
        share = progress.done / progress.total if progress.total else 0.0
        self._done = max(self._done, first + (last - first) * min(share, 1.0))

    def hold(self, held: bool) -> None:
        """Leave the time out from now on, or count it again: compiling says nothing of the rest."""
        now = self._clock()
        if self._held_since is not None:
            self._held += now - self._held_since
        self._held_since = now if held else None

    @property
    def share(self) -> float:
        """Part of the whole training that is done, 0 to 1."""
        return self._done

    @property
    def seconds_left(self) -> float | None:
        """Seconds until the end at the rate so far; None while too little is done to tell."""
        if self._done < _KNOWN:
            return None
        now = self._clock() if self._held_since is None else self._held_since
        return (now - self._begun - self._held) * (1.0 - self._done) / self._done


def in_words(seconds: float | None) -> str:
    """Return a remaining time in words, rounded so that it does not flicker."""
    if seconds is None:
        return "estimating the time left"
    if seconds < 10:
        return "a few seconds left"
    if seconds < 90:
        return f"about {10 * round(seconds / 10)} s left"
    if seconds < 90 * 60:
        return f"about {round(seconds / 60)} min left"
    return f"about {seconds / 3600:.1f} h left"
