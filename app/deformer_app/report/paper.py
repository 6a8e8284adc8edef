"""The paper's tables and figures beside the measured numbers."""

from __future__ import annotations

from collections.abc import Mapping

from deformer.evaluation import LAMBDA_METHOD, Summary, Table, paper
from deformer_app.report import curves
from deformer_app.report.parts import Cell, Figure, Grid, Part, Section, number, value_cell

Tables = Mapping[tuple[str, str, str], Table]

_ENCODER = "reconstruction/encoder"
_DATA = {
    "crane": "crane stands in for Swing and Jumping",
    "face": "ict-expressions for Face",
    "horse": "horse-gallop for Horse",
    "humanoid": "the generated set for Humanoid",
}

_NEARNESS = (
    "How near the paper's numbers come depends on the reference shape and the number of steps: "
    "see docs/evidence/results.md, “The paper's configuration”."
)


def section(tables: Tables) -> Section:
    """The section with those of the paper's tables and figures that have measured numbers."""
    parts = [_more_evaluation(tables), _gerror(tables), _diff_lambda(tables), _control(tables)]
    return Section("Beside the paper", [part for part in parts if part is not None])


def _summary(tables: Tables, key: tuple[str, str, str], method: str) -> Summary | None:
    table = tables.get(key)
    return table.cells.get(method, {}).get(paper.GERROR_COMPONENTS) if table else None


def _more_evaluation(tables: Tables) -> Part | None:
    """Table "moreevaluation": for each data set the paper's numbers above the measured ones."""
    methods = list(paper.METHODS.values())
    also = "autoencoder"
    head = ["data set, metric", *(f"{name}: {ours}" for name, ours in paper.METHODS.items()), also]
    rows = []
    for (title, dataset, metric), numbers in paper.MORE_EVALUATION.items():
        # STED has only its spatial part where the shapes have no order.
        measured = metric
        if metric == "STED" and (dataset, _ENCODER, metric) not in tables:
            measured = "STED_spatial"
        key = dataset, _ENCODER, measured
        if key not in tables:
            continue
        rows.append(
            [
                Cell(f"{title}, {metric}, the paper"),
                *(Cell(number(numbers[name]), "paper") for name in paper.METHODS),
                Cell("–"),
            ]
        )
        found = [_summary(tables, key, method) for method in (*methods, also)]
        least = min((s.mean for s in found if s is not None and s.values), default=None)
        rows.append(
            [
                Cell(f"{dataset}, {measured}, here"),
                *(Cell("–") if s is None else value_cell(s, best=s.mean == least) for s in found),
            ]
        )
    if not rows:
        return None
    note = (
        "Encoder pass with 50 components. The data differ: "
        + "; ".join(_DATA.values())
        + ". STED's constants are not the paper's. Compare methods within a row."
    )
    return Part("Table “moreevaluation”: errors on unseen shapes", [Grid(head, rows)], note=note)


def _gerror(tables: Tables) -> Part | None:
    """Figure "gerror": errors over the number of components."""
    figures = []
    for (dataset, metric), stated in paper.GERROR.items():
        table = tables.get((dataset, _ENCODER, metric))
        if table is None:
            continue
        points = {
            f"{method}, the paper": (paper.GERROR_COMPONENTS, value)
            for method, value in stated.items()
        }
        title = f"{dataset}: {metric.replace('_', ' ')} by the encoder pass"
        image = curves.draw(table, title, "components", points)
        figures.append(Figure(image, "svg+xml", title))
    note = (
        "The paper's curves are pictures; the stars are the numbers that its text states. "
        + _NEARNESS
    )
    return (
        Part("Figure “gerror”: errors over components", figures=figures, note=note)
        if figures
        else None
    )


def _diff_lambda(tables: Tables) -> Part | None:
    """Table "diff_lambda": the weights of the loss, on SCAPE."""
    names = {lambdas: "sensitivity({:g},{:g})".format(*lambdas) for lambdas in paper.DIFF_LAMBDA}
    names[0.5, 0.5] = "reconstruction"
    head, measured, fitted, stated = (
        ["(λ₁, λ₂)"],
        [Cell("encoder pass, here")],
        [Cell("best fit, here")],
        [Cell("the paper", "")],
    )
    for lambdas, name in names.items():
        head.append("({:g}, {:g})".format(*lambdas))
        stated.append(Cell(number(paper.DIFF_LAMBDA[lambdas]), "paper"))
        for row, run in ((measured, "encoder"), (fitted, "fit")):
            found = _summary(tables, ("scape", f"{name}/{run}", "E_rms"), LAMBDA_METHOD)
            row.append(Cell("–") if found is None else value_cell(found))
    if all(cell.text == "–" for cell in measured[2:]):
        return None
    grid = Grid(head, [stated, measured, fitted])
    return Part("Table “diff_lambda”: E_rms on SCAPE, 50 components", [grid], note=_NEARNESS)


def _control(tables: Tables) -> Part | None:
    """Figure "sparse_control": errors over the number of control points."""
    figures = []
    for dataset, metric in (("scape", "E_rms"), ("crane", "E_rms"), ("crane", "STED")):
        table = tables.get((dataset, "sparse_control", metric))
        if table is not None:
            title = f"{dataset}: {metric.replace('_', ' ')} from control points"
            image = curves.draw(table, title, "control points")
            figures.append(Figure(image, "svg+xml", title))
    note = "The paper states no numbers for this figure."
    return (
        Part(
            "Figure “sparse_control”: whole meshes from control points", figures=figures, note=note
        )
        if figures
        else None
    )
