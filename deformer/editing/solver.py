"""Handles: the latent code, and the pose, that meet what the user asks for."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deformer.editing.energy import HandleObjective
from deformer.editing.green_functions import HandleBasis
from deformer.editing.handle_positions import CorrectedHandles, Handles
from deformer.editing.handles import Handle, Pose, check_handles
from deformer.errors import InputError
from deformer.geometry import FloatArray, IntArray, spread
from deformer.linalg import one_blas_thread
from deformer.model import DeformationModel, LatentPrior

# Cold solves try this many of the training codes (spread over the latent space), descend from the
# mean and the most promising few, and finish the best ones exactly.
_CANDIDATES = 32
_STARTS = 3
_FINISHED = 2
# A frame of a drag: steps, the relative gain that ends them, and how far (relative, and in units
# of the energy) the exact energy may lie above the one that the landmarks promised.
_FRAME_STEPS = 4
_FRAME_TOLERANCE = 5e-2
_SURPRISE = 0.05
# Where the targets rest, and to finish a cold solve: steps between two derivatives by all vertices,
# the relative gain that ends them, and how often at most a cold solve takes that derivative.
_FINAL_STEPS = 40
_FINAL_TOLERANCE = 1e-8
_REFINEMENTS = 10
# Steps of the local rotation fits: in a frame of a drag, which goes on from the frame
# before; in the first round of a cold solve, and in its later ones.
_FRAME_TURNS = 1
_FIRST_TURNS = 60
_TURNS = 10
# A round of relaxation that moves no vertex further, in bounding diagonals, is the last one.
_RESTING = 2e-5


@dataclass(frozen=True, eq=False)
class _State:
    """Unknowns x with the handle positions p (H, 3) of all vertices, and their energy."""

    x: FloatArray
    p: FloatArray
    energy: float


class HandleSolver:
    """Finds the latent code and rigid motion whose mesh meets the handles.

    Minimises Σ_h w_h ‖Q p_h(z) + t − q_h‖² / (σ D)² + (z−μ)ᵀ Σ⁻¹ (z−μ), with D the reference's
    bounding diagonal, plus terms on rotation and translation, and on parts that bend more than in
    any example, by damped Gauss–Newton. Handle
    positions come from the features through one Green row a handle, kept while the handle lives;
    nothing is factored when handles come, move or go.

    Args:
        model: the prior.
        rigid: let the whole shape rotate and translate; otherwise it stays where the reference is.
        noise: σ, the distance from handle to target (in bounding diagonals) that weighs as much
            as one standard deviation of the prior. None is the model's, which recovers unseen
            shapes best; targets that are less certain than shapes ask for more.
        freedom: how the whole shape may turn and travel. None: as little as the training shapes
            do, or anywhere at a price (`HandleObjective`). A number: anywhere, as a factor on
            standard deviations of 0.3 rad and one bounding diagonal. With 1 a lone handle carries
            the whole shape along; with 0.01 the shape stays about where it is and bends.
        relaxation: at most so many local/global rounds of rigid relaxation for hard handles; 0 is
            the Schur complement alone.
    """

    def __init__(
        self,
        model: DeformationModel,
        *,
        rigid: bool = True,
        noise: float | None = None,
        freedom: float | None = None,
        relaxation: int = 60,
    ) -> None:
        """Prepare the model's factorisations; handles are set later."""
        self.model = model
        noise = model.handle_noise if noise is None else noise
        self.relaxation = relaxation
        self.basis = HandleBasis(model)
        self._surface = self.basis.surface
        self._objective = HandleObjective.of(model, noise, rigid)
        self._exact: IntArray = np.empty(0, dtype=np.int64)
        self._state: _State | None = None
        # Whether it tells where the present handles lie.
        self._located = False
        # The state whose gradients the surface holds.
        self._decoded: _State | None = None
        # What landmarks leave out of the derivative, and where that was measured.
        self._correction: FloatArray | None = None
        self._corrected_at: FloatArray | None = None
        self._asked: tuple[FloatArray, FloatArray] | None = None
        self.lean(on=model.prior.mean, noise=noise, freedom=freedom)
        self._assign([])

    @property
    def objective(self) -> HandleObjective:
        """The energy of the present handles."""
        return self._objective

    @property
    def solution(self) -> FloatArray | None:
        """Unknowns (K+6,) of the last solution, as `objective` takes them; None before any."""
        return None if self._state is None else self._state.x

    @property
    def handles(self) -> list[Handle]:
        """The present handles, in the order in which they were set."""
        return list(self._handles)

    def set_handles(
        self,
        vertices: ArrayLike,
        targets: ArrayLike,
        weights: ArrayLike | None = None,
        hard: bool | Sequence[bool] = False,
    ) -> None:
        """Replace all handles.

        Args:
            vertices: (H,) vertex indices; H may be 0. A vertex given twice asks for the weighted
                mean of its targets.
            targets: (H, 3) positions.
            weights: (H,) positive factors, or None for ones.
            hard: one for all, or (H,): meet the target exactly.

        Raises:
            InputError: an index out of range, a target that is not finite, lengths that differ.
        """
        index, goals, factors, exact = check_handles(self.model, vertices, targets, weights, hard)
        self._assign(
            [
                Handle(int(v), (float(t[0]), float(t[1]), float(t[2])), float(w), bool(e))
                for v, t, w, e in zip(index, goals, factors, exact, strict=True)
            ]
        )

    def lean(
        self,
        *,
        on: ArrayLike | None = None,
        noise: float | None = None,
        freedom: float | None = None,
    ) -> None:
        """Change what the prior pulls to and how hard; what is None stays as it is.

        The last solution stays where it is, so that a warm solve goes on from there.

        Args:
            on: (K,) latent code to prefer in place of the training codes' mean; without handles
                the pose is that of this code. The covariance is the prior's.
            noise, freedom: as the class takes them.

        Raises:
            InputError: a code of another length or not finite, a number that is not positive.
        """
        for name, value in (("noise", noise), ("freedom", freedom)):
            if value is not None and not (value > 0 and np.isfinite(value)):
                raise InputError(f"{name}: expected a positive number, got {value}")
        before = self._objective
        changes: dict[str, Any] = {"noise": noise, "freedom": freedom}
        objective = replace(before, **{k: v for k, v in changes.items() if v is not None})
        if on is not None:
            centre = self._code(on)
            objective = replace(objective, prior=LatentPrior(centre, before.prior.covariance))
            away = np.linalg.solve(objective.factor, (self.model.codes - centre).T).T
            white: FloatArray = np.asarray(away, dtype=np.float64)
            self._candidates = white[spread(white, _CANDIDATES)]
        self._objective = objective
        self._correction = self._corrected_at = self._asked = None
        if self._state is not None:
            x = objective.unknowns(before.code(self._state.x), *self._state.x[-6:].reshape(2, 3))
            p = self._state.p
            state = _State(x, p, objective.energy(x, p) if self._located else np.inf)
            self._decoded = state if self._decoded is self._state else None
            self._state = state

    def resume(self, z: ArrayLike, rotation: ArrayLike, translation: ArrayLike) -> Pose:
        """Take up a solution found earlier; the next warm solve starts from it.

        The pose depends on the solution and the handles alone, not on what led there: rigid
        relaxation, which a drag carries on from frame to frame, is done afresh.

        Args:
            z: (K,) latent code.
            rotation, translation: (3,) rigid motion, as in `Pose`.
        """
        objective = self._objective
        move = np.asarray(translation, dtype=np.float64) / objective.diagonal
        turn = np.asarray(rotation, dtype=np.float64)
        return self._take_up(objective.unknowns(self._code(z), turn, move))

    def relax(self) -> Pose:
        """The pose of the last solution with exact handles relaxed to the end (see `resume`).

        Raises:
            InputError: nothing has been solved yet.
        """
        if self._state is None:
            raise InputError("the solver has no solution yet to relax; call solve first")
        return self._take_up(self._state.x)

    def _take_up(self, x: FloatArray) -> Pose:
        """The pose of unknowns x (K+6,), whatever led there, as the last solution."""
        begun = time.perf_counter()
        with one_blas_thread():
            self._surface.reset()
            self._correction = self._corrected_at = self._asked = None
            self._state, self._located = self._evaluate(x), True
            pose = self._pose(self._state, 0, self._show_afresh(self._state))
        return replace(pose, milliseconds=1000.0 * (time.perf_counter() - begun))

    def _code(self, z: ArrayLike) -> FloatArray:
        code = np.array(z, dtype=np.float64)
        if code.shape != (self.model.components,) or not np.isfinite(code).all():
            raise InputError(
                f"z: expected {self.model.components} finite numbers, got an array {code.shape}"
                + (" that is not finite" if code.shape == (self.model.components,) else "")
            )
        return code

    def solve(self, warm: bool = False) -> Pose:
        """Pose for the present handles.

        Args:
            warm: start from the last solution only (a frame of a drag). Otherwise several starts
                are tried, and the result does not depend on what was solved before.
        """
        begun = time.perf_counter()
        with one_blas_thread():
            if warm and self._state is not None:
                # Where new handles lie in the last solution is asked here, once for all of them.
                last = self._state if self._located else self._evaluate(self._state.x)
                state, steps = self._follow(last)
                vertices = self._show(state)
            else:
                self._surface.reset()
                state, steps = self._search()
                vertices = self._show_afresh(state)
            pose = self._pose(state, steps, vertices)
        self._state, self._located = state, True
        return replace(pose, milliseconds=1000.0 * (time.perf_counter() - begun))

    def settle(self, frames: int = 8) -> Pose:
        """Solve from the last solution, frame after frame, until the energy stands still.

        For sequences: what a drag would show once the mouse has rested. Without a last solution
        it is a cold solve.

        Args:
            frames: at most this many warm solves.
        """
        if self._state is None:
            return self.solve()
        milliseconds = 0.0
        pose, steps = self.solve(warm=True), 0
        for _ in range(frames - 1):
            milliseconds, steps = milliseconds + pose.milliseconds, steps + pose.iterations
            before, pose = pose, self.solve(warm=True)
            if pose.energy > before.energy * (1.0 - 1e-3):
                break
        return replace(
            pose,
            milliseconds=milliseconds + pose.milliseconds,
            iterations=steps + pose.iterations,
        )

    def drag(self, vertex: int, position: ArrayLike) -> Pose:
        """Move the target of one handle and solve from the last solution.

        Raises:
            InputError: `vertex` has no handle.
        """
        position = np.asarray(position, dtype=np.float64)
        places = [h for h, handle in enumerate(self._handles) if handle.vertex == vertex]
        if not places:
            raise InputError(
                f"vertex {vertex} has no handle; handles are at "
                f"{[handle.vertex for handle in self._handles]}"
            )
        if position.shape != (3,) or not np.isfinite(position).all():
            raise InputError(f"position: expected 3 finite numbers, got {position.tolist()}")
        target = (float(position[0]), float(position[1]), float(position[2]))
        moved = self.handles
        for h in places:
            moved[h] = Handle(vertex, target, moved[h].weight, moved[h].hard)
        self._assign(moved)
        return self.solve(warm=True)

    def _assign(self, handles: list[Handle]) -> None:
        """Take over the handles; Green rows of vertices that stay are kept."""
        self._handles = handles
        wanted = list(dict.fromkeys(handle.vertex for handle in handles))
        if set(wanted) != set(self.basis.vertices.tolist()):
            self._take_vertices(_places(self.basis.vertices.tolist(), wanted))
        vertices = self.basis.vertices.tolist()
        place = {v: n for n, v in enumerate(vertices)}
        weights = np.zeros(len(vertices))
        self._targets = np.zeros((len(vertices), 3))
        self._hard = np.zeros(len(vertices), dtype=bool)
        for handle in handles:
            n = place[handle.vertex]
            weights[n] += handle.weight
            self._targets[n] += handle.weight * np.array(handle.target)
            self._hard[n] |= handle.hard
        if vertices:
            self._targets /= weights[:, None]
        exact = self.basis.vertices[self._hard]
        if exact.tolist() != self._exact.tolist():
            self._exact = exact
            self.basis.hold(exact)
            if len(exact) == 0:
                self._surface.reset()
        self._objective = replace(self._objective, targets=self._targets, weights=weights)

    def _take_vertices(self, vertices: list[int]) -> None:
        """Green rows and landmark coefficients of the handle vertices; known ones are kept."""
        self.basis.take(vertices)
        self._correction = self._corrected_at = self._asked = None
        self._located = False

    def _evaluate(self, x: FloatArray) -> _State:
        p = self._surface.decode(self._objective.code(x))
        self._decoded = _State(x, p, self._objective.energy(x, p))
        return self._decoded

    def _follow(self, state: _State) -> tuple[_State, int]:
        """One frame from the last solution: descend by landmarks, then look at all vertices."""
        # The targets may have moved: the energy of the old unknowns is another now.
        state = replace(state, energy=self._objective.energy(state.x, state.p))
        if self._rests():
            return self._refine(state)
        x, promised, steps = self._descend_by_landmarks(state, _FRAME_STEPS, _FRAME_TOLERANCE)
        found = self._evaluate(x)
        if found.energy > promised + _SURPRISE * abs(promised) + _SURPRISE:
            better = found if found.energy < state.energy else state
            x, _, more = self._descend_by_landmarks(better, _FRAME_STEPS, _FRAME_TOLERANCE)
            again, steps = self._evaluate(x), steps + more
            found = min((again, found), key=lambda entry: entry.energy)
        return min((state, found), key=lambda entry: entry.energy), steps

    def _rests(self) -> bool:
        """Whether the last solve was for these very targets and weights."""
        now = self._objective.targets, self._objective.weights
        last, self._asked = self._asked, now
        return last is not None and all(map(np.array_equal, last, now))

    def _refine(self, state: _State) -> tuple[_State, int]:
        """Towards the exact minimum: landmarks corrected by the derivative of all vertices."""
        if self._corrected_at is None or not np.array_equal(self._corrected_at, state.x):
            z = self._objective.code(state.x)
            landmarks, everything = self.basis.by_landmarks(), self.basis.by_all()
            self._correction = everything.at(z).derivative() - landmarks.at(z).derivative()
            self._corrected_at = state.x
        x, _, steps = self._descend_by_landmarks(state, _FINAL_STEPS, _FINAL_TOLERANCE)
        step = x - state.x
        # Far from where the derivative was taken landmarks may promise too much: go less far.
        for share in (1.0, 0.3, 0.1, 0.03) if step.any() else ():
            found = self._evaluate(state.x + share * step)
            if found.energy < state.energy:
                return found, steps
        return state, steps

    def _descend_by_landmarks(
        self, state: _State, limit: int, tolerance: float = 1e-5
    ) -> tuple[FloatArray, float, int]:
        """Descend from a state with handle positions by landmarks, exact at the state."""
        objective = self._objective
        handles = CorrectedHandles(self.basis.by_landmarks(), self._correction)
        here = handles.pinned_at(objective.code(state.x), state.p)
        return objective.descend(handles, state.x, limit, tolerance, here)

    def _search(self) -> tuple[_State, int]:
        """Several starts by landmarks; the two best are finished with all vertices."""
        objective, handles = self._objective, self.basis.by_landmarks()
        self._rests()
        self._correction = self._corrected_at = None
        # From where one rigid motion is the cheaper, a descent cannot see that the other would be
        # in the end: each is tried by itself.
        coarse = [
            sole.descend(handles, x, 40)
            for sole in objective.apart()
            for x in self._starts(sole, handles)
        ]
        coarse.sort(key=lambda entry: entry[1])
        steps = sum(entry[2] for entry in coarse)
        finished = []
        for x, _, _ in coarse[:_FINISHED]:
            self._correction = self._corrected_at = None
            state = self._evaluate(x)
            for _ in range(_REFINEMENTS):
                before = state
                state, more = self._refine(before)
                steps += more
                if state.energy > before.energy * (1.0 - _FINAL_TOLERANCE):
                    break
            finished.append((state, self._correction, self._corrected_at))
        best = min(finished, key=lambda entry: entry[0].energy)
        state, self._correction, self._corrected_at = best
        return state, steps

    def _starts(self, objective: HandleObjective, handles: Handles) -> list[FloatArray]:
        """The prior's mean and the training codes that fit the handles best, rigidly placed."""
        zero = np.zeros(objective.size)
        if len(self.basis.vertices) == 0:
            return [zero]
        scored = []
        for y in np.vstack([np.zeros((1, objective.size - 6)), self._candidates]):
            x = np.concatenate([y, np.zeros(6)])
            p = handles.at(objective.code(x)).positions
            # Where it stands, or where the handles are.
            places = [(objective.energy(at, p), at) for at in (x, objective.placed(x, p))]
            scored.append(min(places, key=lambda entry: entry[0]))
        others = sorted(scored[1:], key=lambda entry: entry[0])[:_STARTS]
        return [scored[0][1], *(x for _, x in others)]

    def _show(self, state: _State) -> FloatArray:
        """Positions (V, 3) of a state, exact handles by the rotations of the frame before."""
        vertices = self._solve(state)
        if self._hard.any() and self.relaxation:
            self._surface.relax(_FRAME_TURNS)
        return vertices

    def _show_afresh(self, state: _State) -> FloatArray:
        """Positions (V, 3) of a state, exact handles by rounds of rigid relaxation."""
        vertices = self._solve(state)
        for n in range(self.relaxation if self._hard.any() else 0):
            self._surface.relax(_TURNS if n else _FIRST_TURNS)
            before, vertices = vertices, self._solve(state)
            if np.abs(vertices - before).max() < _RESTING * self._objective.diagonal:
                break
        return vertices

    def _solve(self, state: _State) -> FloatArray:
        """Positions (V, 3) by the surface's gradients, with the exact handles met."""
        objective, surface = self._objective, self._surface
        if self._decoded is not state:
            self._decoded = state
            surface.decode(objective.code(state.x))
        surface.solve()
        goals = self._targets[self._hard]
        # In the frame of the model: the rigid motion is taken off the targets.
        surface.meet(objective.move_back(state.x, goals))
        vertices = surface.positions(*objective.motion(state.x))
        # What rounding leaves is set, so that exact means exact.
        vertices[self._exact] = goals
        return vertices

    def _pose(self, state: _State, steps: int, vertices: FloatArray) -> Pose:
        objective = self._objective
        asked = np.array([handle.target for handle in self._handles]).reshape(-1, 3)
        index = np.array([handle.vertex for handle in self._handles], dtype=np.int64)
        return Pose(
            vertices=vertices,
            z=objective.code(state.x),
            rotation=state.x[-6:-3].copy(),
            translation=objective.diagonal * state.x[-3:],
            residual=np.linalg.norm(vertices[index] - asked, axis=1),
            iterations=steps,
            milliseconds=0.0,
            prior_distance=float(np.linalg.norm(state.x[:-6])),
            energy=state.energy,
        )


def _places(before: list[int], wanted: list[int]) -> list[int]:
    """The wanted vertices, as many as possible of them where they were before."""
    here = [v if v in set(wanted) else None for v in before[: len(wanted)]]
    here += [None] * (len(wanted) - len(here))
    stay = set(here)
    rest = iter([v for v in wanted if v not in stay])
    return [next(rest) if v is None else v for v in here]
