"""Libraries of poses: JSON files, and the text that goes through the clipboard."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from deformer import DeformationModel, InputError, io
from deformer_app.viewer.poses import SavedPose, check_poses_fit, read_poses
from deformer_app.viewer.session import ModelName

FORMAT = 1


def save_library(path: str | Path, poses: Sequence[SavedPose], model: ModelName) -> None:
    """Write poses of a model as a library.

    Raises:
        InputError: there are none.
    """
    if not poses:
        raise InputError(f"{path}: there are no saved poses to write; save one first")
    with io.atomic_path(path) as temporary:
        io.write_json(temporary, _library(poses, model))


def library_text(poses: Sequence[SavedPose], model: ModelName) -> str:
    """Return poses of a model as the text of a library."""
    return json.dumps(_library(poses, model))


def load_library(path: str | Path, model: DeformationModel, name: ModelName) -> list[SavedPose]:
    """Read the poses of a library.

    Args:
        path: what `save_library` has written.
        model: the model that the poses must be of.
        name: its name.

    Raises:
        InputError: no library, a damaged one, or one of another model.
    """
    with io.expecting(path, "poses"):
        return _read(io.read_value(path), model, name)


def parse_library(text: str, model: DeformationModel, name: ModelName) -> list[SavedPose]:
    """Read the poses in the text of the clipboard; see `load_library`."""
    if "deformer_poses" not in text:
        raise InputError("clipboard: it holds no pose; copy one first (Ctrl+C)")
    return _read(io.parse_value(text, "clipboard"), model, name)


def _library(poses: Sequence[SavedPose], model: ModelName) -> dict[str, Any]:
    return {
        "deformer_poses": FORMAT,
        "model": asdict(model),
        "poses": [pose.as_json() for pose in poses],
    }


def _read(data: io.JsonValue, model: DeformationModel, name: ModelName) -> list[SavedPose]:
    data.check_keys(("deformer_poses", "model", "poses"))
    if data["deformer_poses"].integer() != FORMAT:
        raise data["deformer_poses"].error(
            f"{FORMAT}", "the library is of another release: write it again there"
        )
    ModelName.read(data["model"]).check_same(name, f"{data}: poses made")
    poses = read_poses(data["poses"])
    if not poses:
        raise data["poses"].error("at least one pose")
    check_poses_fit(poses, model, data)
    return poses
