"""Time from a mouse move to new vertices, beside libigl's ARAP with the same handles.

    python benchmarks/drag_latency.py SHAPES [--model MODEL] [--subdivide 1] [--handles 10]

Prints median and p95 over the frames of a drag from one shape to another, stage by stage, and the
ratio to libigl's as-rigid-as-possible deformation (10 iterations) in the same run. Without a model
one is trained for a few steps: its poses mean little then, its times are those of any model.
"""

import argparse
import time
from itertools import pairwise

import igl
import numpy as np
import trimesh

import deformer
from deformer.handles import HandleSolver


def quantiles(seconds: list[float]) -> str:
    p50, p95 = np.percentile(np.array(seconds) * 1e3, [50, 95])
    return f"{p50:8.2f} {p95:8.2f}"


def subdivided(shapes: deformer.MeshSequence, times: int) -> deformer.MeshSequence:
    """Midpoint subdivision of every shape, four faces for one, `times` over."""
    vertices, faces = shapes.vertices, shapes.faces
    for _ in range(times):
        pairs = [trimesh.remesh.subdivide(v, faces) for v in vertices]
        vertices, faces = np.stack([v for v, _ in pairs]), np.asarray(pairs[0][1])
    return deformer.MeshSequence(vertices, faces)


def arap(reference: deformer.Mesh, handles: np.ndarray, path: np.ndarray) -> list[float]:
    data = igl.ARAPData()
    data.max_iter = 10
    igl.arap_precomputation(
        reference.vertices, reference.faces.astype(np.int64), 3, handles.astype(np.int64), data
    )
    guess, times = reference.vertices.copy(), []
    for targets in path:
        begun = time.perf_counter()
        guess = igl.arap_solve(np.ascontiguousarray(targets), data, guess)
        times.append(time.perf_counter() - begun)
    return times


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shapes")
    parser.add_argument("--model")
    parser.add_argument("--subdivide", type=int, default=0)
    parser.add_argument("--handles", type=int, default=10)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--soft", action="store_true", help="leave out exact handles")
    options = parser.parse_args()
    shapes = deformer.load_shapes(options.shapes)
    shapes = shapes.subset(np.arange(0, len(shapes), max(1, len(shapes) // 24)))
    shapes = subdivided(shapes, options.subdivide)
    if options.model:
        model = deformer.load_model(options.model)
    else:
        model = deformer.train(shapes, 50, epochs=5, align_shapes=True)
    a, b = shapes.vertices[0], shapes.vertices[len(shapes) // 2]
    begun = time.perf_counter()
    fresh = deformer.DeformationModel(
        model.reference, model.config, model.scaler, model.network, model.codes, model.prior, {}
    )
    solver = HandleSolver(fresh)
    setup = time.perf_counter() - begun
    handles = deformer.farthest_points(fresh.geodesics, options.handles, seed=0)
    solver.set_handles(handles[:1] - 1 if handles[0] else handles[:1] + 1, a[:1])
    begun = time.perf_counter()
    solver.set_handles(handles, a[handles], hard=not options.soft)
    adding = (time.perf_counter() - begun) / options.handles
    first = solver.solve()
    path = [(1 - s) * a[handles] + s * b[handles] for s in np.linspace(0, 1, options.frames)]
    for targets in path[:20]:
        solver.set_handles(handles, targets, hard=not options.soft)
        solver.solve(warm=True)
    solver.set_handles(handles, path[0], hard=not options.soft)
    solver.solve()
    frames, steps, last = [], [], first.vertices
    for targets in path:
        begun = time.perf_counter()
        solver.set_handles(handles, targets, hard=not options.soft)
        pose = solver.solve(warm=True)
        frames.append(time.perf_counter() - begun)
        steps.append(np.abs(pose.vertices - last).max())
        last = pose.vertices
    mouse = max(np.linalg.norm(q - p, axis=1).max() for p, q in pairwise(path))
    for _ in range(3):
        settled = solver.solve(warm=True)
    cold = solver.solve()
    rival = arap(model.reference, handles, np.array(path[:: max(1, options.frames // 20)]))
    V = len(model.reference.vertices)
    print(f"{V} vertices, K = {model.components}, {options.handles} handles, ms: median, p95")
    print(f"  a frame          {quantiles(frames)}")
    print(f"  libigl ARAP x10  {quantiles(rival)}")
    print(f"  ratio of medians {np.median(rival) / np.median(frames):8.1f}")
    print(
        f"  set-up {setup:.2f} s, adding a handle {adding * 1e3:.1f} ms, cold solve "
        f"{cold.milliseconds:.0f} ms"
    )
    print(
        f"  largest vertex step / largest mouse step {max(steps[1:]) / mouse:.1f}; energy 3 "
        f"frames after the stop / cold solve {settled.energy / cold.energy:.4f}"
    )


if __name__ == "__main__":
    main()
