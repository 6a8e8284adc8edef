"""How closely rigs follow a model, its training shapes and unseen ones, beside plain alternatives.

    python benchmarks/rigging.py MODEL [SHAPES] [--bones 30] [--influences 4]
    python benchmarks/rigging.py SHAPES --decompose [--bones 5 10 20] [--influences 8]

Rows: Deformer's rig; its rigid parts with each vertex moved by its own part alone; the parts with
the weights of smoothed parts; and dem-bones with its defaults where the package py-dem-bones is
installed. All are fitted to the same shapes: decoded training codes and samples of the prior. The
errors are E_rms of the bones' best poses, nothing else aligned: of the decoded training shapes,
and, with SHAPES, of the true training shapes and of those of the model's split that it has not
seen; without, of other samples of the prior. "astray" is the share of the weights that is not
connected to its bone's others; "rough" is the root mean square difference of the weights along an
edge; "fewest" is the least sum of a bone's weights.

With --decompose the shapes themselves are decomposed, no model: dem-bones' published numbers are
those of its example (`data/Results_MacOS.txt` there).
"""

import argparse
import time
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table

import deformer
from deformer.geometry import edges
from deformer.rigging import decomposition
from deformer.rigging.clusters import one_hot, rigid_parts
from deformer.rigging.matrices import Frame, translations
from deformer.rigging.neighbourhoods import averaging, surface_graph

# RMSE over vertices and frames that dem-bones 1.2 reports for its example, by number of bones, with
# 8 influences; E_rms is 1000/√3 of it.
PUBLISHED = {5: 0.0267535, 10: 0.0155826, 20: 0.00997021}


@dataclass
class Method:
    name: str
    weights: np.ndarray
    seconds: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("shapes", nargs="?")
    parser.add_argument("--decompose", action="store_true", help="MODEL is a file of shapes")
    parser.add_argument("--bones", type=int, nargs="+", default=[30])
    parser.add_argument("--influences", type=int, default=4)
    options = parser.parse_args()
    if options.decompose:
        decompose(options)
        return
    model = deformer.load_model(options.model)
    decoded = model.decode(model.codes)
    measured = {"decoded": decoded}
    if options.shapes:
        shapes = deformer.load_shapes(options.shapes).vertices
        measured["training"] = shapes[model.split["train"]]
        unseen = np.delete(shapes, model.split["train"], axis=0)
        measured["unseen"] = unseen[:: max(1, len(unseen) // 60)]
    else:
        measured["samples"] = model.decode(deformer.draw_codes(model, 60, seed=1))
    examples = model.decode(decomposition._codes(model))
    for bones in options.bones:
        found = methods(model.reference, examples, bones, options.influences)
        start = time.perf_counter()
        rig = deformer.rig(model, bones, options.influences)
        found.insert(0, Method("Deformer", rig.weights, time.perf_counter() - start))
        report(options.model, model.reference, found, measured)


def methods(mesh, examples, bones, influences):
    """The alternatives, fitted to examples (N, V, 3)."""
    graph, frame = surface_graph(mesh), Frame.of(mesh)
    start = time.perf_counter()
    near = frame.inward(examples).transpose(1, 0, 2).copy()
    labels = rigid_parts(graph, frame.inward(mesh.vertices), near, bones, 4, lambda _: None)
    seconds = time.perf_counter() - start
    parts = one_hot(labels)
    smooth = parts
    for _ in range(4):
        smooth = averaging(graph) @ smooth
    found = [Method("rigid parts", parts, seconds), Method("smoothed parts", smooth, seconds)]
    try:
        from py_dem_bones.portable import solve_skinning  # pyright: ignore[reportMissingImports]
    except ImportError:
        return found
    start = time.perf_counter()
    solved = solve_skinning(
        mesh.vertices, examples, bones, faces=mesh.faces, max_influences=influences
    )
    weights = np.where(solved.weights.T < 1e-6, 0.0, solved.weights.T)
    weights /= weights.sum(axis=1, keepdims=True)
    return [*found, Method("dem-bones", weights, time.perf_counter() - start)]


def report(name, mesh, found, measured):
    size = mesh.bounding_diagonal
    table = Table(
        "method", "bones", "influences", "seconds", *measured, "astray %", "rough", "fewest",
        title=f"{name}: E_rms (in % of the bounding diagonal)",
    )  # fmt: skip
    i, j = edges(mesh.faces).T
    for method in found:
        w = method.weights
        rig = rig_of(mesh, w)
        errors = []
        for shapes in measured.values():
            off = deformer.e_rms(shapes, rig.pose(rig.fit(shapes)), "none")
            errors.append(f"{off:.3g} ({off / 10.0 / size:.3f})")
        rough = np.sqrt(((w[i] - w[j]) ** 2).sum(axis=1).mean())
        table.add_row(
            method.name, str(w.shape[1]), str(rig.influences), f"{method.seconds:.1f}", *errors,
            f"{100 * rig.stray:.2g}", f"{rough:.3f}", f"{w.sum(axis=0).min():.0f}",
        )  # fmt: skip
    Console(width=140).print(table)


def rig_of(mesh, weights):
    """A rig of weights alone, whose bones all begin at the origin."""
    B = weights.shape[1]
    rest = translations(np.zeros((B, 3)))
    parents = np.arange(B) - 1
    return deformer.Rig(
        mesh, weights, tuple(map(str, range(B))), parents, rest, rest[None][:0], 0.0, 0.0
    )


def decompose(options):
    """The shapes themselves, the first as the rest shape."""
    shapes = deformer.load_shapes(options.model)
    mesh = shapes.mesh(0)
    frame = Frame.of(mesh)
    inward = frame.inward(shapes.vertices).transpose(1, 0, 2).copy()
    steps = decomposition._Steps(None, 0)
    for bones in options.bones:
        start = time.perf_counter()
        weights = decomposition._decompose(mesh, frame, inward, bones, options.influences, steps)
        found = [Method("Deformer", weights, time.perf_counter() - start)]
        found += methods(mesh, shapes.vertices, bones, options.influences)
        report(options.model, mesh, found, {"all": shapes.vertices})
        if bones in PUBLISHED:
            print(f"dem-bones published: E_rms {1000 * PUBLISHED[bones] / 3**0.5:.3g}")


if __name__ == "__main__":
    main()
