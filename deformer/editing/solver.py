"""The handle solver: the latent code and the pose that bring handles to their targets."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformer.checks import (
    LARGEST,
    as_array,
    checked_array,
    checked_flag,
    checked_indices,
    checked_instance,
    checked_integer,
    checked_number,
)
from deformer.compilation import compile_kernels
from deformer.editing.bodies import Body, checked_freedom
from deformer.editing.energy import HandleEnergy
from deformer.editing.floor import MOST_CONTACTS, Floor, FloorContacts, FloorTerm
from deformer.editing.green_functions import HandleBasis
from deformer.editing.handles import (
    Handle,
    Kind,
    Point,
    Pose,
    check_handles,
    check_points,
    check_target,
    closed_point,
)
from deformer.editing.orientations import LocalFrame, checked_orientations, turned_by
from deformer.editing.posed_surface import PosedSurface
from deformer.editing.refinement import State
from deformer.editing.search import CodeSearch
from deformer.editing.target_warnings import TargetWarnings
from deformer.editing.unknowns import Unknowns
from deformer.errors import InputError
from deformer.geometry import FloatArray, RowPoint, SurfacePoint, SurfacePoints
from deformer.linalg import CORES, one_blas_thread
from deformer.model import DeformationModel

# Modules whose kernels a solve calls.
_KERNELS = (
    "deformer.geometry.rotations",
    "deformer.geometry.laplacian",
    "deformer.linalg.nested_dissection",
    "deformer.linalg.sparse_cholesky",
    "deformer.acap.jacobians",
    "deformer.network.decoder",
    "deformer.editing.kernels",
    "deformer.editing.handle_kernels",
    "deformer.editing.lift_kernels",
)
# Most cold solves that contacts with the floor are added after.
_FLOOR_ROUNDS = 4
# Weight of contacts as handles: none.
_NO_WEIGHT = 1e-12
# A warm solve that lowers the energy by a smaller share than this has converged.
_CONVERGED = 1e-3


class HandleSolver:
    """Finds the latent code and rigid motion whose shape has the handles at their targets.

    Damped Gauss–Newton minimises Σ_h w_h ‖Q p_h(z) + t − q_h‖² / (σ D)² + (z−μ)ᵀ Σ⁻¹ (z−μ), with D
    the reference's bounding diagonal, plus terms for the rigid motion and for parts that bend more
    than in any example (`HandleEnergy`). A model of few examples has an error of its own, its
    `handle_misfits`: the code is then trusted less, and the shape deforms as rigidly as possible by
    the misfit that is left. Handle positions are linear in the deformation gradients,
    with one Green's function a handle, which is kept as long as the handle exists; no matrix is
    factored when handles are added, moved or removed.

    Args:
        model: the prior.
        rigid: true if the whole shape may rotate and translate; otherwise it has no rigid motion.
        noise: σ, the distance from handle to target (in bounding diagonals) that adds as much
            energy as one standard deviation of the prior. None is the model's, with which unseen
            shapes are recovered best, but more for targets out of reach: as much as makes the
            code a likely one or brings the targets within it, so that a figure whose head is
            pulled too far is not contorted for the last millimetre.
        freedom: how far the whole shape may turn and move. None: as little as the training shapes
            do, or anywhere at a cost. A number: a factor on standard deviations of 0.3 rad and one
            bounding diagonal. With 1, "moves", a single handle moves the whole shape; with 0.01,
            "stays", the shape stays about where it is and bends. "auto": it stays under gentle
            pulls and yields to strong ones, such as those of several handles together. With
            "stays" and "auto", a body whose examples hardly travel stays as they do (`Body`).
        misfit: τ, the model's own error at handles, in bounding diagonals, which decreases with
            the distance between them (`handle_errors`). None is the model's, for the number of
            handles (`DeformationModel.misfit_of`); 0 trusts its codes.
        relaxation: the most rounds of rigid relaxation (a local and a global step) for hard
            handles; 0 is the Schur complement alone. More than the default recover some bodies
            better, and thin legs worse.
    """

    def __init__(
        self,
        model: DeformationModel,
        *,
        rigid: bool = True,
        noise: float | None = None,
        freedom: float | Body | None = None,
        misfit: float | None = None,
        relaxation: int = 20,
    ) -> None:
        """Prepare the model's factorisations; handles are set later."""
        checked_instance(model, "model", DeformationModel, remedy="load it with load_model")
        checked_flag(rigid, "rigid")
        checked_integer(relaxation, "relaxation", least=0)
        used = model.handle_noise if noise is None else noise
        _check_parameters(used, misfit)
        compile_kernels(_KERNELS, CORES)
        self.model = model
        self.basis = HandleBasis(model.closed)
        energy = HandleEnergy.of_model(model.closed, used, rigid)
        self._search = CodeSearch(energy, self.basis, model.codes)
        self._surface = PosedSurface(self._search, self.basis, relaxation)
        self._warnings = TargetWarnings(model)
        self._handles: list[Handle] = []
        self._misfit = misfit
        reference = model.closed.reference
        self._contacts = FloorContacts(reference.vertices, reference.bounding_diagonal)
        # The last surface before it was projected onto the floor.
        self._free: FloatArray | None = None
        self.set_prior(noise=used, freedom=freedom)
        self._search.least_noise = used if noise is None else None
        self._places = SurfacePoints([], model.closed.reference.faces)
        self._assign([])

    @property
    def energy(self) -> HandleEnergy:
        """The energy of the present handles."""
        return self._search.energy

    @property
    def solution(self) -> FloatArray | None:
        """Unknowns (K+6,) of the last solution, as of `energy`; None before the first."""
        return self._search.solution

    @property
    def relaxation(self) -> int:
        """The most rounds of rigid relaxation."""
        return self._surface.rounds

    @property
    def handles(self) -> list[Handle]:
        """The present handles, in the order in which they were set."""
        return list(self._handles)

    @property
    def exact(self) -> NDArray[np.bool_]:
        """True (H,) for those of `basis.points` that are at their targets exactly."""
        return self._surface.hard

    def set_handles(
        self,
        vertices: ArrayLike | Sequence[Point],
        targets: ArrayLike,
        weights: ArrayLike | None = None,
        hard: bool | Sequence[bool] = False,
        kinds: Kind | Sequence[Kind] | None = None,
        orientations: ArrayLike | Sequence[ArrayLike | None] | None = None,
        orientation_weights: ArrayLike | None = None,
        gaps: ArrayLike | None = None,
        check_units: bool = True,
    ) -> None:
        """Replace all handles.

        Targets that are most likely in other units than the model are logged as a warning
        (`unit_warning`).

        Args:
            vertices: (H,) vertex indices, `SurfacePoint`s, or both; H may be 0. The target of one
                given twice is the weighted mean of its targets.
            targets: (H, 3) positions, in the data's units.
            weights: (H,) positive factors on the squared distances from the targets; None is ones.
            hard: one for all, or (H,): true for handles that are at their targets exactly.
            kinds: one for all, or (H,), in place of `hard`: "soft"; "exact"; or "pin", an exact
                handle that `drag` refuses to move.
            orientations: (H, 4) unit quaternions (w, x, y, z) or (H, 3, 3) matrices: rotations of
                the surface around the handles, relative to the reference, which exact handles have
                exactly (`local_rotations`). None, or None or NaN for a handle, leaves it free.
            orientation_weights: (H,) positive factors on the squared errors of the orientations,
                beside `weights`; None is ones.
            gaps: (H, 3) vectors from where the code's shape is to be to the targets, as in
                `Handle`; None is zeros.
            check_units: False if the targets are known to be in the model's units.

        Raises:
            InputError: an index out of range, a target that is not finite, a weight that is not
                positive, a kind that is none, an orientation that is no rotation or at a point
                that cannot have one, a gap that is not finite, or lengths that differ.
        """
        points, goals, factors, chosen = check_handles(
            self.model, vertices, targets, weights, hard, kinds
        )
        H = len(points)
        turns = checked_orientations(orientations, orientation_weights, (H,))
        apart = np.zeros((H, 3))
        if gaps is not None and as_array(gaps, "gaps").size:
            apart = checked_array(gaps, "gaps", (H, 3), largest=LARGEST)
        checked_flag(check_units, "check_units")
        if check_units:
            self._warnings.of_units(points, goals)
        self._warnings.of_contradictions(points, goals, chosen)
        R = turns[0] if orientations is not None else [None] * H
        rows = zip(
            points,
            goals.tolist(),
            factors.tolist(),
            chosen,
            R,
            turns[1],
            apart.tolist(),
            strict=True,
        )
        self._assign([Handle(point, (t[0], t[1], t[2]), *rest) for point, t, *rest in rows])

    def set_prior(
        self,
        *,
        mean: ArrayLike | None = None,
        noise: float | None = None,
        freedom: float | Body | None = None,
        misfit: float | None = None,
    ) -> None:
        """Change the prior's mean and the energy's parameters; arguments of None change nothing.

        The last solution remains: a warm solve starts from it.

        Args:
            mean: (K,) latent code that replaces the prior's mean; without handles the pose is that
                of this code. The covariance does not change.
            noise: as in the class.
            freedom: as in the class.
            misfit: as in the class.

        Raises:
            InputError: a code of another length or not finite, a number that is not positive.
        """
        _check_parameters(noise, misfit)
        chosen = checked_freedom(freedom, self.model)
        if noise is not None:
            self._search.least_noise = None
        given: dict[str, Any] = {"noise": noise, "freedom": chosen}
        changes = {name: value for name, value in given.items() if value is not None}
        centre = None if mean is None else self._code(mean, "mean")
        self._search.set_prior(replace(self.energy, **changes), centre)
        if misfit is not None:
            self._misfit = misfit
            self._assign(self._handles)
        if noise is not None:
            self.basis.frames.noise = noise
            if any(handle.orientation is not None for handle in self._handles):
                self._assign(self._handles)

    @property
    def floor(self) -> Floor | None:
        """The floor; None is none."""
        return self._contacts.floor

    def set_floor(self, floor: Floor | None) -> None:
        """Set a plane that the shape does not pass.

        Vertices under the floor become contacts, a few at a time: the solve raises them to it,
        along its normal alone, and projects onto it what is left. Contacts slide freely. Targets
        under the floor, of exact handles, too, count as if they were on it: residuals say by how
        much. While no vertex would pass, poses are those without a floor.

        Args:
            floor: for example `Floor.under(model)`; None removes it.

        Raises:
            InputError: no floor.
        """
        if floor is not None:
            checked_instance(floor, "floor", Floor, remedy="make a Floor, or give None")
        if floor != self._contacts.floor:
            self._contacts.floor = floor
            self._contacts.update(self._free)
            self._assign(self._handles)
            self._search.energy_changed()

    def _touch(self) -> bool:
        """Update the contacts by the last surface; True if they have changed."""
        changed = self._contacts.update(self._free)
        if changed:
            self._assign(self._handles)
            self._search.energy_changed()
        return changed

    def restore(
        self,
        z: ArrayLike,
        rotation: ArrayLike,
        translation: ArrayLike,
        contacts: Sequence[int] = (),
    ) -> Pose:
        """Make an earlier solution the last one; the next warm solve starts from it.

        The pose depends on the solution and the handles alone, not on what was solved before: rigid
        relaxation, which a drag continues from frame to frame, starts anew.

        Args:
            z: (K,) latent code.
            rotation: (3,) rotation vector of the rigid motion, as in `Pose`.
            translation: (3,) its translation, as in `Pose`.
            contacts: as in `Pose`; without them the next solve finds others, and ends a little
                elsewhere. Without a floor they are ignored.

        Raises:
            InputError: a code of another length, numbers that are not finite, contacts that are no
                vertices or too many.
        """
        energy = self.energy
        code = self._code(z, "z")
        touching = self._checked_contacts(contacts)
        rotation = checked_array(rotation, "rotation", (3,), largest=LARGEST)
        t = checked_array(translation, "translation", (3,)) / energy.diagonal
        checked_array(t, "translation", largest=LARGEST)
        begun = time.perf_counter()
        if touching != self._contacts.vertices:
            self._contacts.vertices = touching
            self._assign(self._handles)
        with one_blas_thread():
            state = self._search.restart(energy.unknowns(code, rotation, t))
            return self._pose(begun, state, 0, self._surface.relaxed(state))

    def _checked_contacts(self, contacts: Sequence[int]) -> list[int]:
        """Contacts with the floor among the vertices of the surface without seams."""
        vertices = self.model.reference.vertices
        found = checked_indices(contacts, "contacts", len(vertices), what="vertex").tolist()
        if len(found) > MOST_CONTACTS:
            raise InputError(
                f"contacts: expected at most {MOST_CONTACTS} vertices, got {len(found)}; leave "
                "them out"
            )
        closed = [closed_point(self.model, vertex) for vertex in found]
        return [v for v in closed if isinstance(v, int)] if self._contacts.floor else []

    def relax(self) -> Pose:
        """The pose of the last solution, its rigid relaxation run anew until it ends (`restore`).

        Raises:
            InputError: nothing has been solved yet.
        """
        if self.solution is None:
            raise InputError("the solver has no solution yet to relax; call solve first")
        begun = time.perf_counter()
        with one_blas_thread():
            state = self._search.exact()
            return self._pose(begun, state, 0, self._surface.relaxed(state))

    def _code(self, z: ArrayLike, name: str) -> FloatArray:
        return checked_array(z, name, (self.model.components,), largest=LARGEST).copy()

    def solve(self, warm: bool = False) -> Pose:
        """Solve for the pose of the present handles.

        Args:
            warm: true to start from the last solution alone, for a frame of a drag. Otherwise
                several starts are tried, and the result does not depend on what was solved before.
                While the handles of a large mesh move (20,000 vertices or more), warm solves
                compute nodes that all vertices follow, with exact handles at their targets: of the
                same code, the pose is about 0.1 % of the bounding diagonal from that of all
                vertices. With unchanged targets they compute all vertices.
                Warm solves with unchanged targets converge; then the rigid relaxation runs to its
                end, a few rounds a call; then they try those starts, too, one a call, until
                `at_rest`.
        """
        begun = time.perf_counter()
        search, surface = self._search, self._surface
        with one_blas_thread():
            if warm and self.solution is not None:
                self._touch()
                state, steps = search.warm(explore=surface.rests)
                if search.jumped:
                    vertices = surface.relaxed(state)
                elif search.stayed:
                    vertices = surface.settled(state)
                else:
                    vertices = surface.frame(state)
            else:
                state, steps = search.cold()
                vertices = surface.relaxed(state)
                for _ in range(_FLOOR_ROUNDS):
                    self._free = vertices
                    if not self._touch():
                        break
                    state, more = search.cold()
                    vertices, steps = surface.relaxed(state), steps + more
            return self._pose(begun, state, steps, vertices)

    @property
    def at_rest(self) -> bool:
        """True once further warm solves of the present handles would change nothing.

        The pose is then that of `relax`.
        """
        rests = self._search.at_rest and self._surface.rests
        return rests and self._contacts.chosen(self._free) == self._contacts.vertices

    def solve_to_convergence(self, solves: int = 8) -> Pose:
        """Solve from the last solution, again and again until the energy no longer falls.

        For frames that arrive one by one: it stays in the minimum of the last solution, and the
        rigid relaxation runs anew until it ends, as in `relax`. Without a last solution it is one
        cold solve.

        Args:
            solves: largest number of warm solves.
        """
        checked_integer(solves, "solves", least=1)
        if self.solution is None:
            return self.solve()
        begun, steps, before = time.perf_counter(), 0, np.inf
        with one_blas_thread():
            for _ in range(solves):
                self._touch()
                state, more = self._search.warm(explore=False)
                steps += more
                if self._contacts.floor is not None:
                    self._free = self._surface.frame(state)
                if state.energy > before * (1.0 - _CONVERGED):
                    break
                before = state.energy
            state = self._search.exact()
            return self._pose(begun, state, steps, self._surface.relaxed(state))

    def drag(
        self, vertex: Point, position: ArrayLike, orientation: ArrayLike | None = None
    ) -> Pose:
        """Move the target of one handle and solve from the last solution.

        Args:
            vertex: index of the handle's vertex, or its `SurfacePoint`.
            position: (3,) new target, in the data's units.
            orientation: new orientation, as in `set_handles`; None leaves it as it is.

        Raises:
            InputError: `vertex` has no handle, or one that is a pin, or the position is not 3
                finite numbers in reach, or the orientation is no rotation.
        """
        if not isinstance(vertex, SurfacePoint):
            vertex = checked_integer(vertex, "vertex")
        (vertex,) = check_points(self.model, [vertex])
        position = checked_array(position, "position", (3,))
        indices = [h for h, handle in enumerate(self._handles) if handle.vertex == vertex]
        if not indices:
            raise InputError(
                f"vertex {vertex} has no handle; handles are at "
                f"{[handle.vertex for handle in self._handles]}"
            )
        if any(self._handles[h].kind == "pin" for h in indices):
            raise InputError(
                f"vertex {vertex} is a pin, which drags leave where it is; set_handles moves it, "
                'or makes it "exact"'
            )
        check_target(position, self.energy.centroid, self.energy.diagonal)
        target = (float(position[0]), float(position[1]), float(position[2]))
        changes: dict[str, Any] = {"target": target}
        if orientation is not None:
            changes["orientation"] = orientation
        moved = self.handles
        for h in indices:
            moved[h] = replace(moved[h], **changes)
        self._assign(moved)
        return self.solve(warm=True)

    def _assign(self, handles: list[Handle]) -> None:
        """Replace the handles; a point with several has the weighted mean of their targets."""
        if [handle.vertex for handle in handles] != [handle.vertex for handle in self._handles]:
            faces = self.basis.model.reference.faces
            self._places = SurfacePoints([self._point(handle) for handle in handles], faces)
        rows = [row for handle in handles for row in self._rows(handle)]
        self._handles = handles
        contacts = self._contacts.vertices
        wanted = list(dict.fromkeys([*(row[0] for row in rows), *contacts]))
        if set(wanted) != set(self.basis.points):
            self.basis.set_points(_keeping_indices(self.basis.points, wanted))
            self._search.vertices_changed()
        points = self.basis.points
        index = {point: n for n, point in enumerate(points)}
        weights = np.zeros(len(points))
        targets, gaps = np.zeros((2, len(points), 3))
        hard = np.zeros(len(points), dtype=bool)
        for point, target, weight, gap, is_hard in rows:
            n = index[point]
            weights[n] += weight
            targets[n] += weight * np.array(target)
            gaps[n] += weight * np.array(gap)
            hard[n] |= is_hard
        touching = np.array([index[vertex] for vertex in contacts], dtype=np.int64)
        idle = touching[weights[touching] == 0]
        weights[idle] = _NO_WEIGHT
        targets[idle] = (
            _NO_WEIGHT * self.basis.model.reference.vertices[[points[n] for n in idle.tolist()]]
        )
        if points:
            targets /= weights[:, None]
            gaps /= weights[:, None]
        misfit = self.model.misfit_of(len(handles)) if self._misfit is None else self._misfit
        floor = self._contacts.floor
        term = (
            FloorTerm(floor, touching, self.energy.diagonal)
            if floor is not None and contacts
            else None
        )
        self._search.set_targets(targets - gaps, weights, misfit, term)
        self._surface.set_exact(hard, gaps)

    def _rows(self, handle: Handle) -> list[tuple[RowPoint, ArrayLike, float, ArrayLike, bool]]:
        """Points, targets, weights and gaps by which a handle enters the energy; true if exact."""
        floor = self._contacts.floor
        goal = np.array(handle.target) if floor is None else floor.above(handle.target)
        if handle.orientation is None:
            return [(self._point(handle), goal, handle.weight, handle.gap, handle.hard)]
        frame = self._frame(handle)
        targets = frame.targets(goal, np.array(handle.orientation))
        return [
            (point, target, handle.weight / len(targets), handle.gap, handle.hard)
            for point, target in zip(frame.points, targets, strict=True)
        ]

    def _point(self, handle: Handle) -> Point:
        """The place of a handle on the surface without seams."""
        return closed_point(self.model, handle.vertex)

    def _frame(self, handle: Handle) -> LocalFrame:
        return self.basis.frames.of(self._point(handle), handle.orientation_weight)

    def _turned(self, vertices: FloatArray) -> FloatArray:
        """Angles (H,) from the surface's rotation around each handle to its orientation."""
        found = np.full(len(self._handles), np.nan)
        for h, handle in enumerate(self._handles):
            if handle.orientation is not None:
                R = self._frame(handle).rotation(vertices)
                found[h] = turned_by(R, np.array(handle.orientation))
        return found

    def _pose(self, begun: float, state: State, steps: int, vertices: FloatArray) -> Pose:
        self._free = vertices
        if self._contacts.floor is not None:
            vertices = self._contacts.floor.above(vertices)
        energy, x = self.energy, Unknowns(state.x)
        targets = np.array([handle.target for handle in self._handles]).reshape(-1, 3)
        places = self._places.at(vertices)
        return Pose(
            vertices=self.model.seams.open(vertices),
            z=energy.code(state.x),
            rotation=x.rotation.copy(),
            translation=energy.diagonal * x.translation,
            residual=np.linalg.norm(places - targets, axis=1),
            orientation_residual=self._turned(vertices),
            iterations=steps,
            milliseconds=1000.0 * (time.perf_counter() - begun),
            prior_distance=float(np.linalg.norm(x.code)),
            energy=state.energy,
            contacts=tuple(self.model.seams.first[self._contacts.vertices].tolist()),
        )


def _check_parameters(noise: float | None, misfit: float | None) -> None:
    """Raise InputError for a number that is not positive, or 0 or more; None is not checked."""
    if misfit is not None:
        checked_number(misfit, "misfit", least=0, most=LARGEST)
    if noise is not None:
        checked_number(noise, "noise", above=0, most=LARGEST)


def _keeping_indices(current: list[RowPoint], wanted: list[RowPoint]) -> list[RowPoint]:
    """The wanted points, as many of them as possible at the index that they have in `current`."""
    kept = [v if v in set(wanted) else None for v in current[: len(wanted)]]
    kept += [None] * (len(wanted) - len(kept))
    new = iter([v for v in wanted if v not in set(kept)])
    return [next(new) if v is None else v for v in kept]
