"""Everything that has a menu entry or a key, in one table that all shells read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from deformer_app.viewer.colouring import COLOURINGS
from deformer_app.viewer.editor import Editor

MENUS = ("File", "Edit", "Handles", "View", "Help")
MESH_FILES = "Meshes (*.ply *.obj *.stl *.glb *.off)"


class Shell(Protocol):
    """What an action needs of the window around an editor."""

    editor: Editor

    def ask_open(self, title: str, files: str) -> Path | None:
        """Ask for a file to read."""
        ...

    def ask_folder(self, title: str) -> Path | None:
        """Ask for a folder."""
        ...

    def ask_save(self, title: str, name: str, files: str) -> Path | None:
        """Ask for a file to write."""
        ...

    def save(self, elsewhere: bool) -> bool:
        """Save the session; false if the user thought better of it."""
        ...

    def open_model(self, path: Path | str) -> None:
        """Open a model, unless the user wants to keep unsaved work."""
        ...

    def open_session(self, path: Path) -> None:
        """Open a session, unless the user wants to keep unsaved work."""
        ...

    def train(self) -> None:
        """Train a model on shapes that the user chooses."""
        ...

    def record(self) -> None:
        """Begin or end a recording."""
        ...

    def turntable(self) -> None:
        """Write a turntable."""
        ...

    def help(self) -> None:
        """Show or hide the help."""
        ...

    def tour(self) -> None:
        """Begin the tour."""
        ...

    def close(self) -> Any:
        """End the program, unless the user wants to keep unsaved work."""
        ...


@dataclass(frozen=True)
class Action:
    """One command.

    Args:
        menu: where it is listed.
        title: what it is called there.
        run: what it does.
        key: its shortcut, as Qt writes them ("Ctrl+Shift+Z").
        about: a line for the status bar and the help.
        checked: whether it is on, for what can be on or off.
        dialog: whether it asks for a file, which a plain window cannot.
        rule: whether the menu has a line above it.
    """

    menu: str
    title: str
    run: Callable[[Shell], Any]
    key: str = ""
    about: str = ""
    checked: Callable[[Editor], bool] | None = None
    dialog: bool = False
    rule: bool = False


def _with(path: Path | None, use: Callable[[Path], Any]) -> None:
    if path is not None:
        use(path)


def _open_model(shell: Shell) -> None:
    _with(shell.ask_folder("Open model"), shell.open_model)


def _open_session(shell: Shell) -> None:
    _with(shell.ask_open("Open session", "Sessions (*.json)"), shell.open_session)


def _export_pose(shell: Shell) -> None:
    _with(shell.ask_save("Export pose", "pose.ply", MESH_FILES), shell.editor.export_pose)


def _export_handles(shell: Shell) -> None:
    path = shell.ask_save("Export handles", "handles.json", "Handles (*.json)")
    _with(path, shell.editor.export_handles)


def _load_target(shell: Shell) -> None:
    _with(shell.ask_open("Load target mesh", MESH_FILES), shell.editor.load_target)


def _start_from_mesh(shell: Shell) -> None:
    _with(shell.ask_open("Start from mesh", MESH_FILES), shell.editor.start_from_mesh)


def _screenshot(shell: Shell) -> None:
    path = shell.ask_save("Screenshot", "deformer.png", "Pictures (*.png *.jpg)")
    _with(path, shell.editor.screenshot)


def _next_colour(shell: Shell) -> None:
    editor = shell.editor
    names = [name for name in COLOURINGS if name != "component"]
    if editor.target is None:
        names.remove("error")
    kind = editor.look.colour
    place = names.index(kind) if kind in names else -1
    editor.change_look(colour=names[(place + 1) % len(names)])


def _next_ghost(shell: Shell) -> None:
    editor = shell.editor
    names = ["none", "reference", *(["target"] if editor.target is not None else [])]
    place = names.index(editor.look.ghost)
    editor.change_look(ghost=names[(place + 1) % len(names)])


def _looks(name: str) -> Callable[[Shell], Any]:
    def turn_over(shell: Shell) -> None:
        shell.editor.change_look(**{name: not getattr(shell.editor.look, name)})

    return turn_over


def _paint(shell: Shell) -> None:
    editor = shell.editor
    editor.set_mode("drag" if editor.mode == "paint" else "paint")


def _select_all(shell: Shell) -> None:
    shell.editor.select([handle.id for handle in shell.editor.edit.handles])


ACTIONS: Sequence[Action] = (
    Action("File", "Open model…", _open_model, "Ctrl+O", "A model's folder", dialog=True),
    Action("File", "Train on shapes…", lambda s: s.train(), "Ctrl+T",
           "Learn a model from example shapes", dialog=True),
    Action("File", "Open session…", _open_session, "Ctrl+Shift+O", dialog=True),
    Action("File", "Save session", lambda s: s.save(False), "Ctrl+S",
           "Handles, sliders, camera and the whole history in one file", rule=True),
    Action("File", "Save session as…", lambda s: s.save(True), "Ctrl+Shift+S", dialog=True),
    Action("File", "Load target mesh…", _load_target, "",
           "A mesh to compare with: ghost, error colours, E_rms", dialog=True, rule=True),
    Action("File", "Export pose…", _export_pose, "Ctrl+E", "PLY, OBJ, STL or GLB", dialog=True),
    Action("File", "Export handles…", _export_handles, "",
           "Targets as deformer fit reads them", dialog=True),
    Action("File", "Screenshot…", _screenshot, "F12", dialog=True, rule=True),
    Action("File", "Turntable…", lambda s: s.turntable(), "",
           "A full turn as GIF or MP4", dialog=True),
    Action("File", "Record", lambda s: s.record(), "Ctrl+R",
           "Record what happens as GIF or MP4; again to stop", dialog=True),
    Action("File", "Quit", lambda s: s.close(), "Ctrl+Q", rule=True),
    Action("Edit", "Undo", lambda s: s.editor.undo(), "Ctrl+Z"),
    Action("Edit", "Redo", lambda s: s.editor.redo(), "Ctrl+Shift+Z"),
    Action("Edit", "Select all handles", _select_all, "Ctrl+A", rule=True),
    Action("Edit", "Delete handles", lambda s: s.editor.delete(), "Del", "The selected ones"),
    Action("Edit", "Clear handles", lambda s: s.editor.clear(), "Ctrl+Del"),
    Action("Edit", "Reset to reference", lambda s: s.editor.reset(), "Ctrl+0",
           "The undeformed shape, without handles", rule=True),
    Action("Edit", "Start from this pose", lambda s: s.editor.use_as_base(), "Ctrl+B",
           "From now on the prior leans on what is shown"),
    Action("Edit", "Start from mesh…", _start_from_mesh, "",
           "The pose closest to a mesh of the same connectivity", dialog=True),
    Action("Handles", "Soft", lambda s: s.editor.set_kind("soft"), "S",
           "Close to its target; the examples have a say"),
    Action("Handles", "Exact", lambda s: s.editor.set_kind("exact"), "E", "On its target"),
    Action("Handles", "Pin", lambda s: s.editor.set_kind("pin"), "P",
           "Stays where it is, whatever is dragged"),
    Action("Handles", "Mirror", lambda s: s.editor.mirror(), "M",
           "Copy the selected handles, or all, to the body's other side", rule=True),
    Action("Handles", "Mirror plane: find", lambda s: s.editor.find_symmetry(), "",
           "Look for the plane across which the body is its own image"),
    *(Action("Handles", f"Mirror plane: across {axis}",
             lambda s, a=axis: s.editor.tell_symmetry(a)) for axis in "xyz"),
    Action("Handles", "Paint region", _paint, "B",
           "Paint a patch that moves and turns as one handle",
           checked=lambda e: e.mode == "paint", rule=True),
    Action("Handles", "Smaller brush", lambda s: s.editor.resize_brush(0.8), "["),
    Action("Handles", "Larger brush", lambda s: s.editor.resize_brush(1.25), "]"),
    Action("Handles", "Suggest next handle", lambda s: s.editor.suggest(), "N",
           "Where one more handle would tell most; again to place it", rule=True),
    Action("Handles", "Manipulator: move", lambda s: s.editor.set_gizmo("move"), "1",
           "Along axes and in planes", rule=True, checked=lambda e: e.gizmo_mode == "move"),
    Action("Handles", "Manipulator: rotate", lambda s: s.editor.set_gizmo("rotate"), "2",
           "Several handles or a region, about their centre",
           checked=lambda e: e.gizmo_mode == "rotate"),
    Action("Handles", "Manipulator: scale", lambda s: s.editor.set_gizmo("scale"), "3",
           "Several handles or a region, about their centre",
           checked=lambda e: e.gizmo_mode == "scale"),
    Action("View", "Frame all", lambda s: s.editor.frame(), "F"),
    Action("View", "Front", lambda s: s.editor.frame(0, 0), "Ctrl+1", rule=True),
    Action("View", "Left side", lambda s: s.editor.frame(90, 0), "Ctrl+2"),
    Action("View", "Back", lambda s: s.editor.frame(180, 0), "Ctrl+3"),
    Action("View", "Right side", lambda s: s.editor.frame(-90, 0), "Ctrl+4"),
    Action("View", "Top", lambda s: s.editor.frame(0, 89), "Ctrl+5"),
    Action("View", "Next colouring", _next_colour, "C",
           "Displacement, stretch, error, where to put the next handle", rule=True),
    Action("View", "Next ghost", _next_ghost, "G", "The reference or the target mesh behind"),
    Action("View", "Wireframe", _looks("wireframe"), "W", checked=lambda e: e.look.wireframe,
           rule=True),
    Action("View", "Smooth shading", _looks("smooth"), "L", checked=lambda e: e.look.smooth),
    Action("View", "Dark", _looks("dark"), "D", checked=lambda e: e.look.dark),
    Action("Help", "Keys and mouse", lambda s: s.help(), "F1"),
    Action("Help", "Tour", lambda s: s.tour(), ""),
)  # fmt: skip

MOUSE = (
    ("Click the surface", "place a handle"),
    ("Drag the surface or a handle", "pull it"),
    ("Shift while dragging", "a tenth of the way"),
    ("Shift-click", "select one more"),
    ("Ctrl-drag", "select by a box"),
    ("Drag beside the body, or right button", "orbit"),
    ("Middle button, or Shift and right", "pan"),
    ("Wheel", "zoom to the cursor"),
    ("Esc", "give up a drag"),
)


def help_groups() -> dict[str, list[tuple[str, str]]]:
    """All keys and what the mouse does, by menu: what to press and what comes of it."""
    groups = {"Mouse": list(MOUSE)}
    for menu in MENUS:
        groups[menu] = [(a.key, a.title.rstrip("…")) for a in ACTIONS if a.key and a.menu == menu]
    return groups


def help_text() -> str:
    """All keys and what the mouse does, as lines."""
    rows = [row for group in help_groups().values() for row in group]
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {what}" for name, what in rows)
