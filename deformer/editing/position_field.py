"""The Gaussian field of vertex positions before any handle is known, at some sites of the mesh.

It is the sum of two: what the prior expects, and what the model cannot express. The second matters
as much as the first: with the prior alone a few handles seem to determine everything, and the best
of them lie close together.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from deformer.editing.energy import HandleEnergy
from deformer.geometry import FloatArray, IntArray
from deformer.model import DeformationModel

# Ridge of `rebuilding_error`, as a share of the codes' mean squared distance from their mean.
_RIDGE = 1e-4
# Components are local: a model rebuilds parts each on their own, and comes closer to a shape than a
# combination of whole shapes does: to 0.3 of its error on SCAPE, 0.1 on a hand and a tube.
_LOCALITY = 0.1
# Green's functions solved for, and vertices of `deviation`, at once: bounds memory.
_GREEN_BATCH, _VERTEX_BATCH = 64, 8192
# Sites from which the prior variance of a vertex is interpolated.
_NEIGHBOURS = 4


class PositionField:
    """Covariance C = Y Yᵀ + τ² K ⊗ I of positions about the decoded mean code.

    Y are the derivatives of positions by the whitened unknowns of a handle fit (`HandleEnergy`),
    the rigid motion included. K are Green's functions of a thin plate
    (`PoissonSystem.foundation_rows`), scaled to a mean variance of 1: the covariance of what no
    code expresses. τ is its size (`rebuilding_error`).

    Args:
        model: the prior.
        sites: (S,) vertices, all different.

    Attributes:
        sites: as given.
        weights: (S,) share of the vertices to which a site is the nearest; their sum is 1.
        misfit: τ, in the data's units.
    """

    def __init__(self, model: DeformationModel, sites: IntArray) -> None:
        """Compute the tangents of all vertices and the Green's functions of the sites."""
        self._model, self.sites = model, sites
        v = model.reference.vertices
        self._tree = KDTree(v[sites])
        nearest = np.asarray(self._tree.query(v)[1])
        self.weights = np.bincount(nearest, minlength=len(sites)) / len(v)
        energy = HandleEnergy.of_model(model, model.handle_noise, rigid=True)
        z, x = model.latent_mean, np.zeros(energy.size)
        J = model.tangents(z)
        self.misfit = rebuilding_error(model, J)
        p = model.decode_centred(z)
        p -= p.mean(axis=0)
        tangents = energy.tangents(x, p, J.T.reshape(len(v), 3, -1))
        self._Y = tangents / np.sqrt(energy.stiffness(x)[0])
        K = np.concatenate(
            [
                model.poisson.foundation_rows(sites[start : start + _GREEN_BATCH])[:, sites]
                for start in range(0, len(sites), _GREEN_BATCH)
            ]
        )
        # Rounding makes Green's functions slightly asymmetric.
        K = 0.5 * (K + K.T)
        self._scale = self.misfit**2 / np.diag(K).mean()
        self._K = self._scale * K

    def covariance(self) -> FloatArray:
        """C (3S, 3S) of the sites."""
        Y = self._Y[self.sites].reshape(3 * len(self.sites), -1)
        return Y @ Y.T + np.kron(self._K, np.eye(3))

    def deviation(self, handles: IntArray, noise: float) -> FloatArray:
        """Standard deviations (V,) of all vertices when some of the sites are handles.

        The variance of what the model cannot express is interpolated between sites; all else is
        exact.

        Args:
            handles: (H,) indices into `sites`.
            noise: standard deviation of the handles' positions per axis, in the data's units.
        """
        vertices, H = self.sites[handles], len(handles)
        rows = self._scale * self._model.poisson.foundation_rows(vertices)
        Y = self._Y[vertices].reshape(3 * H, -1)
        R = Y @ Y.T + np.kron(rows[:, vertices], np.eye(3)) + noise**2 * np.eye(3 * H)
        whitening = np.linalg.inv(np.linalg.cholesky(R))
        V = len(self._Y)
        variance = np.empty(V)
        for start in range(0, V, _VERTEX_BATCH):
            part = slice(start, min(start + _VERTEX_BATCH, V))
            own = self._Y[part]
            flat = own.reshape(-1, own.shape[2])
            cross = flat @ Y.T + np.kron(rows[:, part].T, np.eye(3))
            known = np.square(cross @ whitening.T).sum(axis=1).reshape(-1, 3).sum(axis=1)
            before = np.square(own).sum(axis=(1, 2)) + 3.0 * self._misfit_variance(part)
            variance[part] = before - known
        return np.sqrt(np.maximum(variance, 0.0))

    def _misfit_variance(self, part: slice) -> FloatArray:
        """Variances of K at vertices, interpolated between the nearest sites."""
        count = min(_NEIGHBOURS, len(self.sites))
        found = self._tree.query(self._model.reference.vertices[part], count)
        distance, near = (np.asarray(a).reshape(-1, count) for a in found)
        share = 1.0 / np.maximum(distance, 1e-9 * self._model.reference.bounding_diagonal)
        share /= share.sum(axis=1, keepdims=True)
        return (share * np.diag(self._K)[near]).sum(axis=1)


def rebuilding_error(model: DeformationModel, tangents: FloatArray) -> float:
    """Root mean square distance over vertices by which a model is off on shapes like its own.

    Each training shape is rebuilt as the best affine combination of the others, to first order
    about the mean code; `_LOCALITY` times that error is the model's. Added is the error of the
    model on its training shapes.

    Args:
        model: the model; only its codes and its summary are used.
        tangents: (K, 3V) its `tangents` at the mean code.

    Returns:
        The distance in the data's units. It is positive.
    """
    codes = model.codes - model.codes.mean(axis=0)
    N, V = len(codes), tangents.shape[1] // 3
    A = codes @ (tangents @ tangents.T / V) @ codes.T
    size = float(np.trace(A)) / N
    floor = (1e-6 * model.reference.bounding_diagonal) ** 2
    own = float(model.summary.get("train_e_rms", 0.0)) / 1000.0
    ridge = max(_RIDGE * size, floor)
    # min_w ‖x_n − Σ_{m≠n} w_m x_m‖² + ridge ‖w‖² with Σ w = 1 is 1 / B_nn − ridge, with the inverse
    # B of the Gram matrix that is bordered by the constraint.
    B = np.linalg.inv(A + ridge * np.eye(N))
    ones = B.sum(axis=1)
    B -= np.outer(ones, ones) / ones.sum()
    left = np.maximum(1.0 / np.diag(B) - ridge, 0.0) if N > 1 else np.array([size])
    return float(np.sqrt(_LOCALITY**2 * left.mean() + 3.0 * own**2 + floor))
