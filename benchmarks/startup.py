"""How long the program takes to start, in units of importing numpy and scipy.sparse.

    python benchmarks/startup.py [--repeats 5] [--before PYTHON]

Every line is a process of its own, from its start to its end, taken in turn with the others. The
median of the repeats is printed in seconds and as a ratio to that of importing numpy and
scipy.sparse in the same run. Caches are warm, but "first solve" compiles into an empty folder.
`--before` measures another installation in the same turns.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

COMMAND = "import sys; sys.argv[1:] = {}; from deformer_app.cli.main import main; main()"
SOLVE = (
    "import deformer; m = deformer.load_model('humanoid'); s = deformer.HandleSolver(m); "
    "s.set_handles([17], m.reference.vertices[[17]] + 0.1); s.solve()"
)
UNIT = "numpy, scipy.sparse"


def seconds(python: str, code: str, **environment: str) -> float:
    """Time a process from its start to its end."""
    begun = time.perf_counter()
    subprocess.run(
        [python, "-c", code], env={**os.environ, **environment}, check=True, capture_output=True
    )
    return time.perf_counter() - begun


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--before", help="Python of another installation to measure beside this.")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        handles = Path(folder) / "handles.json"
        handles.write_text(json.dumps({"handles": [{"vertex": 17, "position": [0.1, 0.5, 0.2]}]}))
        fit = ["fit", "humanoid", str(handles), "-o", str(Path(folder) / "pose.ply")]
        cases = {
            UNIT: "import numpy, scipy.sparse",
            "import deformer": "import deformer",
            "deformer info humanoid": COMMAND.format(["info", "humanoid"]),
            "deformer fit humanoid": COMMAND.format(fit),
            "editor imported": "import deformer_app.viewer.qt.window",
            "first solve": SOLVE,
        }
        pythons = {"now": sys.executable, **({"before": options.before} if options.before else {})}
        taken: dict[tuple[str, str], list[float]] = {}
        for turn in range(options.repeats + 1):
            for case, code in cases.items():
                for name, python in pythons.items():
                    if name == "before" and case == "editor imported":
                        continue
                    environment = {}
                    if case == "first solve":
                        environment["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(dir=folder)
                    elapsed = seconds(python, code, **environment)
                    if turn:  # the first turn fills the caches
                        taken.setdefault((case, name), []).append(elapsed)
        unit = statistics.median(taken[UNIT, "now"])
        for (case, name), times in taken.items():
            median = statistics.median(times)
            print(f"{case:24} {name:7} {median:6.2f} s   ratio {median / unit:5.1f}")


if __name__ == "__main__":
    main()
