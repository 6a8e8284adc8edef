"""Colours of the two themes: text can be read."""

import pytest

from deformer_app.rendering.palette import DARK, LIGHT, rgb


def luminance(colour: str) -> float:
    """Relative luminance of a colour, as of the Web Content Accessibility Guidelines 2.1."""
    parts = [c / 255 for c in rgb(colour)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return sum(w * c for w, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(one: str, other: str) -> float:
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_contrast_of_black_and_white():
    assert contrast("#000000", "#ffffff") == pytest.approx(21)


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])
def test_texts_have_the_contrast_that_reading_needs(theme):
    """4.5 to 1 at least: of texts, and of what is selected or on."""
    for text, ground in (
        ("WindowText", "Window"),
        ("Text", "Base"),
        ("ButtonText", "Button"),
        ("ToolTipText", "ToolTipBase"),
        ("HighlightedText", "Highlight"),
    ):
        assert contrast(theme.widget(text), theme.widget(ground)) >= 4.5, (text, ground)
    assert contrast(theme.widget("HighlightedText"), theme.accent) >= 4.5
    assert contrast(theme.muted, theme.widget("Window")) >= 4.5
