"""Components of a group of sites: what a factorisation does to them, given the weights.

The sites do not depend on each other. Each function is given the data (N, m·D) of m sites and their
components, and makes new ones; with them it returns what the factorisation needs to know. No
function changes its arguments: a piece that is lost is made anew from the one before.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from deformer.geometry import FloatArray
from deformer.training.admm import Sums, admm, sums_of

# Penalty ρ of the augmented Lagrangian, and ADMM iterations a round, as in the authors' program.
_PENALTY = 10.0
_ADMM_ITERATIONS = 10


class Residual(NamedTuple):
    """The site of a group that the components so far explain least.

    Args:
        square: its squared residual.
        site: its index in the group.
        residual: (N, D).
    """

    square: float
    site: int
    residual: NDArray


@dataclass(frozen=True, eq=False)
class Deflated:
    """A greedy start, as far as it has come.

    Args:
        C: (k, m·D) components so far.
        squares: (m,) squared residual of each site.
    """

    C: NDArray
    squares: FloatArray


@dataclass(frozen=True, eq=False)
class Piece:
    """Components of a group of sites.

    Args:
        C: (K, m·D) components.
        dual: (K, m·D) dual variables of ADMM, scaled.
        before: (K, m·D) components before the last fit.
    """

    C: NDArray
    dual: NDArray
    before: NDArray


def undeflated(X: NDArray, _: None, sites: int) -> tuple[Deflated, Residual]:
    """The start without components: the residual is the data."""
    squares = np.einsum("nm,nm->m", X, X, dtype=np.float64).reshape(sites, -1).sum(axis=1)
    return _deflated(X, np.zeros((0, X.shape[1]), dtype=X.dtype), squares, X[:, :0])


def deflated(
    X: NDArray, last: Deflated, W: NDArray, locality: FloatArray, exhausted: int | None
) -> tuple[Deflated, Residual]:
    """The start with one more component.

    With R = X − W C the residual of the components so far, a component is
    c_i = (1 − Λ_i) g_i / ‖w‖² with g_i = Σ_n w_n R_ni = Σ_n w_n X_ni − (wᵀ W) C_i, and takes
    (1 − Λ_i²) ‖g_i‖² / ‖w‖² from the squared residual of site i.

    Args:
        X: (N, m·D).
        last: with k components.
        W: (N, k + 1) weights, of which the last are the new component's; 0 is none.
        locality: Λ (m,).
        exhausted: a site with nothing left but rounding errors, or None.
    """
    weight, sites = W[:, -1], len(locality)
    squares = last.squares
    if exhausted is not None:
        squares = squares.copy()
        squares[exhausted] = 0.0
    length = weight @ weight
    along = weight @ X - (weight @ W[:, :-1]) @ last.C
    if length > 0:
        along = along.reshape(sites, -1)
        gain = np.einsum("md,md->m", along, along, dtype=np.float64) / length
        squares = np.maximum(0.0, squares - (1.0 - locality**2) * gain)
        along = (along * ((1.0 - locality) / length)[:, None]).astype(X.dtype).reshape(-1)
    return _deflated(X, np.concatenate([last.C, along[None]]), squares, W)


def _deflated(X: NDArray, C: NDArray, squares: FloatArray, W: NDArray) -> tuple[Deflated, Residual]:
    site, D = int(squares.argmax()), X.shape[1] // len(squares)
    columns = slice(site * D, (site + 1) * D)
    residual = X[:, columns] - W @ C[:, columns]
    return Deflated(C, squares), Residual(float(squares[site]), site, residual)


def begun(X: NDArray, start: Deflated) -> tuple[Piece, Sums]:
    """The piece of a greedy start."""
    return given(X, None, start.C, np.zeros_like(start.C), len(start.squares))


def given(X: NDArray, _: None, C: NDArray, dual: NDArray, sites: int) -> tuple[Piece, Sums]:
    """The piece of given components and dual variables (K, m·D)."""
    return Piece(C, dual, C), sums_of(X, C, sites)


def fitted(
    X: NDArray, piece: Piece, W: NDArray, scales: NDArray, penalty: NDArray
) -> tuple[Piece, Sums]:
    """Fit components by ADMM, from the last round's dual variables.

    Args:
        X: (N, m·D).
        piece: to start from.
        W: (N, K) weights.
        scales: (K,) factors on the components before the fit.
        penalty: (K, m) weight of each length.
    """
    C = piece.C * scales[:, None]
    steps = {"strength": _PENALTY, "iterations": _ADMM_ITERATIONS}
    Z, U, sums = admm(X, W, penalty, C, piece.dual, **steps)
    return Piece(Z, U, C), sums


def reverted(X: NDArray, piece: Piece, sites: int) -> tuple[Piece, Sums]:
    """The components before the last fit, with its dual variables."""
    return given(X, None, piece.before, piece.dual, sites)
