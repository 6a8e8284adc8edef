"""What a drag is, from the press of a button to its release, and the path of its mouse."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer_app.viewer.events import Keys, Pixel

CLICK = 4.0  # pixels within which a press and release is a click
FINE = 0.1  # share of the mouse's path that counts while Shift is down


class Drag(ABC):
    """A drag in progress. The camera may change between any two of its moves."""

    turns_view = False  # True if it moves the camera: then no other button moves it, too
    takes_numbers = False  # True if `type_key` may take keys

    @abstractmethod
    def move(self, pixel: Pixel, keys: Keys) -> None:
        """Follow the mouse to `pixel`."""

    @abstractmethod
    def skip(self, pixel: Pixel) -> None:
        """Go on from `pixel`: the way of the mouse to there belonged to another drag."""

    def grasp(self, pixel: Pixel) -> NDArray[np.float64] | None:
        """Return the point (3,) under `pixel`, the mouse's, that is dragged; None without any."""
        return None

    def type_key(self, name: str) -> bool:
        """Use a key, named as X does, as part of a number; return False if it is none."""
        return False

    @abstractmethod
    def release(self, keys: Keys) -> None:
        """Finish the drag and keep its result."""

    @abstractmethod
    def cancel(self) -> None:
        """Abort the drag and restore the state before it."""


class MousePath:
    """The path of the mouse since the press.

    Attributes:
        start: pixel (2,) of the press.
        now: pixel (2,) of the mouse.
        counted: pixel (2,) that the drag follows: with Shift down, the mouse counts a tenth.
    """

    def __init__(self, pixel: Pixel) -> None:
        """Begin at the pixel of the press."""
        self.start = self.now = self.counted = np.array(pixel, dtype=np.float64)

    def move(self, pixel: Pixel, fine: bool) -> None:
        """Continue to `pixel`."""
        step = np.subtract(pixel, self.now)
        self.now = self.now + step
        self.counted = self.counted + (FINE if fine else 1.0) * step

    def skip(self, pixel: Pixel) -> None:
        """Shift the whole path so that it ends at `pixel`."""
        step = np.subtract(pixel, self.now)
        self.start, self.now, self.counted = (
            p + step for p in (self.start, self.now, self.counted)
        )

    def is_click_at(self, pixel: ArrayLike) -> bool:
        """True while `pixel` is so close to the press that its release would be a click."""
        return float(np.abs(np.subtract(pixel, self.start)).max()) <= CLICK
