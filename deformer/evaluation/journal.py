"""Rows of results, and the journal that lets an interrupted run go on."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Literal, TypedDict

from deformer.errors import InputError
from deformer.io import atomic_path

Column = Literal["dataset", "method", "protocol", "count", "seed", "metric", "value"]
COLUMNS: tuple[Column, ...] = ("dataset", "method", "protocol", "count", "seed", "metric", "value")
# The metric of a row whose value is the one-line reason why there is no other.
FAILURE = "failure"


class Row(TypedDict):
    """One number: what was measured, on what, and how."""

    dataset: str
    method: str
    protocol: str
    count: int
    seed: int
    metric: str
    value: float | int | str


class Journal:
    """Rows of finished measurements by their keys, on disk: a line of JSON for each.

    The last line of a key counts. A line that was cut off by a crash is dropped.

    Args:
        path: the file; it is made when the first measurement is finished.

    Raises:
        InputError: the file is there and is no journal.
    """

    def __init__(self, path: Path) -> None:
        """Read what is there."""
        self._path = path
        self._rows: dict[str, list[Row]] = {}
        if not path.is_file():
            return
        lines = path.read_bytes().splitlines(keepends=True)
        for number, line in enumerate(lines):
            try:
                entry = json.loads(line)
                self._rows[entry["key"]] = entry["rows"]
            except (ValueError, KeyError, TypeError) as error:
                if number < len(lines) - 1:
                    raise InputError(
                        f"{path}, line {number + 1}: not an entry of a journal; choose another "
                        "directory or delete the file"
                    ) from error
                # What comes next must begin on a line of its own.
                with atomic_path(path) as temporary:
                    temporary.write_bytes(b"".join(lines[:-1]))

    def __contains__(self, key: str) -> bool:
        """True for a finished measurement; one that failed is not, and will be tried again."""
        return key in self._rows and not any(row["metric"] == FAILURE for row in self._rows[key])

    def __getitem__(self, key: str) -> list[Row]:
        """Rows of a measurement that is finished or has failed."""
        return self._rows[key]

    def add(self, key: str, rows: list[Row]) -> None:
        """Keep a measurement's rows; they are on disk when this returns."""
        self._rows[key] = rows
        line = json.dumps({"key": key, "rows": rows}, ensure_ascii=False, allow_nan=False)
        with self._path.open("ab") as file:
            file.write(line.encode() + b"\n")


def write_csv(path: Path, rows: list[Row]) -> None:
    """Write rows as a table with a head; an existing file is replaced at the end."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows([row[column] for column in COLUMNS] for row in rows)
