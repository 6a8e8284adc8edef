"""Data-driven deformation: a joint solve for weights of components and vertex positions.

After Gao et al., "Sparse Data Driven Mesh Deformation" (arXiv 1709.01250), whose energy goes back
to Sumner et al., "Mesh-based Inverse Kinematics" (2005).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from deformer.acap import features_to_gradients
from deformer.baselines._gradient_space import GradientSpace
from deformer.editing import schur_inverse
from deformer.geometry import FloatArray, IntArray, log_to_rotation, right_jacobian
from deformer.linalg import damped_step, descend
from deformer.model import LatentPrior

# Prior standard deviation of the rigid rotation, radians, as in `HandleEnergy`.
_ROTATION_SCALE = 0.3
# Number of examples that descents start from, beside the mean; first steps of each descent, and
# further steps of the best one.
_STARTS = 2
_FIRST_STEPS = 4
_STEPS = 30
_TOLERANCE = 1e-4


class DataDrivenDeformation:
    """Poses a mesh by a few handles: the mesh closest to a combination of components.

    With handles h and Q = exp(ω), `fit` minimises over positions p, weights w and ω

        Σ_i Σ_j c_ij ‖(p_i − p_j) − Q T_i(w) (v_i − v_j)‖² / (σ² Σ_i Σ_j c_ij ‖v_i − v_j‖²)
            + (w − μ)ᵀ Σ⁻¹ (w − μ) + ‖ω‖² / 0.3²      where p_h = q_h.

    Targets with errors ε have Σ_h ‖p_h − q_h‖² / ε² in place of the constraint.
    The energy is quadratic in p: the factored Laplacian and one Green's function a handle eliminate
    the positions, and damped Gauss–Newton minimises the rest over w and ω. It starts from the mean
    and from the examples of least energy. The first term depends neither on the unit of length nor
    on the number of vertices.

    Two departures from the paper: an ℓ1 term makes its weights sparse, here they have the Gaussian
    prior of the training weights (full covariance), which is smooth and which the project's own
    handle fit uses, too; and the paper has no global rotation.

    Args:
        space: components, and features of weights.
        prior: Gaussian prior of the weights.
        examples: (N, K) weights of the training shapes.
    """

    def __init__(self, space: GradientSpace, prior: LatentPrior, examples: FloatArray) -> None:
        """Decode the examples, and measure how far their gradients are from those of a mesh."""
        self.space, self.prior, self.examples = space, prior, examples
        self.factor = prior.factor
        poisson = space.poisson
        v = poisson.reference.vertices
        i = np.repeat(np.arange(len(v)), np.diff(poisson.indptr))
        e = v[i] - v[poisson.rings]
        # Σ_j c_ij e_ij e_ijᵀ of every vertex.
        self.moments = np.zeros((len(v), 3, 3))
        np.add.at(self.moments, i, poisson.c[:, None, None] * e[:, :, None] * e[:, None, :])
        self.size = float(np.trace(self.moments, axis1=1, axis2=2).sum())
        self._starts = np.vstack([prior.mean[None], examples])
        evaluated = [self.relaxed(w) for w in self._starts]
        self._shapes = np.array([p for p, _ in evaluated])
        self._misfits = np.array([misfit for _, misfit in evaluated])
        self._green: dict[int, FloatArray] = {}

    def relaxed(self, w: FloatArray) -> tuple[FloatArray, float]:
        """Centred vertices (V, 3) closest to the gradients of weights w (K,), and the misfit."""
        T = features_to_gradients(self.space.features(w))
        b = self.space.poisson.rhs(T)
        p = self.space.solve(b[None])[0]
        return p, self.misfit(T, p, b)

    def misfit(self, T: FloatArray, p: FloatArray, b: FloatArray) -> float:
        """Σ_i Σ_j c_ij ‖(p_i − p_j) − T_i (v_i − v_j)‖² at the p with L p = b(T)."""
        # Σ_i tr T_i M_i T_iᵀ − 4 tr pᵀ b + 2 tr pᵀ L p
        return float(np.vdot(T @ self.moments, T) - 2.0 * np.vdot(p, b))

    def green(self, vertices: IntArray) -> FloatArray:
        """Green's functions (H, V) of vertices (H,); those of the last call are cached."""
        new = [v for v in dict.fromkeys(vertices.tolist()) if v not in self._green]
        if new:
            rows = self.space.poisson.green_rows(new)
            self._green |= dict(zip(new, rows, strict=True))
        self._green = {v: self._green[v] for v in vertices.tolist()}
        return np.array([self._green[v] for v in vertices.tolist()])

    def fit(
        self, vertices: IntArray, targets: FloatArray, noise: float, error: float = 0.0
    ) -> FloatArray:
        """Vertices (V, 3) of the fitted mesh.

        Args:
            vertices: (H,) int64 handles, all different, H ≥ 1.
            targets: (H, 3) positions.
            noise: σ, the root mean square strain that adds as much energy as one standard deviation
                of the prior; no unit.
            error: ε, standard deviation of the targets' coordinates, in the data's units; with 0
                the handles are exactly at their targets.
        """
        G = self.green(vertices)
        weight = 1.0 / (noise**2 * self.size)
        # min over e of 2 weight eᵀ G⁻¹ e + ‖d − e‖² / ε² is 2 weight dᵀ (G + 2 weight ε² I)⁻¹ d.
        softness = 2.0 * weight * error**2 * np.eye(len(vertices))
        inverse = schur_inverse(G[:, vertices] + softness)
        # Stiffness of the surface against moving the handles.
        stiffness = inverse[:-1, :-1]
        goals = targets - self.space.poisson.centroid
        control = HandleConstraints(self, vertices, G, stiffness, goals, weight)
        d = goals - self._shapes[:, vertices]
        energy = 2.0 * np.einsum("nha,hg,nga->n", d, stiffness, d) + self._misfits
        white = np.linalg.solve(self.factor, (self._starts - self.prior.mean).T).T
        y = np.asarray(white, dtype=np.float64)
        energy = energy * control.weight + (y**2).sum(axis=1)
        order = [0, *(1 + np.argsort(energy[1:], kind="stable")[:_STARTS])]
        found = []
        for n in order:
            start = FitIterate(control, np.concatenate([y[n], np.zeros(3)]))
            found.append(descend(start, steps=_FIRST_STEPS, relative_gain=_TOLERANCE).point)
        best = min(found, key=lambda point: point.energy)
        best = descend(best, steps=_STEPS, relative_gain=_TOLERANCE).point
        d = best.distances
        p = best.p + np.einsum("vh,ha->va", G.T, stiffness @ d) + inverse[-1, :-1] @ d
        p = p @ log_to_rotation(best.x[-3:]).T + self.space.poisson.centroid
        if error == 0:
            p[vertices] = targets  # removes rounding errors
        return p


