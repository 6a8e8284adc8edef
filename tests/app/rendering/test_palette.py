"""Colours of the two themes: text can be read."""

import pytest

from contrast import contrast
from deformer_app.rendering.palette import DARK, LIGHT, rgb


def test_contrast_of_black_and_white():
    assert contrast(rgb("#000000"), rgb("#ffffff")) == pytest.approx(21)


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
        assert contrast(rgb(theme.widget(text)), rgb(theme.widget(ground))) >= 4.5, (text, ground)
    assert contrast(rgb(theme.widget("HighlightedText")), rgb(theme.accent)) >= 4.5
    assert contrast(rgb(theme.muted), rgb(theme.widget("Window"))) >= 4.5
