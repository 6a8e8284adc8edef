"""Choice of λ₁, the handle noise and the model's own misfit by cross-validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformer.checks import checked_array
from deformer.editing import HandleSolver
from deformer.geometry import FloatArray, IntArray
from deformer.network import ModelConfig
from deformer.training.checkpoints import Stages
from deformer.training.cross_validation import (
    MANY,
    HandleFit,
    held_out_errors,
    held_out_fits,
    held_out_turns,
    misfit_errors,
    misfit_fits,
)
from deformer.training.loop import ProgressCallback, TrainingProgress
from deformer.training.training_set import TrainingSet

# Candidate noises of handle fits, in bounding diagonals. Smaller ones recover more from many
# handles, but sometimes lead to a wrong pose with fewer handles than cross-validation tries.
HANDLE_NOISES = (0.0005, 0.001, 0.002, 0.004, 0.008)
# Key of the misfits' errors among the trials.
_MISFIT = "misfit"
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
        fits = held_out_fits(len(examples.shapes)) * len(HANDLE_NOISES)
        self._total = len(self._sparsities) * (self._epochs + fits)
        self._done = 0

    def run(self) -> tuple[ModelConfig, float, tuple[float, float]]:
        """The configuration with its λ₁, and handle noise and misfits in bounding diagonals.

        Raises:
            KeyboardInterrupt: Ctrl-C; the finished trials are kept.
        """
        measured = {sparsity: found for sparsity, found in self._all_errors() if found.size}
        sparsity, noise = self._sparsities[0], HANDLE_NOISES[-1]
        if measured:
            least = min(found.min() for found in measured.values())
            sparsity, found = next(
                entry for entry in measured.items() if entry[1].min() <= least + _LEAST_GAIN
            )
            noise = HANDLE_NOISES[int(found.argmin())]
        return self._config.with_training(sparsity=sparsity), noise, self._misfits(sparsity, noise)

    def _misfits(self, sparsity: float, noise: float) -> tuple[float, float]:
        """For few handles and for many, the best misfit, or 0 if that is nearly as good."""
        N = len(self._examples.shapes)
        if N >= MANY and noise < HANDLE_NOISES[-1]:
            return 0.0, 0.0
        trials = self._stages.load("trials") or {}
        if _MISFIT in trials:
            found = self._kept(trials, _MISFIT, (0, 0), (2, len(HANDLE_MISFITS)))
        else:
            turns = held_out_turns(N)
            self._total += len(turns) * self._epochs + misfit_fits(N) * len(HANDLE_MISFITS)
            config = self._config.with_training(sparsity=sparsity, epochs=self._epochs)
            options = {"noise": noise, "relaxation": _MISFIT_RELAXATION}
            errors = misfit_errors(
                partial(self._fits, config, options, "misfit"),
                self._examples.shapes,
                self._examples.geodesics,
                HANDLE_MISFITS,
            )
            found = trials[_MISFIT] = np.empty((0, 0)) if errors is None else errors
            self._stages.save("trials", trials)
        if not found.size:
            return _UNKNOWN_MISFIT, _UNKNOWN_MISFIT
        few, many = map(_chosen, found)
        return few, many

    def _all_errors(self) -> Iterator[tuple[float, FloatArray]]:
        """Each sparsity with its `_errors`; kept ones are not computed again."""
        trials = self._stages.load("trials") or {}
        for sparsity in self._sparsities:
            key = str(sparsity)
            if key in trials:
                self._kept(trials, key, (0,), (len(HANDLE_NOISES),))
                self._done += self._total // len(self._sparsities)
            else:
                trials[key] = self._errors(sparsity)
                self._stages.save("trials", trials)
            yield sparsity, trials[key]

    def _kept(self, trials: dict[str, NDArray], key: str, *shapes: tuple[int, ...]) -> FloatArray:
        """A trial's errors from a checkpoint; their shape is one of those given."""
        where = f"{self._stages.place('trials')}: {key}"
        return checked_array(trials[key], where, *shapes, remedy="delete the checkpoint")

    def _errors(self, sparsity: float) -> FloatArray:
        """Logarithms of errors of held-out shapes, by handle noise; empty with too few shapes."""
        config = self._config.with_training(sparsity=sparsity, epochs=self._epochs)
        examples = self._examples
        fits = partial(self._fits, config, {}, "noise")
        errors = held_out_errors(fits, examples.shapes, examples.geodesics, HANDLE_NOISES, 0)
        return np.empty(0) if errors is None else errors

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
        result = examples.train_network(config, on_progress=self._report)
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

    def _report(self, _: TrainingProgress | None = None) -> None:
        self._done += 1
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