@dataclass(frozen=True, eq=False)
class HandleConstraints:
    """Handles, targets and constants of one fit."""

    deformation: DataDrivenDeformation
    vertices: IntArray
    green: FloatArray
    stiffness: FloatArray
    goals: FloatArray
    weight: float


@dataclass(eq=False)
class FitIterate:
    """One iterate of a handle fit: unknowns x = (y, ω) with w = μ + L y, positions eliminated.

    Args:
        control: handles, targets and constants of the fit.
        x: (K+3,) whitened weights y, then the rotation vector ω in radians.

    Attributes:
        w: (K,) weights.
        p: (V, 3) centred vertices closest to the gradients of w, handles free.
        turned: (H, 3) targets in the frame of the model.
        distances: (H, 3) from handles of p to `turned`.
        ridge: (K+3,) diagonal of the prior's precision in x.
        energy: value of the energy of `DataDrivenDeformation`.
    """

    control: HandleConstraints
    x: FloatArray

    def __post_init__(self) -> None:
        control, deformation = self.control, self.control.deformation
        self.w = deformation.prior.mean + deformation.factor @ self.x[:-3]
        self.p, misfit = deformation.relaxed(self.w)
        # Targets in the frame of the model: turned by the inverse of the global rotation.
        self.turned = control.goals @ log_to_rotation(self.x[-3:])
        self.distances = self.turned - self.p[control.vertices]
        correction = np.vdot(self.distances, control.stiffness @ self.distances)
        self.ridge = np.ones(len(self.x))
        self.ridge[-3:] = _ROTATION_SCALE**-2
        self.energy = control.weight * (misfit + 2.0 * float(correction))
        self.energy += float((self.ridge * self.x**2).sum())
        self._normal: tuple[FloatArray, FloatArray] | None = None

    def normal(self) -> tuple[FloatArray, FloatArray]:
        """Half the Gauss–Newton matrix (K+3, K+3) and half the gradient (K+3,)."""
        control, deformation = self.control, self.control.deformation
        K = len(self.w)
        _, dT, db = deformation.space.tangents(self.w)
        dp = deformation.space.solve(db).reshape(K, -1)
        strained = (dT @ deformation.moments).reshape(K, -1)
        flat = dT.reshape(K, -1)
        T = features_to_gradients(deformation.space.features(self.w)).ravel()
        db = db.reshape(K, -1)
        inner = strained @ flat.T - 2.0 * dp @ db.T
        slope = strained @ T - 2.0 * db @ self.p.ravel()
        L = deformation.factor
        H = np.zeros((K + 3, K + 3))
        g = np.zeros(K + 3)
        H[:-3, :-3] = L.T @ inner @ L
        g[:-3] = L.T @ slope
        # Derivative (H, 3, K+3) of the distances of targets from the free surface.
        J = np.empty((*self.distances.shape, K + 3))
        J[:, :, :-3] = -(dp.reshape(K, -1, 3)[:, control.vertices].transpose(1, 2, 0) @ L)
        # ∂(exp(ω)ᵀ q)/∂ω = [exp(ω)ᵀ q]× J_right(ω)
        turn = right_jacobian(self.x[-3:])
        J[:, :, -3:] = np.cross(self.turned[:, None, :], turn.T[None]).transpose(0, 2, 1)
        stiff = np.einsum("hg,gak->hak", control.stiffness, J).reshape(-1, K + 3)
        H += 2.0 * J.reshape(-1, K + 3).T @ stiff
        g += 2.0 * stiff.T @ self.distances.ravel()
        return control.weight * H + np.diag(self.ridge), control.weight * g + self.ridge * self.x

    def step(self, damping: float) -> FloatArray:
        if self._normal is None:
            self._normal = self.normal()
        H, g = self._normal
        return damped_step(H, g, damping)

    def moved(self, step: FloatArray) -> FitIterate:
        return FitIterate(self.control, self.x + step)
