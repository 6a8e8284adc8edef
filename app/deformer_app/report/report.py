"""The report of an evaluation: one HTML file with tables, curves and pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from deformer import InputError
from deformer.evaluation import FAILURE, Row, Table, summarise
from deformer_app import console
from deformer_app.report import curves, paper as paper_sections, shape_rows as examples
from deformer_app.report.page import write_page
from deformer_app.report.parts import Cell, Figure, Grid, Part, Section, grid

_INTRO = Markup(
    "A value is the mean over seeds ± their standard deviation; the best of a column is bold. "
    "E<sub>rms</sub> is in thousandths of the data's own unit. STED has no unit; where the shapes "
    "are in no order of time, only its spatial part is there. Seeds draw the split, the training "
    "and the first control point."
)
# Titles of sections, in order, by the first part of a protocol's name.
_SECTIONS = {
    "reconstruction": "Reconstruction of unseen shapes",
    "sparse_control": "Sparse control",
    "layout": "Sparse control at vertices laid out by a model",
    "sensitivity": "Sensitivity to λ₁, λ₂",
    "noise": "Noise on the training shapes",
    "noisy_control": "Noisy control points",
    "rotation": "Large rotations",
    "training": "Training time",
}
# Meaning of a count, by a part of a protocol's name.
_COUNTS = {
    "control": "control points",
    "rotation": "largest local rotation up to, degrees",
    "": "components",
}
_METRICS = ("E_rms", "E_rms_rigid", "STED", "STED_spatial", "STED_temporal", "seconds")
_RUNS = {"encoder": "encoder pass", "fit": "best latent fit"}


def write(
    folder: Path, rows: list[Row], facts: Mapping[str, Any], datasets: Mapping[str, str]
) -> None:
    """Write FOLDER/report.html, which needs neither other files nor a network.

    Args:
        folder: directory of the run, with its `examples`.
        rows: results of the run.
        facts: values of run.json: command, versions, machine, ….
        datasets: axis that points up, by name of the data set.
    """
    tables = summarise(rows)
    sections = [paper_sections.section(tables)] if facts["preset"] == "paper" else []
    sections += [Section("Pictures", _pictures(folder, rows, datasets))]
    for beginning, title in _SECTIONS.items():
        sections.append(Section(title, _parts(tables, beginning)))
    sections.append(Section("Failures", _failures(rows)))
    shown = [(name.replace("_", " "), console.brief(value)) for name, value in _flat(facts)]
    title = f"Evaluation: {', '.join(datasets)}"
    write_page(folder / "report.html", title, _INTRO, sections, shown, facts["command"])


def _parts(tables: Mapping[tuple[str, str, str], Table], beginning: str) -> list[Part]:
    """A part for every data set and protocol: a table for each metric, and curves over counts."""
    parts: dict[tuple[str, str], Part] = {}
    order = sorted(tables, key=lambda key: _METRICS.index(key[2]))
    for dataset, protocol, metric in order:
        if protocol.split("/")[0].split("(")[0] != beginning:
            continue
        table = tables[dataset, protocol, metric]
        title = f"{dataset}: {describe(protocol)}"
        part = parts.setdefault((dataset, protocol), Part(title))
        part.tables.append(grid(table, f"{metric.replace('_', ' ')} by"))
        if len(table.counts) > 1 and metric in ("E_rms", "STED"):
            counted = next(words for name, words in _COUNTS.items() if name in protocol)
            image = curves.draw(table, title, counted)
            part.figures.append(Figure(image, "svg+xml", f"{title}, {metric.replace('_', ' ')}"))
    return [parts[key] for key in sorted(parts)]


def describe(protocol: str) -> str:
    """Description of a protocol's name in rows.

    "noise(0.01)/reconstruction/encoder" becomes "noise 1 %, reconstruction, encoder pass".
    """
    words = []
    for piece in protocol.split("/"):
        name, _, argument = piece.removesuffix(")").partition("(")
        word = _RUNS.get(name, name.replace("_", " "))
        if name in ("noise", "noisy_control"):
            word += f" {100 * float(argument):g} %"
        elif argument:
            word += f" ({argument.replace(',', ', ')})"
        words.append(word)
    return ", ".join(words)


def _pictures(folder: Path, rows: list[Row], datasets: Mapping[str, str]) -> list[Part]:
    methods = list(dict.fromkeys(row["method"] for row in rows))
    captions = {
        "encoder": "one unseen shape by the encoder pass, and its distance to the true one",
        "sparse_control": "the same shape from 20 control points",
    }
    parts = []
    for dataset, up in datasets.items():
        part = Part(dataset)
        for what, caption in captions.items():
            try:
                image = examples.sheet(folder / "examples" / dataset, what, methods, up)
            except (
                InputError
            ) as error:  # the report of a machine that cannot render has its numbers
                part.note = f"No pictures: {error}"
                break
            if image is not None:
                part.figures.append(Figure(image, "webp", caption, sheet=True))
        if part.figures or part.note:
            parts.append(part)
    return parts


def _failures(rows: list[Row]) -> list[Part]:
    columns = ("dataset", "method", "protocol", "count", "seed", "value")
    found = [[Cell(str(row[c])) for c in columns] for row in rows if row["metric"] == FAILURE]
    if not found:
        return []
    return [Part(f"{len(found)} measurements failed", [Grid([*columns[:-1], "reason"], found)])]


def _flat(facts: Mapping[str, Any]) -> list[tuple[str, Any]]:
    """Facts as (name, value) without the command; a study is one line of what distinguishes it."""
    flat = [
        (name, facts[name]) for name in ("versions", "machine", "processes", "seconds", "seeds")
    ]
    for study in facts["studies"]:
        short = {
            name: study[name]
            for name in (
                "methods",
                "protocols",
                "components",
                "at",
                "counts",
                "seeds",
                "epochs",
                "tests",
            )
        }
        sizes = [
            f"{len(split['train'])} to train, {len(split['test'])} to test"
            for split in study["splits"]
        ]
        flat.append((study["dataset"], {"shapes": study["shapes"], "splits": sizes, **short}))
    return flat
