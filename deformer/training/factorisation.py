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
from deformer.parallel import Executor
from deformer.training.feature_tiles import UNDEFORMED, deviations, features
from deformer.training.loop import (
    ProgressCallback,
    State,
    TrainingResult,
    identity_of,
    run_training,
)
from deformer.training.site_tiles import SiteTiles
from deformer.training.sparse_components import Factorisation, LocalisedSettings

# Scaled features are clipped to ± this before artanh.
_SATURATED = 0.99
# Least weight of sparsity from d_max on, for data of unit variance.
_FAR_SPARSITY = 2.0
# Candidate ridges of the links' rows, relative to the codes' largest squared singular value.
_RIDGES = (*np.logspace(-10, 0, 11), np.inf)
# Numbers of the links whose rows are fitted at once: bounds memory.
_LINK_NUMBERS = 8_000_000


def factor(
    x: FloatArray | SiteTiles,
    scaler: FeatureScaler,
    geodesics: Geodesics | SiteGeodesics,
    config: ModelConfig,
    *,
    links: int = 0,
    executor: Executor | None = None,
    checkpoint: Path | None = None,
    resume: bool = False,
    on_progress: ProgressCallback | None = None,
) -> TrainingResult:
    """Train a network of one layer on scaled features; nothing is random.

    Args:
        x: (N, V, 9) scaled features of the training shapes, or tiles of their `deviations`.
        scaler: their scaling; the undeformed shape's features give the decoder's bias.
        geodesics: distances over the reference, for Λ.
        config: configuration, whose `training` is a `FactorisationSettings` with a sparsity.
        links: number B of the last rows of x that are those of links.
        executor: shares the rounds among its workers if there are several tiles; None is this
            process.
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
    training = NetworkFactorisation(x, scaler, geodesics, config, links, executor)
    outcome = run_training(
        training,
        config.training.epochs,
        identity_of(training.tiles, config, 0),
        checkpoint=checkpoint,
        resume=resume,
        on_progress=on_progress,
    )
    weights, terms = training.finished()
    return TrainingResult(weights, sum(terms), terms[0], *outcome)


class NetworkFactorisation:
    """The rounds of a factorisation as the steps of a training.

    Args:
        x, scaler, geodesics, config, links, executor: as in `factor`.

    Raises:
        InputError: the config is of another method or without a sparsity.
    """

    def __init__(
        self,
        x: FloatArray | SiteTiles,
        scaler: FeatureScaler,
        geodesics: Geodesics | SiteGeodesics,
        config: ModelConfig,
        links: int,
        executor: Executor | None = None,
    ) -> None:
        """Compute what the network's tanh is applied to."""
        training = config.training
        if not isinstance(training, FactorisationSettings):
            raise InputError(f"config: expected training by factorisation, got {training.method!r}")
        if training.sparsity is None:
            raise InputError("sparsity: expected a number, got None; `train` chooses one")
        self.tiles = x if isinstance(x, SiteTiles) else SiteTiles.of(deviations(scaler.unscale(x)))
        self._bias, self._links = np.arctanh(scaler.scale(UNDEFORMED)), links
        data, self._unit = _in_front_of_tanh(self.tiles, scaler, self._bias)
        settings = LocalisedSettings(training.sparsity, config.d_min, config.d_max, _FAR_SPARSITY)
        self._problem = Factorisation(
            data, geodesics.normalised_row, config.components, settings, executor
        )

    def start(self) -> None:
        """As in `Trainee`."""
        self._problem.start()

    def step(self, epoch: int) -> tuple[float, ...]:
        """As in `Trainee`."""
        self._problem.round()
        return self._problem.terms()

    def state(self) -> State:
        """As in `Trainee`."""
        return {}, self._problem.state

    def restore(self, status: dict[str, Any], arrays: dict[str, NDArray]) -> None:
        """As in `Trainee`."""
        self._problem.restore(arrays)

    def finished(self) -> tuple[NetworkWeights, tuple[float, float]]:
        """Weights with links fitted, and the terms of the loss; no step follows."""
        fit_links(self._problem, self._links)
        terms = self._problem.terms()
        return _weights(self._problem, self._unit, self._bias), terms


def fit_links(problem: Factorisation, links: int) -> None:
    """Fit rows of the last B sites to the codes by ridge regression, where that is better.

    Where a piece is may depend on components anywhere, and errors of links add up along their tree.
    A row that is sparse and local is therefore replaced by that of ridge regression if the latter's
    leave-one-out error, for the best ridge, is less than the former's residual.

    Args:
        problem: a factorisation; its components change.
        links: B; 0 changes nothing.
    """
    if not links:
        return
    N, M, D = problem.data.shape
    state = problem.state
    W, C = state["W"].astype(np.float64), state["C"]
    step = max(1, _LINK_NUMBERS // (N * D))
    for first in range(M - links, M, step):
        sites = range(first, min(first + step, M))
        data = np.stack([problem.data.site(site) for site in sites], axis=1)
        columns = slice(sites.start * D, sites.stop * D)
        C[:, columns] = _fitted(W, C[:, columns], data)
    problem.restore(state)


def _fitted(W: FloatArray, rows: NDArray, data: NDArray) -> FloatArray:
    """Rows (K, b·D) of sites with data (N, b, D): the given ones, or ridge regression's."""
    data, rows = data.astype(np.float64), rows.astype(np.float64)
    rows = rows.reshape(len(rows), -1, data.shape[2])
    best = np.square(data - np.einsum("nk,kbd->nbd", W, rows)).sum(axis=(0, 2))
    flat = data.reshape(len(data), -1)
    for found, left_out in ridge_regressions(W, flat, _RIDGES, centred=False, least=1e-6):
        error = np.square(left_out.reshape(data.shape)).sum(axis=(0, 2))
        better = error < best
        best = np.where(better, error, best)
        rows[:, better] = found.reshape(rows.shape)[:, better]
    return rows.reshape(len(rows), -1)


def _in_front_of_tanh(
    tiles: SiteTiles, scaler: FeatureScaler, bias: FloatArray
) -> tuple[SiteTiles, float]:
    """Data of unit variance whose tanh, scaled and with the bias, are features; and their unit."""
    total = 0.0

    def change(part: NDArray) -> NDArray:
        nonlocal total
        x = scaler.scale(features(part))
        data = (np.arctanh(np.clip(x, -_SATURATED, _SATURATED)) - bias).astype(np.float32)
        total += float(np.einsum("nmd,nmd->", data, data, dtype=np.float64))
        return data

    data = tiles.map(change, np.float32)
    unit = float(np.sqrt(total / np.prod(tiles.shape))) or 1.0
    data.divide(unit)
    return data, unit


def _weights(problem: Factorisation, unit: float, bias: FloatArray) -> NetworkWeights:
    """Weights of the autoencoder whose decoder is tanh(unit Cᵀ z + bias).

    The problem's components are gone then: of a large mesh there is no room for both.
    """
    identity = np.eye(FEATURES, dtype=np.float32)
    nothing = np.zeros_like(identity)
    convolution = ConvolutionWeights(identity, nothing, nothing[0], bias.astype(np.float32))
    K = len(problem.centres)
    components = np.zeros((problem.data.shape[1], FEATURES, K), dtype=np.float32)
    for sites, C in problem.taken_components():
        np.multiply(C.reshape(K, -1, FEATURES).transpose(1, 2, 0), unit, out=components[sites])
    return NetworkWeights((convolution,), components)
