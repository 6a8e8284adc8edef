"""Quality of a prior's components and poses, compared with SPLOCS and with the true shapes.

    python benchmarks/shape_quality.py SHAPES MODEL [MODEL…] [--counts 5 20 80] [--shapes 12]

SHAPES are the data set of the models; a few exact handles pose the shapes that a model has not
seen. The first table shows how local components are, beside those of SPLOCS on the same features,
learned in this run from the first model's training shapes. The other tables show errors of edge
lengths and volume, the number of folds, and the jitter of all vertices under noise of exact and of
soft handles, in standard deviations of that noise.

A fold is an edge whose two faces turn by more than 150° against each other, although they do so
neither in the examples nor in the true shape. The path goes from one held-out shape to the next in
21 warm solves, with all handles on straight lines.
"""

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from deformer.acap import FeatureExtractor, FeatureScaler, extract_all
from deformer.analysis import SUPPORT_THRESHOLD, Activations
from deformer.editing import HandleSolver
from deformer.geometry import edges, farthest_points
from deformer.io import load_shapes
from deformer.model.storage import load_model
from deformer.training.sparse_components import localised_components

FOLD = np.cos(np.radians(150.0))
STEPS = 21
NOISE = 0.01
DRAWS = 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shapes")
    parser.add_argument("models", nargs="+")
    parser.add_argument("--counts", type=int, nargs="+", default=[5, 20, 80])
    parser.add_argument("--shapes", dest="tests", type=int, default=12, help="held-out shapes")
    options = parser.parse_args()
    console = Console(width=110)
    shapes = load_shapes(options.shapes)
    models = {Path(name).name: load_model(name) for name in options.models}
    local = Table("components", "K in use", "support %", "p90", "extent %", "p90")
    for name, model in models.items():
        acts = Activations(model)
        weights = np.array([acts.support(k) for k in range(model.components)])
        local.add_row(name, *locality(weights, model.geodesics))
    first = next(iter(models.values()))
    learned = shapes.subset(first.split["train"])
    q = extract_all(FeatureExtractor(first.reference), learned.vertices)
    scaled = (q - q.mean(axis=0)) / FeatureScaler.fit(q).gain
    found = localised_components(scaled, first.geodesics.normalised_row, first.components)
    basis = np.linalg.norm(found.components, axis=2)
    local.add_row("SPLOCS", *locality(basis, first.geodesics))
    console.print(local)
    for name, model in models.items():
        quality(console, name, model, shapes, options)


def locality(weights, geodesics):
    """Number of components in use; mean and 90th percentile of their support and extent in %."""
    used = weights[weights.max(axis=1) > 0.0]
    used = used / used.max(axis=1, keepdims=True)
    share = 100.0 * (used >= SUPPORT_THRESHOLD).mean(axis=1)
    extent = []
    for row in used:
        away = geodesics.normalised_row(int(row.argmax()))[row >= SUPPORT_THRESHOLD]
        extent.append(100.0 * away[np.isfinite(away)].max())
    numbers = [f(x) for x in (share, extent) for f in (np.mean, lambda x: np.quantile(x, 0.9))]
    return [str(len(used)), *(f"{number:.1f}" for number in numbers)]


