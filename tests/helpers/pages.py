"""The pages of the manual: their code, their links, and running them."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

from paths import ROOT

DOCS = ROOT / "docs"
# Markdown outside of docs/ that people read, and that pages link to.
OUTSIDE = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
OUTSIDE += sorted((ROOT / "benchmarks").glob("*.md"))
PAGES = sorted(DOCS.rglob("*.md")) + OUTSIDE

_BLOCK = re.compile(
    r"^<!-- test(?:: (?P<file>[\w./-]+))? -->\n```(?P<language>\w+)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
_FENCE = re.compile(r"^( *)(```+|~~~+).*?^\1\2", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^#+ +(.+?)\s*$", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A fenced block that is marked for testing.

    Args:
        language: "python", "bash" or "json".
        code: its text.
        file: the name under which a block of JSON is saved; else empty.
    """

    language: str
    code: str
    file: str


def blocks(page: Path) -> list[Block]:
    """The marked blocks of a page, in order."""
    found = _BLOCK.finditer(page.read_text(encoding="utf-8"))
    return [Block(m["language"], m["code"], m["file"] or "") for m in found]


def run(page: Path, command, folder: Path) -> dict:
    """Run the marked blocks of a page in order; gives the names that its Python has defined.

    Args:
        page: the page; its code runs in the working directory.
        command: called with the arguments of each `deformer` command; gives its status first.
        folder: where blocks of JSON are saved.
    """
    names: dict = {}
    for block in blocks(page):
        if block.language == "python":
            exec(compile(block.code, page.name, "exec"), names)
        elif block.language == "json":
            (folder / block.file).write_text(block.code, encoding="utf-8")
        else:
            for line in block.code.replace("\\\n", " ").splitlines():
                words = shlex.split(line, comments=True)
                assert words[:1] == ["deformer"], f"{page.name}: {line!r} is no deformer command"
                status, _, errors = command(*words[1:])
                assert status == 0, f"{page.name}: {line}\n{errors}"
    return names


def untried_commands(page: Path) -> list[list[str]]:
    """Arguments of the `deformer` commands in a page's blocks without a mark, which are not run."""
    text = page.read_text(encoding="utf-8")
    marked = {block.start("language") for block in _BLOCK.finditer(text)}
    found = []
    for fence in re.finditer(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        if fence[1] not in ("", "bash") or fence.start(1) in marked:
            continue
        for line in fence[2].replace("\\\n", " ").splitlines():
            command = re.match(r"(?:torchrun .*-m )?deformer +(.*)", line.strip())
            if command:
                found.append(shlex.split(command[1], comments=True))
    return found


def without_code(text: str) -> str:
    """A page's text without fenced blocks and code spans."""
    return re.sub(r"`[^`\n]*`", "", _FENCE.sub("", text))


def links(page: Path) -> list[str]:
    """Where a page's links lead, but those to other hosts."""
    found = _LINK.findall(without_code(page.read_text(encoding="utf-8")))
    return [target for target in found if not re.match(r"[a-z]+:", target)]


def anchors(page: Path) -> set[str]:
    """Anchors of a page's headings, as code hosts and MkDocs make them."""
    found = set()
    for heading in _HEADING.findall(_FENCE.sub("", page.read_text(encoding="utf-8"))):
        text = re.sub(r"\]\([^)]*\)|[`*\[]", "", heading)
        found.add(re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", text).strip().lower()))
    return found
