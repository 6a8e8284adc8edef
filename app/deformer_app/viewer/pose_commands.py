"""Commands on saved poses: save, start from them, copy, paste, libraries."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from deformer import InputError, posed_shape
from deformer_app.viewer.changes import PosesChanged
from deformer_app.viewer.edit import Edit, Handle
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.handle_changes import (
    gaps_of,
    mirrored_edit,
    mirrored_solution,
    on_shape,
    pulling,
)
from deformer_app.viewer.mirror_plane import MirrorPlane
from deformer_app.viewer.pose_files import (
    library_text,
    load_library,
    parse_library,
    save_library,
)
from deformer_app.viewer.pose_worker import PoseWorker
from deformer_app.viewer.poses import PoseShelf, SavedPose
from deformer_app.viewer.worker import in_background

_HALF = 0.5  # of a pin's patch: what holds more of it holds its place


def present_pose(editor: Editor, name: str) -> SavedPose:
    """Return the pose that is shown, with its handles.

    Raises:
        InputError: there is no pose yet.
    """
    if editor.preparing:
        raise InputError("The solver is still being prepared; try again in a moment")
    editor.wait_for_pose()
    return SavedPose(name, editor.edit, editor.shown_solution)


def change_poses(editor: Editor, change: Callable[[PoseShelf], Any]) -> None:
    """Change the saved poses of the session; no step of the history.

    Raises:
        InputError: what `change` raises.
    """
    change(editor.session.shelf)
    editor.announce(PosesChanged())


def save_pose(editor: Editor, name: str | None = None) -> SavedPose:
    """Save the pose that is shown in the session.

    Args:
        editor: whose pose it is.
        name: its name; None numbers it.

    Raises:
        InputError: there is no pose yet, or the name is none.
    """
    shelf = editor.session.shelf
    pose = present_pose(editor, shelf.next_name() if name is None else name)
    change_poses(editor, lambda shelf: shelf.add(pose))
    saved = shelf.poses[-1]
    editor.note(f"Saved “{saved.name}” with the session")
    return saved


def start_from(editor: Editor, pose: SavedPose, label: str | None = None) -> None:
    """Show a pose as it was saved, with its handles in place of the present ones.

    A handle at the same vertices as a present one goes on as that, with its keys. A pose without
    handles is that of its code: present handles go along, as in `PriorCommands.start_at`. In a clip
    present handles stay; a background job places them on the pose.

    Args:
        editor: shows it.
        pose: the pose.
        label: of the step; None is "Start from" its name.
    """
    label = f"Start from {pose.name}" if label is None else label
    if not pose.handles:
        editor.prior.start_at(label, pose.code)
        return
    if editor.timeline.clip.tracks:
        before, frame = editor.edit, editor.timeline.frame
        editor.run(_start_at_playhead(editor, pose, label, before, frame))
        return
    before = editor.edit.handles
    edit = pose.with_ids(before, editor.session.next_id())
    editor.change(label, edit, both_sides=False, solution=pose.solution)
    gone = len({h.id for h in before} - {h.id for h in edit.handles})
    if gone:
        there = "one that was" if gone == 1 else f"{gone} that were"
        editor.note(f"Its handles replace the {there} there")


def _start_at_playhead(
    editor: Editor, pose: SavedPose, label: str, before: Edit, frame: int
) -> Iterator[None]:
    """Start from a pose at a frame of a clip, at whose other frames nothing changes.

    Present handles that the pose has not stay, on its surface, since they have keys elsewhere; its
    own ones get keys there (`Timeline.keyed`). A pin of which a present one holds half is left to
    that one, whose keys at other frames go on to be those of its own vertices.

    Args:
        editor: shows the pose.
        pose: the pose.
        label: of the step.
        before: the present state.
        frame: the playhead.
    """
    model, timeline = editor.model, editor.timeline
    shown = yield from in_background(lambda: PoseWorker(model).final_pose(pose.edit, pose.solution))
    own = pose.with_ids(before.handles, editor.session.next_id())
    new = {handle.id for handle in own.handles} - {handle.id for handle in before.handles}
    while new and timeline.waiting:  # new handles get keys on the shapes of the other key frames
        yield
    if not editor.is_open or editor.model is not model:
        return
    if (editor.edit, timeline.frame) != (before, frame):
        editor.note(f"{label}: given up, since something else has changed the pose")
        return
    code_shape = posed_shape(model, shown.z, shown.rotation, shown.translation)
    taken = {handle.id for handle in own.handles}
    kept = {
        handle.id: on_shape(handle, model, shown.vertices, code_shape)
        for handle in before.handles
        if handle.id not in taken
    }
    handles = []
    for handle in own.handles:
        holds = _held_by(handle, before.handles, kept)
        if holds is None:
            handles.append(handle)
        else:
            there = on_shape(handle, model, shown.vertices, code_shape)
            kept[holds] = pulling(kept[holds], gaps_of(handle) - gaps_of(there))
    own = replace(own, handles=tuple(handles))
    edit = replace(before.with_handles([*own.handles, *kept.values()]), base=own.base)
    solution = pose.solution if own.settings == edit.settings else None
    editor.change(label, edit, both_sides=False, solution=solution, whole=True)
    kinds = {handle.id: handle.kind for handle in before.handles}
    for handle in edit.handles:
        if kinds.get(handle.id, handle.kind) != handle.kind:
            name = editor.handles.names.of(handle)
            editor.note(f"{name} is {handle.kind} now, at all frames, as it is in the pose")


def _held_by(handle: Handle, present: Sequence[Handle], kept: Iterable[int]) -> int | None:
    """Return the id of a kept pin that stands for a pose's new one: it holds half of its patch.

    Args:
        handle: of the pose.
        present: handles that are there.
        kept: ids of those that the pose has not.
    """
    if handle.kind != "pin" or handle.id in {h.id for h in present}:
        return None
    shares = {
        h.id: len(set(h.patch) & set(handle.patch)) / len(handle.patch)
        for h in present
        if h.id in kept and h.kind == "pin"
    }
    best = max(shares, key=lambda number: shares[number], default=None)
    return None if best is None or shares[best] < _HALF else best


def copied(editor: Editor, pose: SavedPose | None = None) -> str:
    """Return the clipboard's text of a pose; None takes the one that is shown."""
    pose = pose or present_pose(editor, "Copied pose")
    return library_text([pose], editor.session.model)


