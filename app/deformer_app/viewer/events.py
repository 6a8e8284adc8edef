"""Events of mouse and keys, as a window reports them to the controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Button = Literal["left", "middle", "right"]
Pixel = tuple[float, float]  # from the top left corner of the picture, x right, y down


@dataclass(frozen=True)
class Keys:
    """Modifier keys that are down."""

    shift: bool = False
    control: bool = False
    alt: bool = False


@dataclass(frozen=True)
class MouseMoved:
    """The mouse is at `pixel`; `buttons` are down, or None where the window cannot tell."""

    pixel: Pixel
    keys: Keys = Keys()
    buttons: frozenset[Button] | None = None


@dataclass(frozen=True)
class MouseLeft:
    """The mouse has left the picture."""


@dataclass(frozen=True)
class ButtonPressed:
    """A button has gone down at `pixel`."""

    button: Button
    pixel: Pixel
    keys: Keys = Keys()


@dataclass(frozen=True)
class ButtonReleased:
    """A button has come up at `pixel`."""

    button: Button
    pixel: Pixel
    keys: Keys = Keys()


@dataclass(frozen=True)
class WheelTurned:
    """The wheel has turned by `notches` at `pixel`; positive is away from the person."""

    notches: float
    pixel: Pixel
    keys: Keys = Keys()


@dataclass(frozen=True)
class KeyPressed:
    """A key has gone down; `name` is X's for it."""

    name: str
    keys: Keys = Keys()


MouseEvent = MouseMoved | MouseLeft | ButtonPressed | ButtonReleased | WheelTurned
