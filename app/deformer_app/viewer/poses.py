"""Poses that the user has saved: values, their shelf, and their part of a file.

Nothing here knows of windows or solves anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from deformer import DeformationModel, InputError, io
from deformer_app.viewer.edit import Handle
from deformer_app.viewer.handle_json import read_handle

_LONGEST = 60  # characters of a name


@dataclass(frozen=True)
class SavedPose:
    """A pose with a name.

    Args:
        name: text of one line for the user.
        code: (K,) latent code.
        handles: those that held the pose, with their targets.
    """

    name: str
    code: tuple[float, ...]
    handles: tuple[Handle, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the pose's entry of a file."""
        handles = [asdict(handle) for handle in self.handles]
        return {"name": self.name, "code": list(self.code), "handles": handles}


class PoseShelf:
    """Saved poses in the user's order.

    Args:
        poses: to begin with; their names differ.
    """

    def __init__(self, poses: Sequence[SavedPose] = ()) -> None:
        """Put the poses on the shelf."""
        self._poses = list(poses)
        self._deleted: tuple[int, SavedPose] | None = None

    @property
    def poses(self) -> tuple[SavedPose, ...]:
        """All poses."""
        return tuple(self._poses)

    @property
    def deleted(self) -> SavedPose | None:
        """The pose that `restore` brings back, if there is one."""
        return None if self._deleted is None else self._deleted[1]

    def free_name(self, wanted: str) -> str:
        """Return `wanted`, with a number behind it if a pose has that name."""
        taken = {pose.name for pose in self._poses}
        name, number = wanted, 2
        while name in taken:
            name, number = f"{wanted} {number}", number + 1
        return name

    def next_name(self) -> str:
        """Return "Pose 1", or the first such name that no pose has."""
        taken = {pose.name for pose in self._poses}
        return next(f"Pose {n}" for n in range(1, len(taken) + 2) if f"Pose {n}" not in taken)

    def add(self, pose: SavedPose) -> SavedPose:
        """Add a pose at the end; return it with the name that it has got.

        Raises:
            InputError: its name is none.
        """
        added = replace(pose, name=self.free_name(checked_name(pose.name)))
        self._poses.append(added)
        return added

    def rename(self, row: int, name: str) -> None:
        """Give a pose another name.

        Raises:
            InputError: no name, or another pose has it.
        """
        name = checked_name(name)
        if any(pose.name == name for n, pose in enumerate(self._poses) if n != row):
            raise InputError(f"pose {name!r}: another pose has this name; choose another")
        self._poses[row] = replace(self._poses[row], name=name)

    def delete(self, row: int) -> SavedPose:
        """Remove a pose; `restore` brings the last one back."""
        self._deleted = row, self._poses.pop(row)
        return self._deleted[1]

    def restore(self) -> SavedPose | None:
        """Bring back the pose that was deleted last, where it was."""
        if self._deleted is None:
            return None
        (row, pose), self._deleted = self._deleted, None
        pose = replace(pose, name=self.free_name(pose.name))
        self._poses.insert(row, pose)
        return pose

    def move(self, row: int, to: int) -> None:
        """Move a pose to another place in the order."""
        self._poses.insert(to, self._poses.pop(row))


def checked_name(name: str) -> str:
    """Return the name of a pose without surrounding blanks.

    Raises:
        InputError: it is empty, of several lines or too long.
    """
    name = name.strip()
    if not name or len(name) > _LONGEST or not name.isprintable():
        raise InputError(
            f"name of a pose: got {name[:_LONGEST]!r}, expected text of one line and up to "
            f"{_LONGEST} characters; choose another"
        )
    return name


def read_poses(value: io.JsonValue) -> list[SavedPose]:
    """Read the poses of a file.

    Args:
        value: the list of what `SavedPose.as_json` has returned.

    Raises:
        InputError: it is damaged, or a name is given twice.
    """
    poses: list[SavedPose] = []
    for item in value.items():
        item.check_keys(("name", "code"), ("handles",))
        try:
            name = checked_name(item["name"].text())
        except InputError as error:
            raise InputError(f"{item}: {error}") from None
        if any(pose.name == name for pose in poses):
            raise item["name"].error("a name that no other pose has")
        handles = item["handles"].items() if "handles" in item else []
        code = item["code"].numbers(largest=io.LARGEST)
        poses.append(SavedPose(name, code, tuple(read_handle(handle) for handle in handles)))
    return poses


def check_poses_fit(poses: Sequence[SavedPose], model: DeformationModel, where: Any) -> None:
    """Check that poses can be those of a model.

    Args:
        poses: as they were read.
        model: the model.
        where: the file, for the message.

    Raises:
        InputError: a code of another length, or a handle at a vertex that does not exist.
    """
    K, V = model.components, len(model.reference.vertices)
    for pose in poses:
        if len(pose.code) != K:
            raise InputError(
                f"{where}: pose {pose.name!r} has a code of {len(pose.code)} numbers, expected "
                f"the model's {K}; restore the file"
            )
        for handle in pose.handles:
            highest = max((*handle.vertices, *handle.patch))
            if highest >= V:
                raise InputError(
                    f"{where}: pose {pose.name!r} has a handle at vertex {highest}, expected "
                    f"0…{V - 1}; restore the file"
                )
