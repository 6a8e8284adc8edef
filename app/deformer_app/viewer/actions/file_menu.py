"""Actions of the menu File: models, sessions, exports, recordings."""

from __future__ import annotations

from collections.abc import Sequence

from deformer_app.rendering.footage import PICTURES, VIDEOS
from deformer_app.viewer.actions.action import MESH_FILES, Action, Shell, always, unless_cancelled
from deformer_app.viewer.actions.pose_menu import POSE_FILES
from deformer_app.viewer.exports import (
    export_handles,
    export_pose,
    export_script,
    save_screenshot,
)
from deformer_app.viewer.rigs import load_handles


def _open_model(shell: Shell) -> None:
    unless_cancelled(shell.ask_folder("Open model"), shell.open_model)


def _open_session(shell: Shell) -> None:
    unless_cancelled(shell.ask_open("Open session", "Sessions (*.json)"), shell.open_session)


def _export_pose(shell: Shell) -> None:
    unless_cancelled(
        shell.ask_save("Export pose", "pose.ply", MESH_FILES),
        lambda path: export_pose(shell.editor, path),
    )


def _export_handles(shell: Shell) -> None:
    path = shell.ask_save("Export handles", "handles.json", "Handles (*.json)")
    unless_cancelled(path, lambda path: export_handles(shell.editor, path))


def _export_script(shell: Shell) -> None:
    path = shell.ask_save("Export as Python", "pose.py", "Python scripts (*.py)")
    unless_cancelled(path, lambda path: export_script(shell.editor, path))


def _open_reference(shell: Shell) -> None:
    endings = " ".join(f"*{suffix}" for suffix in PICTURES + VIDEOS)
    path = shell.ask_open("Reference picture", f"Pictures and videos ({endings})")
    unless_cancelled(path, shell.editor.picture.open_reference)


def _load_handles(shell: Shell) -> None:
    unless_cancelled(
        shell.ask_open("Load handles", "Handles (*.json)"),
        lambda path: load_handles(shell.editor, path),
    )


def _load_target(shell: Shell) -> None:
    unless_cancelled(
        shell.ask_open("Load target mesh", MESH_FILES), shell.editor.picture.load_target
    )


def _screenshot(shell: Shell) -> None:
    path = shell.ask_save("Screenshot", "deformer.png", "Pictures (*.png *.jpg)")
    unless_cancelled(path, lambda path: save_screenshot(shell.editor, path))


FILE: Sequence[Action] = (
    Action("open-model", "File", "Open model…", _open_model, "Ctrl+O", "A model's folder",
           dialog=True, enabled=always),
    Action("train", "File", "Train on shapes…", lambda s: s.train(), "Ctrl+T",
           "Learn a model from example shapes", dialog=True, enabled=always),
    Action("open-session", "File", "Open session…", _open_session, "Ctrl+Shift+O", dialog=True,
           enabled=always),
    Action("close-model", "File", "Close", lambda s: s.close_model(), "Ctrl+W",
           "Back to the start page", dialog=True),
    Action("save", "File", "Save session", lambda s: s.save(False), "Ctrl+S",
           "Handles, sliders, camera and the whole history in one file", rule=True),
    Action("save-as", "File", "Save session as…", lambda s: s.save(True), "Ctrl+Shift+S",
           dialog=True),
    Action("load-target", "File", "Load target mesh…", _load_target, "",
           "A mesh to compare with: ghost, error colours, E_rms", dialog=True, rule=True),
    Action("export-pose", "File", "Export pose…", _export_pose, "Ctrl+E", "PLY, OBJ, STL or GLB",
           dialog=True),
    Action("export-handles", "File", "Export handles…", _export_handles, "",
           "Targets as deformer fit reads them", dialog=True),
    Action("export-script", "File", "Export as Python…", _export_script, "",
           "A script that makes this pose", dialog=True),
    Action("load-handles", "File", "Load handles…", _load_handles, "",
           "Those of deformer layout, or exported ones", dialog=True),
    Action("reference-picture", "File", "Reference picture…", _open_reference, "",
           "A picture or video to pose by; the dock Reference places it", dialog=True, rule=True),
    Action("screenshot", "File", "Screenshot…", _screenshot, "F12", dialog=True, rule=True),
    Action("turntable", "File", "Turntable…", lambda s: s.turntable(), "",
           "A full turn as GIF or MP4", dialog=True),
    Action("record", "File", "Record", lambda s: s.record(), "Ctrl+R",
           "Record what happens as GIF or MP4; again to stop", dialog=True,
           retitled=lambda s: "Stop recording" if s.recording else None),
    *POSE_FILES,
    Action("quit", "File", "Quit", lambda s: s.close(), "Ctrl+Q", rule=True, enabled=always),
)  # fmt: skip
