"""Links of the manual and of the texts beside it lead somewhere, and the site has every page."""

import re

import pytest

from pages import DOCS, PAGES, anchors, links
from paths import ROOT


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_to_files_and_headings(page):
    astray = []
    for target in links(page):
        path, _, anchor = target.partition("#")
        goal = (page.parent / path).resolve() if path else page
        # Headings of the API are made from public names.
        known = not anchor or anchor.startswith("deformer.")
        if not goal.exists() or not (known or anchor in anchors(goal)):
            astray.append(target)
    assert not astray


def test_every_page_is_in_the_navigation_once():
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    listed = re.findall(r"- (?:[\w ]+: )?([\w/-]+\.md)$", text, re.MULTILINE)
    assert len(listed) == len(set(listed))
    there = {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")}
    made = {"contribute/index.md", "contribute/changelog.md", "evidence/benchmarks.md"}
    assert set(listed) == there | made


def test_pictures_of_pages_are_described():
    nameless = [
        page.name for page in DOCS.rglob("*.md") if "![](" in page.read_text(encoding="utf-8")
    ]
    assert not nameless
