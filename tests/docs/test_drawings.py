"""The drawing of the packages tells what is in the code."""

import re

import pytest

from pages import DOCS
from scripts import module_of


@pytest.fixture(scope="module")
def architecture():
    return module_of(DOCS / "draw_architecture.py")


@pytest.fixture(scope="module")
def graph(architecture):
    return architecture.imports()


def test_the_drawing_shows_nothing_that_is_not_there(graph):
    """It may lack an import that is new: the site draws it anew."""
    drawn = (DOCS / "understand" / "architecture.svg").read_text(encoding="utf-8")
    anew = "python docs/draw_architecture.py docs/understand/architecture.svg"
    assert set(re.findall(r'font-weight="600"[^>]*>(\w+)<', drawn)) == set(graph), anew
    arrows = re.findall(r'<path class="(\w+) (\w+)"', drawn)
    assert len(arrows) > 10
    assert all(target in graph[name] for name, target in arrows), anew


def test_every_package_has_a_box_and_arrows_go_down(architecture, graph):
    assert set(graph) == set(architecture.WORDS)
    drawn = architecture.drawing(graph)
    assert set(re.findall(r'font-weight="600"[^>]*>(\w+)<', drawn)) == set(graph)
    for start, end in re.findall(r'd="M[\d.]+ ([\d.]+)C.* ([\d.]+)" fill="none"', drawn):
        assert float(end) > float(start)


def test_arrows_that_are_left_out_follow_from_others(architecture):
    assert architecture.reduced({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == {
        "a": {"b"},
        "b": {"c"},
        "c": set(),
    }
