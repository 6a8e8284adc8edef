"""Trials of settings as tasks: models of some of the shapes, and how they recover the others."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from deformer.editing import HandleSolver
from deformer.geometry import FloatArray, IntArray
from deformer.model import DeformationModel
from deformer.network import ModelConfig
from deformer.parallel import Executor, ended
from deformer.training.cross_validation import (
    Errors,
    Recovery,
    held_out_turns,
    kept_for_noise,
    misfit_recoveries,
    noise_recoveries,
)
from deformer.training.training_set import TrainingSet

# λ₁ and the shapes that a model is trained on.
Key = tuple[float | None, bytes]


class Trials:
    """Has an executor train models on most of the examples, and recover the others.

    Models are shared: a noise and a misfit that leave out the same shapes are tried with one.

    Args:
        examples: the training set.
        executor: runs the tasks; results do not depend on it.
        report: called with the numbers of rounds and of handle fits that have been done.
    """

    def __init__(
        self, examples: TrainingSet, executor: Executor, report: Callable[[int], None]
    ) -> None:
        """Nothing is trained yet."""
        self._examples, self._executor, self._report = examples, executor, report
        self._shared: Any = None
        # Stand-ins for models, by λ₁ and the shapes to train on.
        self._models: dict[Key, Any] = {}

    def noise_errors(
        self, configs: Sequence[ModelConfig], noises: Sequence[float]
    ) -> Iterator[tuple[int, FloatArray]]:
        """Try noises with models of several configurations, side by side.

        Yields:
            Index of a configuration, as soon as it has been tried, and logarithms (M,) of its
            errors by each of M noises (`held_out_errors`).
        """
        shapes, geodesics = self._examples.shapes, self._examples.geodesics
        kept = kept_for_noise(len(shapes))
        models = self._trained([(config, kept) for config in configs])
        cases = noise_recoveries(shapes, geodesics, 0)
        jobs = [(model, cases) for model in models]
        for n, errors in self._recovered(jobs, "noise", noises, {}):
            yield n, np.mean(errors, axis=0)

    def misfit_errors(
        self, config: ModelConfig, noise: float, misfits: Sequence[float], turns: Sequence[int]
    ) -> Iterator[tuple[int, FloatArray]]:
        """Try misfits with models that leave out the shapes of several turns, side by side.

        Args:
            config: configuration of the models.
            noise: of the handle fits.
            misfits: in bounding diagonals.
            turns: indices into `held_out_turns`.

        Yields:
            Index into `turns`, as soon as that turn is over, and logarithms (2, M) of the errors by
            each of M misfits, from few and from many vertices.
        """
        shapes, geodesics = self._examples.shapes, self._examples.geodesics
        N = len(shapes)
        held_out = held_out_turns(N)
        kept = [np.setdiff1d(np.arange(N), held_out[turn]) for turn in turns]
        asked = [(config, indices) for indices in kept]
        self._keep([_key(*job) for job in asked])
        models = self._trained(asked)
        jobs = [
            (model, misfit_recoveries(shapes, geodesics, turn))
            for model, turn in zip(models, turns, strict=True)
        ]
        for n, errors in self._recovered(jobs, "misfit", misfits, {"noise": noise}):
            yield n, np.array(errors)

    def forget(self, sparsity: float) -> None:
        """Drop the models of other values of λ₁ than this one."""
        self._keep([key for key in self._models if key[0] == sparsity])

    def _keep(self, keys: list[Key]) -> None:
        """Drop all models but these: one of many vertices takes a gigabyte with its solver."""
        self._models = {key: model for key, model in self._models.items() if key in keys}

    def _trained(self, jobs: list[tuple[ModelConfig, IntArray]]) -> list[Any]:
        """Stand-ins for models of configurations, trained on the shapes at indices (n,)."""
        keys = [_key(*job) for job in jobs]
        if self._shared is None:
            self._shared = self._executor.share(self._examples)
        missing = {}
        for key, (config, indices) in zip(keys, jobs, strict=True):
            if key in self._models:
                self._report(config.training.epochs)
            else:
                missing[key] = config, indices
        tasks = [self._executor.keep(train_trial, self._shared, *job) for job in missing.values()]
        work = sum(config.training.epochs for config, _ in missing.values())
        found = dict(self._ended(tasks, work))
        self._models |= {key: found[n] for n, key in enumerate(missing)}
        return [self._models[key] for key in keys]

    def _recovered(
        self,
        jobs: list[tuple[Any, list[Recovery]]],
        varied: str,
        values: Sequence[float],
        options: dict[str, Any],
    ) -> Iterator[tuple[int, list[FloatArray]]]:
        """Index of a job, and errors (M,) of each of its recoveries, as soon as there are all."""
        cases = [(n, case) for n, (_, every) in enumerate(jobs) for case in every]
        tasks = [
            self._executor.submit(recover, jobs[n][0], case, varied, values, options)
            for n, case in cases
        ]
        work = sum(len(case.shapes) * len(values) for _, case in cases)
        found: dict[int, FloatArray] = {}
        for task, errors in self._ended(tasks, work):
            found[task] = errors
            own = [t for t, (n, _) in enumerate(cases) if n == cases[task][0]]
            if all(t in found for t in own):
                yield cases[task][0], [found[t] for t in own]

    def _ended(self, tasks: list[int], work: int) -> Iterator[tuple[int, Any]]:
        """Index of each task as it ends, and its result.

        Args:
            tasks: all tasks of the executor.
            work: number of their parts; those that are lost on their way are reported, too.
        """
        done = 0

        def told(_: None) -> None:
            nonlocal done
            done += 1
            self._report(1)

        for task, result in ended(self._executor, told):
            yield tasks.index(task), result
        if done < work:
            self._report(work - done)


def _key(config: ModelConfig, indices: IntArray) -> Key:
    return config.training.sparsity, indices.tobytes()


def train_trial(
    examples: TrainingSet, config: ModelConfig, indices: IntArray
) -> Generator[None, None, DeformationModel]:
    """A task: a model that is trained on the shapes at indices (n,); yields after each round."""
    return (yield from examples.subset(indices).train_trial(config))


def recover(
    model: DeformationModel,
    case: Recovery,
    varied: str,
    values: Sequence[float],
    options: dict[str, Any],
) -> Errors:
    """A task: logarithms (M,) of errors of handle fits; yields after each fit.

    Args:
        model: the model.
        case: what it is to recover.
        varied: the parameter of `HandleSolver.set_prior` whose values are tried.
        values: M values, in increasing order.
        options: of `HandleSolver`.
    """
    solver = HandleSolver(model, **options)
    fit = partial(exact_fits, solver, varied)
    return (yield from case.errors(fit, values))


def exact_fits(
    solver: HandleSolver,
    varied: str,
    vertices: IntArray,
    targets: FloatArray,
    values: Sequence[float],
) -> Iterator[FloatArray]:
    """Positions (V, 3) fitted to exact handles at vertices (H,), for each value of `varied`."""
    solver.set_handles(vertices, targets, hard=True)
    for number, value in enumerate(values):
        solver.set_prior(**{varied: value})
        # From the pose of the last value it is faster, but sometimes another minimum.
        pose = solver.solve_to_convergence() if number else solver.solve()
        yield pose.vertices
