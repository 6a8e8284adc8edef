"""Time from a mouse move to new vertices, compared with libigl's ARAP on the same handles.

    python benchmarks/drag_latency.py MODEL SHAPES [--subdivide 0 1 2] [--handles 10]

For the model, and for the same model on a subdivided mesh, it prints median and p95 over the frames
of a drag from one shape to another, by stage. One run also gives the ratios to libigl's
as-rigid-as-possible deformation (10 iterations), to the plain reference implementation, and to the
floor: the time in which the cores read the bytes that a frame needs once.
"""

import argparse
import time
from collections import defaultdict
from dataclasses import replace
from itertools import pairwise

import igl
import numpy as np
import trimesh
from numba import njit
from reference_solver import ReferenceSolver
from rich.console import Console
from rich.table import Table
from scipy.spatial import KDTree

import deformer
from deformer.editing import DecodedSurface, HandleEnergy, HandleSolver, LiftedSurface
from deformer.geometry import align
from deformer.linalg import SparseCholesky, over_ranges
from deformer.model.latent_prior import fit_prior

STAGES = {
    "search by landmarks": [(HandleEnergy, "descend")],
    "decode": [(DecodedSurface, "decode")],
    "right-hand side": [(DecodedSurface, "write_rhs")],
    "back-substitution": [(SparseCholesky, "solve_in_order")],
    "exact handles": [(DecodedSurface, "move_to_targets"), (LiftedSurface, "move_to_targets")],
    "positions out": [(DecodedSurface, "positions"), (LiftedSurface, "positions")],
}


class Stopwatch:
    """Context in which the time spent in the methods of STAGES is recorded."""

    def __init__(self) -> None:
        self.seconds: dict[str, list[float]] = defaultdict(list)
        self._originals = [
            (name, owner, method, getattr(owner, method))
            for name, places in STAGES.items()
            for owner, method in places
        ]

    def __enter__(self):
        for name, owner, method, original in self._originals:
            setattr(owner, method, self._timed(name, original))
        return self

    def __exit__(self, *_):
        for _, owner, method, original in self._originals:
            setattr(owner, method, original)

    def _timed(self, name, function):
        def timed(*arguments, **options):
            begun = time.perf_counter()
            try:
                return function(*arguments, **options)
            finally:
                self.seconds[name].append(time.perf_counter() - begun)

        return timed


@njit(nogil=True, fastmath=True)
def _read(start, stop, array):
    part, total = array[start:stop], np.float32(0)
    for i in range(len(part)):
        total += part[i]
    part[0] = total


def bandwidth() -> float:
    """Bytes a second that all cores together read from memory; median of several passes."""
    array = np.ones(1 << 26, dtype=np.float32)
    times = []
    for _ in range(9):
        begun = time.perf_counter()
        over_ranges(_read, len(array), array)
        times.append(time.perf_counter() - begun)
    return array.nbytes / float(np.median(times))


