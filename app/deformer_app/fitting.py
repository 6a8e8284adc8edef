"""Fit a model to the handles of a file, frame by frame, and sum up how it went."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import deformer
from deformer import io

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from deformer import DeformationModel, Pose


def check_output(path: Path, is_sequence: bool) -> None:
    """Raise InputError, before any work, if `path` is not named for a pose or for a sequence."""
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
    if not path.absolute().parent.is_dir():
        raise deformer.InputError(f"{path.parent}: no such directory; create it first")


def solve_frames(
    model: DeformationModel,
    handles: io.HandleFile,
    hard: bool,
    progress: Callable[[int, int], None],
) -> list[Pose]:
    """Solve every frame in order, each starting from the pose of the one before."""
    solver = deformer.HandleSolver(model)
    poses = []
    for frame in handles.frames:
        solver.set_handles(
            [handle.vertex for handle in frame],
            [handle.position for handle in frame],
            weights=[handle.weight for handle in frame],
            hard=hard,
        )
        poses.append(solver.settle())
        progress(len(poses), len(handles.frames))
    return poses


def save(path: Path, faces: NDArray, poses: Sequence[Pose], is_sequence: bool) -> None:
    """Write one pose as a mesh, or a sequence as NPZ or as a directory."""
    if is_sequence:
        vertices = np.stack([pose.vertices for pose in poses])
        io.save_shapes(path, deformer.MeshSequence(vertices, faces))
    else:
        io.save_mesh(path, deformer.Mesh(poses[0].vertices, faces))


def summarize(poses: Sequence[Pose], is_sequence: bool) -> dict[str, Any]:
    """Sum up poses: one record for a pose; totals and a record a frame for a sequence."""
    frames = [{"z": pose.z, **_residuals([pose]), **_effort([pose])} for pose in poses]
    if not is_sequence:
        return frames[0]
    return {**_residuals(poses), **_effort(poses), "frames": frames}


def _residuals(poses: Sequence[Pose]) -> dict[str, float]:
    distances = [float(distance) for pose in poses for distance in pose.residual]
    mean_square = sum(distance**2 for distance in distances) / len(distances)
    return {"residual_rms": math.sqrt(mean_square), "max_residual": max(distances)}


def _effort(poses: Sequence[Pose]) -> dict[str, float]:
    return {
        "iterations": sum(int(pose.iterations) for pose in poses),
        "milliseconds": sum(float(pose.milliseconds) for pose in poses),
        "prior_distance": max(float(pose.prior_distance) for pose in poses),
    }
