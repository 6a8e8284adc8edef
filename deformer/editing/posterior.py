"""What the handles leave open, and where one more handle would tell most.

The posterior of a handle fit is taken as Gaussian about the solution (Laplace's approximation)
and pushed through the derivative of all vertex positions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.editing.solver import HandleSolver
from deformer.errors import InputError
from deformer.geometry import FloatArray


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """What the handles of a solver leave open.

    Args:
        deviation: (V,) standard deviation of each vertex's position, in the data's own units (the
            root of the summed variances of x, y and z).
        gain: (V,) the share of the variance of all vertices together that a handle at the vertex
            would take away, 0 to 1.
    """

    deviation: FloatArray
    gain: FloatArray

    @property
    def suggestion(self) -> int:
        """The vertex where one more handle of weight 1 would tell most."""
        return int(self.gain.argmax())


def uncertainty(solver: HandleSolver) -> Uncertainty:
    """Uncertainty of all vertices at a solver's last solution.

    With unknowns' covariance P = U Uᵀ, vertex derivatives Y_v = J_v U and G = Σ_v Y_vᵀ Y_v, the
    variance of v is tr(Y_v Y_vᵀ), and a handle there with noise s takes
    tr((Y_v Y_vᵀ + s² I)⁻¹ Y_v G Y_vᵀ) of tr(G) away (Cohn, Ghahramani and Jordan, Active Learning
    with Statistical Models, 1996). Memory is O(V K).

    Raises:
        InputError: nothing has been solved yet.
    """
    solution = solver.solution
    if solution is None:
        raise InputError("uncertainty: nothing has been solved yet; call solve first")
    x, model, energy = solution, solver.model, solver.energy
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
    noise = (energy.noise * energy.diagonal) ** 2
    taken = np.linalg.solve(variance + noise * np.eye(3), (Y @ G) @ Y.transpose(0, 2, 1))
    total = max(float(np.trace(G)), np.finfo(float).tiny)
    return Uncertainty(np.sqrt(np.einsum("vii->v", variance)), np.einsum("vii->v", taken) / total)
