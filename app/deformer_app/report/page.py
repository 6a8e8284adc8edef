"""One self-contained HTML page of sections, tables and figures."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources
from pathlib import Path

import jinja2
from markupsafe import Markup

from deformer.io import atomic_path
from deformer_app import console
from deformer_app.report.parts import Section


def write_page(
    path: Path,
    title: str,
    intro: str | Markup,
    sections: Sequence[Section],
    facts: Sequence[tuple[str, str]],
    command: str = "",
) -> None:
    """Write a page; sections without parts are left out.

    Args:
        path: the HTML file.
        title: of the page.
        intro: a paragraph below it.
        sections: what is in it.
        facts: names and values about the run, at the end.
        command: the command of the run, or nothing.
    """
    template = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined).from_string(
        resources.files("deformer_app.report").joinpath("report.html").read_text(encoding="utf-8")
    )
    text = template.render(
        title=title,
        intro=intro,
        sections=[section for section in sections if section.parts],
        command=command,
        facts=facts,
    )
    with atomic_path(path) as temporary:
        temporary.write_bytes(text.encode(errors=console.READABLE))
