"""`deformer fit`: a model fitted to the handles of a file, and a record of the fit."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

import deformer
from deformer import io

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deformer import DeformationModel


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

    `noise` is the standard deviation of the positions' coordinates, if it is known.
    """
    frame = handles.frames[0]
    used = None if noise is None else deformer.target_noise(model, noise)
    solver = deformer.HandleSolver(model, noise=used)
    solver.set_handles(
        [handle.vertex for handle in frame],
        [handle.position for handle in frame],
        weights=[handle.weight for handle in frame],
        kinds="exact" if hard else [handle.kind for handle in frame],
        orientations=[handle.orientation for handle in frame],
        orientation_weights=[handle.orientation_weight for handle in frame],
    )
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
    points, targets, weights, *_ = _tracks(handles)
    return deformer.unit_warning(model, points, np.where(weights[..., None] > 0, targets, np.nan))


def sequence(
    model: DeformationModel,
    handles: io.HandleFile,
    *,
    hard: bool,
    noise: float | None,
    smoothness: float,
    device: str,
    backend: str | None,
    progress: Callable[[int, int], None],
) -> tuple[NDArray, dict[str, Any]]:
    """Vertices (F, V, 3) fitted to the handles of F frames, and the fit's record with `frames`.

    `noise` as in `pose`.
    """
    used = None if noise is None else deformer.target_noise(model, noise, sequence=True)
    points, targets, weights, exact, turns, turn_weights = _tracks(handles)
    begun = time.perf_counter()
    found = deformer.fit_sequence(
        model,
        points,
        targets,
        weights=weights,
        hard=exact | hard,
        orientations=turns,
        orientation_weights=turn_weights,
        smoothness=smoothness,
        noise=used,
        device=device,
        backend=backend,
        on_progress=progress,
    )
    milliseconds = 1000.0 * (time.perf_counter() - begun)
    frames = [
        {"z": z, **_residuals(residual, angles), "prior_distance": distance}
        for z, residual, angles, distance in zip(
            found.z,
            found.residual,
            found.orientation_residual,
            found.prior_distance,
            strict=True,
        )
    ]
    record = {
        **_residuals(found.residual, found.orientation_residual),
        "iterations": found.iterations,
        "milliseconds": milliseconds,
        "prior_distance": found.prior_distance.max(),
        "frames": frames,
    }
    return found.vertices, record


def _tracks(
    handles: io.HandleFile,
) -> tuple[list[int | deformer.SurfacePoint], NDArray, NDArray, NDArray, NDArray, NDArray]:
    """Points H with a handle in any frame, targets (F, H, 3), weights (F, H), exact ones (F, H).

    The weight is 0 where a frame has no handle at a point. Last come orientations (F, H, 3, 3),
    NaN for none, and their weights (H,), those of the last frames that have one.
    """
    points = list(dict.fromkeys(handle.vertex for frame in handles.frames for handle in frame))
    column = {point: h for h, point in enumerate(points)}
    targets = np.zeros((len(handles.frames), len(points), 3))
    weights, exact = np.zeros(targets.shape[:2]), np.zeros(targets.shape[:2], dtype=bool)
    turns, factors = np.full((*targets.shape[:2], 3, 3), np.nan), np.ones(len(points))
    for f, frame in enumerate(handles.frames):
        for handle in frame:
            h = column[handle.vertex]
            targets[f, h], weights[f, h] = handle.position, handle.weight
            exact[f, h] = handle.kind != "soft"
            if handle.orientation is not None:
                turns[f, h], factors[h] = handle.orientation, handle.orientation_weight
    return points, targets, weights, exact, turns, factors


def _residuals(distances: NDArray, angles: NDArray) -> dict[str, float | None]:
    """Root mean square and largest of the distances, NaN for a handle that is not seen.

    They are None for a frame in which no handle is seen. The same of angles follows, NaN for a
    handle without an orientation, if there are any.
    """
    seen, turned = distances[~np.isnan(distances)], angles[~np.isnan(angles)]
    found: dict[str, float | None] = {"residual_rms": None, "max_residual": None}
    if len(seen):
        found = {"residual_rms": _rms(seen), "max_residual": float(seen.max())}
    if len(turned):
        found |= {"orientation_rms": _rms(turned), "max_orientation": float(turned.max())}
    return found


def _rms(values: NDArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
