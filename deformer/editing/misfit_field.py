"""What a model cannot express: a smooth Gaussian field over the mesh, and how large it is."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from deformer.geometry import FloatArray, IntArray
from deformer.model import DeformationModel

# Ridge of `rebuilding_error`, as a share of the codes' mean squared distance from their mean.
_RIDGE = 1e-4
# Components are local: a model rebuilds parts each on their own, and comes closer to a shape than a
# combination of whole shapes does: to 0.3 of its error on SCAPE, 0.1 on a hand and a tube.
_LOCALITY = 0.1
# Green's functions solved for at once: bounds memory.
_GREEN_BATCH = 64
# Sites from which a number of a vertex is interpolated.
_NEIGHBOURS = 4


class MisfitField:
    """Covariance τ² K ⊗ I of what no code expresses, at some sites of the mesh.

    K are Green's functions of a thin plate (`PoissonSystem.foundation_rows`), scaled to a mean
    variance of 1. τ is the size of the field (`rebuilding_error`).

    Args:
        model: the prior.
        sites: (S,) vertices, all different.

    Attributes:
        sites: as given.
        weights: (S,) share of the vertices to which a site is the nearest; their sum is 1.
        deviation: τ, in the data's units.
        scale: τ² over the mean variance of the unscaled Green's functions.
        covariance: (S, S) τ² K.
    """

    def __init__(self, model: DeformationModel, sites: IntArray) -> None:
        """Compute the Green's functions of the sites."""
        self._vertices, self.sites = model.reference.vertices, sites
        self._near = 1e-9 * model.reference.bounding_diagonal
        v = self._vertices
        nearest = np.asarray(KDTree(v[sites]).query(v)[1])
        self.weights = np.bincount(nearest, minlength=len(sites)) / len(v)
        self.deviation = rebuilding_error(model, model.tangents(model.latent_mean))
        K = np.concatenate(
            [
                model.poisson.foundation_rows(sites[start : start + _GREEN_BATCH])[:, sites]
                for start in range(0, len(sites), _GREEN_BATCH)
            ]
        )
        # Rounding makes Green's functions slightly asymmetric.
        K = 0.5 * (K + K.T)
        self.scale = self.deviation**2 / np.diag(K).mean()
        self.covariance = self.scale * K

    def interpolated(self, values: FloatArray, vertices: IntArray, known: FloatArray) -> FloatArray:
        """Values (V,) at all vertices, between some, by inverse distances.

        Args:
            values: (S,) at the sites.
            vertices: (n,) more vertices with values; some may be sites.
            known: (n,) values at these, which replace those of sites.
        """
        vertices, first = np.unique(vertices, return_index=True)
        kept = ~np.isin(self.sites, vertices)
        at = np.concatenate([self.sites[kept], vertices])
        values = np.concatenate([values[kept], known[first]])
        count = min(_NEIGHBOURS, len(at))
        found = KDTree(self._vertices[at]).query(self._vertices, count)
        distance, near = (np.asarray(a).reshape(-1, count) for a in found)
        share = 1.0 / np.maximum(distance, self._near)
        share /= share.sum(axis=1, keepdims=True)
        out = (share * values[near]).sum(axis=1)
        out[at] = values
        return out


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
