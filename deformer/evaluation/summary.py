"""Mean and standard deviation of rows over several seeds."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from statistics import fmean, stdev

from deformer.evaluation.journal import FAILURE, Row


@dataclass(frozen=True)
class Summary:
    """Values of one metric over seeds.

    Args:
        mean: NaN if there are no values.
        spread: standard deviation over seeds; None for fewer than two.
        values: by seed.
        failed: number of seeds without a value.
        lost: number of shapes on which the method failed, over all seeds with a value; the values
            leave these shapes out.
        shapes: number of shapes in all, over the same seeds; 0 where they were not counted.
    """

    mean: float
    spread: float | None
    values: tuple[float, ...]
    failed: int = 0
    lost: int = 0
    shapes: int = 0


@dataclass
class Table:
    """One metric of one protocol on one data set: summaries by method and count."""

    dataset: str
    protocol: str
    metric: str
    cells: dict[str, dict[int, Summary]] = field(default_factory=dict)

    @property
    def counts(self) -> list[int]:
        """The counts of all methods, in increasing order."""
        return sorted({count for row in self.cells.values() for count in row})


def summarise(rows: Iterable[Row]) -> dict[tuple[str, str, str], Table]:
    """Tables by (dataset, protocol, metric), in the order of the rows.

    The metrics "failure", "failures" and "shapes" have no tables of their own: they fill `failed`,
    `lost` and `shapes` in the summaries of the other metrics.

    Raises:
        TypeError: a row of another metric than "failure" has a text as its value.
    """
    values: dict[tuple, list[float]] = defaultdict(list)
    failed: dict[tuple, int] = defaultdict(int)
    counted: dict[tuple, list[float]] = defaultdict(lambda: [0, 0])
    for row in rows:
        key = row["dataset"], row["protocol"], row["method"], row["count"]
        metric, value = row["metric"], row["value"]
        if metric == FAILURE:
            failed[key] += 1
        elif isinstance(value, str):
            raise TypeError(f"row {row}: a text for a value")
        elif metric in ("failures", "shapes"):
            counted[key][metric == "shapes"] += value
        else:
            values[*key, metric].append(float(value))
    tables: dict[tuple[str, str, str], Table] = {}
    for (*key, metric), found in values.items():
        dataset, protocol, method, count = key
        table = tables.setdefault((dataset, protocol, metric), Table(dataset, protocol, metric))
        lost, shapes = (int(number) for number in counted[*key,])
        table.cells.setdefault(method, {})[count] = Summary(
            fmean(found),
            stdev(found) if len(found) > 1 else None,
            tuple(found),
            failed[*key,],
            lost,
            shapes,
        )
    for (dataset, protocol, method, count), number in failed.items():
        for table in tables.values():
            if (table.dataset, table.protocol) == (dataset, protocol):
                row = table.cells.setdefault(method, {})
                row.setdefault(count, Summary(float("nan"), None, (), number))
    return tables
