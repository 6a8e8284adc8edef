"""Fits a model to a sequence of handle frames, such as motion-capture markers.

All frames of a window are solved for together (`SequenceEnergy`). Penalising squared accelerations
of the unknowns reduces jitter; since earlier and later frames count alike, it adds no lag. A frame
in which no handle is seen follows its neighbours: the prior has hardly any weight there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import (
    LARGEST,
    check_memory,
    checked_choice,
    checked_integer,
    checked_number,
)
from deformer.editing.batch_numba import Frames, NumbaFrames
from deformer.editing.energy import HandleEnergy
from deformer.editing.green_functions import HandleBasis
from deformer.editing.handles import LEAST_SEQUENCE_NOISE, Kind, Point, Pose
from deformer.editing.misfit_track import MisfitTrack
from deformer.editing.sequence_energy import SequenceEnergy
from deformer.editing.solver import HandleSolver
from deformer.editing.tracks import Tracks, checked_tracks
from deformer.editing.unknowns import Unknowns
from deformer.errors import InputError
from deformer.geometry import FloatArray, SurfacePoints, log_to_rotation
from deformer.linalg import check_device, one_blas_thread, resolve_device
from deformer.model import DeformationModel

# Number of frames in a window, and of frames after it that are solved for with it, and again with
# the next window.
_WINDOW = 512
_AHEAD = 32
# Frames whose automatic noise decides that of a sequence.
_NOISE_FRAMES = 3


@dataclass(frozen=True, eq=False)
class SequenceFit:
    """A fitted sequence of F frames. Lengths are in the data's units, arrays float64.

    Args:
        vertices: (F, V, 3) positions.
        z: (F, K) latent codes.
        rotation: (F, 3) rotation vectors of the rigid motion about the reference's centroid,
            radians.
        translation: (F, 3) translations of the rigid motion.
        residual: (F, H) distances from handle to target; NaN where a handle has no weight.
        orientation_residual: (F, H) angles from the surface's rotation around each handle to its
            orientation, in radians; NaN where it has none, or no weight.
        prior_distance: (F,) Mahalanobis distances of the codes from the training codes' mean.
        iterations: Gauss–Newton steps of whole windows taken.
    """

    vertices: FloatArray
    z: FloatArray
    rotation: FloatArray
    translation: FloatArray
    residual: FloatArray
    orientation_residual: FloatArray
    prior_distance: FloatArray
    iterations: int


def fit_sequence(
    model: DeformationModel,
    vertices: ArrayLike | Sequence[Point],
    targets: ArrayLike,
    *,
    weights: ArrayLike | None = None,
    hard: ArrayLike = False,
    kinds: Kind | Sequence[Kind] | None = None,
    orientations: ArrayLike | Sequence[Sequence[ArrayLike | None]] | None = None,
    orientation_weights: ArrayLike | None = None,
    smoothness: float = 10.0,
    rigid: bool = True,
    noise: float | None = None,
    misfit: float | None = None,
    relaxation: int = 2,
    device: str = "cpu",
    backend: str | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> SequenceFit:
    """Fit a model to frames of handle targets.

    Targets that are most likely in other units than the model are logged as a warning
    (`unit_warning`).

    Args:
        model: the prior.
        vertices: (H,) handle vertices, `SurfacePoint`s, or both, all different.
        targets: (F, H, 3) positions in each frame, in the data's units.
        weights: (F, H) or (H,) factors on the squared distances from the targets. In a frame in
            which a handle has the weight 0 it is not seen, and its target is ignored. None is ones.
        hard: one for all, (H,) or (F, H): true for handles that are at their targets exactly
            wherever their weight is not 0.
        kinds: one for all, or (H,), in place of `hard`: "soft", "exact" or "pin", as in
            `HandleSolver.set_handles`.
        orientations: (F, H, 4) unit quaternions (w, x, y, z) or (F, H, 3, 3) matrices, as in
            `HandleSolver.set_handles`; None, or None or NaN in a frame for a handle, for none.
        orientation_weights: (H,) as in `HandleSolver.set_handles`.
        smoothness: weight of squared accelerations, 0 or more; 0 fits every frame on its own. For
            motion that is slow for its frame rate, 100 and more are suitable.
        rigid: as in `HandleSolver`.
        noise: as in `HandleSolver`. None is the median of what it chooses for a few frames, but at
            least 0.007: with less the descent over all frames stalls (docs/prior.md).
        misfit: as in `HandleSolver`. What codes miss at the handles changes smoothly in time
            (`MisfitTrack`), where they are seen and where they are not.
        relaxation: rounds of rigid relaxation in each frame with hard handles, or of a model with a
            misfit.
        device: "cpu", "cuda", "mps" or "auto" (cuda or mps if there is one, else cpu).
        backend: "numba", which uses all cores of the CPU, or "torch", which computes many frames
            at once on any device; None is numba on the CPU and torch on every other device.
        on_progress: called with the number of frames done and the number of all frames.

    Raises:
        InputError: shapes of arrays that disagree, an index out of range, a vertex given twice, a
            target that is not finite, a negative weight or smoothness, an orientation that is no
            rotation or at a point that cannot have one, a device that is unknown or missing, or a
            backend that cannot use it.
    """
    tracks = checked_tracks(
        model, vertices, targets, weights, hard, kinds, orientations, orientation_weights
    )
    checked_number(smoothness, "smoothness", least=0, most=LARGEST)
    checked_integer(relaxation, "relaxation", least=0)
    if backend is not None:
        checked_choice(backend, "backend", ("numba", "torch"))
    check_device(device)  # before the solver, which may compile kernels
    # In a motion the body may go anywhere: the rigid motion has the diffuse prior alone.
    seams, model = model.seams, model.closed
    solver = HandleSolver(model, rigid=rigid, noise=noise, freedom=1.0, misfit=misfit)
    seen = tracks.weights > 0
    solver.warn_of_units(tracks.points, np.where(seen[..., None], tracks.targets, np.nan))
    first = _first_guess(solver, tracks)
    if noise is None:
        solver.set_prior(noise=_noise(solver, tracks))
    basis = solver.basis
    rows = tracks.rows(basis.frames)
    basis.set_points(rows.points)
    batch = _backend(basis, device, backend)
    misfit = model.misfit_of(len(tracks.points)) if misfit is None else misfit
    errors = basis.model_errors(misfit) if misfit and rows.points else None
    energy = replace(solver.energy, errors=errors)
    missed = None
    if errors is not None:
        missed = MisfitTrack(errors, energy.noise, rows.weights, smoothness)
    sequence = SequenceEnergy(energy, batch, rows.targets, rows.weights, smoothness)
    F, V = len(seen), len(model.reference.vertices)
    check_memory(24 * F * V, f"targets: {F} frames of {V} vertices")
    X = np.zeros((F, energy.size))
    out = np.empty((F, V, 3))
    steps = 0
    with one_blas_thread():
        for start in range(0, F, _WINDOW):
            stop, ahead = min(start + _WINDOW, F), min(start + _WINDOW + _AHEAD, F)
            guess = X[start - 1] if start else first
            before = X[max(0, start - 2) : start]
            window, more = sequence.solve(slice(start, ahead), guess, before)
            X[start:stop] = window[: stop - start]
            steps += more
            part = slice(start, stop)
            Q, centroids = log_to_rotation(Unknowns(X[part]).rotation), energy.centroids(X[part])
            z = energy.codes(X[part])
            wanted, reached = rows.targets[part], rows.exact[part]
            if missed is not None:
                # As in `HandleSolver`: the shape deforms by what is left of soft handles, too.
                at = _handle_positions(batch, energy, window)
                expected = missed.expected(part, rows.targets[start:ahead] - at)
                expected += at[: stop - start]
                wanted = np.where(reached[..., None], wanted, expected)
                reached = rows.used[part]
            batch.shapes(z, Q, centroids, wanted, reached, relaxation, out[part])
            if on_progress is not None:
                on_progress(stop, F)
    places = SurfacePoints(tracks.points, model.reference.faces).at(out)
    residual = np.linalg.norm(places - tracks.targets, axis=2)
    found = Unknowns(X)
    return SequenceFit(
        vertices=seams.open(out),
        z=energy.codes(X),
        rotation=found.rotation.copy(),
        translation=energy.diagonal * found.translation,
        residual=np.where(seen, residual, np.nan),
        orientation_residual=np.where(seen, tracks.turned(basis.frames, out), np.nan),
        prior_distance=np.linalg.norm(found.code, axis=1),
        iterations=steps,
    )


def _handle_positions(batch: Frames, energy: HandleEnergy, X: FloatArray) -> FloatArray:
    """Positions (m, H, 3) of handles by unknowns X (m, K+6) alone."""
    Q = log_to_rotation(Unknowns(X).rotation)
    return batch.by_all(energy.codes(X)) @ Q.transpose(0, 2, 1) + energy.centroids(X)[:, None]


def _first_guess(solver: HandleSolver, tracks: Tracks) -> FloatArray:
    """Unknowns (K+6,) to start the first frame from, by a solve from several starts.

    They are those of the first frame that sees at least half as many handles as any frame of the
    first window.
    """
    counts = (tracks.weights[:_WINDOW] > 0).sum(axis=1)
    pose = _solve_frame(solver, tracks, int((2 * counts >= counts.max()).argmax()))
    energy = solver.energy
    return energy.unknowns(pose.z, pose.rotation, pose.translation / energy.diagonal)


def _noise(solver: HandleSolver, tracks: Tracks) -> float:
    """Noise of a sequence: the median of a few frames' automatic noises, or the least one."""
    seen = np.flatnonzero((tracks.weights > 0).any(axis=1))
    if not len(seen):
        return LEAST_SEQUENCE_NOISE
    noises = []
    for frame in np.unique(seen[np.linspace(0, len(seen) - 1, _NOISE_FRAMES).astype(int)]):
        _solve_frame(solver, tracks, int(frame))
        noises.append(solver.energy.noise)
    return max(LEAST_SEQUENCE_NOISE, float(np.median(noises)))


def _solve_frame(solver: HandleSolver, tracks: Tracks, frame: int) -> Pose:
    """Pose of the handles of one frame that are seen."""
    seen = np.flatnonzero(tracks.weights[frame] > 0)
    solver.set_handles(
        [tracks.points[h] for h in seen],
        tracks.targets[frame, seen],
        tracks.weights[frame, seen],
        orientations=tracks.orientations[frame, seen],
        orientation_weights=tracks.orientation_weights[seen],
    )
    return solver.solve()


def _backend(basis: HandleBasis, device: str, backend: str | None) -> Frames:
    """`Frames` of a backend on a device; see `fit_sequence`."""
    if device == "auto" and (backend == "numba" or not basis.model.decoder.pointwise):
        device = "cpu"  # torch knows networks of one layer only
    if device != "cpu":
        device = str(resolve_device(device))
    if backend == "torch" or (backend is None and device != "cpu"):
        # torch takes seconds to import.
        from deformer.editing.batch_torch import TorchFrames

        return TorchFrames(basis, device)
    if device != "cpu":
        raise InputError(f"backend 'numba' computes on the CPU, got device {device!r}; use 'torch'")
    return NumbaFrames(basis)
