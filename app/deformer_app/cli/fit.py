"""`deformer fit`: a model fitted to the handles of a file, and a record of the fit."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import deformer
from deformer import io

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deformer import DeformationModel


# Frames of a sequence by which warnings are decided.
_SPACED = 25
# Smoothness and rounds of relaxation of sequences whose file tells neither.
_SMOOTHNESS, _RELAXATION = 10.0, 2


@dataclass(frozen=True)
class Options:
    """Options of the command line that a fit has; None leaves what the file says."""

    hard: bool = False
    noise: float | None = None
    smoothness: float | None = None
    device: str = "cpu"
    backend: str | None = None


def handles_of(
    model: DeformationModel, path: Path, workspace: deformer.Workspace | None = None
) -> io.HandleFile:
    """The contents of a handles file for a model.

    Args:
        model: the model.
        path: the file.
        workspace: where the frames of a sequence are; None has them in memory.

    Raises:
        InputError: it cannot be read, or belongs to another model.
    """
    reference = model.reference
    file = io.load_handles(
        path, len(reference.vertices), reference.faces, model.components, workspace
    )
    file.check_model(path, model.fingerprint)
    return file


def fit_task(
    model: DeformationModel, handles: io.HandleFile, noise: float | None, options: Options
) -> Generator[None, None, tuple[NDArray, dict[str, Any]]]:
    """A fit of `pose` or `sequence` as a task of an executor, which has no parts."""
    yield from ()
    if not handles.is_sequence:
        return pose(model, handles, options.hard, noise)
    return sequence(
        model,
        handles,
        hard=options.hard,
        noise=noise,
        smoothness=options.smoothness,
        device=options.device,
        backend=options.backend,
        progress=lambda done, total: None,
    )


def chosen_noise(option: float | None, handles: io.HandleFile) -> float | None:
    """Standard deviation of positions: the option's, else the file's; None if neither tells it."""
    if option is None:
        return handles.noise
    if not 0 < option < math.inf:
        raise deformer.InputError(
            f"--noise: expected a finite number above 0, got {option}; leave it out for exact "
            "positions"
        )
    return option


def pose(
    model: DeformationModel, handles: io.HandleFile, hard: bool, noise: float | None
) -> tuple[NDArray, dict[str, Any]]:
    """Vertices (V, 3) of a pose fitted to the first frame's handles, and the fit's record.

    With a start, the pose comes to rest from it, as in the viewer (`deformer.solve_to_rest`).
    `noise` is the standard deviation of the positions' coordinates, if it is known.
    """
    frame, prior, start = handles.frames[0], handles.prior, handles.start
    used = prior.noise if noise is None else deformer.target_noise(model, noise)
    solver = deformer.HandleSolver(model, noise=used, freedom=prior.body)
    solver.set_prior(mean=prior.mean)
    if handles.floor is not None:
        solver.set_floor(deformer.Floor.at(model, handles.floor))
    solver.set_handles(
        [handle.vertex for handle in frame],
        [handle.position for handle in frame],
        weights=[handle.weight for handle in frame],
        kinds="exact" if hard else [handle.kind for handle in frame],
        orientations=[handle.orientation for handle in frame],
        orientation_weights=[handle.orientation_weight for handle in frame],
        gaps=[handle.gap for handle in frame],
    )
    if start is not None:
        solver.restore(start.z, start.rotation, start.translation, start.contacts)
        found = deformer.solve_to_rest(solver)
    else:
        found = solver.solve()
    return found.vertices, describe(found)


def describe(found: deformer.Pose) -> dict[str, Any]:
    """Code, residuals, iterations, time and prior distance of a pose.

    Residuals of orientations, in radians, are there if a handle has one.
    """
    return {
        "z": found.z,
        **_residuals(found.residual, found.orientation_residual),
        "iterations": found.iterations,
        "milliseconds": found.milliseconds,
        "prior_distance": found.prior_distance,
    }


def unit_warning(model: DeformationModel, handles: io.HandleFile) -> str | None:
    """A warning if the targets are most likely in other units than the model; else None."""
    seen = [n for n, frame in enumerate(handles.frames) if frame]
    return deformer.unit_warning(model, *_spaced(handles, seen))


def axis_warning(model: DeformationModel, handles: io.HandleFile) -> str | None:
    """A warning if the targets most likely have other axes than the model; else None."""
    return deformer.axis_warning(model, *_spaced(handles, range(len(handles.frames))))


def _spaced(
    handles: io.HandleFile, frames: Sequence[int]
) -> tuple[list[int | deformer.SurfacePoint], NDArray]:
    """Points of some frames, evenly spread, and their targets (F, H, 3), NaN where not seen."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, _SPACED).astype(int)).tolist()
    tracks = io.handle_tracks([handles.frames[frames[n]] for n in chosen])
    return tracks.points, tracks.seen(slice(None))


def sequence(
    model: DeformationModel,
    handles: io.HandleFile,
    *,
    hard: bool,
    noise: float | None,
    smoothness: float | None,
    device: str,
    backend: str | None,
    progress: Callable[[int, int], None],
) -> tuple[NDArray, dict[str, Any]]:
    """Vertices (F, V, 3) fitted to the handles of F frames, and the fit's record with `frames`.

    `noise` as in `pose`; a smoothness of None is what the file tells, or 10.
    """
    options = Options(hard, noise, smoothness, device, backend)
    record = _Record(frames=True)
    found = deformer.fit_sequence(
        model, **_arguments(model, handles, io.handle_tracks(handles.frames), options, progress)
    )
    record.add(found)
    return found.vertices, record.told()


