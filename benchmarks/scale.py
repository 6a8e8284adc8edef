"""Growth of trainings and drags with shapes, vertices, components and handles, and with memory.

    python benchmarks/scale.py [--shapes 200 400 800] [--vertices 5000 10000 20000]
        [--components 50 25 100] [--handles 10 5 20 40] [--memory 2e9] [--rounds 50] [--both]

Each list is varied while the others keep their first value. Shapes are drawn from the latent prior
of the shipped humanoid, on its surface subdivided to the number of vertices, and written to an NPZ
file. A process of its own loads and trains on them, with the limit of memory, and drags the model
from one shape to another; with --both another one trains with everything in memory. Prints seconds,
the processor's time, peak resident memory and frames, the ratios of both trainings, the largest
difference of their codes, and the exponents of growth: slopes of logarithms by least squares.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from drawn_sets import write_shapes
from rich.console import Console
from rich.table import Table

import deformer
from deformer.editing import HandleSolver

FRAMES = 100
OF_TRAINING = {
    "seconds": "training, s",
    "processor": "processor's time, s",
    "peak": "peak GB",
}
OF_DRAG = {
    "frame": "a frame, ms",
    "p95": "p95, ms",
    "rest": "at rest, ms",
    "cold": "cold solve, ms",
    "user": "MB a user",
}


@dataclass(frozen=True)
class Size:
    """Numbers of a case."""

    shapes: int
    vertices: int
    components: int


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shapes", type=int, nargs="+", default=[200, 400, 800])
    parser.add_argument("--vertices", type=int, nargs="+", default=[5000, 10_000, 20_000])
    parser.add_argument("--components", type=int, nargs="+", default=[50, 25, 100])
    parser.add_argument("--handles", type=int, nargs="+", default=[10, 5, 20, 40])
    parser.add_argument("--memory", type=float, default=2e9, help="bytes")
    parser.add_argument("--rounds", type=int, default=50, help="of each training")
    parser.add_argument("--both", action="store_true", help="also with everything in memory")
    parser.add_argument("--folder", type=Path, help="for shapes and temporary files")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        path, limit = options.one
        print(json.dumps(measured(Path(path), float(limit), options)))
        return
    console = Console(width=120)
    found = {}
    for size in sizes(options):
        found[size] = cases(size, options)
        print(size, found[size], file=sys.stderr)
    console.print(trainings(found))
    console.print(drags(found))
    console.print(exponents(found, options))


def sizes(options) -> list[Size]:
    """The first of all lists, then each list's others."""
    lists = {name: getattr(options, name) for name in ("shapes", "vertices", "components")}
    base = {name: values[0] for name, values in lists.items()}
    rest = [base | {name: value} for name, values in lists.items() for value in values[1:]]
    return [Size(**one) for one in (base, *rest)]


def cases(size: Size, options) -> dict:
    """Figures of a size, with ratios to those of everything in memory."""
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        path = Path(folder) / "shapes.npz"
        write_shapes(path, size.shapes, size.vertices)
        one = run(path, options.memory, size, options)
        if options.both:
            codes = np.load(one["codes"])
            whole = run(path, 1e12, size, options)
            for name in ("seconds", "processor"):
                one[f"ratio of {name}"] = one[name] / whole[name]
            one["differ"] = float(np.abs(codes - np.load(whole["codes"])).max())
    return one


def run(path: Path, limit: float, size: Size, options) -> dict:
    """Figures of one training in a process of its own."""
    command = [sys.executable, __file__, "--one", str(path), str(limit)]
    command += ["--rounds", str(options.rounds), "--components", str(size.components)]
    command += ["--handles", *map(str, options.handles)]
    found = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True)
    return json.loads(found.stdout.splitlines()[-1])


