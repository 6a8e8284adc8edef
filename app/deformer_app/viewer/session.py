"""A session: handles and prior's mean, their unlimited history, and its file.

Nothing here knows of windows or solves anything. Every state is an immutable `Edit`; a command
makes the next one, `Session` has them all.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import deformer
from deformer import InputError, io
from deformer_app.viewer.edit import Edit, Handle, Solution
from deformer_app.viewer.edit_json import (
    check_state_fits,
    read_handle,
    read_settings,
    read_solution,
    settings_as_json,
)
from deformer_app.viewer.handle_rows import handle_rows
from deformer_app.viewer.poses import PoseShelf, SavedPose, check_poses_fit, read_poses
from deformer_app.viewer.timeline.keys import NO_KEYS, Clip
from deformer_app.viewer.timeline.storage import check_clip_fits, clips_as_json, read_clips

FORMAT = 1


@dataclass(frozen=True)
class Entry:
    """A step of the history.

    Args:
        label: what was done, in words for the user.
        edit: the state that it led to.
        solution: the pose of that state, once it has been solved for.
        clip: the keys of the timeline.
    """

    label: str
    edit: Edit
    solution: Solution | None = None
    clip: Clip = NO_KEYS


@dataclass(frozen=True)
class ModelName:
    """Which model a session belongs to.

    Args:
        path: name of a shipped model, or where the model was.
        fingerprint: of its contents, see DeformationModel.
    """

    path: str
    fingerprint: str

    @classmethod
    def of(cls, path: str | Path, model: deformer.DeformationModel) -> ModelName:
        """Return the name of a model that has been read from a folder or by its name."""
        shipped = str(path) in deformer.shipped_models()
        return cls(str(path) if shipped else str(Path(path).resolve()), model.fingerprint)

    @classmethod
    def read(cls, value: io.JsonValue) -> ModelName:
        """Read the name of a model in a file."""
        return cls(value["path"].text(), value["fingerprint"].text())

    def check_same(self, opened: ModelName, what: str) -> None:
        """Check that the model that has been opened is this one.

        Args:
            opened: the name of the model that has been opened.
            what: what belongs to this model, with its file, for the message.

        Raises:
            InputError: it is another one, or has changed at its place.
        """
        if opened.fingerprint == self.fingerprint:
            return
        if opened.path == self.path:
            raise InputError(
                f"{what} with the model that was at {self.path}, which has been trained anew or "
                "changed since; restore that one, or begin anew with the present one"
            )
        raise InputError(
            f"{what} with another model than this one (it was {self.path}); open that one"
        )


@dataclass
class Session:
    """The history of one model's editing.

    Between `change` and `commit` an edit is under way (a drag); it becomes one entry.

    Args:
        model: which model is edited.
        entries: the history, never empty.
        cursor: the entry that is shown.
        view: state of the window (camera, colours), as JSON values.
        frame: the playhead of the timeline; no step of the history.
        shelf: poses that the user has saved.
        component_names: component → name that the user has given to it in this session; empty where
            the user has removed the model's.
        saved_as: of an autosave, the file in which the user has saved the session; else empty.
    """

    model: ModelName
    entries: list[Entry]
    cursor: int = 0
    view: dict[str, Any] = field(default_factory=dict)
    frame: int = 0
    shelf: PoseShelf = field(default_factory=PoseShelf)
    component_names: dict[int, str] = field(default_factory=dict)
    saved_as: str = ""

    def __post_init__(self) -> None:
        """Start without a change."""
        self._live: Edit | None = None
        self._note_saved()

    def _note_saved(self) -> None:
        self._saved: Entry | None = self.entry
        self._saved_beside = self._beside_history

    @property
    def _beside_history(self) -> tuple[tuple[SavedPose, ...], dict[int, str]]:
        """What a session stores beside its history, and undo leaves alone."""
        return self.shelf.poses, dict(self.component_names)

    @classmethod
    def begin(cls, model: ModelName, base: ArrayLike) -> Session:
        """Return a new session at a latent code (K,)."""
        code = tuple(float(value) for value in np.asarray(base))
        return cls(model, [Entry("Start", Edit(code))])

    @property
    def entry(self) -> Entry:
        """The entry that is shown."""
        return self.entries[self.cursor]

    @property
    def edit(self) -> Edit:
        """The current state, with changes that are not yet an entry."""
        return self.entry.edit if self._live is None else self._live

    @property
    def under_way(self) -> bool:
        """True between `change` and `commit` or `revert`."""
        return self._live is not None

    def change(self, edit: Edit) -> None:
        """Try a state; `commit` makes it an entry, `revert` drops it."""
        self._live = edit

    def revert(self) -> None:
        """Discard the current change."""
        self._live = None

    def commit(
        self, label: str, solution: Solution | None = None, clip: Clip | None = None
    ) -> bool:
        """Make the current change an entry; return False if nothing is different.

        Args:
            label: what was done.
            solution: the pose of the state, if it is known.
            clip: the keys that go with the state; None keeps those of the entry before.
        """
        edit, self._live = self.edit, None
        if edit == self.entry.edit:
            return False
        self._append(Entry(label, edit, solution, self.clip if clip is None else clip))
        return True

    def _append(self, entry: Entry) -> None:
        del self.entries[self.cursor + 1 :]
        self.entries.append(entry)
        self.cursor += 1

    @property
    def clip(self) -> Clip:
        """The keys of the timeline."""
        return self.entry.clip

    def change_clip(self, label: str, clip: Clip) -> bool:
        """Make other keys an entry of the same state; return False if nothing is different."""
        if clip == self.clip:
            return False
        self._append(replace(self.entry, label=label, clip=clip))
        return True

    def show(self, edit: Edit) -> None:
        """Make a state that of the shown entry, as the playhead does: no step of the history."""
        if edit != self.entry.edit:
            self._replace_entry(replace(self.entry, edit=edit, solution=None))

    def _replace_entry(self, entry: Entry) -> None:
        """Change the shown entry in its place; a saved session still counts as saved."""
        was_saved = self._saved is self.entry
        self.entries[self.cursor] = entry
        if was_saved:
            self._saved = entry

    def do(self, label: str, edit: Edit) -> bool:
        """Change and commit at once."""
        self.change(edit)
        return self.commit(label)

    def solved(self, edit: Edit, solution: Solution) -> None:
        """Store the pose of the shown entry, if it is the solution of that edit.

        A final one stays: another pose of the same edit may be that of another entry, as where a
        step changes keys alone, which comes while the user goes on to this one.
        """
        last = self.entry.solution
        missing = last is None or not last.final
        if missing and self._live is None and edit == self.entry.edit:
            self._replace_entry(replace(self.entry, solution=solution))

    def show_solution(self, solution: Solution) -> None:
        """Make a known pose, as a clip's, that of the shown entry; not during a change."""
        if self._live is None:
            self._replace_entry(replace(self.entry, solution=solution))

    @property
    def can_undo(self) -> bool:
        """True if there is a step to undo."""
        return self.cursor > 0 and not self.under_way

    @property
    def can_redo(self) -> bool:
        """True if there is a step to redo."""
        return self.cursor + 1 < len(self.entries) and not self.under_way

    def undo(self) -> Entry:
        """Undo one entry; return the one shown now."""
        self.cursor -= self.can_undo
        return self.entry

    def redo(self) -> Entry:
        """Redo one entry; return the one shown now."""
        self.cursor += self.can_redo
        return self.entry

    def go_to(self, number: int) -> Entry:
        """Undo or redo as many entries as lead to `entries[number]`; return the one shown now."""
        if not self.under_way:
            self.cursor = min(max(number, 0), len(self.entries) - 1)
        return self.entry

    @property
    def changed(self) -> bool:
        """True if there are unsaved changes."""
        if self.under_way or self._saved is not self.entry:
            return True
        return self._saved_beside != self._beside_history

    def mark_unsaved(self) -> None:
        """Count the session as unsaved, as after a crash."""
        self._saved = None

    def next_id(self) -> int:
        """Return an id that no handle of the history has."""
        used = [h.id for entry in self.entries for h in entry.edit.handles]
        used += [h.id for h in self.edit.handles]
        return max(used, default=0) + 1

    def summary(self) -> dict[str, Any]:
        """Return the result for other programs: a handles file of `deformer fit`, and the code.

        `z` is None where the pose has not been solved for; then there is no start either.
        """
        edit, solution = self.edit, self.entry.solution
        found: dict[str, Any] = {
            "model": self.model.path,
            "fingerprint": self.model.fingerprint,
            "steps": self.cursor,
            "saved": not self.changed,
            "handles": handle_rows(edit.handles),
            "regions": [handle.patch for handle in edit.handles if handle.is_region],
            "prior": {"mean": list(edit.base), "noise": edit.noise, "body": edit.body},
            "z": None if solution is None else list(solution.z),
        }
        if edit.floor is not None:
            found["floor"] = edit.floor
        if solution is not None:
            motion = {"rotation": solution.rotation, "translation": solution.translation}
            found["start"] = {"z": list(solution.z), **motion}
            if solution.contacts:
                found["start"]["contacts"] = list(solution.contacts)
        return found

    def save(self, path: str | Path) -> None:
        """Write the whole session as JSON."""
        self.saved_as = ""
        self.write_copy(path)
        self._note_saved()

    def write_copy(self, path: str | Path) -> None:
        """Write the whole session as JSON; it still counts as unsaved."""
        with io.atomic_path(path) as temporary:
            io.write_json(temporary, self._as_json())

    def _as_json(self) -> dict[str, Any]:
        """Return the file's contents: each handle and base once, and entries with their indices."""
        handles: dict[Handle, int] = {}
        bases: dict[tuple[float, ...], int] = {}
        clips: dict[Clip, int] = {}
        entries = []
        for entry in self.entries:
            edit = entry.edit
            named = [handles.setdefault(handle, len(handles)) for handle in edit.handles]
            entries.append(
                {
                    "label": entry.label,
                    "handles": named,
                    "base": bases.setdefault(edit.base, len(bases)),
                    **settings_as_json(edit),
                    "solution": None if entry.solution is None else asdict(entry.solution),
                    "clip": clips.setdefault(entry.clip, len(clips)),
                }
            )
        return {
            "deformer_session": FORMAT,
            "model": asdict(self.model),
            "view": self.view,
            "cursor": self.cursor,
            "entries": entries,
            "handles": [asdict(handle) for handle in handles],
            "bases": list(bases),
            **clips_as_json(clips),
            "frame": self.frame,
            "saved_as": self.saved_as,
            "poses": [pose.as_json() for pose in self.shelf.poses],
            "component_names": {str(k): name for k, name in self.component_names.items()},
        }

    @classmethod
    def load(cls, path: str | Path) -> Session:
        """Read what `save` has written.

        Raises:
            InputError: no session, of another format, or damaged; the message names the file.
        """
        with io.expecting(path, "session"):
            return cls._of(io.read_value(path))

    @classmethod
    def _of(cls, data: io.JsonValue) -> Session:
        if "deformer_session" not in data:
            raise InputError(
                f"{data}: is no session of the viewer; give a file that File > Save session wrote"
            )
        if data["deformer_session"].integer() != FORMAT:
            raise data["deformer_session"].error(
                f"{FORMAT}", "the session is of another release: save it again there"
            )
        handles = [read_handle(item) for item in data["handles"].items()]
        bases = [code.numbers(largest=io.LARGEST) for code in data["bases"].items()]
        clips = read_clips(data)
        entries = [_entry(item, handles, bases, clips) for item in data["entries"].items()]
        if not entries:
            raise data["entries"].error("a list of at least one entry")
        model = ModelName.read(data["model"])
        cursor = data["cursor"].integer(0, len(entries) - 1)
        view = {key: value.value for key, value in data["view"].entries()}
        most = entries[cursor].clip.length - 1
        frame = data["frame"].integer(0, most) if "frame" in data else 0
        # Sessions of earlier versions have none of these.
        shelf = PoseShelf(read_poses(data["poses"]) if "poses" in data else ())
        names = _names(data["component_names"]) if "component_names" in data else {}
        saved_as = data["saved_as"].text() if "saved_as" in data else ""
        return cls(model, entries, cursor, view, frame, shelf, names, saved_as)

    def check_fits(
        self, model: deformer.DeformationModel, path: str | Path, where: str | Path
    ) -> None:
        """Check that the session belongs to a model.

        Args:
            model: the model.
            path: that it has been read from, or the name of a shipped one.
            where: the session's file, for the message.

        Raises:
            InputError: it belongs to another one, or the model has changed since.
        """
        self.model.check_same(ModelName.of(path, model), f"{where}: made")
        check_poses_fit(self.shelf.poses, model, where)
        K, V = model.components, len(model.reference.vertices)
        for n, entry in enumerate(self.entries):
            check_clip_fits(entry.clip, K, f"{where}: entries[{n}]")
            check_state_fits(entry.edit, entry.solution, K, V, f"{where}: entries[{n}]")


def _names(value: io.JsonValue) -> dict[int, str]:
    names = {}
    for key, name in value.entries():
        if not key.isdecimal() or len(key) > 9:
            raise value.error('an object of components, such as {"3": "nod"}')
        names[int(key)] = name.text()
    return names


def _entry(
    item: io.JsonValue, handles: list[Handle], bases: list[tuple[float, ...]], clips: list[Clip]
) -> Entry:
    edit = Edit(
        bases[item["base"].integer(0, len(bases) - 1)],
        tuple(handles[n] for n in item["handles"].integers(0, len(handles) - 1)),
        **read_settings(item),
    )
    solution = read_solution(item["solution"])
    clip = clips[item["clip"].integer(0, len(clips) - 1)] if clips else NO_KEYS
    return Entry(item["label"].text(), edit, solution, clip)
