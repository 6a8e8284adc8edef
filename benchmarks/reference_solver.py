"""A plain implementation of the handle solve, with which `deformer.HandleSolver` is compared.

It has the interface and the energies of the fast solver, but no numerics in common with it: double
precision, all vertices, derivatives by automatic differentiation, descents to convergence, direct
sparse solves. It reads only data from a model.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation
from torch import Tensor

from deformer import DeformationModel, Pose
from deformer.geometry import site_rings
from deformer.network import MeshAutoencoder

# Prior standard deviations of the rigid motion: radians, and bounding diagonals.
_ROTATION_SCALE = 0.3
_TRANSLATION_SCALE = 1.0
# Prior probability that these deviations apply, and not those of the training shapes.
_ELSEWHERE = 0.01
# A cold solve evaluates so many training codes, and descends from the best of them and the mean.
_CANDIDATES = 60
_STARTS = 8
# A descent ends with a step of a smaller relative gain, or after so many steps.
_TOLERANCE = 1e-12
_STEPS = 200
# Rounds of relaxation in a warm solve.
_WARM_ROUNDS = 1
# Over-relaxation of the local steps of warm solves.
_OVER_RELAXATION = 1.5
# Tension of the plate that spreads corrections at exact handles, over the reference's area.
_TENSION = 100.0
# Rows of the Jacobian computed at once; bounds the memory.
_ROWS = 32

Array = NDArray[np.float64]


class ReferenceSolver:
    """Finds the latent code, rigid motion and relaxed pose for handles.

    Unknowns x = (y, ω, t): z = μ + L y with Σ = L Lᵀ, a rotation vector, and a translation in
    bounding diagonals D. With p_h(z) the handle in the decoded shape, relative to the centroid of
    the reference, the latent energy is

        Σ_h w_h ‖Q(ω) p_h(z) + centroid + D t − q_h‖² / (σ D)² + ‖y‖² + ‖b(z)‖² + m(ω, t),

    where b is the bending beyond all examples (`model.bend_limits`). m is the smaller of two costs:
    that with the deviations of the training shapes (`model.rigid_prior`), and ‖ω‖²/0.3² + ‖t‖²/1²
    plus the cost of freedom.

    Hard handles add rounds of a global and a local step, which start at R = I. With b the
    right-hand side of the edges ½ (R_i + R_j)(x_i − x_j) of the decoded shape x, the global step
    minimises (p − L⁻¹b)ᵀ K (p − L⁻¹b) over positions p with exact handles, K a thin plate under
    tension; the local step minimises Σ_j c_ij ‖(p_i − p_j) − R_i (x_i − x_j)‖² over R_i.

    Args:
        model: the prior; any number of decoder layers.
        rigid: true to let the whole shape rotate and translate; false fixes ω = t = 0.
        noise: σ.
        relaxation: rounds of a cold solve; 0 is one global step with R = I.
    """

    def __init__(
        self,
        model: DeformationModel,
        *,
        rigid: bool = True,
        noise: float = 0.007,
        relaxation: int = 10,
    ) -> None:
        """Read the model's arrays; handles are set later."""
        self.model, self.rigid, self.noise, self.relaxation = model, rigid, noise, relaxation
        v, c = model.reference.vertices, sparse.coo_array(model.poisson.weights)
        self._centroid, self._diagonal = v.mean(axis=0), model.reference.bounding_diagonal
        self._edge_weights = c
        self._divergence, _ = self._operators(v)
        self._divergence = self._with_links(self._divergence)
        self._laplacian = sparse.csc_array(_row_sums(c) - c)
        # A thin plate under tension, L A⁻¹ L / α + L = (L A⁻¹ / α + I) L.
        f = model.reference.faces
        double = np.linalg.norm(np.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]]), axis=1)
        area = np.bincount(f.ravel(), np.repeat(double / 6, 3), len(v))
        area = np.maximum(area, 1e-6 * area.sum() / len(v))
        stiffening = self._laplacian @ sparse.diags_array(area.sum() / (_TENSION * area))
        self._bending = sparse.csc_array(stiffening + sparse.eye_array(len(v)))
        self._plate = self._bending @ self._laplacian
        # Vertex 0 is fixed, because L does not determine the translation.
        self._factor = splu(self._laplacian[1:, 1:])
        rings = site_rings(model.reference)
        network = MeshAutoencoder.from_weights(model.weights, *rings)
        self._network = network.double().requires_grad_(False)
        # The network has rounded this to single precision.
        degree = np.maximum(np.diff(rings[0]), 1)
        self._network.mean.register_buffer("inverse_degree", torch.tensor(1.0 / degree))
        self._mean, self._root = torch.tensor(model.prior.mean), torch.tensor(model.prior.factor)
        self._motions = [(np.repeat([_ROTATION_SCALE, _TRANSLATION_SCALE], 3), 0.0)]
        if model.rigid_prior is not None:
            near = np.repeat([model.rigid_prior.rotation, model.rigid_prior.translation], 3)
            # −2 log of the odds and of the ratio of two Gaussian densities at their centres.
            odds = 2.0 * np.log((1.0 - _ELSEWHERE) / _ELSEWHERE)
            cost = odds + 2.0 * np.log(self._motions[0][0] / near).sum()
            self._motions = [(near, 0.0), (self._motions[0][0], cost)]
        self._x: Array | None = None
        self._R: Array | None = None
        self.set_handles(np.empty(0, dtype=np.int64), np.empty((0, 3)))

    def set_handles(
        self,
        vertices: ArrayLike,
        targets: ArrayLike,
        weights: ArrayLike | None = None,
        hard: bool | Sequence[bool] = False,
    ) -> None:
        """Replace all handles; arguments as those of `HandleSolver.set_handles`.

        For a vertex given twice, weights are added and targets averaged with these weights; it is
        hard if one of the two is.
        """
        self._given = np.asarray(vertices, dtype=np.int64).reshape(-1)
        self._given_targets = np.asarray(targets, dtype=np.float64).reshape(-1, 3)
        H = len(self._given)
        factors = np.ones(H) if weights is None else np.asarray(weights, dtype=np.float64)
        exact = np.broadcast_to(np.asarray(hard, dtype=bool), (H,))
        self._vertices, index = np.unique(self._given, return_inverse=True)
        self._weights = np.bincount(index, factors, len(self._vertices))
        self._exact = np.unique(self._given[exact])
        self._targets = np.zeros((len(self._vertices), 3))
        np.add.at(self._targets, index, factors[:, None] * self._given_targets)
        self._targets /= self._weights[:, None]
        V = len(self.model.reference.vertices)
        sites = V + len(self.model.reference.links)
        self._coefficients = np.array([self._coefficients_of(h) for h in self._vertices]).reshape(
            -1, 3 * sites
        )
        self._free = np.delete(np.arange(V), self._exact)
        self._free_factor = None
        if 0 < len(self._exact) < V:
            self._free_factor = splu(sparse.csc_array(self._plate[self._free][:, self._free]))

    def solve(self, warm: bool = False) -> Pose:
        """Pose for the current handles; its `energy` is the latent energy, without relaxation.

        Args:
            warm: true to start from the last solution alone, with its rotations.
        """
        begun = time.perf_counter()
        if warm and self._x is not None:
            found, rounds = [self._descend(self._x)], min(self.relaxation, _WARM_ROUNDS)
        else:
            found, rounds, self._R = self._search(), self.relaxation, None
        x, energy, _ = min(found, key=lambda entry: entry[1])
        p, self._x = self._pose(x, rounds), x
        return Pose(
            vertices=p,
            z=self._codes(torch.tensor(x)[None])[0].numpy(),
            rotation=x[-6:-3].copy(),
            translation=self._diagonal * x[-3:],
            residual=np.linalg.norm(p[self._given] - self._given_targets, axis=1),
            orientation_residual=np.full(len(self._given), np.nan),
            iterations=sum(steps for _, _, steps in found),
            milliseconds=1000.0 * (time.perf_counter() - begun),
            prior_distance=float(np.linalg.norm(x[:-6])),
            energy=energy,
        )

    def decode(self, z: ArrayLike) -> Array:
        """Shape (V, 3) of a latent code (K,), at the position that the prior predicts."""
        code = torch.tensor(np.asarray(z, dtype=np.float64))[None]
        p = self._free_solution(self._rhs(self._gradients(code)[0].numpy()))
        return p + self._centroid + self._centroid_offset(code)[0].numpy()

    def energy(self, x: Array) -> float:
        """Latent energy of the unknowns x = (y, ω, t), (K + 6,)."""
        residual = self._residual(torch.tensor(x)[None]).numpy()
        stiffness, cost = self._stiffness(x)
        excess, _ = self._bend_excess(x)
        return float((residual**2).sum() + (excess**2).sum() + (stiffness * x**2).sum() + cost)

    def _bend_excess(self, x: Array) -> tuple[Array, Array]:
        """Bending beyond the examples (M,), in slacks, and its derivative (M, K) by y."""
        limits, K = self.model.bend_limits, len(x) - 6
        if limits is None:
            return np.zeros(0), np.zeros((0, K))
        bends = limits.directions @ self._codes(torch.tensor(x)[None])[0].numpy()
        over, under = np.maximum(bends - limits.high, 0), np.maximum(limits.low - bends, 0)
        outside = ((over > 0) | (under > 0)) / limits.slack
        slope = outside[:, None] * (limits.directions @ self._root.numpy())
        return (over - under) / limits.slack, slope

    def _stiffness(self, x: Array) -> tuple[Array, float]:
        """Weights (K + 6,) of the squared unknowns and the constant cost of the cheaper motion."""
        scales, cost = min(self._motions, key=lambda m: ((x[-6:] / m[0]) ** 2).sum() + m[1])
        return np.r_[np.ones(self.model.components), scales] ** -2, cost

    def _codes(self, x: Tensor) -> Tensor:
        """Latent codes z = μ + L y, (n, K), of unknowns (n, K + 6)."""
        return self._mean + x[:, :-6] @ self._root.T

    def _centroid_offset(self, z: Tensor) -> Tensor:
        """Predicted centroids (n, 3) of codes (n, K), relative to the reference's."""
        prior = self.model.rigid_prior
        if prior is None or prior.offset is None:
            return torch.zeros(3).expand(len(z), 3)
        offset, gain = torch.tensor(prior.offset), torch.tensor(prior.gain)
        return self._diagonal * (offset + z @ gain.T)

    def _gradients(self, z: Tensor) -> Tensor:
        """Deformation gradients T = exp(r) S, (n, V+B, 3, 3), of latent codes (n, K)."""
        gain, offset = self.model.scaler.gain, self.model.scaler.offset
        q = self._network.decode(z).transpose(0, 1) * torch.tensor(gain) + torch.tensor(offset)
        # Features are xx xy xz yy yz zz of S.
        S = q[..., [3, 4, 5, 4, 6, 7, 5, 7, 8]].unflatten(-1, (3, 3))
        return _exp(q[..., :3]) @ S

    def _operators(self, v: Array) -> tuple[list[sparse.csr_array], list[sparse.csr_array]]:
        """Matrices (V, V) B_x and C_x, x in 0, 1, 2, of the edges of a shape v (V, 3).

        b_i = Σ_j ½ c_ij (T_i + T_j)(v_i − v_j) is Σ_x B_x T_x with T_x (V, 3) column x of T, and
        Σ_j c_ij (p_i − p_j)(v_i − v_j)_x is row i of C_x p.
        """
        c = self._edge_weights
        i, j = c.coords
        data = (c.data[:, None] * (v[i] - v[j])).T
        edges = [sparse.coo_array((row, (i, j)), c.shape) for row in data]
        sums = [_row_sums(E) for E in edges]
        divergence = [sparse.csr_array(S + E) / 2 for S, E in zip(sums, edges, strict=True)]
        return divergence, [sparse.csr_array(S - E) for S, E in zip(sums, edges, strict=True)]

    def _with_links(self, divergence: list[sparse.csr_array]) -> list[sparse.csr_array]:
        """Matrices (V, V+B) that add (T_b − T_j) a to row i, and take it from row j, of each link.

        a = (α, 0, 0), so that only the first column of T counts.
        """
        links = self.model.reference.links
        V, B = len(self.model.reference.vertices), len(links)
        i, j = links.T
        b = V + np.arange(B)
        alpha = np.full(B, self.model.poisson.lever[0])
        columns = np.concatenate([b, b, j, j])
        data = np.concatenate([alpha, -alpha, -alpha, alpha])
        moves = sparse.csr_array((data, (np.concatenate([i, j, i, j]), columns)), shape=(V, V + B))
        wide = [sparse.hstack([D, sparse.csr_array((V, B))], format="csr") for D in divergence]
        return [sparse.csr_array(wide[0] + moves), *wide[1:]]

    def _rhs(self, T: Array) -> Array:
        """Right-hand side b (V, 3) of gradients (V+B, 3, 3)."""
        return _times(self._divergence, T)

    def _free_solution(self, b: Array) -> Array:
        """Solution (V, m) of L p = b with mean 0, for b (V, m) that sum to 0."""
        p = np.zeros_like(b)
        p[1:] = self._factor.solve(b[1:])
        return p - p.mean(axis=0)

    def _coefficients_of(self, vertex: int) -> Array:
        """Adjoint weights (3V+3B,) of a vertex: p_h = Σ_i T_i a_i for the centred free solution.

        p_h = gᵀ b with L g = e_h − 1/V, and b = Σ_x B_x T_x, so that a_x = B_xᵀ g.
        """
        V = len(self.model.reference.vertices)
        unit = (np.arange(V) == vertex) - 1.0 / V
        g = self._free_solution(unit[:, None])[:, 0]
        return np.stack([B.T @ g for B in self._divergence], axis=1).ravel()

    def _residual(self, x: Tensor) -> Tensor:
        """Weighted differences (n, H, 3) of handles from targets, for unknowns (n, K + 6)."""
        T = self._gradients(self._codes(x))
        p = (T.transpose(1, 2).flatten(2) @ torch.from_numpy(self._coefficients).T).transpose(1, 2)
        p = p + self._centroid_offset(self._codes(x))[:, None]
        offset = torch.tensor(self._centroid) + self._diagonal * x[:, None, -3:]
        moved = p @ _exp(x[:, -6:-3]).transpose(1, 2) + offset
        weights = torch.tensor(np.sqrt(self._weights) / (self.noise * self._diagonal))
        return weights[:, None] * (moved - torch.tensor(self._targets))

    def _jacobian(self, x: Array) -> Array:
        """Derivative (3H, K + 6) of the residual."""
        J = np.empty((3 * len(self._vertices), len(x)))
        for start in range(0, len(J), _ROWS):
            # One backward pass over as many copies of x gives a row for each copy.
            rows = J[start : start + _ROWS]
            copies = torch.tensor(x).repeat(len(rows), 1).requires_grad_()
            picked = self._residual(copies).flatten(1)[:, start : start + _ROWS].diagonal()
            rows[:] = torch.autograd.grad(picked.sum(), copies)[0].numpy()
        return J

    def _search(self) -> list[tuple[Array, float, int]]:
        """Last points of the descents from all starts, for each cost of the rigid motion."""
        motions, found = self._motions, []
        for motion in motions:
            self._motions = [motion]
            found += [self._descend(x) for x in self._starts()]
        self._motions = motions
        return [(x, self.energy(x), steps) for x, _, steps in found]

    def _starts(self) -> list[Array]:
        """The prior's mean and the best training codes, translated towards the targets."""
        codes = self.model.codes
        picked = np.unique(np.linspace(0, len(codes) - 1, _CANDIDATES).round().astype(int))
        y = np.linalg.solve(self._root.numpy(), (codes[picked] - self._mean.numpy()).T).T
        plain = [np.concatenate([white, np.zeros(6)]) for white in [np.zeros(y.shape[1]), *y]]
        mean, *starts = [min((x, self._translated_to_targets(x)), key=self.energy) for x in plain]
        starts.sort(key=self.energy)
        return [mean, *starts[:_STARTS]]

    def _translated_to_targets(self, x: Array) -> Array:
        """Unknowns translated so that the weighted means of handles and targets agree."""
        if not self.rigid or len(self._vertices) == 0:
            return x
        root = np.sqrt(self._weights)
        # The residual of a handle is √w_h / (σ D) times its offset to the target.
        offset = (
            root @ self._residual(torch.tensor(x)[None])[0].numpy() * self.noise / (root @ root)
        )
        moved = x.copy()
        moved[-3:] -= offset
        return moved

    def _descend(self, x: Array) -> tuple[Array, float, int]:
        """Levenberg–Marquardt from x: unknowns, energy and number of steps at convergence."""
        active = slice(None) if self.rigid else slice(-6)
        energy, damping = self.energy(x), 1e-3
        for count in range(_STEPS):
            J = self._jacobian(x)[:, active]
            stiffness = self._stiffness(x)[0][active]
            hessian = J.T @ J + np.diag(stiffness)
            excess, slope = self._bend_excess(x)
            hessian[: slope.shape[1], : slope.shape[1]] += slope.T @ slope
            residual = self._residual(torch.tensor(x)[None]).numpy().ravel()
            gradient = J.T @ residual + stiffness * x[active]
            gradient[: slope.shape[1]] += slope.T @ excess
            while True:
                trial = x.copy()
                damped = hessian + damping * np.diag(np.diag(hessian))
                trial[active] -= np.linalg.solve(damped, gradient)
                value = self.energy(trial)
                if value <= energy:
                    break
                damping *= 8.0
                if damping > 1e12:
                    return x, energy, count
            gain, x, energy = energy - value, trial, value
            damping = max(damping / 8.0, 1e-12)
            if gain <= _TOLERANCE * energy:
                return x, energy, count + 1
        return x, energy, _STEPS

    def _pose(self, x: Array, rounds: int) -> Array:
        """Vertices (V, 3) of the unknowns: relaxed if handles are hard, then moved rigidly."""
        T = self._gradients(self._codes(torch.tensor(x)[None]))[0].numpy()
        Q = _exp(torch.tensor(x[-6:-3])).numpy()
        offset = self._centroid + self._diagonal * x[-3:]
        offset = offset + Q @ self._centroid_offset(self._codes(torch.tensor(x)[None]))[0].numpy()
        if len(self._exact) == 0:
            return self._free_solution(self._rhs(T)) @ Q.T + offset
        goals = self._targets[np.isin(self._vertices, self._exact)]
        p = self._relaxed(T, (goals - offset) @ Q, rounds) @ Q.T + offset
        p[self._exact] = goals
        return p

    def _relaxed(self, T: Array, targets: Array, rounds: int) -> Array:
        """Positions (V, 3) with hard handles at targets (h, 3), both in the model's frame.

        A cold call starts with R = I and ends with a global step. A warm call starts with a global
        step for the last rotations, and ends with a local step for the next call.
        """
        divergence, covariance = self._operators(self._free_solution(self._rhs(T)))
        if self._R is None:
            R = np.tile(np.eye(3), (len(self.model.reference.vertices), 1, 1))
            p = self._global(_times(divergence, R), targets)
            # Nesterov's momentum, which starts anew where an iteration turns back.
            start, last, t = p, p, 1.0
            for n in range(rounds):
                if n:
                    if ((start - p) * (p - last)).sum() > 0:
                        t = 1.0
                    t, before = (1.0 + np.sqrt(1.0 + 4.0 * t * t)) / 2.0, t
                    start = p + (before - 1.0) / t * (p - last)
                R = self._local(covariance, start, R, 1.0)
                p, last = self._global(_times(divergence, R), targets), p
        else:
            R = self._R
            p = self._global(_times(divergence, R), targets)
            if rounds:
                R = self._local(covariance, p, R, _OVER_RELAXATION)
        self._R = R
        return p

    def _local(self, covariance: list[sparse.csr_array], p: Array, R: Array, over: float) -> Array:
        """Rotations (V, 3, 3) from the local step: argmax tr(R_iᵀ A_i), or past it, from R.

        A_i = Σ_j c_ij p_ij x_ijᵀ. Half-angle tangents of the step from R to the optimum are
        multiplied by `over`.
        """
        A = np.stack([C @ p for C in covariance], axis=2)
        U, _, Vt = np.linalg.svd(A)
        U[:, :, 2] *= np.linalg.det(U @ Vt)[:, None]
        step = Rotation.from_matrix(U @ Vt @ R.transpose(0, 2, 1)).as_quat(canonical=True)
        step[:, :3] *= over
        return Rotation.from_quat(step).as_matrix() @ R

    def _global(self, b: Array, targets: Array) -> Array:
        """Positions (V, 3) of a right-hand side b (V, 3) with the hard handles at the targets.

        Solves the rows of K p = K L⁻¹ b, K = L A⁻¹ L / α + L, of the other vertices, with the known
        positions on the right-hand side. The Schur complement with free translation has the same
        minimiser.
        """
        p = np.zeros_like(b)
        p[self._exact] = targets
        if self._free_factor is not None:
            left = self._bending @ b - self._plate @ p
            p[self._free] = self._free_factor.solve(left[self._free])
        return p


