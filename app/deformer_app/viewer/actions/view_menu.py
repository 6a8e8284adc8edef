"""Actions of the menu View: directions, colours, ghosts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from deformer_app.viewer.actions.action import Action, Shell, always
from deformer_app.viewer.colouring import COLOURINGS
from deformer_app.viewer.look import GHOSTS


def _next_colour(shell: Shell) -> None:
    editor = shell.editor
    names = [name for name in COLOURINGS if name != "component"]
    if editor.state.target_mesh is None:
        names.remove("error")
    kind = editor.state.look.colour
    current = names.index(kind) if kind in names else -1
    editor.picture.change_look(colour=names[(current + 1) % len(names)])


def _next_ghost(shell: Shell) -> None:
    editor = shell.editor
    has_target = editor.state.target_mesh is not None
    names = [name for name in GHOSTS if name != "target" or has_target]
    current = names.index(editor.state.look.ghost)
    editor.picture.change_look(ghost=names[(current + 1) % len(names)])


def _save_camera(shell: Shell) -> None:
    state = shell.editor.state
    proposed = f"Camera {len(state.cameras.names) + 1}"
    name = shell.ask_text("Save camera", "Name:", proposed)
    if name is not None:
        state.cameras.save(name, state.camera)
        shell.editor.touch()


def _turn_over(name: str) -> Callable[[Shell], Any]:
    """Toggle a boolean field of the look."""

    def run(shell: Shell) -> None:
        shell.editor.picture.change_look(**{name: not getattr(shell.editor.state.look, name)})

    return run


VIEW: Sequence[Action] = (
    Action("frame", "View", "Frame selection", lambda s: s.editor.picture.frame_selected(), "F",
           "The selected handles and what is around them; all without any", tool="Frame"),
    Action("frame-all", "View", "Frame all", lambda s: s.editor.picture.frame_all(), "Home",
           "The whole shape, seen as it is now"),
    Action("front", "View", "Front", lambda s: s.editor.picture.frame(0, 0), "Ctrl+1", rule=True),
    Action("left", "View", "Left side", lambda s: s.editor.picture.frame(90, 0), "Ctrl+2"),
    Action("back", "View", "Back", lambda s: s.editor.picture.frame(180, 0), "Ctrl+3"),
    Action("right", "View", "Right side", lambda s: s.editor.picture.frame(-90, 0), "Ctrl+4"),
    Action("top", "View", "Top", lambda s: s.editor.picture.frame(0, 90), "Ctrl+5"),
    Action("bottom", "View", "Bottom", lambda s: s.editor.picture.frame(0, -90), "Ctrl+6"),
    Action("orthographic", "View", "Orthographic",
           lambda s: s.editor.state.viewpoint.toggle_orthographic(),
           "O", "Parallel lines of sight: lengths are alike at any depth",
           checked=lambda e: e.state.camera.is_orthographic),
    Action("save-camera", "View", "Save camera…", _save_camera, "Alt+0",
           "By a name, in the session; Alt+1 to Alt+9 bring cameras back", dialog=True, rule=True),
    Action("next-colouring", "View", "Next colouring", _next_colour, "C",
           "Displacement, stretch, error, where to put the next handle", rule=True),
    Action("next-ghost", "View", "Next ghost", _next_ghost, "G",
           "The reference, the target mesh, or the pose before the last step"),
    Action("cube", "View", "Orientation cube", _turn_over("cube"), "",
           "Shows and sets the direction of view", checked=lambda e: e.state.look.cube, rule=True),
    Action("floor", "View", "Floor", lambda s: s.editor.floor.switch(), "Ctrl+F",
           "A plane where the examples stand, which no part of the body passes",
           checked=lambda e: e.floor.height is not None),
    Action("wireframe", "View", "Wireframe", _turn_over("wireframe"), "W",
           checked=lambda e: e.state.look.wireframe),
    Action("smooth", "View", "Smooth shading", _turn_over("smooth"), "L",
           checked=lambda e: e.state.look.smooth),
    Action("dark", "View", "Dark", lambda s: s.choose_theme(not s.editor.state.look.dark), "D",
           "The dark or the light theme, also at the next start", enabled=always,
           checked=lambda e: e.state.look.dark),
    Action("system-theme", "View", "Theme of the system", lambda s: s.choose_theme(None), "",
           "Dark or light as the system is", enabled=always),
)  # fmt: skip
