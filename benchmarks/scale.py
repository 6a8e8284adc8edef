"""Growth of a training with the number of shapes, and what a limit of memory costs.

    python benchmarks/scale.py [--vertices 10000] [--shapes 250 500 1000] [--memory 2e9]
        [--rounds 50] [--both]

Shapes are drawn from the latent prior of the shipped humanoid, on its surface subdivided (and cut
down to the number of vertices), and written to an NPZ file. A process of its own loads and trains
on each number of them, with the limit, and with --both also with everything in memory. Prints
seconds and peak resident memory of each, their ratios, and the largest difference of the codes.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

import deformer
from deformer.geometry import edges


def config(rounds: int) -> deformer.ModelConfig:
    """Fifty components and a given sparsity, in so many rounds."""
    training = deformer.FactorisationSettings(rounds, sparsity=0.2)
    return deformer.ModelConfig(components=50, training=training, align=False)


def main() -> None:
    """Make shapes, and train in processes of their own."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--vertices", type=int, default=10_000)
    parser.add_argument("--shapes", type=int, nargs="+", default=[250, 500, 1000])
    parser.add_argument("--memory", type=float, default=2e9, help="bytes")
    parser.add_argument("--rounds", type=int, default=50, help="of each training")
    parser.add_argument("--both", action="store_true", help="also with everything in memory")
    parser.add_argument("--folder", type=Path, help="for shapes and temporary files")
    parser.add_argument("--one", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        path, limit = options.one
        train_one(Path(path), float(limit), options.folder, options.rounds)
        return
    console = Console(width=110)
    table = Table("shapes", "memory", "seconds", "load", "peak GB", "time ratio", "codes differ")
    with tempfile.TemporaryDirectory(dir=options.folder) as name:
        folder = Path(name)
        for count in options.shapes:
            path = folder / f"{count}.npz"
            write_shapes(path, count, options.vertices)
            limits = [options.memory, 1e12] if options.both else [options.memory]
            found = [run_one(path, limit, folder, options.rounds) for limit in limits]
            for limit, one in zip(limits, found, strict=True):
                whole, row = found[-1], ["", ""]
                if options.both:
                    codes = [np.load(f"{f['codes']}") for f in (one, whole)]
                    row = [f"{one['seconds'] / whole['seconds']:.2f}"]
                    row.append(f"{np.abs(codes[0] - codes[1]).max():.1e}")
                table.add_row(
                    str(count),
                    f"{limit:g}",
                    f"{one['seconds']:.0f}",
                    f"{one['load']:.0f}",
                    f"{one['peak'] / 1e9:.2f}",
                    *row,
                )
            path.unlink()
    console.print(f"{options.vertices} vertices, 50 components")
    console.print(table)


def write_shapes(path: Path, count: int, vertices: int) -> None:
    """Write shapes of so many vertices to an NPZ file, a few at a time in memory."""
    model = deformer.load_model("humanoid")
    rng = np.random.default_rng(0)
    codes = model.prior.mean + rng.normal(size=(count, model.components)) @ model.prior.factor.T
    codes[0] = 0.0
    lift, faces = subdivided(model.reference, vertices)
    raw = path.with_suffix(".npy")
    out = np.lib.format.open_memmap(raw, "w+", np.float32, (count, lift.shape[0], 3))
    for n, code in enumerate(codes):
        out[n] = lift @ model.decode(code)
    out.flush()
    del out
    import zipfile

    face_file = path.with_name("faces.npy")
    np.save(face_file, faces)
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(raw, "vertices.npy")
        archive.write(face_file, "faces.npy")
    raw.unlink()


def subdivided(mesh: deformer.Mesh, vertices: int):
    """Interpolation (W, V) to a mesh of so many vertices, and its faces."""
    from scipy import sparse

    lift, faces = sparse.eye_array(len(mesh.vertices), format="csr"), mesh.faces
    while lift.shape[0] < vertices:
        pairs = edges(faces)
        # Only as many edges as are needed: those of the first faces.
        rng = np.random.default_rng(1)
        wanted = min(len(pairs), vertices - lift.shape[0])
        chosen = np.zeros(len(pairs), dtype=bool)
        chosen[rng.permutation(len(pairs))[:wanted]] = True
        if wanted < len(pairs):
            # Not all of them are split at once: each face only once.
            lift, faces = split_some(lift, faces, pairs[chosen])
            continue
        V = lift.shape[0]
        number = {tuple(pair): V + n for n, pair in enumerate(pairs.tolist())}
        rows = np.repeat(np.arange(len(pairs)), 2)
        middle = sparse.csr_array(
            (np.full(2 * len(pairs), 0.5), (rows, pairs.ravel())), shape=(len(pairs), V)
        )
        lift = sparse.vstack([lift, middle @ lift]).tocsr()
        new = []
        for a, b, c in faces.tolist():
            ab, bc, ca = (number[tuple(sorted(p))] for p in ((a, b), (b, c), (c, a)))
            new += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = np.array(new)
    return lift, faces


def split_some(lift, faces, pairs):
    """Split single edges of faces, each face at most once."""
    from scipy import sparse

    V, faces = lift.shape[0], faces.tolist()
    at: dict[tuple[int, int], list[int]] = {}
    for f, (a, b, c) in enumerate(faces):
        for pair in ((a, b), (b, c), (c, a)):
            at.setdefault(tuple(sorted(pair)), []).append(f)
    touched, ends = set(), []
    for pair in map(tuple, pairs.tolist()):
        if touched & set(at[pair]):
            continue
        touched |= set(at[pair])
        middle = V + len(ends)
        ends.append(pair)
        for f in at[pair]:
            corners = faces[f]
            turn = next(i for i in range(3) if {corners[i], corners[(i + 1) % 3]} == set(pair))
            a, b, c = corners[turn:] + corners[:turn]
            faces[f] = [a, middle, c]
            faces.append([middle, b, c])
    rows = np.repeat(np.arange(len(ends)), 2)
    half = sparse.csr_array(
        (np.full(2 * len(ends), 0.5), (rows, np.ravel(ends))), shape=(len(ends), V)
    )
    return sparse.vstack([lift, half @ lift]).tocsr(), np.array(faces)


def run_one(path: Path, limit: float, folder: Path, rounds: int) -> dict:
    """Figures of one training in a process of its own."""
    command = [sys.executable, __file__, "--one", str(path), str(limit)]
    command += ["--folder", str(folder), "--rounds", str(rounds)]
    found = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True)
    return json.loads(found.stdout.splitlines()[-1])


