"""Posterior variance of the vertices given the handles, and where a further handle reduces it most.

Positions are a Gaussian field about the solution (`PositionField`): what the prior expects there,
and what no code expresses. The handles are observations of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.checks import checked_instance
from deformer.editing.handles import closed_point
from deformer.editing.position_field import ObservedHandles, PositionField, variance_reductions
from deformer.editing.solver import HandleSolver
from deformer.errors import InputError
from deformer.geometry import FloatArray

# Noise of exact handles, as a share of the model's: with none a covariance could not be inverted.
_EXACT_NOISE = 0.01


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of the vertex positions given the handles of a solver.

    Args:
        deviation: (V,) float64 standard deviation of each vertex's position, in the data's own
            units: the root of the summed variances of x, y and z.
        gain: (V,) float64 share, 0 to 1, by which one more handle at the vertex would reduce the
            summed variance of all vertices; 0 where there is a handle.
    """

    deviation: FloatArray
    gain: FloatArray

    @property
    def suggestion(self) -> int:
        """The vertex where one more handle of weight 1 reduces the summed variance most."""
        return int(self.gain.argmax())


def uncertainty(solver: HandleSolver) -> Uncertainty:
    """Uncertainty of all vertices at a solver's last solution.

    Positions have the covariance of a `PositionField` about the solution, given the handles with
    the noises of the solver's energy, exact ones almost without. A handle at v with noise s reduces
    the summed variance by `variance_reductions`. On meshes of more than some hundred vertices gains
    are computed at sites spread over the mesh and interpolated. Memory is O(V K).

    Args:
        solver: a solver with a solution.

    Raises:
        InputError: nothing has been solved yet.
    """
    checked_instance(solver, "solver", HandleSolver, remedy="make one of a model")
    solution = solver.solution
    if solution is None:
        raise InputError("uncertainty: nothing has been solved yet; call solve first")
    basis, energy = solver.basis, solver.energy
    model, misfit, D = basis.model, basis.misfit_field, energy.diagonal
    field = PositionField(model, energy, solution, misfit)
    here = basis.exact_positions().at(energy.code(solution))
    soft = energy.noise / np.sqrt(energy.weights)
    observed = ObservedHandles(
        field.tangents(here.positions, here.derivative()),
        basis.misfit_rows(),
        basis.misfit_block(),
        D * np.where(solver.exact, _EXACT_NOISE * model.handle_noise, soft),
        np.array([p if isinstance(p, int) else -1 for p in basis.points], dtype=np.int64),
    )
    P, S = field.covariance(observed), len(misfit.sites)
    rows = P.reshape(S, 3, 3 * S)
    weights = np.repeat(misfit.weights, 3)
    own = np.einsum("aiaj->aij", P.reshape(S, 3, S, 3))
    gains = variance_reductions(
        own, (rows * weights) @ rows.transpose(0, 2, 1), (energy.noise * D) ** 2
    )
    total = max(float(weights @ np.diag(P)), np.finfo(float).tiny)
    places = [closed_point(solver.model, handle.vertex) for handle in solver.handles]
    taken = np.array([p for p in places if isinstance(p, int)], dtype=np.int64)
    gain = misfit.interpolated(gains / total, taken, np.zeros(len(taken)))
    closed = solver.model.seams.closed
    return Uncertainty(field.deviation(observed)[closed], gain[closed])
