"""The Gaussian field of vertex positions about a pose, before or after handles are known.

It is the sum of two: what the prior expects, and what the model cannot express. The second matters
as much as the first: with the prior alone a few handles seem to determine everything, and the best
of them lie close together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.editing.energy import HandleEnergy
from deformer.editing.misfit_field import MisfitField
from deformer.geometry import FloatArray, IntArray
from deformer.model import DeformationModel

# Vertices of `deviation` at once: bounds memory.
_VERTEX_BATCH = 8192


@dataclass(frozen=True, eq=False)
class ObservedHandles:
    """Handles whose positions are known, as they enter a `PositionField`.

    Args:
        tangents: (H, 3, n) derivatives of their positions by the field's unknowns.
        rows: (H, V) Green's functions of the misfit, unscaled: `PoissonSystem.foundation_rows`.
        block: (H, H) the rows at the handles.
        noise: (H,) standard deviations of their positions per axis, in the data's units; positive.
        vertices: (H,) int64 the handles' vertices; -1 for points that are no vertex.
    """

    tangents: FloatArray
    rows: FloatArray
    block: FloatArray
    noise: FloatArray
    vertices: IntArray


class PositionField:
    """Covariance C = Y Yᵀ + τ² K ⊗ I of positions about a pose, and what handles leave of it.

    Y are the derivatives of positions by the whitened unknowns of a handle fit (`HandleEnergy`),
    the rigid motion included; τ² K is the covariance of a `MisfitField`.

    Args:
        model: the prior.
        energy: energy of handle fits; its handles do not matter.
        x: (K+6,) the pose's unknowns: all is to first order about them.
        misfit: what no code expresses.
    """

    def __init__(
        self, model: DeformationModel, energy: HandleEnergy, x: FloatArray, misfit: MisfitField
    ) -> None:
        """Compute the tangents of all vertices."""
        self._model, self._energy, self._x, self._misfit = model, energy, x, misfit
        self._whitening = np.linalg.inv(np.linalg.cholesky(energy.prior_equations(x)[0])).T
        z, V = energy.code(x), len(model.reference.vertices)
        p = model.decode_centred(z)
        p -= p.mean(axis=0)
        self._Y = self.tangents(p, model.tangents(z).T.reshape(V, 3, -1))

    @classmethod
    def of_prior(cls, model: DeformationModel, misfit: MisfitField) -> PositionField:
        """The field about the decoded mean code."""
        energy = HandleEnergy.of_model(model, model.handle_noise, rigid=True)
        return cls(model, energy, np.zeros(energy.size), misfit)

    def tangents(self, p: FloatArray, dp: FloatArray) -> FloatArray:
        """Derivatives (m, 3, n) of points by whitened unknowns; as in `HandleEnergy.tangents`."""
        J = self._energy.tangents(self._x, p, dp)
        return J[:, :, : len(self._whitening)] @ self._whitening

    def observed(self, vertices: IntArray, noise: float) -> ObservedHandles:
        """Handles at vertices (H,), all with the same noise."""
        rows = self._model.poisson.foundation_rows(vertices)
        noises = np.full(len(vertices), noise)
        return ObservedHandles(self._Y[vertices], rows, rows[:, vertices], noises, vertices)

    def covariance(self, handles: ObservedHandles | None = None) -> FloatArray:
        """C (3S, 3S) of the misfit's sites, before or after handles are known."""
        sites = self._misfit.sites
        Y = self._Y[sites].reshape(3 * len(sites), -1)
        C = Y @ Y.T + np.kron(self._misfit.covariance, np.eye(3))
        if handles is not None:
            known = self._known(sites, handles, self._whitened(handles))
            C -= known @ known.T
        return C

    def deviation(self, handles: ObservedHandles) -> FloatArray:
        """Standard deviations (V,) of all vertices when handles are known.

        The variance of what the model cannot express is interpolated between sites and handles; all
        else is exact.
        """
        V, misfit = len(self._Y), self._misfit
        at = np.flatnonzero(handles.vertices >= 0)
        own = misfit.interpolated(
            np.diag(misfit.covariance),
            handles.vertices[at],
            misfit.scale * np.diag(handles.block)[at],
        )
        whitening = self._whitened(handles)
        variance = np.empty(V)
        for start in range(0, V, _VERTEX_BATCH):
            part = np.arange(start, min(start + _VERTEX_BATCH, V))
            known = np.square(self._known(part, handles, whitening)).sum(axis=1)
            before = np.square(self._Y[part]).sum(axis=(1, 2)) + 3.0 * own[part]
            variance[part] = before - known.reshape(-1, 3).sum(axis=1)
        return np.sqrt(np.maximum(variance, 0.0))

    def _whitened(self, handles: ObservedHandles) -> FloatArray:
        """W (3H, 3H) with Wᵀ W = R⁻¹, the covariance R of the handles' positions."""
        Y = handles.tangents.reshape(-1, self._Y.shape[2])
        own = self._misfit.scale * handles.block + np.diag(handles.noise**2)
        return np.linalg.inv(np.linalg.cholesky(Y @ Y.T + np.kron(own, np.eye(3))))

    def _known(
        self, vertices: IntArray, handles: ObservedHandles, whitening: FloatArray
    ) -> FloatArray:
        """Q (3m, 3H) of vertices (m,): handles reduce the covariance by Q Qᵀ."""
        Y = handles.tangents.reshape(-1, self._Y.shape[2])
        cross = self._Y[vertices].reshape(3 * len(vertices), -1) @ Y.T
        cross += np.kron(self._misfit.scale * handles.rows[:, vertices].T, np.eye(3))
        return cross @ whitening.T


def variance_reductions(own: FloatArray, reduced: FloatArray, noise: float) -> FloatArray:
    """Reductions (n,) of a summed variance by one more handle, or several, for n candidates.

    With the covariance P, its rows P_g of a candidate g, and weights W: tr((P_gg + noise I)⁻¹ P_g W
    P_gᵀ) (Cohn, Ghahramani and Jordan, Active Learning with Statistical Models, 1996).

    Args:
        own: (n, m, m) P_gg.
        reduced: (n, m, m) P_g W P_gᵀ.
        noise: variance of a handle's position per axis; positive.
    """
    return np.einsum("gii->g", np.linalg.solve(own + noise * np.eye(own.shape[1]), reduced))