def train_one(path: Path, limit: float, folder: Path, rounds: int) -> None:
    """Load, train, and print figures as JSON."""
    stages: dict[str, float] = {}

    def told(progress) -> None:
        seconds = time.perf_counter() - begun
        stages[progress.stage] = seconds
        if progress.done in (1, progress.total) or progress.done % 500 == 0:
            what = f"{progress.stage} {progress.done} of {progress.total}"
            print(f"{seconds:.0f} s: {what}, {peak_memory() / 1e9:.2f} GB", file=sys.stderr)

    begun = time.perf_counter()
    workspace = deformer.Workspace(limit, folder)
    shapes = deformer.load_shapes(path, workspace=workspace)
    load = time.perf_counter() - begun
    model = deformer.train(shapes, config=config(rounds), workspace=workspace, on_progress=told)
    seconds = time.perf_counter() - begun
    codes = folder / f"{path.stem}-{limit:g}.npy"
    np.save(codes, model.codes)
    peak = peak_memory()
    stages = {name: round(value, 1) for name, value in stages.items()}
    print(f"{path.stem} shapes, limit {limit:g}: ends of stages {stages}", file=sys.stderr)
    print(json.dumps({"load": load, "seconds": seconds, "peak": peak, "codes": str(codes)}))


def peak_memory() -> int:
    """Largest resident memory of this process, in bytes."""
    # The peak that getrusage tells begins with that of the process that made the shapes.
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:"))


if __name__ == "__main__":
    main()
