"""Rows of results, and the journal from which an interrupted run continues."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Literal, TypedDict

from deformer.errors import InputError
from deformer.io import JsonValue, atomic_path, parse_value, read_bytes

Column = Literal["dataset", "method", "protocol", "count", "seed", "metric", "value"]
COLUMNS: tuple[Column, ...] = ("dataset", "method", "protocol", "count", "seed", "metric", "value")
"""Names of the columns of results.csv, and of the keys of a row."""
FAILURE = "failure"
"""Metric of a row that reports a failure; its value is the reason in one line."""


class Row(TypedDict):
    """One measured number with its data set, method, protocol, count, seed and metric.

    `count` is a number of components or of control points, or an upper bound in degrees (protocol
    "rotation").
    """

    dataset: str
    method: str
    protocol: str
    count: int
    seed: int
    metric: str
    value: float | int | str


class Journal:
    """Rows of measurements by their keys, in a file with a line of JSON for each measurement.

    Of several lines with one key the last is valid. A last line that a crash cut off is dropped.

    Args:
        path: the file; `add` creates it.

    Raises:
        InputError: the file exists and is not a journal.
    """

    def __init__(self, path: Path) -> None:
        """Read the file, if it exists."""
        self._path = path
        self._rows: dict[str, list[Row]] = {}
        if not path.is_file() or not path.stat().st_size:
            return
        lines = read_bytes(path).splitlines(keepends=True)
        for number, line in enumerate(lines):
            try:
                key, rows = _entry(parse_value(line, f"{path}, line {number + 1}"))
            except InputError as error:
                if number < len(lines) - 1 or line.endswith(b"\n"):
                    raise InputError(
                        f"{error} (not an entry of a journal; choose another directory or delete "
                        "the file)"
                    ) from error
                # The next entry must begin on a line of its own.
                with atomic_path(path) as temporary:
                    temporary.write_bytes(b"".join(lines[:-1]))
            else:
                self._rows[key] = rows

    def __contains__(self, key: str) -> bool:
        """True for a finished measurement; a failed one is not finished, and is tried again."""
        return key in self._rows and not any(row["metric"] == FAILURE for row in self._rows[key])

    def __getitem__(self, key: str) -> list[Row]:
        """Rows of a measurement that is finished or has failed."""
        return self._rows[key]

    def add(self, key: str, rows: list[Row]) -> None:
        """Store a measurement's rows; they are on disk when this returns."""
        self._rows[key] = rows
        line = json.dumps({"key": key, "rows": rows}, ensure_ascii=False, allow_nan=False)
        try:
            with self._path.open("ab") as file:
                file.write(f"{line}\n".encode(errors="backslashreplace"))
        except OSError as error:
            error.filename = str(self._path)
            raise


def _entry(value: JsonValue) -> tuple[str, list[Row]]:
    value.check_keys(("key", "rows"))
    return value["key"].text(), [_row(row) for row in value["rows"].items()]


def _row(value: JsonValue) -> Row:
    value.check_keys(COLUMNS)
    found = value["value"]
    return Row(
        dataset=value["dataset"].text(),
        method=value["method"].text(),
        protocol=value["protocol"].text(),
        count=value["count"].integer(0),
        seed=value["seed"].integer(0),
        metric=value["metric"].text(),
        value=found.text() if value["metric"].value == FAILURE else _result(found),
    )


def _result(value: JsonValue) -> float | int | str:
    """A number, an integer if it was one, or a text."""
    if isinstance(value.value, str):
        return value.text()
    value.number()
    return value.value


def write_csv(path: Path, rows: list[Row]) -> None:
    """Write rows as CSV with a header line; an existing file is replaced at the end."""
    with (
        atomic_path(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8", errors="backslashreplace") as file,
    ):
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        writer.writerows([row[column] for column in COLUMNS] for row in rows)
