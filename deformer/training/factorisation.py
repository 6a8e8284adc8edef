"""Training by alternating least squares: the components of the default configuration.

Where the encoder is a projection the network is its decoder alone, x = tanh(C z + b). In front of
the tanh that is a factorisation, and a factorisation has better steps than gradients: codes and
components are each the best for the other in turn, with the sparse localised components of
`sparse_components.Factorisation`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformer.acap import FeatureScaler
from deformer.errors import InputError
from deformer.geometry import FloatArray, Geodesics
from deformer.network import (
    FEATURES,
    ConvolutionWeights,
    FactorisationSettings,
    ModelConfig,
    NetworkWeights,
)
from deformer.training.loop import (
    ProgressCallback,
    State,
    TrainingResult,
    identity_of,
    run_training,
)
from deformer.training.sparse_components import Factorisation, LocalisedSettings

# Scaled features beyond this count as this much: there the tanh says nothing any more.
_SATURATED = 0.99
# Least weight of sparsity far from a component's centre, for data of unit variance.
_BEYOND = 2.0
# Features of a vertex that neither turns nor stretches.
_UNDEFORMED = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0])


def factor(
    x: FloatArray,
    scaler: FeatureScaler,
    geodesics: Geodesics,
    config: ModelConfig,
    *,
    checkpoint: Path | None = None,
    resume: bool = False,
    on_progress: ProgressCallback | None = None,
) -> TrainingResult:
    """Train a network of one layer on scaled features; nothing is random.

    Args:
        x: (N, V, 9) scaled features of the training shapes.
        scaler: their scaling; the undeformed shape's features become the decoder's bias.
        geodesics: distances over the reference, for Λ.
        config: its `training` is a `FactorisationSettings` with a sparsity.
        checkpoint: folder written every half minute and on interruption, or None.
        resume: continue from `checkpoint`; every number comes out as without the stop.
        on_progress: called after every round.

    Returns:
        The weights. Ctrl-C ends the training early, after the round under way; the checkpoint is
        saved and the weights so far returned.

    Raises:
        InputError: the config trains otherwise or leaves the sparsity open, or the checkpoint is
            not to be used.
    """
    training = config.training
    if not isinstance(training, FactorisationSettings):
        raise InputError(f"config: expected training by factorisation, got {training.method!r}")
    if training.sparsity is None:
        raise InputError("sparsity: expected a number, got None; `train` chooses one")
    bias = np.arctanh(scaler.scale(_UNDEFORMED))
    data = (np.arctanh(np.clip(x, -_SATURATED, _SATURATED)) - bias).astype(np.float32)
    unit = float(np.sqrt((data**2).mean())) or 1.0
    data /= unit
    settings = LocalisedSettings(training.sparsity, config.d_min, config.d_max, _BEYOND)
    problem = Factorisation(data, geodesics.normalised_row, config.components, settings)
    course = run_training(
        _Rounds(problem),
        training.epochs,
        identity_of(x, config, 0),
        checkpoint=checkpoint,
        resume=resume,
        on_progress=on_progress,
    )
    terms = problem.terms()
    return TrainingResult(_weights(problem, unit, bias), sum(terms), terms[0], *course)


class _Rounds:
    """The rounds of a factorisation as steps of a training."""

    def __init__(self, problem: Factorisation) -> None:
        self._problem = problem

    def start(self) -> None:
        self._problem.start()

    def step(self, epoch: int) -> tuple[float, ...]:
        self._problem.round()
        return self._problem.terms()

    def state(self) -> State:
        return {}, self._problem.state

    def restore(self, status: dict[str, Any], arrays: dict[str, NDArray]) -> None:
        self._problem.restore(arrays)


def _weights(problem: Factorisation, unit: float, bias: FloatArray) -> NetworkWeights:
    """Weights of the autoencoder whose decoder is tanh(Cᵀ z + bias)."""
    identity = np.eye(FEATURES, dtype=np.float32)
    nothing = np.zeros_like(identity)
    convolution = ConvolutionWeights(identity, nothing, nothing[0], bias.astype(np.float32))
    components = problem.C.reshape(len(problem.C), -1, FEATURES).transpose(1, 2, 0) * unit
    return NetworkWeights((convolution,), np.ascontiguousarray(components, dtype=np.float32))
