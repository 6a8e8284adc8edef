"""`deformer fit`: a model fitted to the handles of a file, and a record of the fit."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import deformer
from deformer import io

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deformer import DeformationModel


def check_output(path: Path, is_sequence: bool) -> None:
    """Raise InputError, before any work, if the output cannot be written to `path`."""
    suffix = path.suffix.lower()
    one_mesh = suffix in io.MESH_SUFFIXES
    if is_sequence and one_mesh:
        raise deformer.InputError(
            f"{path}: names one mesh file, but the handles are a sequence; name an .npz file or a "
            "directory"
        )
    if not is_sequence and not one_mesh:
        raise deformer.InputError(
            f"{path}: got suffix {suffix!r}, expected one of {', '.join(io.MESH_SUFFIXES)} for a "
            "single pose"
        )
    io.check_shapes_output(path) if is_sequence else io.check_output_file(path)


def pose(
    model: DeformationModel, handles: io.HandleFile, hard: bool
) -> tuple[NDArray, dict[str, Any]]:
    """Vertices (V, 3) of a pose fitted to the first frame's handles, and the fit's record."""
    frame = handles.frames[0]
    solver = deformer.HandleSolver(model)
    solver.set_handles(
        [handle.vertex for handle in frame],
        [handle.position for handle in frame],
        weights=[handle.weight for handle in frame],
        kinds="exact" if hard else [handle.kind for handle in frame],
    )
    found = solver.solve()
    return found.vertices, describe(found)


def describe(found: deformer.Pose) -> dict[str, Any]:
    """Code, residuals, iterations, time and prior distance of a pose."""
    return {
        "z": found.z,
        **_residuals(found.residual),
        "iterations": found.iterations,
        "milliseconds": found.milliseconds,
        "prior_distance": found.prior_distance,
    }


def unit_warning(model: DeformationModel, handles: io.HandleFile) -> str | None:
    """A warning if the targets are most likely in other units than the model; else None."""
    points, targets, weights, _ = _tracks(handles)
    return deformer.unit_warning(model, points, np.where(weights[..., None] > 0, targets, np.nan))


def sequence(
    model: DeformationModel,
    handles: io.HandleFile,
    *,
    hard: bool,
    smoothness: float,
    device: str,
    backend: str | None,
    progress: Callable[[int, int], None],
) -> tuple[NDArray, dict[str, Any]]:
    """Vertices (F, V, 3) fitted to the handles of F frames, and the fit's record with `frames`."""
    points, targets, weights, exact = _tracks(handles)
    begun = time.perf_counter()
    found = deformer.fit_sequence(
        model,
        points,
        targets,
        weights=weights,
        hard=exact | hard,
        smoothness=smoothness,
        device=device,
        backend=backend,
        on_progress=progress,
    )
    milliseconds = 1000.0 * (time.perf_counter() - begun)
    frames = [
        {"z": z, **_residuals(residual), "prior_distance": distance}
        for z, residual, distance in zip(found.z, found.residual, found.prior_distance, strict=True)
    ]
    record = {
        **_residuals(found.residual),
        "iterations": found.iterations,
        "milliseconds": milliseconds,
        "prior_distance": found.prior_distance.max(),
        "frames": frames,
    }
    return found.vertices, record


def save(path: Path, faces: NDArray, vertices: NDArray) -> None:
    """Write one pose (V, 3) as a mesh, or a sequence (F, V, 3) as NPZ or as a directory."""
    if vertices.ndim == 3:
        io.save_shapes(path, deformer.MeshSequence(vertices, faces))
    else:
        io.save_mesh(path, deformer.Mesh(vertices, faces))


def _tracks(
    handles: io.HandleFile,
) -> tuple[list[int | deformer.SurfacePoint], NDArray, NDArray, NDArray]:
    """Points H with a handle in any frame, targets (F, H, 3), weights (F, H), exact ones (F, H).

    The weight is 0 where a frame has no handle at a point.
    """
    points = list(dict.fromkeys(handle.vertex for frame in handles.frames for handle in frame))
    column = {point: h for h, point in enumerate(points)}
    targets = np.zeros((len(handles.frames), len(points), 3))
    weights, exact = np.zeros(targets.shape[:2]), np.zeros(targets.shape[:2], dtype=bool)
    for f, frame in enumerate(handles.frames):
        for handle in frame:
            h = column[handle.vertex]
            targets[f, h], weights[f, h] = handle.position, handle.weight
            exact[f, h] = handle.kind != "soft"
    return points, targets, weights, exact


def _residuals(distances: NDArray) -> dict[str, float | None]:
    """Root mean square and largest of the distances, NaN for a handle that is not seen.

    They are None for a frame in which no handle is seen.
    """
    seen = distances[~np.isnan(distances)]
    if not len(seen):
        return {"residual_rms": None, "max_residual": None}
    return {
        "residual_rms": float(np.sqrt(np.mean(seen**2))),
        "max_residual": float(seen.max()),
    }
