"""The report of `deformer check`: facts, findings and pictures, in one HTML file."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image

from deformer import Finding, InputError, Mesh, MeshSequence, Report
from deformer_app import console
from deformer_app.rendering.camera import aim
from deformer_app.rendering.offscreen import HandleGlyphs, Picture, contact_sheet, render
from deformer_app.report.page import write_page
from deformer_app.report.parts import Cell, Figure, Grid, Part, Section

_SIZE = (360, 360)
# Most shapes and most marks that are drawn of one finding.
_SHAPES, _MARKS = 4, 150
_INTRO = (
    "Shapes are compared with all others of their set. Orange balls mark the vertices that a "
    "finding is about; each picture is scaled to what it shows."
)


def write(
    page: Path,
    source: Path,
    shapes: MeshSequence,
    report: Report,
    done: tuple[str, ...],
    fixed: tuple[MeshSequence, Report] | None,
) -> None:
    """Write a page that needs neither other files nor a network.

    Args:
        page: the HTML file.
        source: where the shapes are from, for the title.
        shapes: the shapes.
        report: of the shapes.
        done: what was repaired.
        fixed: the repaired shapes and their report, or None.
    """
    sections = _sections("", shapes, report)
    if fixed is not None:
        rows = [[Cell(line)] for line in done or ("nothing that can be repaired safely",)]
        sections.append(Section("Repairs", [Part("", [Grid(["what was done"], rows)])]))
        sections += _sections(" after the repair", *fixed)
    usable = (fixed[1] if fixed else report).usable
    verdict = "fit for training" if usable else "not fit for training"
    facts = [("shapes", str(source)), ("verdict", verdict)]
    write_page(page, f"Check: {source.name}, {verdict}", _INTRO, sections, facts)


def _sections(when: str, shapes: MeshSequence, report: Report) -> list[Section]:
    rows = [
        [Cell(name.replace("_", " ")), Cell(console.brief(value))]
        for name, value in report.facts.items()
    ]
    found = [
        [Cell(finding.severity, "failed" if finding.severity == "error" else ""),
         Cell(finding.message, "text")]
        for finding in report.findings
    ]  # fmt: skip
    facts = Part("Facts", [Grid(["fact", "value"], rows)])
    findings = Part("Findings", [Grid(["severity", "finding"], found)] if found else [])
    if not found:
        findings.note = "None."
    pictures = _pictures(shapes, report)
    return [
        Section(f"Shapes{when}", [findings, facts]),
        Section(f"Pictures{when}", pictures),
    ]


def _pictures(shapes: MeshSequence, report: Report) -> list[Part]:
    """The reference, and a part for every finding that can be seen."""
    faulty = {n for finding in report.findings for n in finding.shapes}
    sound = [n for n in range(len(shapes)) if n not in faulty]
    try:
        reference = _figure([_draw(shapes, 0)], [_title(shapes, 0)], "")
        parts = [Part("Reference", figures=[reference])]
        for finding in report.findings:
            if not (finding.shapes or finding.vertices or finding.faces):
                continue
            if finding.kind == "repeated":
                continue
            parts.append(_part(shapes, finding, sound))
    except InputError as error:  # the report of a machine that cannot render has its findings
        return [Part("", note=f"No pictures: {error}")]
    return parts


def _part(shapes: MeshSequence, finding: Finding, sound: list[int]) -> Part:
    corners = shapes.faces[list(finding.faces)].ravel().tolist()
    marks = np.unique(np.array([*finding.vertices, *corners], dtype=np.int64))
    marks = marks[np.linspace(0, len(marks) - 1, min(len(marks), _MARKS)).astype(int)]
    drawn = list(finding.shapes[:_SHAPES]) or [0]
    pictures = [_draw(shapes, n, marks) for n in drawn]
    titles = [_title(shapes, n) for n in drawn]
    if finding.shapes and sound:
        usual = min(sound, key=lambda n: abs(n - drawn[-1]))
        pictures.append(_draw(shapes, usual, marks))
        titles.append(f"usual: {_title(shapes, usual)}")
    return Part(finding.kind, figures=[_figure(pictures, titles, finding.message)])


def _title(shapes: MeshSequence, n: int) -> str:
    return f"shape {n}, size {shapes.mesh(n).bounding_diagonal:.3g}"


def _draw(shapes: MeshSequence, n: int, marks: np.ndarray | None = None) -> Picture:
    vertices = shapes.vertices[n]
    # Far from the origin single precision, which pictures have, shows steps; and sizes differ.
    centred = vertices - vertices.mean(axis=0)
    centred /= max(float(np.ptp(centred, axis=0).max()), 1e-300)
    camera = aim(centred, aspect=_SIZE[0] / _SIZE[1])
    balls = None if marks is None or not len(marks) else HandleGlyphs(centred[marks])
    return render(Mesh(centred, shapes.faces), camera, _SIZE, balls)


def _figure(pictures: list[Picture], titles: list[str], caption: str) -> Figure:
    buffer = io.BytesIO()
    image = contact_sheet(pictures, len(pictures), titles)
    Image.fromarray(image).save(buffer, format="WEBP", quality=88)
    return Figure(buffer.getvalue(), "webp", caption, sheet=True)
