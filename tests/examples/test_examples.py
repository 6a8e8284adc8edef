"""The examples run, at reduced size, and each shows what it says."""

import pytest
from PIL import Image

from paths import ROOT

EXAMPLES = ROOT / "examples"
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("error::RuntimeWarning")]


@pytest.fixture
def run(load_example, tmp_path):
    """Run an example's main; its picture must be one."""

    def call(name):
        picture = tmp_path / f"{name}.png"
        result = load_example(name).main(picture, quick=True)
        assert Image.open(picture).convert("L").getextrema()[0] < 128
        return result

    return call


def test_features_hold_two_turns(run):
    assert run("02_features") < 1e-6


def test_training_reproduces_something(run):
    assert run("03_train") < 100  # thousandths; a tube left at rest is off by 130 and more


def test_handles_are_met(run):
    assert run("04_fit_handles") < 0.02


def test_components_are_ranked(run):
    first, second = run("05_components")
    assert first.strength >= second.strength > 0


def test_synthesis_runs(run):
    run("06_synthesis")


def test_only_the_straight_line_shrinks_limbs(run):
    found = run("07_interpolation")
    assert min(found["latent"], found["features"]) > 0.98 > 0.8 > found["linear"]


def test_methods_are_compared(run):
    assert set(run("08_compare_methods")) == {"Deformer", "pca", "splocs", "arap"}


def test_markers_are_fitted_below_their_noise(run):
    error, noise = run("09_markers")
    assert error < noise


def test_the_gallery_shows_every_example():
    text = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    for path in sorted(EXAMPLES.glob("0[2-9]_*.py")):
        assert f"../examples/{path.name}" in text
        assert f"gallery/{path.stem}.png" in text
        assert (ROOT / "docs" / "gallery" / f"{path.stem}.png").is_file()
