"""Frames a second of `fit_sequence` on markers of a moving mesh, and the effect of smoothness.

    python benchmarks/sequences.py MODEL SHAPES [--markers 40] [--frames 2800] [--device cpu]
        [--backend torch]

SHAPES is a motion. It is repeated forwards and backwards at four times its rate until there are
enough frames. Markers are some of its vertices, without noise and with noise of 0.5 % of the
bounding diagonal. For every smoothness the table has E_rms from clean and from noisy markers,
jitter (rms acceleration of all vertices relative to the true motion's) and lag (the shift in frames
with the least error).
"""

import argparse
import time

import numpy as np
from rich.console import Console
from rich.table import Table

import deformer
from deformer.geometry import align

_RATE = 4
_NOISE = 0.005


def there_and_back(shapes, frames):
    """Motion (frames, V, 3) through the shapes, linearly interpolated, and back again."""
    N = len(shapes)
    time = np.abs((np.arange(frames) / _RATE + N - 1) % (2 * N - 2) - (N - 1))
    before = np.minimum(time.astype(int), N - 2)
    share = (time - before)[:, None, None]
    return (1 - share) * shapes[before] + share * shapes[before + 1]


def acceleration(vertices):
    return float(np.sqrt((np.diff(vertices, 2, axis=0) ** 2).sum(axis=2).mean()))


def lag(truth, found, most=6):
    """Shift of least error, in frames, by which `found` is behind the truth."""
    shifts = np.arange(-most, most + 1)
    inner = found[most:-most]
    errors = [((truth[most - s : len(truth) - most - s] - inner) ** 2).mean() for s in shifts]
    best = int(np.clip(np.argmin(errors), 1, len(shifts) - 2))
    a, b, c = errors[best - 1 : best + 2]
    return float(shifts[best] + 0.5 * (a - c) / (a - 2 * b + c))


def speed(model, markers, motion, where, console):
    table = Table(title=f"{len(motion)} frames, {len(markers)} markers, {where}")
    for name in ("", "frames a second", "set-up and all, s", "E_rms"):
        table.add_column(name, justify="left" if not name else "right")
    for hard in (False, True):
        deformer.fit_sequence(model, markers, motion[:20, markers], hard=hard, **where)
        begun = time.perf_counter()
        fit = deformer.fit_sequence(model, markers, motion[:, markers], hard=hard, **where)
        took = time.perf_counter() - begun
        error = deformer.e_rms(motion, fit.vertices, "none")
        row = f"{len(motion) / took:.0f}", f"{took:.1f}", f"{error:.2f}"
        table.add_row("exact markers" if hard else "soft markers", *row)
    console.print(table)


def smoothness(model, markers, motion, where, console):
    rng = np.random.default_rng(0)
    noisy = motion[:, markers].copy()
    noisy += _NOISE * model.reference.bounding_diagonal * rng.normal(size=noisy.shape) / 3**0.5
    table = Table(title=f"{len(motion)} frames, {len(markers)} soft markers")
    for name in ("smoothness", "E_rms clean", "E_rms noisy", "jitter noisy / true", "lag, frames"):
        table.add_column(name, justify="right")
    for weight in (0.0, 1.0, 10.0, 100.0, 1000.0):
        clean, found = (
            deformer.fit_sequence(model, markers, goals, smoothness=weight, **where).vertices
            for goals in (motion[:, markers], noisy)
        )
        table.add_row(
            f"{weight:g}",
            f"{deformer.e_rms(motion, clean, 'none'):.2f}",
            f"{deformer.e_rms(motion, found, 'none'):.2f}",
            f"{acceleration(found) / acceleration(motion):.2f}",
            f"{lag(motion, found):+.2f}",
        )
    console.print(table)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("shapes")
    parser.add_argument("--markers", type=int, default=40)
    parser.add_argument("--frames", type=int, default=2800)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--backend")
    options = parser.parse_args()
    model = deformer.load_model(options.model)
    shapes = align(deformer.load_shapes(options.shapes).vertices, model.reference.vertices)
    motion = there_and_back(shapes, options.frames)
    markers = deformer.farthest_points(model.geodesics, options.markers, seed=0)
    console = Console(width=100)
    where = {"device": options.device, "backend": options.backend}
    speed(model, markers, motion, where, console)
    smoothness(model, markers, motion[: min(400, len(motion))], where, console)


if __name__ == "__main__":
    main()
