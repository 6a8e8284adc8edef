"""Curves of errors over counts, with bands of one standard deviation."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping

import matplotlib as mpl
from matplotlib.figure import Figure

from deformer.evaluation import Table

_MARKERS = "osD^v<>pPX*h"


def draw(
    table: Table,
    title: str,
    horizontal: str,
    points: Mapping[str, tuple[float, float]] | None = None,
) -> bytes:
    """Plot a curve for each method with a band of one standard deviation; returns SVG.

    The SVG has no date, so that equal tables give equal bytes. An axis is logarithmic if errors (or
    more than two counts) span a factor of ten.

    Args:
        table: summaries by method and count; the order of the methods gives their colours.
        title: title of the figure.
        horizontal: label of the axis of counts.
        points: single (count, value) pairs by their names, drawn beside the curves.
    """
    figure = Figure(figsize=(7.2, 4.0), layout="constrained")
    axes = figure.add_subplot()
    seen: list[float] = []
    for index, (method, row) in enumerate(table.cells.items()):
        found = [(count, row[count]) for count in sorted(row) if row[count].values]
        counts = [count for count, _ in found]
        means = [summary.mean for _, summary in found]
        spreads = [summary.spread or 0.0 for _, summary in found]
        seen += means
        color, style = f"C{index % 10}", ("-", "--")[index // 10 % 2]
        marker = _MARKERS[index % len(_MARKERS)]
        axes.plot(counts, means, marker=marker, ms=4, label=method, color=color, linestyle=style)
        low = [max(m - s, 0.1 * m) for m, s in zip(means, spreads, strict=True)]
        high = [m + s for m, s in zip(means, spreads, strict=True)]
        axes.fill_between(counts, low, high, color=color, alpha=0.15, linewidth=0)
    for index, (name, (count, value)) in enumerate((points or {}).items()):
        axes.plot([count], [value], "k" + "*P"[index % 2], ms=11, label=name)
        seen.append(value)
    seen = [value for value in seen if value > 0 and math.isfinite(value)]
    if seen and max(seen) > 10 * min(seen):
        axes.set_yscale("log")
    counts = table.counts
    if len(counts) > 2 and min(counts) > 0 and counts[-1] >= 10 * counts[0]:
        axes.set_xscale("log")
    axes.set_xticks(counts, [str(count) for count in counts])
    axes.minorticks_off()
    axes.set_xlabel(horizontal)
    axes.set_ylabel(table.metric.replace("_", " "))
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "deformer", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()
