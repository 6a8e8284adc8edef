"""Fits a model to a sequence of handle frames, such as motion-capture markers.

All frames of a window are solved for together (`SequenceEnergy`). Penalising squared accelerations
of the unknowns reduces jitter; since earlier and later frames count alike, it adds no lag. A frame
in which no handle is seen follows its neighbours: the prior has hardly any weight there. Without
that penalty each frame is solved for on its own (`SeparateFrames`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deformer.checks import (
    LARGEST,
    check_memory,
    checked_array,
    checked_choice,
    checked_indices,
    checked_instance,
    checked_integer,
    checked_number,
    checked_path,
)
from deformer.editing import sequence_windows as windows
from deformer.editing.bodies import Body
from deformer.editing.energy import HandleEnergy
from deformer.editing.finished_windows import FinishedWindows, check_windows
from deformer.editing.fit_memory import sequence_memory
from deformer.editing.floor import Floor
from deformer.editing.handles import LEAST_SEQUENCE_NOISE, Kind, Point, Pose
from deformer.editing.sequence_windows import FittedFrames, Progress, WindowFits, fits_above
from deformer.editing.solver import HandleSolver
from deformer.editing.target_warnings import TargetWarnings
from deformer.editing.track_source import TrackSource, checked_tracks
from deformer.editing.units import FRAMES as UNIT_FRAMES
from deformer.editing.unknowns import Unknowns
from deformer.errors import InputError
from deformer.geometry import FloatArray, Seams, SurfacePoints
from deformer.linalg import check_device
from deformer.model import DeformationModel
from deformer.workspace import LEAST_MEMORY, StoredArray, Workspace

# Frames whose automatic noise decides that of a sequence.
_NOISE_FRAMES = 3
# Bytes: all that a fit in memory takes was checked before.
_UNLIMITED = 1e15


@dataclass(frozen=True, eq=False)
class SequenceFit:
    """F fitted frames of a sequence. Lengths are in the data's units, arrays float64.

    Args:
        vertices: (F, V, 3) positions.
        z: (F, K) latent codes.
        rotation: (F, 3) rotation vectors of the rigid motion about the reference's centroid,
            radians.
        translation: (F, 3) translations of the rigid motion.
        residual: (F, H) distances from handle to target; NaN where a handle has no weight.
        orientation_residual: (F, H) angles from the surface's rotation around each handle to its
            orientation, in radians; NaN where it has none, or no weight.
        prior_distance: (F,) Mahalanobis distances of the codes from the prior's means.
        iterations: Gauss–Newton steps of whole windows taken, or, without smoothness, of the frame
            that took most; those of parts of a sequence add up.
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
    gaps: ArrayLike | None = None,
    floor: Floor | None = None,
    smoothness: float = 10.0,
    key_frames: ArrayLike | None = None,
    rigid: bool = True,
    noise: float | None = None,
    mean: ArrayLike | None = None,
    freedom: float | Body = 1.0,
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
        gaps: (H, 3) or (F, H, 3) vectors from where the codes' shapes are to be to the targets, as
            in `Handle`; None is zeros.
        floor: a plane that no vertex passes in any frame, as in `HandleSolver.set_floor`; None is
            none.
        smoothness: weight of squared accelerations, 0 or more. For motion that is slow for its
            frame rate, 100 and more are suitable. 0 fits every frame on its own, to the end and on
            the CPU: it is then the pose of a `HandleSolver`.
        key_frames: indices of frames, such as those that an animator has posed. Without smoothness
            each is solved for from several starts, as `HandleSolver.solve` does, and the others
            between them; None has the fit choose some, solved one after the other. With smoothness
            they are ignored.
        rigid: as in `HandleSolver`.
        noise: as in `HandleSolver`. None is the median of what it chooses for a few frames, but at
            least 0.007: with less the descent over all frames stalls (docs/evidence/prior.md).
            Without smoothness it is what each frame asks for.
        mean: (K,) or (F, K) latent codes that are the prior's means in place of the model's; a
            frame without handles is then near its own. None is the model's, in all frames.
        freedom: as in `HandleSolver`, but never None; with 1, or "moves", a motion goes anywhere.
        misfit: as in `HandleSolver`. What codes miss at the handles changes smoothly in time
            (`MisfitTrack`), where they are seen and where they are not.
        relaxation: rounds of rigid relaxation in each frame with hard handles, or of a model with a
            misfit.
        device: "cpu", "cuda", "mps" or "auto" (cuda or mps if there is one, else cpu).
        backend: "numba", which uses all cores of the CPU, or "torch", which computes many frames
            at once on any device; None is numba on the CPU and torch on every other device.
        on_progress: called with the number of frames done and the number of all frames, and with
            the same numbers after every step in between; an exception that it raises ends the fit.
            Frames that pass the floor are fitted again, and counted from 0.

    Raises:
        InputError: shapes of arrays that disagree, an index out of range, a vertex given twice, a
            target that is not finite, a negative weight or smoothness, a key frame that does not
            exist, a mean of another length, a freedom that is not positive, an orientation that is
            no rotation or at a point that cannot have one, a gap that is not finite, no floor, a
            device that is unknown or missing, or a backend that cannot use it.
    """
    parts = fit_sequence_parts(
        model,
        vertices,
        targets,
        weights=weights,
        hard=hard,
        kinds=kinds,
        orientations=orientations,
        orientation_weights=orientation_weights,
        gaps=gaps,
        floor=floor,
        smoothness=smoothness,
        key_frames=key_frames,
        rigid=rigid,
        noise=noise,
        mean=mean,
        freedom=freedom,
        misfit=misfit,
        relaxation=relaxation,
        device=device,
        backend=backend,
        workspace=Workspace(_UNLIMITED),
        on_progress=on_progress,
    )
    F, V = len(np.asarray(targets)), len(model.reference.vertices)
    check_memory(24 * F * V, f"targets: {F} frames of {V} vertices")
    shapes, found, done = np.empty((F, V, 3)), [], 0
    for part in parts:
        shapes[done : done + len(part.vertices)] = part.vertices
        done += len(part.vertices)
        found.append(replace(part, vertices=shapes[:0]))
    joined = {field.name: [getattr(part, field.name) for part in found] for field in _ARRAYS}
    arrays = {name: np.concatenate(values) for name, values in joined.items()}
    iterations = sum(part.iterations for part in found)
    return SequenceFit(**{**arrays, "vertices": shapes}, iterations=iterations)


# Fields of a `SequenceFit` that have a row a frame.
_ARRAYS = [field for field in fields(SequenceFit) if field.name != "iterations"]


def fit_sequence_parts(
    model: DeformationModel,
    vertices: ArrayLike | Sequence[Point],
    targets: ArrayLike | StoredArray,
    *,
    weights: ArrayLike | StoredArray | None = None,
    hard: ArrayLike | StoredArray = False,
    kinds: Kind | Sequence[Kind] | None = None,
    orientations: ArrayLike | Sequence[Sequence[ArrayLike | None]] | StoredArray | None = None,
    orientation_weights: ArrayLike | None = None,
    gaps: ArrayLike | StoredArray | None = None,
    floor: Floor | None = None,
    smoothness: float = 10.0,
    key_frames: ArrayLike | None = None,
    rigid: bool = True,
    noise: float | None = None,
    mean: ArrayLike | None = None,
    freedom: float | Body = 1.0,
    misfit: float | None = None,
    relaxation: int = 2,
    device: str = "cpu",
    backend: str | None = None,
    checkpoint: str | Path | None = None,
    workspace: Workspace | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> Iterator[SequenceFit]:
    """Fit a model to frames of handle targets, and give some frames at a time.

    The frames are those of `fit_sequence`, to the last bit. The memory that the fit takes does not
    depend on the number of frames, except with a floor, which all frames are fitted for before the
    first is given: their shapes are then in the workspace.

    Args:
        model, vertices, orientation_weights, kinds, floor, smoothness, key_frames, rigid, noise,
            mean, freedom, misfit, relaxation, device, backend, on_progress: as in `fit_sequence`.
        targets, weights, hard, orientations, gaps: as in `fit_sequence`, or arrays in files
            (`StoredArray`) that have all F frames; orientations in a file are matrices.
        checkpoint: folder in which windows that are fitted are kept, or None. A later fit of the
            same arguments goes on from them, with the same result, however the process ended;
            `remove_windows` removes them.
        workspace: keeps memory for what `sequence_memory` tells, and has shapes that are needed
            again; None has half of the free memory.

    Returns:
        Some frames at a time, in their order.

    Raises:
        InputError: as `fit_sequence` raises; less memory than `sequence_memory` tells; or a
            checkpoint that holds other files or is damaged.
    """
    tracks = checked_tracks(
        model, vertices, targets, weights, hard, kinds, orientations, orientation_weights, gaps
    )
    checked_number(smoothness, "smoothness", least=0, most=LARGEST)
    checked_integer(relaxation, "relaxation", least=0)
    if backend is not None:
        checked_choice(backend, "backend", ("numba", "torch"))
    check_device(device)  # before the solver, which may compile kernels
    if freedom is None:
        raise InputError("freedom: expected a number or the name of a body, got None; leave it out")
    if floor is not None:
        checked_instance(floor, "floor", Floor, remedy="make a Floor, or give None")
    if workspace is not None:
        checked_instance(workspace, "workspace", Workspace, remedy="make a Workspace")
    keys: list[int] = []
    if key_frames is not None:
        keys = sorted(checked_indices(key_frames, "key_frames", len(tracks), what="frame").tolist())
    work = workspace or Workspace()
    V, K, H = len(model.reference.vertices), model.components, len(tracks.points)
    needed = sequence_memory(V, K, H).least - LEAST_MEMORY
    work.reserve(needed, f"fit: {H} handles, {K} components, {V} vertices")
    means = _checked_means(mean, len(tracks), model.components)
    folder = None if checkpoint is None else checked_path(checkpoint, "checkpoint")
    if folder is not None:
        check_windows(folder)
    seams, fingerprint, model = model.seams, model.fingerprint, model.closed
    solver = HandleSolver(model, rigid=rigid, noise=noise, freedom=freedom, misfit=misfit)
    _warn_of_units(model, tracks)
    lifted = tracks.above(floor)
    seen = lifted.seen
    if not smoothness > 0 and any(seen[key] for key in keys if key < windows.WINDOW):
        # Key frames find their own starts.
        at, first = 0, np.zeros(solver.energy.size)
    else:
        at, first = _first_guess(solver, lifted, means)
    own_noise = noise is None and not smoothness > 0
    if own_noise:
        solver.set_prior(noise=model.handle_noise)
    elif noise is None:
        solver.set_prior(noise=_noise(solver, lifted, means))
    energy = replace(solver.energy, errors=None)
    centres = None if means is None else _whitened(means, energy)
    if centres is not None:
        Unknowns(first).code += centres(slice(at, at + 1))[0]
    used = model.misfit_of(len(tracks.points)) if misfit is None else misfit
    identity: dict[str, Any] = {}
    if folder is not None:
        identity = {
            "model": fingerprint,
            "handles": lifted.digest(),
            "means": "" if means is None else sha256(np.ascontiguousarray(means).data).hexdigest(),
            "floor": None if floor is None else [floor.height, *floor.normal],
            "key_frames": keys,
            "options": [
                smoothness,
                rigid,
                energy.noise,
                own_noise,
                freedom,
                used,
                device,
                backend or "",
            ],
            "windows": windows.sizes(),
        }
    fits = WindowFits(
        solver.basis,
        energy,
        first,
        lifted,
        centres,
        smoothness,
        keys,
        own_noise,
        used,
        relaxation,
        device,
        backend,
        Progress(len(tracks), on_progress),
        FinishedWindows(folder, identity),
    )
    return _Parts(tracks, fits, floor, seams).fitted(work)


@dataclass(frozen=True, eq=False)
class _Parts:
    """A sequence that is to be fitted.

    Args:
        tracks: the handles as they were given.
        fits: of the windows.
        floor: as in `fit_sequence`.
        seams: of the model that was given.
    """

    tracks: TrackSource
    fits: WindowFits
    floor: Floor | None
    seams: Seams

    def fitted(self, workspace: Workspace) -> Iterator[SequenceFit]:
        """Fit the frames; some are given at a time."""
        faces = self.fits.basis.model.reference.faces
        places = SurfacePoints(self.tracks.points, faces)
        for part in fits_above(self.floor, self.fits, workspace):
            yield self._described(part, places)

    def _described(self, part: FittedFrames, places: SurfacePoints) -> SequenceFit:
        energy, found = self.fits.energy, Unknowns(part.X)
        tracks, shapes = self.tracks.part(part.frames), part.shapes
        seen = tracks.weights > 0
        residual = np.linalg.norm(places.at(shapes) - tracks.targets, axis=2)
        turned = tracks.turned(self.fits.basis.frames, shapes)
        apart = found.code
        if self.fits.centres is not None:
            apart = apart - self.fits.centres(part.frames)
        return SequenceFit(
            vertices=self.seams.open(shapes),
            z=energy.codes(part.X),
            rotation=found.rotation.copy(),
            translation=energy.diagonal * found.translation,
            residual=np.where(seen, residual, np.nan),
            orientation_residual=np.where(seen, turned, np.nan),
            prior_distance=np.linalg.norm(apart, axis=1),
            iterations=part.steps,
        )


def _warn_of_units(model: DeformationModel, tracks: TrackSource) -> None:
    """Log the `unit_warning` of the targets, by as many frames as it looks at."""
    seen = np.flatnonzero(tracks.seen)
    if len(seen):
        spaced = np.unique(np.linspace(0, len(seen) - 1, UNIT_FRAMES).astype(int))
        targets, visible = tracks.frames(seen[spaced].tolist())
        shown = np.where(visible[..., None], targets, np.nan)
        TargetWarnings(model).of_units(tracks.points, shown)


def _checked_means(mean: ArrayLike | None, frames: int, components: int) -> FloatArray | None:
    """Means (F, K) of the prior, of one (K,) or F of them; None where none are given.

    Raises:
        InputError: another shape, or numbers that are not finite.
    """
    if mean is None:
        return None
    codes = checked_array(mean, "mean", largest=LARGEST)
    if codes.shape not in ((components,), (frames, components)):
        raise InputError(
            f"mean: expected ({components},) or ({frames}, {components}), got {codes.shape}; give "
            "one latent code, or one a frame"
        )
    return np.broadcast_to(codes, (frames, components))


def _whitened(means: FloatArray, energy: HandleEnergy) -> Callable[[slice], FloatArray]:
    """What gives whitened codes (m, K) of the means (F, K) of the frames of a slice."""

    def of(frames: slice) -> FloatArray:
        apart = (means[frames] - energy.prior.mean).T
        return np.asarray(np.linalg.solve(energy.factor, apart).T, dtype=np.float64)

    return of


def _first_guess(
    solver: HandleSolver, tracks: TrackSource, means: FloatArray | None
) -> tuple[int, FloatArray]:
    """A frame, and its unknowns (K+6,) about its own mean, by a solve from several starts.

    It is the first frame that sees at least half as many handles as any frame of the first window.
    """
    counts = tracks.seen[: windows.WINDOW]
    frame = int((2 * counts >= counts.max()).argmax())
    pose = _solve_frame(solver, tracks, frame, means)
    energy = solver.energy
    return frame, energy.unknowns(pose.z, pose.rotation, pose.translation / energy.diagonal)


def _noise(solver: HandleSolver, tracks: TrackSource, means: FloatArray | None) -> float:
    """Noise of a sequence: the median of a few frames' automatic noises, or the least one."""
    seen = np.flatnonzero(tracks.seen)
    if not len(seen):
        return LEAST_SEQUENCE_NOISE
    noises = []
    for frame in np.unique(seen[np.linspace(0, len(seen) - 1, _NOISE_FRAMES).astype(int)]):
        _solve_frame(solver, tracks, int(frame), means)
        noises.append(solver.energy.noise)
    return max(LEAST_SEQUENCE_NOISE, float(np.median(noises)))


def _solve_frame(
    solver: HandleSolver, source: TrackSource, frame: int, means: FloatArray | None
) -> Pose:
    """Pose of the handles of one frame that are seen, with the frame's mean."""
    if means is not None:
        solver.set_prior(mean=means[frame])
    tracks = source.part(slice(frame, frame + 1))
    seen = np.flatnonzero(tracks.weights[0] > 0)
    solver.set_handles(
        [tracks.points[h] for h in seen],
        tracks.targets[0, seen],
        tracks.weights[0, seen],
        orientations=tracks.orientations[0, seen],
        orientation_weights=tracks.orientation_weights[seen],
        gaps=tracks.gaps[0, seen],
        check_units=False,  # of all frames together it is known
    )
    return solver.solve()
