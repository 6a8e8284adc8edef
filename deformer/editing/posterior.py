"""Posterior variance of the vertices given the handles, and where a further handle reduces it most.

The posterior of a handle fit is approximated by a Gaussian about the solution (Laplace's
approximation); the derivative of the vertex positions maps its covariance to the vertices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.checks import checked_instance
from deformer.editing.solver import HandleSolver
from deformer.errors import InputError
from deformer.geometry import FloatArray


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of the vertex positions given the handles of a solver.

    Args:
        deviation: (V,) float64 standard deviation of each vertex's position, in the data's own
            units: the root of the summed variances of x, y and z.
        gain: (V,) float64 share, 0 to 1, by which one more handle at the vertex would reduce the
            summed variance of all vertices.
    """

    deviation: FloatArray
    gain: FloatArray

    @property
    def suggestion(self) -> int:
        """The vertex where one more handle of weight 1 reduces the summed variance most."""
        return int(self.gain.argmax())


def uncertainty(solver: HandleSolver) -> Uncertainty:
    """Uncertainty of all vertices at a solver's last solution.

    Let P = U Uᵀ be the posterior covariance of the unknowns, J_v the derivative of vertex v,
    Y_v = J_v U and G = Σ_v Y_vᵀ Y_v. The variance of v is tr(Y_v Y_vᵀ), and a handle at v with
    noise s reduces the summed variance tr(G) by tr((Y_v Y_vᵀ + s² I)⁻¹ Y_v G Y_vᵀ) (Cohn,
    Ghahramani and Jordan, Active Learning with Statistical Models, 1996). Memory is O(V K).

    Args:
        solver: a solver with a solution.

    Raises:
        InputError: nothing has been solved yet.
    """
    checked_instance(solver, "solver", HandleSolver, remedy="make one of a model")
    solution = solver.solution
    if solution is None:
        raise InputError("uncertainty: nothing has been solved yet; call solve first")
    x, model, energy = solution, solver.basis.model, solver.energy
    z = energy.code(x)
    P = energy.posterior(x, solver.basis.exact_positions().at(z))
    V, n = len(model.reference.vertices), len(P)
    p = model.decode(z)
    p -= p.mean(axis=0)
    dp = model.tangents(z).T.reshape(V, 3, -1)
    Y = energy.tangents(x, p, dp)[:, :, :n] @ np.linalg.cholesky(P)
    flat = Y.reshape(-1, n)
    G = flat.T @ flat
    variance = Y @ Y.transpose(0, 2, 1)
    noise = (energy.noise**2 + energy.misfit**2) * energy.diagonal**2
    reduction = np.linalg.solve(variance + noise * np.eye(3), (Y @ G) @ Y.transpose(0, 2, 1))
    total = max(float(np.trace(G)), np.finfo(float).tiny)
    closed = solver.model.seams.closed
    deviation = np.sqrt(np.einsum("vii->v", variance))
    return Uncertainty(deviation[closed], np.einsum("vii->v", reduction)[closed] / total)
