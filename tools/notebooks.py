"""Run the notebooks of examples/notebooks, and keep what their cells print and show.

python tools/notebooks.py examples/notebooks/*.ipynb

No Jupyter is needed. A cell that is tagged "parameters" sets names that a caller may replace, so
that the tests run the same cells with less.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import sys
from pathlib import Path
from typing import Any

Notebook = dict[str, Any]


def load(path: Path) -> Notebook:
    """A notebook, which is a JSON object with "cells"."""
    return json.loads(path.read_text(encoding="utf-8"))


def run(notebook: Notebook, replaced: dict[str, Any] | None = None) -> dict[str, Any]:
    """Run all cells in order, and put their outputs into the notebook.

    Args:
        notebook: as of `load`; the outputs of its cells are replaced.
        replaced: values of names that the cell "parameters" sets.

    Returns:
        The names that the cells have defined.
    """
    names: dict[str, Any] = {}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(cells, 1):
        cell["outputs"] = _outputs("".join(cell["source"]), names, number)
        cell["execution_count"] = number
        if "parameters" in cell["metadata"].get("tags", []):
            names.update(replaced or {})
    return names


def _outputs(source: str, names: dict[str, Any], number: int) -> list[dict[str, Any]]:
    """What a cell prints, and the value of its last line if that is an expression."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, f"cell {number}", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names)
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        text = printed.getvalue().splitlines(keepends=True)
        outputs.append({"output_type": "stream", "name": "stdout", "text": text})
    if value is not None:
        data: dict[str, Any] = {"text/plain": [repr(value)]}
        if hasattr(value, "_repr_png_"):
            data = {
                "image/png": base64.b64encode(value._repr_png_()).decode("ascii"),
                "text/plain": ["a picture"],
            }
        found = {"output_type": "execute_result", "execution_count": number, "metadata": {}}
        outputs.append({**found, "data": data})
    return outputs


def save(path: Path, notebook: Notebook) -> None:
    """Write a notebook."""
    text = json.dumps(notebook, indent=1, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


def main() -> None:
    """Run the notebooks that the arguments name, each in its own folder."""
    for path in [Path(name).resolve() for name in sys.argv[1:]]:
        notebook = load(path)
        os.chdir(path.parent)
        sys.path.insert(0, str(path.parent.parent))  # the modules beside the examples
        run(notebook)
        save(path, notebook)
        print(path.name)


if __name__ == "__main__":
    main()
