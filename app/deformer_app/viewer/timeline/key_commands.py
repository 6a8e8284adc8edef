"""Commands on the keys of a timeline: set, delete, move, ease, copy, paste and select them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

from deformer_app.viewer.timeline.keys import (
    SLIDERS,
    Ease,
    Key,
    KeyName,
    continued,
    keys_of,
    shift_within,
)

if TYPE_CHECKING:
    from deformer_app.viewer.editor import Editor
    from deformer_app.viewer.timeline.timeline import Timeline


class KeyCommands:
    """Changes the keys of a timeline.

    Args:
        timeline: has the keys and the playhead.
        editor: has the handles that are keyed.
    """

    def __init__(self, timeline: Timeline, editor: Editor) -> None:
        """Start with nothing copied."""
        self._timeline, self._editor = timeline, editor
        self._copied: list[tuple[int, Key]] = []

    def set(self, owners: Iterable[int] | None = None) -> None:
        """Set keys at the playhead.

        Args:
            owners: ids of handles, or SLIDERS; None is the selected handles, and without any all
                handles and the sliders.
        """
        editor = self._editor
        if editor.session.under_way:
            return
        edit, frame = editor.edit, self._timeline.frame
        if owners is None:
            owners = editor.handles.selected or (SLIDERS, *(handle.id for handle in edit.handles))
        keys = keys_of(edit, frame, owners)
        self._timeline.change(
            f"Key at frame {frame}",
            self._timeline.clip.with_keys(continued(self._timeline.clip, keys)),
        )

    def delete(self) -> None:
        """Delete the selected keys; without any, those at the playhead.

        With selected handles, those of these handles at the playhead.
        """
        names: set[KeyName] = set(self._timeline.selected & set(self._timeline.clip.names))
        if not names:
            chosen = self._editor.handles.selected
            names = {
                n
                for n in self._timeline.clip.names
                if n[1] == self._timeline.frame and n[0] in (chosen or {n[0]})
            }
        if names:
            self._timeline.selected = frozenset()
            self._timeline.change("Delete keys", self._timeline.clip.without(names))
        else:
            self._editor.note(f"There is no key at frame {self._timeline.frame}")

    def move(self, by: int) -> None:
        """Move the selected keys in time."""
        names = self._timeline.selected & set(self._timeline.clip.names)
        by = shift_within(self._timeline.clip.copied(names), by)
        if names and by:
            clip = self._timeline.clip.moved(names, by)
            self._timeline.selected = frozenset((owner, frame + by) for owner, frame in names)
            self._timeline.change("Move keys", clip)

    def ease(self, ease: Ease) -> None:
        """Let the selected keys, or all, go on to the next ones eased or straight."""
        names = self._timeline.selected & set(self._timeline.clip.names) or set(
            self._timeline.clip.names
        )
        if names:
            self._timeline.change(
                "Ease" if ease == "ease" else "Linear", self._timeline.clip.eased(names, ease)
            )

    def copy(self) -> None:
        """Remember the selected keys; without any, those at the playhead."""
        names = self._timeline.selected or {
            name for name in self._timeline.clip.names if name[1] == self._timeline.frame
        }
        self._copied = self._timeline.clip.copied(names)
        self._editor.note(f"Copied {len(self._copied)} keys")

    def paste(self) -> None:
        """Set the remembered keys so that the first of them is at the playhead."""
        known = {owner for owner, _ in self._timeline.rows}
        keys = [(owner, key) for owner, key in self._copied if owner in known]
        if not keys:
            self._editor.note("Copy keys first")
            return
        by = shift_within(keys, self._timeline.frame - min(key.frame for _, key in keys))
        pasted = [(owner, replace(key, frame=key.frame + by)) for owner, key in keys]
        self._timeline.selected = frozenset((owner, key.frame) for owner, key in pasted)
        self._timeline.change("Paste keys", self._timeline.clip.with_keys(pasted))

    def select(self, names: Iterable[KeyName]) -> None:
        """Select these keys alone."""
        self._timeline.selected = frozenset(names)
        self._timeline.tell()
