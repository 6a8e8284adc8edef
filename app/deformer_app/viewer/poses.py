"""Poses that the user has saved: values, their shelf, and their part of a file.

Nothing here knows of windows or solves anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from deformer import DeformationModel, InputError, io
from deformer_app.viewer.edit import Edit, Handle, Solution
from deformer_app.viewer.edit_json import (
    check_state_fits,
    read_handle,
    read_settings,
    read_solution,
    settings_as_json,
)

_LONGEST = 60  # characters of a name
# Keys of a file's entry beside name, code and handles.
_STATE = ("base", "noise", "body", "floor", "solution")


@dataclass(frozen=True)
class SavedPose:
    """A pose with a name: the state that made it, and its solution.

    Args:
        name: text of one line for the user.
        edit: the state: the prior's mean, and the handles with their targets.
        solution: the pose of that state; None is to be solved for.
    """

    name: str
    edit: Edit
    solution: Solution | None = None

    @classmethod
    def of_code(cls, name: str, code: tuple[float, ...]) -> SavedPose:
        """The pose of a latent code (K,) alone."""
        return cls(name, Edit(code), Solution.of_code(code))

    @property
    def code(self) -> tuple[float, ...]:
        """(K,) latent code of the pose."""
        return self.shown.z

    @property
    def shown(self) -> Solution:
        """The solution; that of the code alone if it is not known."""
        return Solution.of_code(self.edit.base) if self.solution is None else self.solution

    @property
    def handles(self) -> tuple[Handle, ...]:
        """The handles that hold the pose."""
        return self.edit.handles

    def with_ids(self, present: Sequence[Handle], first: int) -> Edit:
        """Return the state with ids of an editor's.

        Args:
            present: handles there; one at the same vertices gives its id.
            first: id of the first of the others; the next ones count on.
        """
        ids = {handle.vertices: handle.id for handle in present}
        handles = tuple(
            replace(h, id=ids.pop(h.vertices, first + n)) for n, h in enumerate(self.handles)
        )
        return replace(self.edit, handles=handles)

    def as_json(self) -> dict[str, Any]:
        """Return the pose's entry of a file."""
        return {
            "name": self.name,
            "code": list(self.code),
            "handles": [asdict(handle) for handle in self.handles],
            "base": list(self.edit.base),
            **settings_as_json(self.edit),
            "solution": None if self.solution is None else asdict(self.solution),
        }


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
        item.check_keys(("name", "code"), ("handles", *_STATE))
        try:
            name = checked_name(item["name"].text())
        except InputError as error:
            raise InputError(f"{item}: {error}") from None
        if any(pose.name == name for pose in poses):
            raise item["name"].error("a name that no other pose has")
        poses.append(_read_state(name, item))
    return poses


def _read_state(name: str, item: io.JsonValue) -> SavedPose:
    rows = item["handles"].items() if "handles" in item else []
    handles = tuple(read_handle(row) for row in rows)
    code = item["code"].numbers(largest=io.LARGEST)
    if "base" not in item:  # files of earlier versions have the code and the handles alone
        return SavedPose(name, Edit(code, handles))
    base = item["base"].numbers(len(code), largest=io.LARGEST)
    edit = Edit(base, handles, **read_settings(item))
    return SavedPose(name, edit, read_solution(item["solution"]))


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
        check_state_fits(pose.edit, pose.solution, K, V, f"{where}: pose {pose.name!r}")
