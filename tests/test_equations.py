"""Truths of the page of equations: each function is there and cites its equation in its words."""

from __future__ import annotations

import ast
import re

import pytest

from paths import ROOT

PAGE = ROOT / "docs" / "understand" / "equations.md"
ROWS = [
    tuple(cell.strip() for cell in line.strip("|\n ").split("|"))
    for line in PAGE.read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith(("| equation", "| ---"))
]


def source_of(where: str) -> str:
    """Source text of "path.py:name" or "path.py:Class.method", in one line."""
    path, _, name = where.partition(":")
    text = (ROOT / path).read_text(encoding="utf-8")
    node: ast.AST = ast.parse(text)
    for part in name.split("."):
        found = [
            child
            for child in getattr(node, "body", [])
            if isinstance(child, (ast.FunctionDef, ast.ClassDef)) and child.name == part
        ]
        assert found, f"{path} has no {name}"
        node = found[0]
    segment = ast.get_source_segment(text, node)
    assert segment is not None
    return re.sub(r"[\s#]+", " ", segment)


@pytest.mark.parametrize(("equation", "what", "where"), ROWS)
def test_each_function_is_there_and_cites_its_equation(equation, what, where):
    assert what
    source = source_of(where)
    assert re.search(re.escape(equation) + r"(?!\d)", source), f"{where} does not cite {equation}"


def test_no_equation_of_the_paper_is_missing():
    numbers = {int(n) for e, *_ in ROWS if (n := e.partition("Tan et al. 2018, equation ")[2])}
    assert numbers == set(range(1, 10))
