"""The API pages: every public name once, documented with the shapes of its arrays, and examples."""

from __future__ import annotations

import ast
import doctest
import importlib
import inspect
import re
import typing

import numpy as np
import pytest

import deformer
from pages import DOCS
from paths import ROOT
from shapes import sequence, small_model

API = sorted(path for path in (DOCS / "api").glob("*.md"))
_NAME = re.compile(r"^::: ([\w.]+)$", re.MULTILINE)
_EXAMPLE = re.compile(r"^```pycon\n(.*?)^```$", re.MULTILINE | re.DOTALL)
# Packages whose names are public beside those of `deformer`.
OPEN = ("io", "evaluation", "baselines")
_ARRAY = re.compile(r"\b(ArrayLike|FloatArray|IntArray|NDArray)\b")
_SHAPE = re.compile(r"\((?:\.\.\.|[\w+·′'*]+)(?:, ?[\w+·′']+)*,?\)")
_ELSEWHERE = re.compile(r"same shape|as (?:in|of|there)|`")


def public_names():
    """Full names of what is public, without packages."""
    found = {}
    for package in ("", *OPEN):
        module = importlib.import_module("deformer" + (f".{package}" if package else ""))
        stub = ast.parse((ROOT / "deformer" / package / "__init__.pyi").read_text(encoding="utf-8"))
        for node in stub.body:
            assert isinstance(node, ast.ImportFrom)
            for alias in node.names:
                value = getattr(module, alias.name)
                if not inspect.ismodule(value):
                    found[f"{module.__name__}.{alias.name}"] = value
    # `io` has four functions that `deformer` has, too, with or without documents.
    return {
        name: value
        for name, value in found.items()
        if name not in ("deformer.io.load_shapes", "deformer.io.load_mesh")
    }


PUBLIC = public_names()


def sections():
    """Name → what follows it on its page, up to the next name."""
    found: dict[str, str] = {}
    for page in API:
        text = page.read_text(encoding="utf-8")
        starts = list(_NAME.finditer(text))
        for start, end in zip(starts, [*starts[1:], None], strict=False):
            assert start[1] not in found, f"{start[1]} is documented twice"
            found[start[1]] = text[start.end() : end.start() if end else len(text)]
    return found


def test_every_public_name_is_on_a_page_once():
    assert set(sections()) == set(PUBLIC)


def test_every_public_name_has_an_example():
    without = [name for name, text in sections().items() if not _EXAMPLE.search(text)]
    assert not without


def lacking(name, value):
    """Arrays of a function, a class and its methods whose docstrings say no shape."""
    doc = inspect.getdoc(value) or ""
    if not doc:
        return [name]
    faults = []
    signature = inspect.signature(value)
    entries = dict(re.findall(r"^    (\w+): ((?:.|\n(?=        ))*)", doc, re.MULTILINE))
    for argument in signature.parameters.values():
        if not _ARRAY.search(str(argument.annotation)):
            continue
        told = entries.get(argument.name, doc)
        if not (_SHAPE.search(told) or _ELSEWHERE.search(told)):
            faults.append(f"{name}: {argument.name}")
    if _ARRAY.search(str(signature.return_annotation)) and not _SHAPE.search(doc):
        faults.append(f"{name}: its result")
    return faults


def test_docstrings_say_the_shapes_of_arrays():
    faults = []
    for name, value in PUBLIC.items():
        if typing.get_origin(value) or not callable(value):
            continue  # a type or a constant
        if inspect.isclass(value) and issubclass(value, (Exception, dict)):
            continue  # without arguments of its own
        faults += lacking(name, value)
        if inspect.isclass(value):
            for member, function in vars(value).items():
                plain = inspect.unwrap(getattr(function, "__func__", function))
                if not member.startswith("_") and inspect.isfunction(plain):
                    faults += lacking(f"{name}.{member}", plain)
    assert not faults


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("page", API, ids=lambda page: page.stem)
def test_examples_print_what_stands_there(page, tmp_path, monkeypatch):
    if "usd" in page.read_text(encoding="utf-8"):
        pytest.importorskip("pxr", reason="needs usd-core")
    monkeypatch.chdir(tmp_path)
    shapes = sequence()
    names = {
        "deformer": deformer,
        "np": np,
        "shapes": shapes,
        "model": small_model(),
        "mesh": shapes.mesh(0),
    }
    text = page.read_text(encoding="utf-8")
    examples = "\n".join(_EXAMPLE.findall(text))
    test = doctest.DocTestParser().get_doctest(examples, names, page.name, str(page), 0)
    told: list[str] = []
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    runner = doctest.DocTestRunner(optionflags=flags)
    runner.run(test, out=told.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(told)
