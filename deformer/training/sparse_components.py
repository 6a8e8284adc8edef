"""Sparse localised components of any data on the sites of a mesh.

The optimisation of Neumann et al., "Sparse Localized Deformation Components" (SIGGRAPH Asia 2013),
on M sites (vertices, edges) with D numbers each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer.checks import checked_indices
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray
from deformer.network import locality_row
from deformer.parallel import Executor
from deformer.training import site_pieces as pieces
from deformer.training.admm import Sums
from deformer.training.piecewise import Change, Order, Piecewise
from deformer.training.site_pieces import Residual
from deformer.training.site_tiles import SiteTiles

# Distances (M,) from one site to all.
Distances = Callable[[int], FloatArray]

# Residuals up to this, of data of unit variance, count as rounding errors.
_ROUNDING = 1e-10


@dataclass(frozen=True)
class LocalisedSettings:
    """Settings of `localised_components`.

    Args:
        sparsity: λ, for data of unit variance.
        d_min, d_max: distances from a component's centre, in the unit of the distances, between
            which Λ rises from 0 to 1.
        far_sparsity: least value of λ Λ from d_max on; it keeps components local if λ is small.
        signed: true for weights in [−1, 1], false for [0, 1]; a component's largest is 1.
        tolerance: the rounds end when the objective falls by less than this share of itself.
        rounds: greatest number of rounds.

    Raises:
        InputError: a value out of its range.
    """

    sparsity: float = 2.0
    d_min: float = 0.2
    d_max: float = 0.4
    far_sparsity: float = 0.0
    signed: bool = True
    tolerance: float = 1e-3
    rounds: int = 50

    def __post_init__(self) -> None:
        """Check the values."""
        if not self.sparsity >= 0:
            raise InputError(f"sparsity: expected a number of at least 0, got {self.sparsity}")
        if not 0 <= self.d_min < self.d_max:
            raise InputError(
                f"d_min, d_max: expected 0 ≤ d_min < d_max, got {self.d_min} and {self.d_max}"
            )
        if not self.rounds >= 0:
            raise InputError(f"rounds: expected at least 0, got {self.rounds}")


@dataclass(frozen=True, eq=False)
class Localised:
    """Data (N, M, D) ≈ weights (N, K) times components (K, M, D).

    Args:
        components: (K, M, D) in the unit of the data; exactly 0 outside their supports. If fewer
            than K components explain the data, the last ones are 0.
        weights: (N, K) of the training data; the largest magnitude of a component's is 1.
        centres: (K,) int64 central site of each component.
        objective: (rounds + 1,) value before the first round and after each; never rises.
    """

    components: FloatArray
    weights: FloatArray
    centres: IntArray
    objective: FloatArray


def localised_components(
    data: ArrayLike,
    distances: Distances,
    count: int,
    settings: LocalisedSettings | None = None,
) -> Localised:
    """Factor data into few local components: minimise ½‖X − W C‖² + λ Σ_k Σ_i Λ_ki ‖C_ki‖₂.

    Neumann et al. 2013, objective; Λ is that of Tan et al. 2018, equation 5.

    Λ_ki rises from 0 to 1 with the distance of site i from the centre of component k. The
    components are initialised by greedy deflation: the centre of each is the site with the largest
    residual. Each round has three steps: it fits the weights by block coordinate descent within
    their range, moves the centres to the sites where the components are largest, and fits the
    components by ADMM. Two things differ from the paper: when a weight is scaled into its
    range, the component is scaled inversely at once, and a step that would raise the objective is
    not taken. Nothing is random.

    Args:
        data: (N, M, D) differences from a reference or a mean, in any unit, D numbers a site;
            numbers of different kinds should have one scale. The data are divided by their root
            mean square, so that λ means the same in any unit.
        distances: gives the distances (M,) from a site to all sites, non-negative, infinite for
            sites that are not connected, in the unit of d_min and d_max. It is called for few more
            than K sites.
        count: K, number of components.
        settings: None is the authors' λ, and the d_min and d_max of Tan et al. 2018, for distances
            in units of the largest one.

    Raises:
        InputError: the data are not (N, M, D) and finite, or K is below 1.
    """
    settings = settings or LocalisedSettings()
    X = np.asarray(data, dtype=np.float64)
    if X.ndim != 3 or 0 in X.shape or not np.isfinite(X).all():
        raise InputError(f"data: expected finite numbers of shape (N, M, D), got {X.shape}")
    if count < 1:
        raise InputError(f"components: expected at least 1, got {count}")
    unit = float(np.sqrt((X**2).mean())) or 1.0
    problem = Factorisation(X / unit, distances, count, settings)
    problem.start()
    objective = [problem.objective()]
    for _ in range(settings.rounds):
        problem.round()
        objective.append(problem.objective())
        if objective[-2] - objective[-1] <= settings.tolerance * objective[-2]:
            break
    components = problem.C.reshape(count, *X.shape[1:]) * unit
    return Localised(components, problem.W, problem.centres, np.array(objective))


class Factorisation:
    """The unknowns W (N, K), C (K, M·D) and the centres, and the three steps that improve them.

    Their dtype is that of the data. All unknowns are 0 until `start` or `restore` sets them. The
    components are in pieces, one a tile of the data, each where its tile is used (`Piecewise`): a
    round sends weights to the pieces and gets sums back.

    Args:
        X: (N, M, D) data of unit variance, of any floating dtype, or tiles of them.
        distances, count, settings: as in `localised_components`.
        executor: has other processes keep and fit the pieces, if there are several; None is this
            one.
    """

    def __init__(
        self,
        X: NDArray | SiteTiles,
        distances: Distances,
        count: int,
        settings: LocalisedSettings,
        executor: Executor | None = None,
    ) -> None:
        """Allocate weights and penalties."""
        self.data = X if isinstance(X, SiteTiles) else SiteTiles.of(X)
        N, self._sites, _ = self.data.shape
        # Σ ‖X_i‖² of all sites.
        self._squares = sum(
            float(np.einsum("nm,nm->", x, x, dtype=np.float64)) for _, x in self.data.each()
        )
        self._distances = distances
        self._settings = settings
        dtype = self.data.dtype
        self.W: NDArray = np.zeros((N, count), dtype=dtype)
        self.centres: IntArray = np.zeros(count, dtype=np.int64)
        self._penalty: NDArray = np.zeros((count, self._sites), dtype=dtype)
        self._pieces = Piecewise(self.data, executor)
        # Sums of the components, and factors on them that the pieces do not have yet.
        self._sums = Sums(
            np.zeros((N, count)), np.zeros((count, count)), np.zeros_like(self._penalty)
        )
        self._scales: NDArray = np.ones(count, dtype=dtype)

    @property
    def C(self) -> NDArray:
        """The components (K, M·D), gathered from the pieces."""
        C = self._pieces.gather("C", len(self.centres))
        C *= self._scales[:, None]
        return C

    def taken_components(self) -> Iterator[tuple[slice, NDArray]]:
        """Sites of each tile, and the components (K, m·D) there, which are gone then."""
        for sites, C in self._pieces.taken("C"):
            yield sites, C * self._scales[:, None]

    def start(self) -> None:
        """Initialise the unknowns by greedy deflation, see `site_pieces.deflated`."""
        largest = self._largest(pieces.undeflated, _number)
        for k in range(len(self.centres)):
            site, residual = largest
            left, scale, _ = np.linalg.svd(residual, full_matrices=False)
            self.centres[k], locality = site, self._locality(site)
            self._penalty[k] = self._length_weights(locality)
            exhausted = scale[0] <= _ROUNDING * np.sqrt(len(left))
            if not exhausted:
                self.W[:, k] = self._normalised(left[:, 0] * scale[0])
            largest = self._deflate(k, site if exhausted else None, locality)
        self._change(pieces.begun, lambda _: ())

    def _deflate(self, k: int, exhausted: int | None, locality: FloatArray) -> tuple[int, NDArray]:
        """Have component k, of the weights W_k, in all pieces; site and residual as `_largest`."""
        W = self.W[:, : k + 1].copy()

        def order(sites: slice) -> tuple[Any, ...]:
            here = exhausted is not None and sites.start <= exhausted < sites.stop
            return W, locality[sites], exhausted - sites.start if here else None

        return self._largest(pieces.deflated, order)

    def _largest(self, function: Change, order: Order) -> tuple[int, NDArray]:
        """Change a greedy start; the site of the largest residual, and the residual (N, D)."""
        best: list[tuple[int, Residual]] = []

        def take(tile: int, found: Residual) -> None:
            if not best or found.square > best[0][1].square:
                best[:] = [(tile, found)]

        self._pieces.change(function, order, take)
        [(tile, found)] = best
        return self.data.sites(tile).start + found.site, found.residual

    def round(self) -> None:
        """Improve weights, centres and components once."""
        self.fit_weights()
        self.move_centres()
        self.fit_components()

    @property
    def state(self) -> dict[str, np.ndarray]:
        """Arrays that later rounds depend on, by name."""
        dual = self._pieces.gather("dual", len(self.centres))
        return {"W": self.W, "C": self.C, "centres": self.centres, "dual": dual}

    def restore(self, state: Mapping[str, np.ndarray]) -> None:
        """Continue from a `state` of the same problem."""
        self.W, D = state["W"].copy(), self.data.shape[2]
        remedy = "delete the checkpoint"
        self.centres = checked_indices(
            state["centres"], "checkpoint: centres", self._sites, what="vertex", remedy=remedy
        )
        for k, site in enumerate(self.centres.tolist()):
            self._penalty[k] = self._length_weights(self._locality(site))

        def order(sites: slice) -> tuple[Any, ...]:
            columns = slice(sites.start * D, sites.stop * D)
            return *(
                state[name][:, columns].copy() for name in ("C", "dual")
            ), sites.stop - sites.start

        self._change(pieces.given, order)

    def _change(self, function: Change, order: Order) -> None:
        """Change all pieces, which then have all factors, and add up their sums."""
        against, gram, _ = self._sums
        against, gram, lengths = np.zeros_like(against), np.zeros_like(gram), []

        def take(_: int, found: Sums) -> None:
            np.add(against, found.against, out=against)
            np.add(gram, found.gram, out=gram)
            lengths.append(found.lengths)

        self._pieces.change(function, order, take)
        self._sums = Sums(against, gram, np.hstack(lengths))
        self._scales = np.ones_like(self._scales)

    def _length_weights(self, locality: FloatArray) -> FloatArray:
        """Weight (M,) of each site's length in the objective, λ Λ or more, from Λ (M,)."""
        weights = self._settings.sparsity * locality
        return np.where(locality < 1.0, weights, np.maximum(weights, self._settings.far_sparsity))

    def _locality(self, site: int) -> FloatArray:
        return locality_row(self._distances(site), self._settings.d_min, self._settings.d_max)

    def _normalised(self, weight: FloatArray) -> FloatArray:
        """Weights (N,) in range, along ±`weight`, the largest magnitude 1."""
        if not self._settings.signed:
            weight = max((np.maximum(weight, 0), np.maximum(-weight, 0)), key=np.linalg.norm)
        largest = np.abs(weight).max()
        return weight / (largest or 1.0)

    def terms(self) -> tuple[float, float]:
        """½‖X − W C‖² and Σ_k Σ_i λ Λ_ki ‖C_ki‖₂; no residual is formed."""
        against, gram, lengths = self._sums
        W = self.W.astype(np.float64)
        squares = self._squares - 2.0 * float((W * against).sum()) + float((W.T @ W * gram).sum())
        penalty = np.einsum("km,km->", self._penalty, lengths, dtype=np.float64)
        return max(0.0, 0.5 * squares), float(penalty)

    def objective(self) -> float:
        """The sum of `terms`."""
        return sum(self.terms())

    def fit_weights(self) -> None:
        """Minimise over each column of W in turn, within range, scaling C_k where it helps.

        Of the misfit only ½‖C_k‖²‖w − w*‖² depends on w = W_k, with w* the unconstrained best.
        """
        against, gram, lengths = self._sums
        penalty = np.einsum("km,km->k", self._penalty, lengths, dtype=np.float64)
        lowest = -1.0 if self._settings.signed else 0.0
        for k in range(len(gram)):
            if gram[k, k] == 0:
                self.W[:, k] = 0
                continue
            best = self.W[:, k] + (against[:, k] - self.W @ gram[k]) / gram[k, k]
            free = best if self._settings.signed else np.maximum(best, 0.0)
            clipped = np.clip(best, lowest, 1.0)
            scale = float(np.abs(free).max())
            gain = gram[k, k] / 2 * (((clipped - best) ** 2).sum() - ((free - best) ** 2).sum())
            if (scale - 1) * penalty[k] > gain:
                self.W[:, k] = clipped
                continue
            # w / scale and scale · C_k: the same product, with the largest weight 1.
            self.W[:, k] = free / scale if scale > 0 else 0.0
            self._scales[k] *= scale
            gram[k] *= scale
            gram[:, k] *= scale
            against[:, k] *= scale
            lengths[k] *= scale

    def move_centres(self) -> None:
        """Move each centre to the site where the component is largest, if that lowers the cost."""
        lengths = self._sums.lengths
        for k, site in enumerate(lengths.argmax(1).tolist()):
            if site == self.centres[k]:
                continue
            penalty = self._length_weights(self._locality(site))
            if penalty @ lengths[k] <= self._penalty[k] @ lengths[k]:
                self.centres[k], self._penalty[k] = site, penalty

    def fit_components(self) -> None:
        """Fit components to the current weights and centres by ADMM, from the last round's dual.

        A fit that raises the objective is not kept.
        """
        old = self.objective()
        W, scales = self.W.copy(), self._scales
        self._change(pieces.fitted, lambda sites: (W, scales, self._penalty[:, sites].copy()))
        if self.objective() > old:
            self._change(pieces.reverted, _number)


def _number(sites: slice) -> tuple[int]:
    """The number of sites, as an order."""
    return (sites.stop - sites.start,)
