"""Read damaged inputs until the time is over; print what is read wrongly, and keep these inputs.

    python tests/fuzz/fuzz.py [--minutes 20] [--seed N] [--kind NAME …] [--number N] [--keep FOLDER]

Without a seed it takes a new one, and prints it. The exit status is 1 if an input was read wrongly:
with another exception than InputError, with a message of several lines or without the file's name,
accepted with numbers that are not finite or do not fit each other, or with much memory or time.
"""

import argparse
import faulthandler
import resource
import secrets
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).parents[1] / "helpers")]

from damage import KINDS, SECONDS, Valid, fault_of  # noqa: E402

ADDRESSES = 8 << 30  # bytes; a reader that asks for more gets a MemoryError


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--minutes", type=float, default=20.0)
    options.add_argument("--seed", type=int, default=None)
    options.add_argument("--kind", nargs="*", choices=[*KINDS], default=[*KINDS])
    options.add_argument("--number", type=int, default=None, help="of inputs of each kind")
    options.add_argument("--keep", type=Path, default=Path("fuzz-failures"))
    chosen = options.parse_args()
    seed = secrets.randbits(32) if chosen.seed is None else chosen.seed
    print(f"seed {seed}", flush=True)
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESSES, ADDRESSES))
    end = time.monotonic() + 60 * chosen.minutes
    faults, done = 0, dict.fromkeys(chosen.kind, 0)
    with tempfile.TemporaryDirectory() as folder:
        valid = {name: Valid(KINDS[name], folder) for name in chosen.kind}
        number = 0
        while time.monotonic() < end and number != chosen.number:
            for name in chosen.kind:
                faulthandler.dump_traceback_later(SECONDS, exit=True)
                fault = one(KINDS[name], valid[name], (seed, [*KINDS].index(name), number))
                faulthandler.cancel_dump_traceback_later()
                done[name] += 1
                if fault is not None:
                    faults += 1
                    kept = keep(valid[name].path, chosen.keep / f"{seed}-{number}")
                    print(f"{name}, input {number}: {fault}; kept as {kept}", flush=True)
            number += 1
    print(", ".join(f"{name} {count}" for name, count in done.items()), f"inputs; {faults} faults")
    sys.exit(int(faults > 0))


def one(kind, valid, seed):
    """Damage an input and read it; the fault, or None."""
    valid.restore()
    kind.damage(valid.path, np.random.default_rng(seed))
    return fault_of(kind, valid.path)


def keep(path, folder):
    folder.mkdir(parents=True, exist_ok=True)
    kept = folder / path.name
    (shutil.copytree if path.is_dir() else shutil.copy)(path, kept)
    return kept


if __name__ == "__main__":
    main()
