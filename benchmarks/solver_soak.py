"""Stress test of HandleSolver: random edits and drags, and comparisons with cold solves.

    python benchmarks/solver_soak.py [MODEL …] [--edits 10000] [--paths 1000] [--seed 0]

Edits: one solver for each model goes through handles set, dragged (near and absurdly far), added,
removed, made soft or exact, another prior, restored solutions and rests, in an order that the seed
determines. Every pose must be finite. At every hundredth edit, drags bring the handles back within
reach, warm solves follow until `at_rest`, and the energy is compared with that of a cold solve by
a new solver.

Paths: each sets up to six handles on a solver of its own, drags one of them over random legs to a
goal, rests, and compares in the same way.

The test fails if a pose is not finite, if a solver does not come to rest, or if more than 1 % of
the comparisons of a kind are more than 1 % above the cold solve.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import deformer

CHECK = 100  # edits between two comparisons
NEAR = 0.01  # of energies: more above the cold solve's counts as another minimum
SHARE = 0.99  # of comparisons that must be near
REST = 400  # warm solves in which a solver must come to rest
COLUMNS = (
    "model", "test", "number", "poses not finite", "never at rest", "compared", "within 1 %",
    "better by 1 %", "worst ratio", "frames of a rest", "slowest frame, ms", "minutes",
)  # fmt: skip
STEPS = 8  # frames of one leg of a drag


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("models", nargs="*", metavar="MODEL", default=deformer.shipped_models())
    options.add_argument("--edits", type=int, default=10_000)
    options.add_argument("--paths", type=int, default=1000)
    options.add_argument("--seed", type=int, default=0)
    chosen = options.parse_args()
    print("| " + " | ".join(COLUMNS) + " |")
    print("| --- " * len(COLUMNS) + "|", flush=True)
    failed = False
    for name in chosen.models:
        model = deformer.load_model(name)
        for test, run, number in (("edits", walk, chosen.edits), ("paths", drags, chosen.paths)):
            if number:
                begun = time.monotonic()
                found = run(model, number, np.random.default_rng(chosen.seed))
                minutes = (time.monotonic() - begun) / 60
                print(f"| {name} | {test} | {number} | {found.row()} | {minutes:.1f} |", flush=True)
                failed |= found.failed
    sys.exit(int(failed))


@dataclass
class Findings:
    """What a test has seen.

    Args:
        broken: poses that were not finite.
        restless: rests that did not end.
        ratios: energy at rest over that of a cold solve, of every comparison.
        frames: warm solves of every rest.
        slowest: milliseconds of the slowest warm solve.
    """

    broken: int = 0
    restless: int = 0
    ratios: list[float] = field(default_factory=list)
    frames: list[int] = field(default_factory=list)
    slowest: float = 0.0

    @property
    def failed(self) -> bool:
        return bool(self.broken or self.restless or self._near < SHARE * len(self.ratios))

    @property
    def _near(self) -> int:
        return sum(ratio <= 1 + NEAR for ratio in self.ratios)

    def row(self) -> str:
        better = sum(ratio < 1 - NEAR for ratio in self.ratios)
        worst = max(self.ratios, default=1.0)
        frames = f"{np.median(self.frames or [0]):.0f}, at most {max(self.frames, default=0)}"
        cells = (self.broken, self.restless, len(self.ratios), self._near, better)
        return f"{' | '.join(map(str, cells))} | {worst:.3f} | {frames} | {self.slowest:.0f}"

    def see(self, pose: deformer.Pose) -> deformer.Pose:
        """Count a pose that is not finite."""
        numbers = (pose.vertices, pose.z, pose.residual, pose.rotation, pose.translation)
        finite = all(np.isfinite(array).all() for array in numbers)
        self.broken += not (finite and np.isfinite(pose.energy))
        return pose

    def rest(self, solver: deformer.HandleSolver) -> deformer.Pose:
        """Solve warm until the solver is at rest."""
        for frame in range(1, REST + 1):
            pose = self.see(solver.solve(warm=True))
            self.slowest = max(self.slowest, pose.milliseconds)
            if solver.at_rest:
                self.frames.append(frame)
                return pose
        self.restless += 1
        return pose

    def compare(self, solver: deformer.HandleSolver, prior: dict[str, object]) -> None:
        """Compare the energy at rest with that of a cold solve by a new solver."""
        found = self.rest(solver).energy
        cold = deformer.HandleSolver(solver.model)
        cold.set_prior(**prior)  # pyright: ignore[reportArgumentType]
        handles = solver.handles
        cold.set_handles(
            [handle.vertex for handle in handles],
            [handle.target for handle in handles],
            [handle.weight for handle in handles],
            [handle.hard for handle in handles],
        )
        other = self.see(cold.solve()).energy
        # Without handles both are 0, up to rounding.
        self.ratios.append(found / other if max(found, other) > 1e-9 else 1.0)


def walk(model: deformer.DeformationModel, edits: int, rng: np.random.Generator) -> Findings:
    """Take random edits with one solver."""
    walker = _Walker(model, rng)
    for n in range(1, edits + 1):
        walker.edit()
        if n % CHECK == 0:
            walker.come_back()
            walker.found.compare(walker.solver, walker.prior)
    return walker.found


class _Walker:
    """A solver, what has been set of its prior, and solutions to go back to."""

    def __init__(self, model: deformer.DeformationModel, rng: np.random.Generator) -> None:
        self.model, self.rng, self.found = model, rng, Findings()
        self.solver = deformer.HandleSolver(model)
        self.prior: dict[str, object] = {}
        self.diagonal = model.reference.bounding_diagonal
        self.kept = [self.found.see(self.solver.solve())]

    def edit(self) -> None:
        """Take one edit and see its pose."""
        edits: list[Callable[[], deformer.Pose]] = [self.place, self.solve]
        weights = [2.0, 1.0]
        if self.solver.handles:
            edits += [self.drag, self.drag_far, self.toggle, self.remove, self.weigh]
            weights += [8.0, 2.0, 2.0, 1.0, 1.0]
        edits += [self.change_prior, self.restore, self.some_rest, self.clear]
        weights += [1.0, 1.0, 1.0, 0.2]
        chosen = edits[self.rng.choice(len(edits), p=np.array(weights) / sum(weights))]
        pose = self.found.see(chosen())
        if self.rng.random() < 0.05:
            self.kept = [*self.kept[-9:], pose]

    def _set(self, handles: list[tuple[int, np.ndarray, float, bool]]) -> deformer.Pose:
        vertices, targets, weights, hard = zip(*handles, strict=True) if handles else ((),) * 4
        self.solver.set_handles(list(vertices), list(targets), list(weights), list(hard))
        return self.solver.solve(warm=True)

    def _handles(self) -> list[tuple[int, np.ndarray, float, bool]]:
        return [(h.vertex, np.array(h.target), h.weight, h.hard) for h in self.solver.handles]

    def _example(self) -> np.ndarray:
        return self.model.decode(self.rng.choice(self.model.codes))

    def place(self) -> deformer.Pose:
        """Add up to three handles, where they are or where an example has them; 12 at most."""
        handles, shape = self._handles(), self._example()
        for vertex in self.rng.choice(len(shape), self.rng.integers(1, 4), replace=False):
            kind = (float(10 ** self.rng.uniform(-1, 1)), bool(self.rng.random() < 0.4))
            handles.append((int(vertex), shape[vertex], *kind))
        return self._set(handles[-12:])

    def drag(self) -> deformer.Pose:
        """Drag a handle to another place within reach."""
        handle = self.solver.handles[self.rng.integers(len(self.solver.handles))]
        if self.rng.random() < 0.5:
            goal = self._example()[handle.vertex]
        else:
            step = self.diagonal * 10 ** self.rng.uniform(-3, -0.5)
            goal = np.array(handle.target) + step * self.rng.standard_normal(3)
        return self._drag(handle, goal)

    def drag_far(self) -> deformer.Pose:
        """Drag a handle by one to a thousand million bounding diagonals."""
        handle = self.solver.handles[self.rng.integers(len(self.solver.handles))]
        direction = self.rng.standard_normal(3)
        direction /= np.linalg.norm(direction)
        return self._drag(handle, direction * self.diagonal * 10 ** self.rng.uniform(0, 9))

    def _drag(self, handle: deformer.Handle, goal: np.ndarray) -> deformer.Pose:
        begin = np.array(handle.target)
        for t in np.linspace(0, 1, self.rng.integers(2, STEPS))[1:]:
            pose = self.found.see(self.solver.drag(handle.vertex, begin + (goal - begin) * t))
        return pose

    def toggle(self) -> deformer.Pose:
        """Make a soft handle exact, or the reverse."""
        handles = self._handles()
        n = self.rng.integers(len(handles))
        handles[n] = (*handles[n][:3], not handles[n][3])
        return self._set(handles)

    def weigh(self) -> deformer.Pose:
        """Change the weight of a handle."""
        handles = self._handles()
        n = self.rng.integers(len(handles))
        handles[n] = (*handles[n][:2], float(10 ** self.rng.uniform(-3, 3)), handles[n][3])
        return self._set(handles)

    def remove(self) -> deformer.Pose:
        """Remove a handle."""
        handles = self._handles()
        del handles[self.rng.integers(len(handles))]
        return self._set(handles)

    def clear(self) -> deformer.Pose:
        """Remove all handles."""
        return self._set([])

    def change_prior(self) -> deformer.Pose:
        """Move the prior's mean to an example or back, change noise and freedom."""
        choices: dict[str, object] = {
            "mean": self.rng.choice([self.model.prior.mean, *self.model.codes]),
            "noise": float(self.model.handle_noise * 10 ** self.rng.uniform(-0.5, 0.5)),
            "freedom": float(10 ** self.rng.uniform(-2, 0)),
        }
        name = self.rng.choice(list(choices))
        self.prior[name] = choices[name]
        self.solver.set_prior(**{name: choices[name]})  # pyright: ignore[reportArgumentType]
        return self.solver.solve(warm=True)

    def restore(self) -> deformer.Pose:
        """Go back to an earlier solution, as undo does."""
        kept = self.kept[self.rng.integers(len(self.kept))]
        return self.solver.restore(kept.z, kept.rotation, kept.translation)

    def some_rest(self) -> deformer.Pose:
        """Solve warm a few times."""
        for _ in range(self.rng.integers(1, 30)):
            pose = self.found.see(self.solver.solve(warm=True))
        return pose

    def solve(self) -> deformer.Pose:
        """Solve cold."""
        return self.solver.solve()

    def come_back(self) -> None:
        """Drag the handles that are out of reach to where one example has them."""
        shape = self._example()
        for handle in self.solver.handles:
            if np.abs(np.array(handle.target) - shape[handle.vertex]).max() > self.diagonal:
                self._drag(handle, shape[handle.vertex])


