"""Elements of a report: sections, their parts, tables and figures."""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass, field

from deformer.evaluation import Summary, Table


@dataclass(frozen=True)
class Cell:
    """Text of a table's cell, and its style: "", "best", "failed" or "paper"."""

    text: str
    kind: str = ""


@dataclass(frozen=True)
class Grid:
    """A table: its header, and rows whose first cell is their name."""

    head: list[str]
    rows: list[list[Cell]]


@dataclass(frozen=True)
class Figure:
    """An image embedded in the page; a sheet keeps its full width and scrolls."""

    image: bytes
    kind: str
    caption: str
    sheet: bool = False

    @property
    def source(self) -> str:
        """The image as a data URL."""
        return f"data:image/{self.kind};base64,{base64.b64encode(self.image).decode()}"


@dataclass
class Part:
    """A headed part of a section."""

    title: str
    tables: list[Grid] = field(default_factory=list)
    figures: list[Figure] = field(default_factory=list)
    note: str = ""


@dataclass
class Section:
    """A chapter of the report."""

    title: str
    parts: list[Part]

    @property
    def anchor(self) -> str:
        """Name for links within the page."""
        return "".join(letter for letter in self.title.lower() if letter.isalnum())


def grid(table: Table, head: str) -> Grid:
    """A table with a row for each method and a column for each count.

    The smallest mean of a column is marked as the best.

    Args:
        table: summaries by method and count.
        head: header of the column of method names.
    """
    least = {
        count: min(
            (row[count].mean for row in table.cells.values() if count in row and row[count].values),
            default=math.nan,
        )
        for count in table.counts
    }
    rows = []
    for method, row in table.cells.items():
        cells = [Cell(method)]
        for count in table.counts:
            if count not in row:
                cells.append(Cell("–"))
            else:
                cells.append(value_cell(row[count], best=row[count].mean == least[count]))
        rows.append(cells)
    return Grid([head, *map(str, table.counts)], rows)


def value_cell(summary: Summary, best: bool = False) -> Cell:
    """Mean ± standard deviation, and the numbers of failed shapes and seeds."""
    if not summary.values:
        return Cell("failed", "failed")
    text = number(summary.mean)
    if summary.spread is not None:
        text += f" ± {number(summary.spread)}"
    if summary.lost:
        text += f" ({summary.lost} of {summary.shapes} shapes failed)"
    if summary.failed:
        seeds = len(summary.values) + summary.failed
        text += f" ({summary.failed} of {seeds} seeds failed)"
    if summary.lost or summary.failed:
        return Cell(text, "failed")
    return Cell(text, "best" if best else "")


def number(value: float) -> str:
    """A number in four digits, with an exponent only below 1e-4 and from 1e6 on."""
    if value and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.2e}"
    digits = 3 - math.floor(math.log10(abs(value))) if value else 0
    return f"{value:.{min(max(digits, 0), 6)}f}"
