"""The public names, and what their pages and docstrings lack; building the manual asks for it.

A public name is on one page of docs/api, with an example. Its docstring, and those of the methods
of a class, say the shapes of arrays.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import typing
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
API = sorted((ROOT / "docs" / "api").glob("*.md"))
# Packages whose names are public beside those of `deformer`.
_OPEN = ("io", "evaluation", "baselines")
# `io` has two functions that `deformer` has, too, with or without documents.
_TWICE = ("deformer.io.load_shapes", "deformer.io.load_mesh")
EXAMPLE = re.compile(r"^```pycon\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_NAME = re.compile(r"^::: ([\w.]+)$", re.MULTILINE)
_ARRAY = re.compile(r"\b(ArrayLike|FloatArray|IntArray|NDArray)\b")
_SHAPE = re.compile(r"\((?:\.\.\.|[\w+·′'*]+)(?:, ?[\w+·′']+)*,?\)")
_ELSEWHERE = re.compile(r"same shape|as (?:in|of|there)|`")


def public_names() -> dict[str, typing.Any]:
    """Full name → what is public, without packages."""
    found = {}
    for package in ("", *_OPEN):
        module = importlib.import_module("deformer" + (f".{package}" if package else ""))
        stub = ast.parse((ROOT / "deformer" / package / "__init__.pyi").read_text(encoding="utf-8"))
        for node in stub.body:
            assert isinstance(node, ast.ImportFrom)
            for alias in node.names:
                value = getattr(module, alias.name)
                if not inspect.ismodule(value):
                    found[f"{module.__name__}.{alias.name}"] = value
    return {name: value for name, value in found.items() if name not in _TWICE}


def sections() -> list[tuple[str, str]]:
    """Names on the pages of the API, and what follows each up to the next."""
    found = []
    for page in API:
        text = page.read_text(encoding="utf-8")
        starts = list(_NAME.finditer(text))
        for start, end in zip(starts, [*starts[1:], None], strict=False):
            found.append((start[1], text[start.end() : end.start() if end else len(text)]))
    return found


def faults() -> list[str]:
    """What pages and docstrings lack, a line each."""
    public, told = public_names(), sections()
    names = [name for name, _ in told]
    found = [f"{name}: is public and on no page of docs/api" for name in public.keys() - {*names}]
    found += [f"{name}: is on a page of docs/api and not public" for name in {*names} - {*public}]
    found += [f"{name}: is documented twice" for name in {*names} if names.count(name) > 1]
    found += [f"{name}: has no example" for name, text in told if not EXAMPLE.search(text)]
    for name, value in public.items():
        found += _of_docstrings(name, value)
    return sorted(found)


def _of_docstrings(name: str, value: typing.Any) -> list[str]:
    """What the docstrings of a public name and its methods lack."""
    if typing.get_origin(value) or not callable(value):
        return []  # a type or a constant
    if inspect.isclass(value) and issubclass(value, (Exception, dict)):
        return []  # without arguments of its own
    found = lacking(name, value)
    if inspect.isclass(value):
        for member, function in vars(value).items():
            plain = inspect.unwrap(getattr(function, "__func__", function))
            if not member.startswith("_") and inspect.isfunction(plain):
                found += lacking(f"{name}.{member}", plain)
    return found


def lacking(name: str, value: typing.Any) -> list[str]:
    """What the docstring of a function or a class lacks: itself, or shapes of arrays."""
    doc = inspect.getdoc(value) or ""
    if not doc:
        return [f"{name}: has no docstring"]
    found = []
    signature = inspect.signature(value)
    entries = dict(re.findall(r"^    (\w+): ((?:.|\n(?=        ))*)", doc, re.MULTILINE))
    for argument in signature.parameters.values():
        if not _ARRAY.search(str(argument.annotation)):
            continue
        told = entries.get(argument.name, doc)
        if not (_SHAPE.search(told) or _ELSEWHERE.search(told)):
            found.append(f"{name}: the docstring says no shape of {argument.name}")
    if _ARRAY.search(str(signature.return_annotation)) and not _SHAPE.search(doc):
        found.append(f"{name}: the docstring says no shape of the result")
    return found
