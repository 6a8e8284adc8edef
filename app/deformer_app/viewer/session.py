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
from deformer_app.viewer.edit import (
    BODIES,
    KINDS,
    Edit,
    Handle,
    Orientation,
    Point,
    Solution,
    point,
)

FORMAT = 1


@dataclass(frozen=True)
class Entry:
    """A step of the history.

    Args:
        label: what was done, in words for the user.
        edit: the state that it led to.
        solution: the pose of that state, once it has been solved for.
    """

    label: str
    edit: Edit
    solution: Solution | None = None


@dataclass(frozen=True)
class ModelName:
    """Which model a session belongs to.

    Args:
        path: name of a shipped model, or where the model was.
        fingerprint: of its contents, see DeformationModel.
    """

    path: str
    fingerprint: str


@dataclass
class Session:
    """The history of one model's editing.

    Between `change` and `commit` an edit is under way (a drag); it becomes one entry.

    Args:
        model: which model is edited.
        entries: the history, never empty.
        cursor: the entry that is shown.
        view: state of the window (camera, colours), as JSON values.
    """

    model: ModelName
    entries: list[Entry]
    cursor: int = 0
    view: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Start without a change."""
        self._live: Edit | None = None
        self._saved: Entry | None = self.entries[self.cursor]

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

    def commit(self, label: str, solution: Solution | None = None) -> bool:
        """Make the current change an entry; return False if nothing is different."""
        edit, self._live = self.edit, None
        if edit == self.entry.edit:
            return False
        del self.entries[self.cursor + 1 :]
        self.entries.append(Entry(label, edit, solution))
        self.cursor += 1
        return True

    def do(self, label: str, edit: Edit) -> bool:
        """Change and commit at once."""
        self.change(edit)
        return self.commit(label)

    def solved(self, edit: Edit, solution: Solution) -> None:
        """Store the pose of the shown entry, if it is the solution of that edit."""
        if self._live is None and edit == self.entry.edit:
            was_saved = self._saved is self.entry
            self.entries[self.cursor] = replace(self.entry, solution=solution)
            if was_saved:
                self._saved = self.entry

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

    @property
    def changed(self) -> bool:
        """True if there are unsaved changes."""
        return self.under_way or self._saved is not self.entry

    def mark_unsaved(self) -> None:
        """Count the session as unsaved, as after a crash."""
        self._saved = None

    def next_id(self) -> int:
        """Return an id that no handle of the history has."""
        used = [h.id for entry in self.entries for h in entry.edit.handles]
        used += [h.id for h in self.edit.handles]
        return max(used, default=0) + 1

    def summary(self) -> dict[str, Any]:
        """Return the result for other programs: targets as `deformer fit` reads them, and the code.

        `z` is None where the pose has not been solved for.
        """
        rows = self.edit.arrays()
        return {
            "model": self.model.path,
            "steps": self.cursor,
            "saved": not self.changed,
            "handles": [_target(*row) for row in zip(*rows.values(), strict=True)],
            "z": None if self.entry.solution is None else list(self.entry.solution.z),
        }

    def save(self, path: str | Path) -> None:
        """Write the whole session as JSON."""
        self.write_copy(path)
        self._saved = self.entry

    def write_copy(self, path: str | Path) -> None:
        """Write the whole session as JSON; it still counts as unsaved."""
        with io.atomic_path(path) as temporary:
            io.write_json(temporary, self._as_json())

    def _as_json(self) -> dict[str, Any]:
        """Return the file's contents: each handle and base once, and entries with their indices."""
        handles: dict[Handle, int] = {}
        bases: dict[tuple[float, ...], int] = {}
        entries = []
        for entry in self.entries:
            edit = entry.edit
            named = [handles.setdefault(handle, len(handles)) for handle in edit.handles]
            entries.append(
                {
                    "label": entry.label,
                    "handles": named,
                    "base": bases.setdefault(edit.base, len(bases)),
                    "noise": edit.noise,
                    "body": edit.body,
                    "solution": None if entry.solution is None else asdict(entry.solution),
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
        }

    @classmethod
    def load(cls, path: str | Path) -> Session:
        """Read what `save` has written.

        Raises:
            InputError: no session, of another format, or damaged; the message names the file.
        """
        data = io.read_value(path)
        if data["deformer_session"].integer() != FORMAT:
            raise data["deformer_session"].error(
                f"{FORMAT}", "the session is of another release: save it again there"
            )
        handles = [_handle(item) for item in data["handles"].items()]
        bases = [_numbers(code) for code in data["bases"].items()]
        entries = [_entry(item, handles, bases) for item in data["entries"].items()]
        if not entries:
            raise data["entries"].error("a list of at least one entry")
        model = ModelName(data["model"]["path"].text(), data["model"]["fingerprint"].text())
        cursor = data["cursor"].integer(0, len(entries) - 1)
        view = {key: value.value for key, value in data["view"].entries()}
        return cls(model, entries, cursor, view)

    def check_fits(self, model: deformer.DeformationModel, where: str | Path) -> None:
        """Raise InputError unless the session belongs to this model."""
        if model.fingerprint != self.model.fingerprint:
            raise InputError(
                f"{where}: made with another model than this one (it was {self.model.path}); "
                "open that one"
            )
        K, V = model.components, len(model.reference.vertices)
        for n, entry in enumerate(self.entries):
            codes = [entry.edit.base, *([entry.solution.z] if entry.solution else [])]
            for code in codes:
                if len(code) != K:
                    raise InputError(
                        f"{where}: entries[{n}]: a code of {len(code)} numbers, expected the "
                        f"model's {K}; restore the file"
                    )
            for handle in entry.edit.handles:
                highest = max((*handle.vertices, *handle.patch))
                if highest >= V:
                    raise InputError(
                        f"{where}: entries[{n}]: handle {handle.id} has vertex {highest}, expected "
                        f"0…{V - 1}; restore the file"
                    )


def _handle(item: io.JsonValue) -> Handle:
    vertices = item["vertices"].integers(least=0)
    if not vertices:
        raise item["vertices"].error("a list of at least one vertex")
    # Sessions of earlier versions have neither.
    turn = item["orientation"].value if "orientation" in item else None
    factor = "orientation_weight"
    handle = Handle(
        item["id"].integer(least=0),
        tuple(vertices),
        tuple(point(target.numbers(3)) for target in item["targets"].items(len(vertices))),
        item["kind"].choice(KINDS),
        item["weight"].number(above=0, most=io.LARGEST),
        tuple(item["patch"].integers(least=0)),
        orientation_weight=item[factor].number(above=0, most=1e4) if factor in item else 1.0,
    )
    return handle if turn is None else handle.oriented(item["orientation"].rotation())


def _target(
    vertex: int,
    target: Point,
    weight: float,
    kind: str,
    orientation: Orientation | None,
    orientation_weight: float,
) -> dict[str, Any]:
    """An entry of a handles file."""
    entry = {"vertex": vertex, "position": list(target), "weight": weight, "kind": kind}
    if orientation is not None:
        entry |= {"orientation": orientation, "orientation_weight": orientation_weight}
    return entry


def _entry(item: io.JsonValue, handles: list[Handle], bases: list[tuple[float, ...]]) -> Entry:
    edit = Edit(
        bases[item["base"].integer(0, len(bases) - 1)],
        tuple(handles[n] for n in item["handles"].integers(0, len(handles) - 1)),
        item["noise"].number(above=0, most=io.LARGEST),
        item["body"].choice(BODIES),
    )
    found = item["solution"]
    solution = None
    if found.value is not None:
        parts = _point(found["rotation"]), _point(found["translation"])
        solution = Solution(_numbers(found["z"]), *parts)
    return Entry(item["label"].text(), edit, solution)


def _numbers(value: io.JsonValue, length: int | None = None) -> tuple[float, ...]:
    return value.numbers(length, largest=io.LARGEST)


def _point(value: io.JsonValue) -> Point:
    return point(_numbers(value, 3))
