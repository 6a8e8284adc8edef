"""Actions of the menu Timeline: keys, playhead, playback, sequences and clips of files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from deformer_app.viewer.actions.action import Action, Shell, unless_cancelled
from deformer_app.viewer.timeline.exports import CLIP_FILES, export_clip
from deformer_app.viewer.timeline.sequences import SEQUENCE_FILES, load_sequence
from deformer_app.viewer.timeline.timeline import Timeline


def _on(command: Callable[[Timeline], Any]) -> Callable[[Shell], Any]:
    """Run a command of the timeline."""
    return lambda shell: command(shell.editor.timeline)


def _load_file(shell: Shell) -> None:
    unless_cancelled(
        shell.ask_open("Load sequence", SEQUENCE_FILES),
        lambda path: shell.editor.run(load_sequence(shell.editor, path)),
    )


def _load_folder(shell: Shell) -> None:
    unless_cancelled(
        shell.ask_folder("Load a folder of posed meshes"),
        lambda path: shell.editor.run(load_sequence(shell.editor, path)),
    )


def _export(shell: Shell) -> None:
    unless_cancelled(
        shell.ask_save("Export clip", "clip.glb", CLIP_FILES),
        lambda path: shell.editor.run(export_clip(shell.editor, path)),
    )


TIMELINE: Sequence[Action] = (
    Action("play", "Timeline", "Play", _on(lambda t: t.play_or_stop()), "Space",
           "The clip, in real time",
           retitled=lambda s: "Stop" if s.editor.timeline.playing else None),
    Action("previous-frame", "Timeline", "Previous frame", _on(lambda t: t.step(-1)), "Left",
           rule=True),
    Action("next-frame", "Timeline", "Next frame", _on(lambda t: t.step(1)), "Right"),
    Action("previous-key", "Timeline", "Previous key", _on(lambda t: t.go_to_key(-1)),
           "Ctrl+Left"),
    Action("next-key", "Timeline", "Next key", _on(lambda t: t.go_to_key(1)), "Ctrl+Right"),
    Action("key", "Timeline", "Set key", _on(lambda t: t.keys.set()), "K",
           "Key the selected handles; without any, all handles and the sliders", rule=True),
    Action("delete-key", "Timeline", "Delete key", _on(lambda t: t.keys.delete()), "Shift+K",
           "The selected keys, or those at the playhead"),
    Action("copy-keys", "Timeline", "Copy keys", _on(lambda t: t.keys.copy()), "Ctrl+Alt+C",
           "The selected keys, or those at the playhead"),
    Action("paste-keys", "Timeline", "Paste keys", _on(lambda t: t.keys.paste()), "Ctrl+Alt+V",
           "The copied keys, the first of them at the playhead"),
    Action("ease", "Timeline", "Ease keys", _on(lambda t: t.keys.ease("ease")), "",
           "The selected keys, or all, go on to the next ones gently"),
    Action("linear", "Timeline", "Linear keys", _on(lambda t: t.keys.ease("linear")), "",
           "The selected keys, or all, go on to the next ones at constant speed"),
    Action("load-sequence", "Timeline", "Load sequence…", _load_file, "",
           "Markers, or posed meshes of the model's connectivity: handles with a key a frame",
           dialog=True, rule=True),
    Action("load-sequence-folder", "Timeline", "Load sequence from a folder…", _load_folder, "",
           "A folder of posed meshes", dialog=True),
    Action("export-clip", "Timeline", "Export clip…", _export, "Ctrl+Shift+E",
           "GLB, MDD, PC2, USD, NPZ, a folder; handles with frames; GIF or MP4", dialog=True),
)  # fmt: skip
