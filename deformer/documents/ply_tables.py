"""All elements of a PLY file as arrays, and where their rows are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from deformer.geometry import IntArray
from deformer.io import PlyElement, ply_header, ply_row


@dataclass(frozen=True, eq=False)
class PlyTable:
    """The rows of an element.

    Args:
        element: its name and properties.
        start: byte of a binary file, or number of the line among those of text that are not blank,
            where the rows start.
        row: layout of the rows of a binary file where it is the same for all, else None.
        scalars: name → values (n,).
        lists: name → lengths (n,) and the values of all rows, one after the other.
    """

    element: PlyElement
    start: int
    row: np.dtype | None
    scalars: dict[str, np.ndarray]
    lists: dict[str, tuple[IntArray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class PlyTables:
    """The elements of a PLY file that have rows, by name.

    Args:
        order: "<" or ">" for binary files, "" for text.
        body: byte after the header.
        tables: name → table.
    """

    order: str
    body: int
    tables: dict[str, PlyTable]


def ply_tables(data: bytes) -> PlyTables:
    """Read all elements.

    Args:
        data: contents of a PLY file that the reader of `deformer.io` accepts, without a byte order
            mark.
    """
    order, elements, body = ply_header(data, "the document")
    read = _binary_tables(data, body, order, elements) if order else _text_tables(
        data, body, elements
    )  # fmt: skip
    return PlyTables(order, body, {table.element.name: table for table in read})


def _text_tables(data: bytes, body: int, elements: list[PlyElement]) -> Iterator[PlyTable]:
    rows = [line.split() for line in data[body:].splitlines() if line and not line.isspace()]
    start = 0
    for element in elements:
        block = rows[start : start + element.count]
        columns: dict[str, list[bytes]] = {p.name: [] for p in element.properties}
        lengths: dict[str, list[int]] = {p.name: [] for p in element.properties if p.count_type}
        for row in block:
            at = 0
            for prop in element.properties:
                size = 1
                if prop.count_type:
                    size = int(row[at])
                    lengths[prop.name].append(size)
                    at += 1
                columns[prop.name] += row[at : at + size]
                at += size
        values = {
            p.name: np.array([_number(token) for token in columns[p.name]])
            for p in element.properties
        }
        yield _table(element, start, None, values, lengths)
        start += element.count


def _binary_tables(
    data: bytes, offset: int, order: str, elements: list[PlyElement]
) -> Iterator[PlyTable]:
    for element in elements:
        row = ply_row(data, offset, element, order)
        values: dict[str, np.ndarray] = {}
        lengths: dict[str, list[int]] = {}
        start = offset
        if row is not None:
            table = np.frombuffer(data, row, element.count, offset)
            offset += table.nbytes
            for prop in element.properties:
                values[prop.name] = table[prop.name].ravel()
                if prop.count_type:
                    lengths[prop.name] = table[f"{prop.name} length"].tolist()
        else:
            chunks: dict[str, list[bytes]] = {p.name: [] for p in element.properties}
            lengths = {p.name: [] for p in element.properties if p.count_type}
            kinds = [
                (
                    p.name,
                    np.dtype(order + p.type).itemsize,
                    np.dtype(p.count_type).itemsize if p.count_type else 0,
                )
                for p in element.properties
            ]
            for _ in range(element.count):
                for name, size, head in kinds:
                    if head:
                        count = int.from_bytes(
                            data[offset : offset + head],
                            "little" if order == "<" else "big",
                        )
                        lengths[name].append(count)
                        offset += head
                        size *= count
                    chunks[name].append(data[offset : offset + size])
                    offset += size
            values = {
                p.name: np.frombuffer(b"".join(chunks[p.name]), order + p.type)
                for p in element.properties
            }
        yield _table(element, start, row, values, lengths)


def _number(token: bytes) -> float:
    """The number; NaN for a token that the reader has ignored and that is none."""
    try:
        return float(token)
    except ValueError:
        return np.nan


def _table(
    element: PlyElement,
    start: int,
    row: np.dtype | None,
    values: dict[str, np.ndarray],
    lengths: dict[str, list[int]],
) -> PlyTable:
    return PlyTable(
        element,
        start,
        row,
        {name: array for name, array in values.items() if name not in lengths},
        {name: (np.array(counts), values[name]) for name, counts in lengths.items()},
    )
