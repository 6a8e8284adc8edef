"""How long the program takes to start, in units of importing numpy and scipy.sparse.

    python benchmarks/startup.py [--repeats 5] [--before PYTHON]

Every line is a process of its own, from its start to its end, taken in turn with the others. The
median of the repeats is printed in seconds and as a ratio to that of importing numpy and
scipy.sparse in the same run. Caches are warm, but "first solve" compiles into an empty folder.
`deformer edit humanoid` is timed from its start until its window is on the screen, until the window
has a model, and until a handle can be dragged; it needs Xvfb and xdotool, and is left out without
them. `--before` measures another installation in the same turns.
"""

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

SOLVE = (
    "import deformer; m = deformer.load_model('humanoid'); s = deformer.HandleSolver(m); "
    "s.set_handles([17], m.reference.vertices[[17]] + 0.1); s.solve()"
)
UNIT = "numpy, scipy.sparse"
# Stages of `deformer edit`, and the titles of windows that show them.
STAGES = {"edit: window": "Deformer", "edit: model": " – Deformer", "edit: ready": " – Deformer$"}
PATIENCE = 120.0  # seconds


def seconds(command: list[str], environment: dict[str, str]) -> float:
    """Time a process from its start to its end; its folder holds nothing to import."""
    begun = time.perf_counter()
    folder = environment["DEFORMER_SETTINGS"]
    subprocess.run(command, env=environment, check=True, capture_output=True, cwd=folder)
    return time.perf_counter() - begun


def stages(command: list[str], environment: dict[str, str]) -> dict[str, float]:
    """Time an editor from its start to each of the `STAGES`, and close it."""
    begun = time.perf_counter()
    editor = subprocess.Popen(
        command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    taken: dict[str, float] = {}
    try:
        for stage, title in STAGES.items():
            search = ["xdotool", "search", "--onlyvisible", "--name", title]
            while subprocess.run(search, env=environment, capture_output=True).returncode != 0:
                if editor.poll() is not None or time.perf_counter() - begun > PATIENCE:
                    raise RuntimeError(f"{stage}: no window whose title matches {title!r}")
                time.sleep(0.02)
            taken[stage] = time.perf_counter() - begun
    finally:
        editor.kill()
        editor.wait()
    return taken


@contextmanager
def display() -> Iterator[str | None]:
    """The name of an X display of its own; None where Xvfb or xdotool is missing."""
    if shutil.which("Xvfb") is None or shutil.which("xdotool") is None:
        yield None
        return
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "1400x950x24", "-noreset"],
        pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    try:
        yield f":{os.read(read, 20).decode().strip()}"
    finally:
        os.close(read)
        server.terminate()
        server.wait()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--before", help="Python of another installation to measure beside this.")
    options = parser.parse_args()
    pythons = {"now": sys.executable, **({"before": options.before} if options.before else {})}
    with tempfile.TemporaryDirectory() as folder, display() as screen:
        handles = Path(folder) / "handles.json"
        handles.write_text(json.dumps({"handles": [{"vertex": 17, "position": [0.1, 0.5, 0.2]}]}))
        output = str(Path(folder) / "pose.ply")
        # Byte code is cached, as that of an installed program; settings are not the user's own.
        environment = {**os.environ, "PYTHONPYCACHEPREFIX": str(Path(folder) / "bytecode")}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        environment["DEFORMER_SETTINGS"] = tempfile.mkdtemp(dir=folder)
        taken: dict[tuple[str, str], list[float]] = {}
        for turn in range(options.repeats + 1):
            for name, python in pythons.items():
                program = str(Path(python).with_name("deformer"))
                # In a new folder: the first solve compiles.
                fresh = {**environment, "NUMBA_CACHE_DIR": tempfile.mkdtemp(dir=folder)}
                times = {
                    UNIT: seconds([python, "-c", "import numpy, scipy.sparse"], environment),
                    "import deformer": seconds([python, "-c", "import deformer"], environment),
                    "deformer info": seconds([program, "info", "humanoid"], environment),
                    "deformer fit": seconds(
                        [program, "fit", "humanoid", str(handles), "-o", output], environment
                    ),
                    "first solve": seconds([python, "-c", SOLVE], fresh),
                }
                if screen is not None:
                    times |= stages(
                        [program, "edit", "humanoid"], {**environment, "DISPLAY": screen}
                    )
                for case, elapsed in times.items():
                    if turn:  # the first turn fills the caches
                        taken.setdefault((case, name), []).append(elapsed)
        unit = statistics.median(taken[UNIT, "now"])
        for (case, name), elapsed in taken.items():
            median = statistics.median(elapsed)
            print(f"{case:24} {name:7} {median:6.2f} s   ratio {median / unit:5.1f}")


if __name__ == "__main__":
    main()