def _row_sums(matrix: sparse.coo_array) -> sparse.dia_array:
    """Diagonal matrix of a matrix's row sums."""
    return sparse.diags_array(np.asarray(matrix.sum(axis=1)).ravel())


def _times(divergence: list[sparse.csr_array], T: Array) -> Array:
    """Σ_x B_x T_x (V, 3) of gradients or rotations T (V, 3, 3)."""
    return np.sum([B @ T[:, :, x] for x, B in enumerate(divergence)], axis=0)


def _exp(r: Tensor) -> Tensor:
    """Rotations (..., 3, 3) of rotation vectors (..., 3): I + a [r]× + b [r]×² (Rodrigues)."""
    square = (r * r).sum(-1)[..., None, None]
    small = square < 1e-4
    # `torch.where` needs finite derivatives of both branches.
    angle = torch.where(small, torch.ones_like(square), square).sqrt()
    a_series = 1 - square / 6 * (1 - square / 20 * (1 - square / 42))
    b_series = 0.5 - square / 24 * (1 - square / 30 * (1 - square / 56))
    a = torch.where(small, a_series, angle.sin() / angle)
    b = torch.where(small, b_series, 2 * (angle / 2).sin() ** 2 / angle**2)
    x, y, z = r.unbind(-1)
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).unflatten(-1, (3, 3))
    return torch.eye(3, dtype=r.dtype) + a * cross + b * cross @ cross
