"""Numbers typed while the manipulator moves."""

from __future__ import annotations

_SIGNS = {"minus", "KP_Subtract"}
_POINTS = {"period", "comma", "KP_Decimal", "KP_Separator"}
_DIGITS = {str(n): str(n) for n in range(10)} | {f"KP_{n}": str(n) for n in range(10)}
ENTER = {"Return", "KP_Enter"}
KEYS = {*_SIGNS, *_POINTS, *_DIGITS, *ENTER, "BackSpace", "Tab"}


class TypedNumbers:
    """One or more numbers that keys are typed into.

    Args:
        count: of the numbers; Tab goes to the next one.
    """

    def __init__(self, count: int) -> None:
        """Start with nothing typed."""
        self._texts, self._at = [""] * count, 0

    @property
    def begun(self) -> bool:
        """True while something is typed."""
        return any(self._texts)

    @property
    def values(self) -> list[float]:
        """The numbers; 0 where nothing is typed."""
        return [float(text) if text.strip("-.") else 0.0 for text in self._texts]

    @property
    def texts(self) -> list[str]:
        """What has been typed, with a caret where the next key goes."""
        return [
            (text or "0") + "|" * (n == self._at and self.begun)
            for n, text in enumerate(self._texts)
        ]

    def take(self, key: str) -> bool:
        """Type a key, named as X does; return False if it is no part of a number."""
        text = self._texts[self._at]
        if key in _DIGITS:
            text += _DIGITS[key]
        elif key in _POINTS:
            text += "" if "." in text else "."
        elif key in _SIGNS:
            text = text[1:] if text.startswith("-") else "-" + text
        elif key == "BackSpace":
            text = text[:-1]
        elif key == "Tab":
            self._at = (self._at + 1) % len(self._texts)
            return True
        else:
            return False
        self._texts[self._at] = text
        return True
