"""What the manual needs beside its pages: files of the repository, links to them, and fonts.

MkDocs calls these functions by their names. Pages link to each other, and to files outside of
docs/, by paths that also work where the repository is browsed as it is. The site has a page for
each such file: Markdown as it stands, code as a listing.
"""

from __future__ import annotations

import base64
import json
import os
import posixpath
import re
import shutil
import sys
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "docs"))
import draw_architecture  # noqa: E402  (beside this file, which is in no package)
import public_names  # noqa: E402

# Files of the repository that are pages of the manual, and where.
PAGES = {
    "CONTRIBUTING.md": "contribute/index.md",
    "CHANGELOG.md": "contribute/changelog.md",
    "benchmarks/README.md": "evidence/benchmarks.md",
    "README.md": "index.md",
}
_LINK = re.compile(r"(!?\[[^\]]*\]\()([^)\s]+)(\))")
_FENCE = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)
_LANGUAGES = {".py": "python", ".md": "markdown", ".cff": "yaml", ".toml": "toml"}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that stand outside of docs/, and a page for each file that pages link to."""
    for source, page in PAGES.items():
        if page != "index.md":
            text = (ROOT / source).read_text(encoding="utf-8")
            files.append(File.generated(config, page, content=text))
    linked: set[str] = set()
    for file in list(files.documentation_pages()):
        for target in _links(file.content_string):
            path = _in_repository(file.src_uri, target)
            if path is not None and _page_of(path) is None:
                linked.add(path)
    for path in sorted(linked):
        files.append(File.generated(config, _listing_of(path), content=_listing(path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn paths of the repository into paths of the site."""
    here = page.file.src_uri

    def replaced(match: re.Match[str]) -> str:
        before, target, after = match.groups()
        path = _in_repository(here, target)
        if path is None:
            return match[0]
        _, hash_, anchor = target.partition("#")
        goal = _page_of(path) or _listing_of(path)
        return before + posixpath.relpath(goal, posixpath.dirname(here)) + hash_ + anchor + after

    return _outside_of_code(markdown, lambda text: _LINK.sub(replaced, text))


def on_post_build(config: MkDocsConfig) -> None:
    """Make the site whole without a network, and refuse what would be fetched."""
    _inline_fonts(Path(config.site_dir))
    drawing = draw_architecture.drawing(draw_architecture.imports())
    (Path(config.site_dir) / "understand" / "architecture.svg").write_text(drawing, "utf-8")
    for page in Path(config.site_dir).rglob("*.html"):
        for tag in re.findall(
            r"<(?:script|link|img|video|iframe)\b[^>]*>", page.read_text("utf-8")
        ):
            if re.search(r"(?:src|href)=[\"']?(?:https?:)?//", tag):
                raise PluginError(
                    f"{page.name}: {tag} is fetched from elsewhere; keep a copy in docs"
                )


def _inline_fonts(site: Path) -> None:
    """Put the fonts of formulas into their style sheet.

    Browsers do not let a page that was opened from disk load fonts from files.
    """
    sheet = site / "assets" / "katex" / "katex.min.css"

    def inlined(rule: re.Match[str]) -> str:
        found = re.search(r"url\((fonts/[\w-]+\.woff2)\)", rule[0])
        font = sheet.parent / found[1] if found else None
        if font is None or not font.is_file():
            return ""  # a font that no formula of ours has
        data = base64.b64encode(font.read_bytes()).decode("ascii")
        source = f'src:url("data:font/woff2;base64,{data}") format("woff2")'
        return re.sub(r"src:[^;}]*", lambda _: source, rule[0])

    text = sheet.read_text(encoding="utf-8")
    sheet.write_text(re.sub(r"@font-face\{[^}]*\}", inlined, text), encoding="utf-8")
    shutil.rmtree(sheet.parent / "fonts")


def _outside_of_code(markdown: str, change) -> str:
    """Apply `change` to what is not in a fenced block."""
    parts, end = [], 0
    for fence in _FENCE.finditer(markdown):
        parts += [change(markdown[end : fence.start()]), fence[0]]
        end = fence.end()
    return "".join([*parts, change(markdown[end:])])


def _links(markdown: str) -> list[str]:
    found: list[str] = []

    def note(text: str) -> str:
        found.extend(match[2] for match in _LINK.finditer(text))
        return text

    _outside_of_code(markdown, note)
    return found


def _in_repository(page: str, target: str) -> str | None:
    """The file of the repository that a page's link leads to; None for a link inside docs/."""
    path = target.partition("#")[0]
    if not path or re.match(r"[a-z]+:", path):
        return None
    home = next((source for source, at in PAGES.items() if at == page and at != "index.md"), None)
    folder = posixpath.dirname(home if home is not None else f"docs/{page}")
    full = posixpath.normpath(posixpath.join(folder, path))
    if home is None and full.startswith("docs/") and Path(full).suffix != ".py":
        return None
    if not (ROOT / full).exists():
        raise PluginError(f"{page}: a link leads to {full}, which does not exist")
    return full


def _page_of(path: str) -> str | None:
    """The page of the manual that shows a file, or None if no page does."""
    if path in PAGES:
        return PAGES[path]
    if f"{path}/README.md" in PAGES:
        return PAGES[f"{path}/README.md"]
    if path.startswith("docs/") and Path(path).suffix != ".py":
        return path.removeprefix("docs/")
    return None


def _listing_of(path: str) -> str:
    return f"source/{path.rstrip('/').replace('.', '_')}.md"


def _listing(path: str) -> str:
    """A page that shows a file or what is in a folder."""
    full = ROOT / path
    search = "---\nsearch:\n  exclude: true\n---\n\n"
    if full.is_dir():
        names = sorted(child.name for child in full.iterdir() if not child.name.startswith("_"))
        return search + f"# {path}\n\n" + "".join(f"- `{name}`\n" for name in names)
    text = full.read_text(encoding="utf-8")
    if full.suffix == ".ipynb":
        return search + "\n\n".join(_shown(cell) for cell in json.loads(text)["cells"])
    if full.suffix == ".md":
        return search + re.sub(r"\]\((?!\w+:)[^)]*\)", "]", text).replace("![", "[")
    language = _LANGUAGES.get(full.suffix, "text")
    return search + f"# {path}\n\n````{language}\n{text}````\n"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Refuse public names that are not documented, before pages are made.

    Paths of mkdocstrings are those of the repository, wherever the command was started.
    """
    os.chdir(ROOT)
    faults = public_names.faults()
    if faults:
        raise PluginError("\n".join(["the API is not documented:", *faults]))
    return config


def _shown(cell: dict[str, Any]) -> str:
    """A cell of a notebook as Markdown: its text, or its code and what came out."""
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        return re.sub(r"\[([^\]]*)\]\((?!\w+:)[^)]*\)", r"\1", source)
    parts = [f"```python\n{source}\n```"]
    for output in cell["outputs"]:
        data = output.get("data", {})
        if "image/png" in data:
            parts.append(f"![What the cell shows](data:image/png;base64,{data['image/png']})")
        else:
            text = "".join(output.get("text") or data["text/plain"]).rstrip()
            parts.append(f"```text\n{text}\n```")
    return "\n\n".join(parts)
