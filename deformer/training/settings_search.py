"""Choice of λ₁, the handle noise and the model's own misfit by cross-validation."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from deformer.checks import checked_array
from deformer.geometry import FloatArray
from deformer.model import HANDLE_COUNTS
from deformer.network import ModelConfig
from deformer.parallel import Executor
from deformer.training.checkpoints import Stages
from deformer.training.cross_validation import MANY, held_out_fits, held_out_turns
from deformer.training.loop import ProgressCallback, TrainingProgress
from deformer.training.training_set import TrainingSet
from deformer.training.trials import Trials

# Candidate noises of handle fits, in bounding diagonals. Smaller ones recover more from many
# handles, but sometimes lead to a wrong pose with fewer handles than cross-validation tries.
HANDLE_NOISES = (0.0005, 0.001, 0.002, 0.004, 0.008)
# Candidate misfits of the model itself, in bounding diagonals; the one of two shapes, of which none
# can be held out; the share by which errors must fall for another misfit than 0; and the share by
# which they may differ by chance.
HANDLE_MISFITS = (0.0, 0.0125, 0.025, 0.05, 0.1, 0.2, 0.4)
_UNKNOWN_MISFIT, _MISFIT_GAIN, _MISFIT_TIE = 0.05, 0.05, 0.02
# Of larger sets so many shapes, evenly spread, stand for all in the trials.
_TRIAL_SHAPES = 500
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
    largest is best. Of more than 500 examples the first of every N / 500 are used: trials of all
    would take most of the training's time.

    Args:
        examples: the training set.
        config: configuration, whose `training` is a `FactorisationSettings`.
        stages: keep every trial's errors once it is finished, as the stage "trials".
        executor: runs the trials; the choice does not depend on it.
        on_progress: called after every round and handle fit, with the stage "cross-validation".
    """

    def __init__(
        self,
        examples: TrainingSet,
        config: ModelConfig,
        stages: Stages,
        executor: Executor,
        on_progress: ProgressCallback | None,
    ) -> None:
        """Count the steps."""
        self._stages = stages
        N = len(examples.shapes)
        if N > _TRIAL_SHAPES:
            examples = examples.subset((np.arange(_TRIAL_SHAPES) * N) // _TRIAL_SHAPES)
        self._config, self._on_progress = config, on_progress
        self._trials = Trials(examples, executor, self._report)
        given = config.training.sparsity
        self._sparsities = SPARSITIES if given is None else (given,)
        self._epochs = min(_TRIAL_EPOCHS, config.training.epochs)
        N = self._count = len(examples.shapes)
        # Rounds and handle fits of a trial of the noises, and of each one of the misfits, which may
        # turn out to be unnecessary.
        fits = held_out_fits(N) * len(HANDLE_NOISES)
        self._noise_work = self._epochs + fits if fits else 0
        fits = len(HANDLE_COUNTS) * len(HANDLE_MISFITS)
        self._misfit_work = [self._epochs + fits * len(turn) for turn in held_out_turns(N)]
        self._total = len(self._sparsities) * self._noise_work + sum(self._misfit_work)
        self._done, self._reported = 0, False

    def run(self) -> tuple[ModelConfig, float, tuple[float, float]]:
        """The configuration with its λ₁, and handle noise and misfits in bounding diagonals.

        Raises:
            KeyboardInterrupt: Ctrl-C; the finished trials are kept.
        """
        sparsity, noise = self._sparsities[0], HANDLE_NOISES[-1]
        if self._noise_work:
            sparsity, noise = self._sparsity_and_noise()
        misfits = self._misfits(sparsity, noise)
        if self._reported and self._done < self._total:
            self._report(self._total - self._done)
        return self._config.with_training(sparsity=sparsity), noise, misfits

    def _sparsity_and_noise(self) -> tuple[float, float]:
        """The largest λ₁ whose error is nearly the least, and its best noise.

        The two largest are tried side by side; a smaller λ₁ is not tried if the last one was no
        better than the one before.
        """
        measured: dict[float, FloatArray] = {}
        chosen = self._sparsities[0]
        for tried in (self._sparsities[:2], self._sparsities[2:]):
            if not tried:
                break
            measured |= self._noise_errors(tried)
            errors = [float(found.min()) for found in measured.values()]
            chosen = next(
                s
                for s, error in zip(measured, errors, strict=True)
                if error <= min(errors) + _LEAST_GAIN
            )
            self._trials.forget(chosen)
            if errors[-1] >= errors[0]:
                break
        self._done += self._noise_work * (len(self._sparsities) - len(measured))
        return chosen, HANDLE_NOISES[int(measured[chosen].argmin())]

    def _noise_errors(self, sparsities: Sequence[float]) -> dict[float, FloatArray]:
        """Logarithms of errors of held-out shapes, by handle noise, for each λ₁."""
        configs = [self._trial_config(sparsity) for sparsity in sparsities]
        found = self._kept(
            [str(sparsity) for sparsity in sparsities],
            [self._noise_work] * len(sparsities),
            (len(HANDLE_NOISES),),
            lambda missing: self._trials.noise_errors([configs[n] for n in missing], HANDLE_NOISES),
        )
        return dict(zip(sparsities, found, strict=True))

    def _misfits(self, sparsity: float, noise: float) -> tuple[float, float]:
        """For few handles and for many, the best misfit, or 0 if that is nearly as good."""
        if self._count >= MANY and noise < HANDLE_NOISES[-1]:
            return 0.0, 0.0
        if not self._misfit_work:
            return _UNKNOWN_MISFIT, _UNKNOWN_MISFIT
        config = self._trial_config(sparsity)
        found = self._kept(
            [f"misfit {turn}" for turn in range(len(self._misfit_work))],
            self._misfit_work,
            (len(HANDLE_COUNTS), len(HANDLE_MISFITS)),
            lambda missing: self._trials.misfit_errors(config, noise, HANDLE_MISFITS, missing),
        )
        few, many = map(_chosen, np.mean(found, axis=0))
        return few, many

    def _trial_config(self, sparsity: float) -> ModelConfig:
        return self._config.with_training(sparsity=sparsity, epochs=self._epochs)

    def _kept(
        self,
        keys: Sequence[str],
        work: Sequence[int],
        shape: tuple[int, ...],
        errors: Callable[[list[int]], Iterable[tuple[int, FloatArray]]],
    ) -> list[FloatArray]:
        """Errors of trials by these keys; those that were kept before are not tried again.

        Args:
            keys: names among what is kept.
            work: what each trial counts in progress.
            shape: of the errors of each.
            errors: gives those of the trials at indices that are missing, each with an index into
                these.
        """
        trials = self._stages.load("trials") or {}
        missing = [n for n, key in enumerate(keys) if key not in trials]
        self._done += sum(work) - sum(work[n] for n in missing)
        if missing:
            for n, found in errors(missing):
                trials[keys[missing[n]]] = found
                self._stages.save("trials", trials)
        where, remedy = self._stages.place("trials"), "delete the checkpoint"
        return [checked_array(trials[key], f"{where}: {key}", shape, remedy=remedy) for key in keys]

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