def drags(model: deformer.DeformationModel, paths: int, rng: np.random.Generator) -> Findings:
    """Drag one of a few handles over random legs, each path with a solver of its own."""
    found, diagonal = Findings(), model.reference.bounding_diagonal
    for _ in range(paths):
        count = int(rng.integers(1, 7))
        vertices = rng.choice(len(model.reference.vertices), count, replace=False).tolist()
        first, last = (model.decode(z)[vertices] for z in rng.choice(model.codes, 2))
        solver = deformer.HandleSolver(model)
        solver.set_handles(vertices, first, hard=bool(rng.random() < 0.5))
        found.see(solver.solve())
        moved = int(rng.integers(count))
        legs = [
            first[moved] + diagonal * rng.standard_normal(3) * 10 ** rng.uniform(-2, 0.3)
            for _ in range(rng.integers(2, 6))
        ]
        wild = first[moved] + diagonal * rng.standard_normal(3) * 0.3
        at = first[moved]
        for goal in (*legs, last[moved] if rng.random() < 0.7 else wild):
            for t in np.linspace(0, 1, STEPS)[1:]:
                found.see(solver.drag(vertices[moved], at + (goal - at) * t))
            at = goal
        found.compare(solver, {})
    return found


if __name__ == "__main__":
    main()