def quality(console, name, model, shapes, options):
    faces = shapes.faces
    held_out = np.delete(shapes.vertices, model.split["train"], axis=0)
    some = np.unique(np.linspace(0, len(held_out) - 1, options.tests).round().astype(int))
    truth = held_out[some]
    i, j = edges(faces).T
    hinges = pairs(faces)
    shown = turned(shapes.vertices[model.split["train"]], faces, hinges).any(axis=0)
    folded = turned(truth, faces, hinges)
    solver = HandleSolver(model)
    diagonal = model.reference.bounding_diagonal
    table = Table(
        "handles", "edge p50 %", "p99 %", "volume %", "folds a shape", "on the path",
        "jitter", "soft",
        title=f"{name}: median and p99 change of edges against the true shapes, …",
    )  # fmt: skip
    for count in options.counts:
        h = farthest_points(model.geodesics, count, 0)
        poses = []
        for shape in truth:
            solver.set_handles(h, shape[h], hard=True)
            poses.append(solver.solve().vertices)
        poses = np.array(poses)
        stretch = np.abs(lengths(poses, i, j) / lengths(truth, i, j) - 1.0)
        volume = np.abs(volumes(poses, faces) / volumes(truth, faces) - 1.0)
        folds = (turned(poses, faces, hinges) & ~shown & ~folded).sum() / len(poses)
        worst = 0
        for a, b in zip(range(len(truth) - 1), range(1, len(truth)), strict=True):
            solver.set_handles(h, truth[a][h], hard=True)
            solver.solve()
            for t in np.linspace(0.0, 1.0, STEPS):
                solver.set_handles(h, (1.0 - t) * truth[a][h] + t * truth[b][h], hard=True)
                frame = solver.solve(warm=True).vertices[None]
                worst = max(worst, int((turned(frame, faces, hinges)[0] & ~shown).sum()))
        rng, moved = np.random.default_rng(0), {True: [], False: []}
        for hard in moved:
            solver.set_handles(h, truth[0][h], hard=hard)
            solver.solve()
            for _ in range(DRAWS):
                noise = rng.normal(scale=NOISE * diagonal, size=(count, 3))
                solver.set_handles(h, truth[0][h] + noise, hard=hard)
                moved[hard].append(solver.solve(warm=True).vertices)
        jitter = [
            np.std(np.array(frames), axis=0) / (NOISE * diagonal) for frames in moved.values()
        ]
        table.add_row(
            str(count),
            f"{100 * np.median(stretch):.2f}",
            f"{100 * np.quantile(stretch, 0.99):.1f}",
            f"{100 * volume.mean():.2f}",
            f"{folds:.1f}",
            str(worst),
            *(f"{np.sqrt((x**2).mean()):.2f}" for x in jitter),
        )
    console.print(table)
    rest = model.reference.vertices[None]
    stretch = np.abs(lengths(truth, i, j) / lengths(rest, i, j) - 1.0)
    volume = np.abs(volumes(truth, faces) / volumes(rest, faces) - 1.0)
    console.print(
        f"true shapes against the reference: edges p50 {100 * np.median(stretch):.2f} %, p99 "
        f"{100 * np.quantile(stretch, 0.99):.1f} %, volume {100 * volume.mean():.2f} %, edges "
        f"folded {folded.sum() / len(truth):.1f} a shape; folded by examples: {shown.sum()}"
    )


def lengths(shapes, i, j):
    return np.linalg.norm(shapes[:, i] - shapes[:, j], axis=2)


def volumes(shapes, faces):
    """Signed volumes (N,) of shapes (N, V, 3); for open surfaces relative to the centroid."""
    corners = (shapes - shapes.mean(axis=1, keepdims=True))[:, faces]
    return np.linalg.det(corners).sum(axis=1) / 6.0


def pairs(faces):
    """Faces (n, 2) on the two sides of every inner edge."""
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    face = np.tile(np.arange(len(faces)), 3)
    key = np.sort(directed, axis=1)
    order = np.lexsort(key.T)
    same = (key[order][1:] == key[order][:-1]).all(axis=1)
    return np.stack([face[order][:-1][same], face[order][1:][same]], axis=1)


def turned(shapes, faces, hinges):
    """True (N, n) where the two faces of a hinge turn by more than 150°."""
    found = []
    for shape in shapes:
        a, b, c = (shape[faces[:, k]] for k in range(3))
        normal = np.cross(b - a, c - a)
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
        found.append((normal[hinges[:, 0]] * normal[hinges[:, 1]]).sum(axis=1) < FOLD)
    return np.array(found)


if __name__ == "__main__":
    main()