def measured(path: Path, limit: float, options) -> dict:
    """Load, train, drag."""
    begun, processor = time.perf_counter(), time.process_time()

    def told(progress) -> None:
        if progress.done in (1, progress.total) or progress.done % 500 == 0:
            what = f"{progress.stage} {progress.done} of {progress.total}"
            seconds = time.perf_counter() - begun
            print(f"{seconds:.0f} s: {what}, {memory('VmHWM') / 1e9:.2f} GB", file=sys.stderr)

    workspace = deformer.Workspace(limit, path.parent)
    shapes = deformer.load_shapes(path, workspace=workspace)
    # A given sparsity: fewer trials, which go through 500 shapes at most.
    training = deformer.FactorisationSettings(options.rounds, sparsity=0.2)
    config = deformer.ModelConfig(components=options.components[0], training=training, align=False)
    model = deformer.train(shapes, config=config, workspace=workspace, on_progress=told)
    codes = path.with_name("codes.npy")
    np.save(codes, model.codes)
    figures = {
        "seconds": time.perf_counter() - begun,
        "processor": time.process_time() - processor,
        "peak": memory("VmHWM") / 1e9,
        "codes": str(codes),
        "shapes": len(shapes),
        "vertices": len(model.reference.vertices),
        "components": model.components,
    }
    ends = np.stack([shapes.mesh(i).vertices for i in (0, len(shapes) // 2)])
    return figures | {"drags": {H: dragged(model, ends, H) for H in options.handles}}


def dragged(model, ends, count: int) -> dict:
    """Milliseconds of frames with so many exact handles that move from one shape to another."""
    handles = deformer.farthest_points(model.geodesics, count, seed=0)
    path = [(1 - s) * ends[0, handles] + s * ends[1, handles] for s in np.linspace(0, 1, FRAMES)]
    solver = HandleSolver(model)
    for _ in range(2):  # the first drag warms up
        solver.set_handles(handles, path[0], hard=True)
        begun = time.perf_counter()
        solver.solve()
        cold = time.perf_counter() - begun
        frames = []
        for targets in path:
            begun = time.perf_counter()
            solver.set_handles(handles, targets, hard=True)
            solver.solve(warm=True)
            frames.append(time.perf_counter() - begun)
        begun = time.perf_counter()
        solver.solve(warm=True)
        rest = time.perf_counter() - begun
    frame, p95 = np.percentile(frames, [50, 95])
    times = {"frame": frame, "p95": p95, "rest": rest, "cold": cold}
    # Solvers of other users of the same model.
    before, others = memory("VmRSS"), [HandleSolver(model) for _ in range(4)]
    for other in others:
        other.set_handles(handles, path[0], hard=True)
        other.solve()
        other.set_handles(handles, path[1], hard=True)
        other.solve(warm=True)
    user = (memory("VmRSS") - before) / len(others)
    return {name: 1e3 * seconds for name, seconds in times.items()} | {"user": user / 1e6}


def memory(name: str) -> int:
    """Resident memory of this process in bytes: now (VmRSS), or at its peak (VmHWM)."""
    # The peak that getrusage tells begins with that of the process that made the shapes.
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(f"{name}:"))


def trainings(found: dict[Size, dict]) -> Table:
    """A row for each training."""
    names = [
        "shapes",
        "vertices",
        "components",
        *OF_TRAINING.values(),
        "time ratio",
        "of processor",
        "codes differ",
    ]
    table = Table(*names, title="trainings")
    for one in found.values():
        sizes = [str(one[name]) for name in ("shapes", "vertices", "components")]
        figures = [f"{one[name]:.4g}" for name in OF_TRAINING]
        if "differ" in one:
            ratios = [f"{one[f'ratio of {name}']:.2f}" for name in ("seconds", "processor")]
            figures += [*ratios, f"{one['differ']:.1e}"]
        figures += [""] * (len(names) - 3 - len(figures))
        table.add_row(*sizes, *figures)
    return table


def drags(found: dict[Size, dict]) -> Table:
    """A row for each number of handles, and for each model."""
    table = Table("vertices", "components", "handles", *OF_DRAG.values(), title="drags")
    first = next(iter(found))
    for size, one in found.items():
        if size.shapes != first.shapes:
            continue
        drags = list(one["drags"].items())
        for H, drag in drags if size == first else drags[:1]:
            figures = [f"{drag[name]:.1f}" for name in OF_DRAG]
            table.add_row(str(one["vertices"]), str(size.components), H, *figures)
    return table


def exponents(found: dict[Size, dict], options) -> Table:
    """Slopes of the logarithms over each list."""
    table = Table("grows with", *OF_TRAINING.values(), *OF_DRAG.values(), title="exponents")
    first, H = next(iter(found)), str(options.handles[0])
    for name in ("shapes", "vertices", "components"):
        line = [one for size, one in found.items() if varies_alone(size, first, name)]
        if len(line) > 1:
            x = [one[name] for one in line]
            values = [[one[of] for one in line] for of in OF_TRAINING]
            values += [[one["drags"][H][of] for one in line] for of in OF_DRAG]
            table.add_row(name, *(slope(x, y) for y in values))
    drags = found[first]["drags"]
    if len(drags) > 1:
        values = [[drag[of] for drag in drags.values()] for of in OF_DRAG]
        x = [int(H) for H in drags]
        table.add_row("handles", *("" for _ in OF_TRAINING), *(slope(x, y) for y in values))
    return table


def varies_alone(size: Size, first: Size, name: str) -> bool:
    """Whether the size is that of the first, apart from the named number."""
    return replace(size, **{name: getattr(first, name)}) == first


def slope(x: list[int], y: list[float]) -> str:
    # The memory of small solvers is lost in what the process holds free.
    return f"{np.polyfit(np.log(x), np.log(y), 1)[0]:.2f}" if min(y) > 0 else ""


if __name__ == "__main__":
    main()
