"""Choice of λ₁, the handle noise and the model's own misfit by cross-validation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np

from deformer.checks import checked_array
from deformer.editing import HandleSolver
from deformer.geometry import FloatArray, IntArray
from deformer.model import HANDLE_COUNTS
from deformer.network import ModelConfig
from deformer.training.checkpoints import Stages
from deformer.training.cross_validation import (
    MANY,
    HandleFit,
    held_out_errors,
    held_out_fits,
    held_out_turns,
    misfit_errors,
)
from deformer.training.loop import ProgressCallback, TrainingProgress
from deformer.training.training_set import TrainingSet

# Candidate noises of handle fits, in bounding diagonals. Smaller ones recover more from many
# handles, but sometimes lead to a wrong pose with fewer handles than cross-validation tries.
HANDLE_NOISES = (0.0005, 0.001, 0.002, 0.004, 0.008)
# Candidate misfits of the model itself, in bounding diagonals; the one of two shapes, of which none
# can be held out; the share by which errors must fall for another misfit than 0; the share by which
# they may differ by chance; and the rounds of rigid relaxation of its fits.
HANDLE_MISFITS = (0.0, 0.0125, 0.025, 0.05, 0.1, 0.2, 0.4)
_UNKNOWN_MISFIT, _MISFIT_GAIN, _MISFIT_TIE, _MISFIT_RELAXATION = 0.05, 0.05, 0.02, 10
# Candidate values of λ₁, the sparsest components first.
SPARSITIES = (2.0, 0.2, 0.02)
# Greatest number of rounds of a trial's factorisation.
_TRIAL_EPOCHS = 15
# The logarithm of the error must fall by this much for less sparse components: with three held-out
# shapes smaller gains are not significant.
_LEAST_GAIN = 0.15


class SettingsSearch:
    """Chooses λ₁, if the configuration leaves it open, and noise and misfit of handle fits.

    Shorter trainings on most examples are tested on the others. Sets with few examples for their
    degrees of freedom need sparser components: the largest λ₁ that is nearly the best is chosen.
    Models of few examples come nearer to other shapes if the code is trusted less: the misfit is
    chosen by examples left out one by one, or is 0 if there are many examples and a noise below the
    largest is best.

    Args:
        examples: the training set.
        config: configuration, whose `training` is a `FactorisationSettings`.
        stages: keep every trial's errors once it is finished, as the stage "trials".
        on_progress: called after every round and handle fit, with the stage "cross-validation".
    """

    def __init__(
        self,
        examples: TrainingSet,
        config: ModelConfig,
        stages: Stages,
        on_progress: ProgressCallback | None,
    ) -> None:
        """Count the steps."""
        self._stages = stages
        self._examples, self._config, self._on_progress = examples, config, on_progress
        given = config.training.sparsity
        self._sparsities = SPARSITIES if given is None else (given,)
        self._epochs = min(_TRIAL_EPOCHS, config.training.epochs)
        N = len(examples.shapes)
        # Rounds and handle fits of a trial of the noises, and of each one of the misfits, which may
        # turn out to be unnecessary.
        fits = held_out_fits(N) * len(HANDLE_NOISES)
        self._noise_work = self._epochs + fits if fits else 0
        self._turns = held_out_turns(N)
        fits = len(HANDLE_COUNTS) * len(HANDLE_MISFITS)
        self._misfit_work = [self._epochs + fits * len(turn) for turn in self._turns]
        self._total = len(self._sparsities) * self._noise_work + sum(self._misfit_work)
        self._done, self._reported = 0, False

    def run(self) -> tuple[ModelConfig, float, tuple[float, float]]:
        """The configuration with its λ₁, and handle noise and misfits in bounding diagonals.

        Raises:
            KeyboardInterrupt: Ctrl-C; the finished trials are kept.
        """
        measured = {s: self._errors(s) for s in self._sparsities if self._noise_work}
        sparsity, noise = self._sparsities[0], HANDLE_NOISES[-1]
        if measured:
            least = min(found.min() for found in measured.values())
            sparsity, found = next(
                entry for entry in measured.items() if entry[1].min() <= least + _LEAST_GAIN
            )
            noise = HANDLE_NOISES[int(found.argmin())]
        misfits = self._misfits(sparsity, noise)
        if self._reported and self._done < self._total:
            self._report(self._total - self._done)
        return self._config.with_training(sparsity=sparsity), noise, misfits

    def _misfits(self, sparsity: float, noise: float) -> tuple[float, float]:
        """For few handles and for many, the best misfit, or 0 if that is nearly as good."""
        if len(self._examples.shapes) >= MANY and noise < HANDLE_NOISES[-1]:
            return 0.0, 0.0
        if not self._turns:
            return _UNKNOWN_MISFIT, _UNKNOWN_MISFIT
        config = self._config.with_training(sparsity=sparsity, epochs=self._epochs)
        options = {"noise": noise, "relaxation": _MISFIT_RELAXATION}
        fits = partial(self._fits, config, options, "misfit")
        shapes, geodesics = self._examples.shapes, self._examples.geodesics
        found = [
            self._trial(
                f"misfit {turn}",
                (len(HANDLE_COUNTS), len(HANDLE_MISFITS)),
                work,
                partial(misfit_errors, fits, shapes, geodesics, HANDLE_MISFITS, turn),
            )
            for turn, work in enumerate(self._misfit_work)
        ]
        few, many = map(_chosen, np.mean(found, axis=0))
        return few, many

    def _trial(
        self, key: str, shape: tuple[int, ...], work: int, errors: Callable[[], FloatArray]
    ) -> FloatArray:
        """Errors of a trial by that key, whose `work` counts in progress; kept ones from before."""
        trials = self._stages.load("trials") or {}
        if key not in trials:
            trials[key] = errors()
            self._stages.save("trials", trials)
        else:
            self._done += work
        where = f"{self._stages.place('trials')}: {key}"
        return checked_array(trials[key], where, shape, remedy="delete the checkpoint")

    def _errors(self, sparsity: float) -> FloatArray:
        """Logarithms of errors of held-out shapes, by handle noise."""
        config = self._config.with_training(sparsity=sparsity, epochs=self._epochs)
        shapes, geodesics = self._examples.shapes, self._examples.geodesics
        fits = partial(self._fits, config, {}, "noise")
        errors = partial(held_out_errors, fits, shapes, geodesics, HANDLE_NOISES, 0)
        return self._trial(str(sparsity), (len(HANDLE_NOISES),), self._noise_work, errors)

    def _fits(
        self, config: ModelConfig, options: dict[str, Any], varied: str, indices: IntArray
    ) -> HandleFit:
        """Handle fits of a model that is trained on some of the shapes.

        Args:
            config: configuration of the training.
            options: of `HandleSolver`.
            varied: the parameter of `HandleSolver.set_prior` whose values are tried.
            indices: (n,) training shapes.
        """
        examples = self._examples.subset(indices)
        result = examples.train_network(config, on_progress=lambda _: self._report())
        if result.interrupted:
            raise KeyboardInterrupt
        model = examples.build_model(result.weights, config, {}, {})
        return partial(self._poses, HandleSolver(model, **options), varied)

    def _poses(
        self,
        solver: HandleSolver,
        varied: str,
        vertices: IntArray,
        targets: FloatArray,
        values: Sequence[float],
    ) -> Iterator[FloatArray]:
        """Positions (V, 3) fitted to exact handles, for each value."""
        solver.set_handles(vertices, targets, hard=True)
        for number, value in enumerate(values):
            solver.set_prior(**{varied: value})
            if number == 0:
                pose = solver.solve()
            else:
                # Starts from the pose of the last value: faster, but sometimes another minimum.
                solver.solve_to_convergence()
                # The surface as a solve from the start gives it.
                pose = solver.relax()
            yield pose.vertices
            self._report()

    def _report(self, work: int = 1) -> None:
        self._done, self._reported = self._done + work, True
        if self._on_progress is not None:
            self._on_progress(TrainingProgress("cross-validation", self._done, self._total))


def _chosen(errors: FloatArray) -> float:
    """The misfit of errors (M,): 0, or the geometric mean, weighed by how good each is.

    Few shapes cannot tell neighbouring misfits apart.
    """
    if errors[0] <= errors.min() + _MISFIT_GAIN:
        return HANDLE_MISFITS[0]
    weights = np.exp((errors.min() - errors[1:]) / _MISFIT_TIE)
    return float(np.exp(np.average(np.log(HANDLE_MISFITS[1:]), weights=weights)))
