"""How well a text can be read on its ground."""


def contrast(one, other) -> float:
    """Contrast of two colours, (red, green, blue) of 0 to 255: from 1 to 21.

    As of the Web Content Accessibility Guidelines 2.1.
    """
    low, high = sorted((_luminance(one), _luminance(other)))
    return (high + 0.05) / (low + 0.05)


def _luminance(colour) -> float:
    parts = [c / 255 for c in colour]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return sum(w * c for w, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))