def paste(editor: Editor, text: str) -> None:
    """Start from the pose in the clipboard's text, as it was copied.

    Raises:
        InputError: it holds none of this model.
    """
    pose = parse_library(text, editor.model, editor.session.model)[0]
    start_from(editor, pose, "Paste pose")


def paste_mirrored(editor: Editor, text: str) -> None:
    """Start from the mirror image of the pose in the clipboard's text; a background job finds it.

    Raises:
        InputError: it holds none of this model.
    """
    plane, model = editor.mirror.plane, editor.model
    pose = parse_library(text, model, editor.session.model)[0]

    def paste() -> Iterator[None]:
        image = yield from in_background(lambda: _mirrored(pose, plane))
        if editor.model is model:
            start_from(editor, image, "Paste pose mirrored")

    editor.mirror.with_plane(lambda: editor.run(paste()))


def _mirrored(pose: SavedPose, plane: MirrorPlane) -> SavedPose:
    """The mirror image of a pose."""
    if not pose.handles:
        return SavedPose.of_code(pose.name, plane.mirrored_code(pose.code))
    solution = None if pose.solution is None else mirrored_solution(pose.solution, plane)
    return SavedPose(pose.name, mirrored_edit(pose.edit, plane), solution)


def export_poses(editor: Editor, path: str | Path) -> None:
    """Write the session's saved poses as a library."""
    save_library(path, editor.session.shelf.poses, editor.session.model)
    editor.note(f"Wrote {path}")


def import_poses(editor: Editor, path: str | Path) -> None:
    """Add the poses of a library to those of the session.

    Raises:
        InputError: no library, a damaged one, or one of another model.
    """
    found = load_library(path, editor.model, editor.session.model)
    change_poses(editor, lambda shelf: [shelf.add(pose) for pose in found])
    editor.note(f"Added {len(found)} poses of {Path(path).name}")