def stored_sequence(
    model: DeformationModel,
    handles: io.HandleFile,
    options: Options,
    *,
    workspace: deformer.Workspace,
    checkpoint: Path | None,
    frames: bool,
    progress: Callable[[int, int], None],
) -> tuple[deformer.MeshSequence | deformer.StoredShapes, dict[str, Any]]:
    """`sequence` within a limit of memory: the shapes, and the fit's record.

    Args:
        model, handles, options: as in `sequence`.
        workspace: where arrays are.
        checkpoint: folder of windows that are fitted, or None.
        frames: true for a record with `frames`, which takes memory for each.
        progress: called with the frames that are fitted, and all frames.
    """
    reference, F = model.reference, len(handles.frames)
    record, done = _Record(frames), 0
    tracks = io.handle_tracks(handles.frames, workspace)
    parts = deformer.fit_sequence_parts(
        model,
        **_arguments(model, handles, tracks, options, progress),
        checkpoint=checkpoint,
        workspace=workspace,
    )
    vertices = workspace.doubles((F, len(reference.vertices), 3))
    for part in parts:
        vertices[done : done + len(part.vertices)] = part.vertices
        done += len(part.vertices)
        record.add(part)
    if isinstance(vertices, np.ndarray):
        vertices.setflags(write=False)  # else it would be copied
        return deformer.MeshSequence(vertices, reference.faces), record.told()
    return deformer.StoredShapes(vertices, reference.faces), record.told()


def _arguments(
    model: DeformationModel,
    handles: io.HandleFile,
    tracks: io.HandleTracks,
    options: Options,
    progress: Callable[[int, int], None],
) -> dict[str, Any]:
    """Arguments of `fit_sequence` and of `fit_sequence_parts`, but the model."""
    prior, noise, smoothness = handles.prior, options.noise, options.smoothness
    told = _SMOOTHNESS if handles.smoothness is None else handles.smoothness
    return {
        "vertices": tracks.points,
        "targets": tracks.targets,
        "weights": tracks.weights,
        "hard": True if options.hard else tracks.hard,
        "orientations": tracks.orientations,
        "orientation_weights": tracks.orientation_weights,
        "gaps": tracks.gaps,
        "floor": None if handles.floor is None else deformer.Floor.at(model, handles.floor),
        "smoothness": told if smoothness is None else smoothness,
        "key_frames": handles.key_frames,
        "noise": prior.noise
        if noise is None
        else deformer.target_noise(model, noise, sequence=True),
        "mean": prior.mean if prior.means is None else prior.means,
        "freedom": prior.body or "moves",
        "relaxation": _RELAXATION if handles.relaxation is None else handles.relaxation,
        "device": options.device,
        "backend": options.backend,
        "on_progress": progress,
    }


class _Record:
    """The record of a sequence's fit, made of its parts.

    Args:
        frames: true to have a record of each frame, too.
    """

    def __init__(self, frames: bool) -> None:
        """Start the time."""
        self._begun = time.perf_counter()
        self._frames: list[dict[str, Any]] | None = [] if frames else None
        self._distances, self._angles = _Errors(), _Errors()
        self._iterations, self._prior_distance = 0, 0.0

    def add(self, part: deformer.SequenceFit) -> None:
        """Add frames."""
        self._distances.add(part.residual)
        self._angles.add(part.orientation_residual)
        self._iterations += part.iterations
        self._prior_distance = max(self._prior_distance, float(part.prior_distance.max()))
        if self._frames is not None:
            columns = part.z, part.residual, part.orientation_residual, part.prior_distance
            self._frames += [
                {"z": z, **_residuals(residual, angles), "prior_distance": distance}
                for z, residual, angles, distance in zip(*columns, strict=True)
            ]

    def told(self) -> dict[str, Any]:
        """The record."""
        return {
            **_summaries(self._distances, self._angles),
            "iterations": self._iterations,
            "milliseconds": 1000.0 * (time.perf_counter() - self._begun),
            "prior_distance": self._prior_distance,
            **({} if self._frames is None else {"frames": self._frames}),
        }


class _Errors:
    """Root mean square and largest of errors that are added, without those that are NaN."""

    def __init__(self) -> None:
        """Start without any."""
        self._squares, self._count, self.largest = 0.0, 0, 0.0

    def add(self, errors: NDArray) -> None:
        """Add errors."""
        seen = errors[~np.isnan(errors)]
        if len(seen):
            self._squares += float((seen**2).sum())
            self._count += len(seen)
            self.largest = max(self.largest, float(seen.max()))

    @property
    def rms(self) -> float | None:
        """The root mean square; None without errors."""
        return math.sqrt(self._squares / self._count) if self._count else None


def _residuals(distances: NDArray, angles: NDArray) -> dict[str, float | None]:
    """Root mean square and largest of the distances, NaN for a handle that is not seen.

    They are None for a frame in which no handle is seen. The same of angles follows, NaN for a
    handle without an orientation, if there are any.
    """
    summaries = _Errors(), _Errors()
    for summary, errors in zip(summaries, (distances, angles), strict=True):
        summary.add(errors)
    return _summaries(*summaries)


def _summaries(distances: _Errors, angles: _Errors) -> dict[str, float | None]:
    seen = distances.rms is not None
    found = {
        "residual_rms": distances.rms,
        "max_residual": distances.largest if seen else None,
    }
    if angles.rms is not None:
        found |= {"orientation_rms": angles.rms, "max_orientation": angles.largest}
    return found
