"""Draw understand/architecture.svg: the packages, and who imports whom, read from the code.

python docs/draw_architecture.py docs/understand/architecture.svg

An arrow leads from a package to one that it imports from. Arrows that follow from others are left
out: if A imports from B and B from C, that A imports from C as well is not drawn.
"""

from __future__ import annotations

import argparse
import ast
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parent.parent
# What each package knows, in a few words.
WORDS = {
    "cli": "the command",
    "viewer": "the window",
    "report": "HTML of an evaluation",
    "rendering": "pictures",
    "evaluation": "unseen shapes, tables",
    "baselines": "methods to compare with",
    "training": "shapes → model",
    "editing": "handles → pose",
    "rigging": "model → bones",
    "analysis": "components, new shapes",
    "model": "the prior, on disk",
    "network": "features ↔ code",
    "acap": "vertices ↔ features",
    "parallel": "tasks side by side",
    "linalg": "sparse solves",
    "preflight": "check and repair",
    "animation": "clips, point caches",
    "documents": "files as a whole",
    "io": "files",
    "geometry": "meshes, rotations",
}
APPLICATION = ("cli", "viewer", "report", "rendering")
WIDTH, HEIGHT, GAP, RISE = 160, 46, 30, 38


def packages() -> dict[str, Path]:
    """Folder of each package, by its name."""
    found = {path.parent.name: path.parent for path in (ROOT / "deformer").glob("*/__init__.py")}
    application = ROOT / "app" / "deformer_app"
    return found | {path.parent.name: path.parent for path in application.glob("*/__init__.py")}


def imports() -> dict[str, set[str]]:
    """Packages that each package imports from, anywhere in it."""
    folders = packages()
    public = {name: package for package, folder in folders.items() for name in _exports(folder)}
    graph: dict[str, set[str]] = {name: set() for name in folders}
    for package, folder in folders.items():
        for path in folder.rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and node.module:
                    graph[package] |= _targets(node, folders, public)
        graph[package].discard(package)
    return graph


def _exports(folder: Path) -> list[str]:
    stub = folder / "__init__.pyi"
    if not stub.is_file():
        return []
    nodes = ast.parse(stub.read_text(encoding="utf-8")).body
    return [
        alias.name for node in nodes if isinstance(node, ast.ImportFrom) for alias in node.names
    ]


def _targets(node: ast.ImportFrom, folders: dict[str, Path], public: dict[str, str]) -> set[str]:
    root, *parts = (node.module or "").split(".")
    if root not in ("deformer", "deformer_app"):
        return set()
    names = parts[:1] or [alias.name for alias in node.names]
    return {
        name if name in folders else public[name] for name in names if name in {*folders, *public}
    }


def reduced(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """The graph without arrows that follow from others."""

    def below(name: str) -> set[str]:
        return graph[name].union(*(below(target) for target in graph[name]))

    return {
        name: targets - set().union(*(below(target) for target in targets))
        for name, targets in graph.items()
    }


def rows(graph: dict[str, set[str]]) -> list[list[str]]:
    """Packages by level, the lowest first: each is one above the highest that it imports from.

    The application is above the whole library.
    """
    level: dict[str, int] = {}

    def of(name: str) -> int:
        if name not in level:
            level[name] = 1 + max((of(target) for target in graph[name]), default=-1)
        return level[name]

    library = [name for name in graph if name not in APPLICATION]
    top = max(of(name) for name in library)
    for name in APPLICATION:
        level[name] = top
    for _ in APPLICATION:
        for name in APPLICATION:
            inside = [level[target] for target in graph[name] if target in APPLICATION]
            level[name] = 1 + max(inside, default=top)
    found: list[list[str]] = [[] for _ in range(max(level.values()) + 1)]
    for name in sorted(graph):
        found[level[name]].append(name)
    return found


def drawing(graph: dict[str, set[str]]) -> str:
    """The drawing as SVG."""
    levels = rows(graph)
    widest = max(len(row) for row in levels)
    full = widest * WIDTH + (widest + 1) * GAP
    height = len(levels) * HEIGHT + (len(levels) + 1) * RISE
    arrows = reduced(graph)
    place: dict[str, tuple[float, float]] = {}
    for n, row in enumerate(levels):
        y = height - RISE - HEIGHT - n * (HEIGHT + RISE)
        # Near the middle of what it imports, so that arrows are short.
        wished = sorted(row, key=lambda name: _middle(arrows[name], place, full))
        start = (full - len(row) * WIDTH - (len(row) - 1) * GAP) / 2
        for column, name in enumerate(wished):
            place[name] = (start + column * (WIDTH + GAP), y)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {full:g} {height:g}" '
        'font-family="system-ui, sans-serif" text-anchor="middle">',
        "<title>The packages of Deformer, and which imports from which</title>",
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path d="M0 0 8 4 0 8z" fill="#7a8a94"/></marker></defs>',
        f'<rect width="{full:g}" height="{height:g}" fill="#ffffff"/>',
    ]
    for name in sorted(arrows):
        for target in sorted(arrows[name]):
            parts.append(_arrow(name, target, place))
    for name, (x, y) in sorted(place.items()):
        parts += _box(name, x, y)
    return "\n".join([*parts, "</svg>\n"])


def _middle(targets: set[str], place: dict[str, tuple[float, float]], full: float) -> float:
    known = [place[target][0] for target in targets if target in place]
    return sum(known) / len(known) if known else full / 2


def _arrow(name: str, target: str, place: dict[str, tuple[float, float]]) -> str:
    start, end = place[name], place[target]
    x, y = start[0] + WIDTH / 2, start[1] + HEIGHT
    u, v = end[0] + WIDTH / 2, end[1]
    bend = (v - y) / 2
    return (
        f'<path class="{name} {target}" d="M{x:g} {y:g}C{x:g} {y + bend:g} {u:g} {v - bend:g} '
        f'{u:g} {v:g}" fill="none" stroke="#7a8a94" stroke-width="1.4" marker-end="url(#tip)"/>'
    )


def _box(name: str, x: float, y: float) -> list[str]:
    fill, edge = ("#fdf0e3", "#d2691e") if name in APPLICATION else ("#e8eff3", "#2f4858")
    middle = x + WIDTH / 2
    return [
        f'<rect x="{x:g}" y="{y:g}" width="{WIDTH}" height="{HEIGHT}" rx="5" fill="{fill}" '
        f'stroke="{edge}"/>',
        f'<text x="{middle:g}" y="{y + 19:g}" font-size="14" font-weight="600" fill="#1d2f3b">'
        f"{escape(name)}</text>",
        f'<text x="{middle:g}" y="{y + 36:g}" font-size="11.5" fill="#445863">'
        f"{escape(WORDS[name])}</text>",
    ]


def main() -> None:
    """Write the drawing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("output", type=Path)
    parser.parse_args().output.write_text(drawing(imports()), encoding="utf-8")


if __name__ == "__main__":
    main()