def subdivided(model: deformer.DeformationModel) -> deformer.DeformationModel:
    """The model on its mesh with each face split into four.

    The weights C of a new vertex are the mean of those at its edge's ends. C is halved and codes
    are doubled, because the sums over vertices grow fourfold.
    """
    model = model.closed
    ref, C = model.reference, model.weights.C
    V = len(ref.vertices)
    v, faces = trimesh.remesh.subdivide(ref.vertices, ref.faces)
    edges = np.unique(np.sort(ref.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    _, of = KDTree(ref.vertices[edges].mean(axis=1)).query(v[V:])
    finer = np.concatenate([C, C[edges[of]].mean(axis=1)]) / 2
    mesh = deformer.Mesh(v, np.asarray(faces))
    return replace(
        model, reference=mesh, weights=replace(model.weights, C=finer), codes=2 * model.codes,
        prior=fit_prior(2 * model.codes), seams=None, document=None,
    )  # fmt: skip


def arap(reference: deformer.Mesh, handles: np.ndarray, path: np.ndarray) -> list[float]:
    data = igl.ARAPData()
    data.max_iter = 10
    faces = reference.faces.astype(np.int64)
    igl.arap_precomputation(reference.vertices, faces, 3, handles.astype(np.int64), data)
    guess, times = reference.vertices.copy(), []
    for targets in path:
        begun = time.perf_counter()
        guess = igl.arap_solve(np.ascontiguousarray(targets), data, guess)
        times.append(time.perf_counter() - begun)
    return times


def drag(solver, handles, path, hard, watch=None):
    """Seconds of each frame, and the largest step of a vertex relative to the mouse's."""
    solver.set_handles(handles, path[0], hard=hard)
    last = solver.solve().vertices
    frames, steps = [], []
    for targets in path:
        begun = time.perf_counter()
        solver.set_handles(handles, targets, hard=hard)
        pose = solver.solve(warm=True)
        frames.append(time.perf_counter() - begun)
        steps.append(np.linalg.norm(pose.vertices - last, axis=1).max())
        last = pose.vertices
    mouse = max(np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(path))
    return np.array(frames), max(steps[1:]) / mouse


def measure(model, a, b, options, bytes_a_second) -> None:
    console = Console(width=100)
    V = len(model.reference.vertices)
    begun = time.perf_counter()
    solver = HandleSolver(replace(model))
    setup = time.perf_counter() - begun
    handles = deformer.farthest_points(model.geodesics, options.handles, seed=0)
    hard = not options.soft
    solver.set_handles(handles[:-1], a[handles[:-1]], hard=hard)
    solver.solve()
    begun = time.perf_counter()
    solver.set_handles(handles, a[handles], hard=hard)
    adding = time.perf_counter() - begun
    path = [(1 - s) * a[handles] + s * b[handles] for s in np.linspace(0, 1, options.frames)]
    drag(solver, handles, path[:30], hard)
    frames, stretch = drag(solver, handles, path, hard)
    with Stopwatch() as watch:
        drag(solver, handles, path, hard)
    for _ in range(3):
        converged = solver.solve(warm=True)
    begun = time.perf_counter()
    cold = solver.solve()
    cold_time = time.perf_counter() - begun
    arap_times = arap(model.reference, handles, np.array(path[:: max(1, len(path) // 20)]))
    frame, p95 = np.percentile(frames * 1e3, [50, 95])
    floor = solver.basis.moving.bytes_of_a_frame / bytes_a_second
    table = Table(title=f"{V} vertices, K = {model.components}, {options.handles} handles, ms")
    for name in ("", "p50", "p95", "ratio to a frame's p50"):
        table.add_column(name, justify="left" if name == "" else "right")
    table.add_row("a frame", f"{frame:.2f}", f"{p95:.2f}", "1")
    for name, times in watch.seconds.items():
        x, y = np.percentile(np.array(times[-len(path) :]) * 1e3, [50, 95])
        table.add_row(f"  {name}", f"{x:.2f}", f"{y:.2f}", f"{x / frame:.2f}")
    x, y = np.percentile(np.array(arap_times) * 1e3, [50, 95])
    table.add_row("libigl ARAP, 10 iterations", f"{x:.1f}", f"{y:.1f}", f"{x / frame:.1f}")
    if options.reference:
        plain = ReferenceSolver(model)
        plain.set_handles(handles, path[0], hard=hard)
        plain.solve(warm=False)
        slow = []
        for targets in path[1 : options.reference + 1]:
            begun = time.perf_counter()
            plain.set_handles(handles, targets, hard=hard)
            plain.solve(warm=True)
            slow.append(time.perf_counter() - begun)
        x, y = np.percentile(np.array(slow) * 1e3, [50, 95])
        table.add_row("reference implementation", f"{x:.0f}", f"{y:.0f}", f"{x / frame:.0f}")
    table.add_row("floor: bytes read once", f"{floor * 1e3:.2f}", "", f"{floor * 1e3 / frame:.2f}")
    console.print(table)
    console.print(
        f"set-up {setup:.2f} s, adding a handle {adding * 1e3:.1f} ms, cold solve "
        f"{cold_time * 1e3:.0f} ms; largest vertex step / largest mouse step {stretch:.2f}; energy "
        f"3 frames after the stop / cold solve {converged.energy / cold.energy:.6f}\n"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("shapes")
    parser.add_argument(
        "--subdivide", type=int, nargs="*", default=[0], help="numbers of subdivisions"
    )
    parser.add_argument("--handles", type=int, default=10)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--soft", action="store_true", help="leave out exact handles")
    parser.add_argument("--reference", type=int, default=0, help="frames of the reference path")
    options = parser.parse_args()
    model = deformer.load_model(options.model)
    shapes = deformer.load_shapes(options.shapes).vertices
    a, b = align(shapes[[0, len(shapes) // 2]], model.reference.vertices)
    speed = bandwidth()
    print(f"memory: {speed / 1e9:.1f} GB/s read by all cores\n")
    for level in range(max(options.subdivide, default=0) + 1):
        if level:
            faces = model.reference.faces
            a, b = (trimesh.remesh.subdivide(shape, faces)[0] for shape in (a, b))
            model = subdivided(model)
        if level in options.subdivide:
            measure(model, a, b, options, speed)


if __name__ == "__main__":
    main()
