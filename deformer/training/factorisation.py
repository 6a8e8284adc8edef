"""Training by alternating least squares: the components of the default configuration.

If the encoder is a projection, the network is its decoder alone, x = tanh(C z + b). In front of the
tanh that is a matrix factorisation, which alternating minimisation solves faster than gradients do:
codes and components are optimised in turn, by `sparse_components.Factorisation`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformer.acap import FeatureScaler
from deformer.errors import InputError
from deformer.geometry import FloatArray, Geodesics, SiteGeodesics
from deformer.linalg import ridge_regressions
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

# Scaled features are clipped to ± this before artanh.
_SATURATED = 0.99
# Least weight of sparsity from d_max on, for data of unit variance.
_FAR_SPARSITY = 2.0
# Candidate ridges of the links' rows, relative to the codes' largest squared singular value.
_RIDGES = (*np.logspace(-10, 0, 11), np.inf)
# Features of a vertex without rotation and stretch.
_UNDEFORMED = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0])


def factor(
    x: FloatArray,
    scaler: FeatureScaler,
    geodesics: Geodesics | SiteGeodesics,
    config: ModelConfig,
    *,
    links: int = 0,
    checkpoint: Path | None = None,
    resume: bool = False,
    on_progress: ProgressCallback | None = None,
) -> TrainingResult:
    """Train a network of one layer on scaled features; nothing is random.

    Args:
        x: (N, V, 9) scaled features of the training shapes.
        scaler: their scaling; the undeformed shape's features give the decoder's bias.
        geodesics: distances over the reference, for Λ.
        config: configuration, whose `training` is a `FactorisationSettings` with a sparsity.
        links: number B of the last rows of x that are those of links.
        checkpoint: folder written every half minute and at the end, or None.
        resume: continue from `checkpoint`; the result is that of an uninterrupted training.
        on_progress: called after every round.

    Returns:
        The weights. Ctrl-C ends the training after the current round; the checkpoint is then saved
        and the weights so far are returned.

    Raises:
        InputError: the config is of another method or without a sparsity, or the checkpoint cannot
            be used.
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
    settings = LocalisedSettings(training.sparsity, config.d_min, config.d_max, _FAR_SPARSITY)
    problem = Factorisation(data, geodesics.normalised_row, config.components, settings)
    outcome = run_training(
        _Rounds(problem),
        training.epochs,
        identity_of(x, config, 0),
        checkpoint=checkpoint,
        resume=resume,
        on_progress=on_progress,
    )
    fit_links(problem, links)
    terms = problem.terms()
    return TrainingResult(_weights(problem, unit, bias), sum(terms), terms[0], *outcome)


def fit_links(problem: Factorisation, links: int) -> None:
    """Fit rows of the last B sites to the codes by ridge regression, where that is better.

    Where a piece is may depend on components anywhere, and errors of links add up along their tree.
    A row that is sparse and local is therefore replaced by that of ridge regression if the latter's
    leave-one-out error, for the best ridge, is less than the former's residual.

    Args:
        problem: a factorisation; its components change.
        links: B; 0 changes nothing.
    """
    if links == 0:
        return
    W = problem.W.astype(np.float64)
    data = problem.data[:, -links:].astype(np.float64)
    C = problem.C.reshape(len(problem.C), -1, FEATURES)
    rows = C[:, -links:].astype(np.float64)
    best = np.square(data - np.einsum("nk,kbd->nbd", W, rows)).sum(axis=(0, 2))
    flat = data.reshape(len(data), -1)
    for found, left_out in ridge_regressions(W, flat, _RIDGES, centred=False, least=1e-6):
        error = np.square(left_out.reshape(data.shape)).sum(axis=(0, 2))
        better = error < best
        best = np.where(better, error, best)
        rows[:, better] = found.reshape(rows.shape)[:, better]
    C[:, -links:] = rows.astype(C.dtype)


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
