"""Training time of every compared method, one after the other on one machine.

    python benchmarks/training_times.py SHAPES [--components 50] [--methods autoencoder,pca]

Every method learns from the same random half of the shapes, alone and with one thread of PyTorch
and BLAS, as in `deformer evaluate`. Prints seconds and the ratio to the default network's.
"""

import argparse
import tempfile
from pathlib import Path

from rich.console import Console
from rich.progress import track
from rich.table import Table

from deformer.evaluation.journal import FAILURE
from deformer.evaluation.measurements import run_job
from deformer.evaluation.methods import Setting, has_components, known_methods
from deformer.evaluation.plan import Job, Measurement, Training
from deformer.evaluation.sources import Source
from deformer.evaluation.splits import random_split

OURS = "autoencoder"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shapes")
    parser.add_argument("--components", type=int, default=50)
    parser.add_argument("--methods", default=",".join(known_methods()))
    parser.add_argument("--epochs", type=int, help="of the networks; default: their own")
    options = parser.parse_args()
    source = Source.at(Path(options.shapes).stem, options.shapes)
    split = random_split(source.count, 0)
    asked = options.methods.split(",")
    found = {}
    for method in track([OURS, *(name for name in asked if name != OURS)], "training"):
        components = options.components if has_components(method) else 0
        setting = Setting(epochs=options.epochs) if method.startswith(OURS) else Setting()
        training = Training(source, split, 0, method, components, setting=setting)
        job = Job(training, (Measurement("training", (), components, 0),))
        with tempfile.TemporaryDirectory() as folder:
            found[method] = next(run_job(job, Path(folder)))[1][0]
    table = Table("method", "seconds", f"of {OURS}")
    base = found[OURS]["value"]
    for method, row in found.items():
        if row["metric"] == FAILURE:
            table.add_row(method, "failed", row["value"])
        else:
            table.add_row(method, f"{row['value']:.2f}", f"{row['value'] / base:.3f}")
    console = Console(width=100)
    console.print(
        f"{source.name}: {len(split.train)} of {source.count} shapes, K = {options.components}"
    )
    console.print(table)


if __name__ == "__main__":
    main()
