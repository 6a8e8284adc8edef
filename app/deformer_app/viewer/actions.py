"""The table of all actions with a menu entry or a key, shared by the Qt and the plain window."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from deformer import io
from deformer_app.viewer.colouring import COLOURINGS
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.exports import export_handles, export_pose, save_screenshot
from deformer_app.viewer.mirror_plane import AXES
from deformer_app.viewer.rigs import load_handles, place_rig

MENUS = ("File", "Edit", "Handles", "View", "Help")
MESH_FILES = f"Meshes ({' '.join(f'*{suffix}' for suffix in io.MESH_SUFFIXES)})"


_RIG = 20  # handles that the dialog of a rig proposes


class Shell(Protocol):
    """The functions of a window that actions call."""

    editor: Editor

    @property
    def recording(self) -> bool:
        """True while the picture is being recorded."""
        ...

    def ask_open(self, title: str, files: str) -> Path | None:
        """Ask for a file to read."""
        ...

    def ask_folder(self, title: str) -> Path | None:
        """Ask for a folder."""
        ...

    def ask_save(self, title: str, name: str, files: str) -> Path | None:
        """Ask for a file to write."""
        ...

    def ask_number(self, title: str, about: str, start: int, most: int) -> int | None:
        """Ask for a whole number of 1 to `most`."""
        ...

    def save(self, elsewhere: bool) -> bool:
        """Save the session; return False if the user cancels."""
        ...

    def open_model(self, path: Path | str) -> None:
        """Open a model, unless the user wants to keep unsaved work."""
        ...

    def open_session(self, path: Path) -> None:
        """Open a session, unless the user wants to keep unsaved work."""
        ...

    def train(self) -> Any:
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

    def begin_tour(self) -> None:
        """Begin the tour."""
        ...

    def close(self) -> Any:
        """End the program, unless the user wants to keep unsaved work."""
        ...


def _always(editor: Editor) -> bool:
    return True


def _with_model(editor: Editor) -> bool:
    return editor.is_open


@dataclass(frozen=True)
class Action:
    """One command.

    Args:
        id: name within the program; never shown.
        menu: title of its menu.
        title: its text in the menu.
        run: function that carries it out.
        key: its shortcut in Qt's notation ("Ctrl+Shift+Z").
        about: text of the status bar and the help.
        enabled: returns True while it can be run.
        checked: returns True while it is on; None if it cannot be on or off.
        retitled: returns another title while it would do something else, or None.
        dialog: true if it asks for a file, which the plain window cannot do.
        rule: true if the menu has a line above it.
        tool: text of its button in the tool bar; empty without a button.
    """

    id: str
    menu: str
    title: str
    run: Callable[[Shell], Any]
    key: str = ""
    about: str = ""
    enabled: Callable[[Editor], bool] = _with_model
    checked: Callable[[Editor], bool] | None = None
    retitled: Callable[[Shell], str | None] = lambda shell: None
    dialog: bool = False
    rule: bool = False
    tool: str = ""


def _unless_cancelled(path: Path | None, use: Callable[[Path], Any]) -> None:
    if path is not None:
        use(path)


def _open_model(shell: Shell) -> None:
    _unless_cancelled(shell.ask_folder("Open model"), shell.open_model)


def _open_session(shell: Shell) -> None:
    _unless_cancelled(shell.ask_open("Open session", "Sessions (*.json)"), shell.open_session)


def _export_pose(shell: Shell) -> None:
    _unless_cancelled(
        shell.ask_save("Export pose", "pose.ply", MESH_FILES),
        lambda path: export_pose(shell.editor, path),
    )


def _export_handles(shell: Shell) -> None:
    path = shell.ask_save("Export handles", "handles.json", "Handles (*.json)")
    _unless_cancelled(path, lambda path: export_handles(shell.editor, path))


def _load_handles(shell: Shell) -> None:
    _unless_cancelled(
        shell.ask_open("Load handles", "Handles (*.json)"),
        lambda path: load_handles(shell.editor, path),
    )


def _place_rig(symmetric: bool) -> Callable[[Shell], Any]:
    """Ask how many handles to lay out."""

    def run(shell: Shell) -> None:
        most = len(shell.editor.model.reference.vertices)
        count = shell.ask_number("Place a rig", "Handles:", min(_RIG, most), most)
        if count is not None:
            place_rig(shell.editor, count, symmetric)

    return run


def _load_target(shell: Shell) -> None:
    _unless_cancelled(shell.ask_open("Load target mesh", MESH_FILES), shell.editor.load_target)


def _start_from_mesh(shell: Shell) -> None:
    _unless_cancelled(shell.ask_open("Start from mesh", MESH_FILES), shell.editor.start_from_mesh)


def _screenshot(shell: Shell) -> None:
    path = shell.ask_save("Screenshot", "deformer.png", "Pictures (*.png *.jpg)")
    _unless_cancelled(path, lambda path: save_screenshot(shell.editor, path))


def _next_colour(shell: Shell) -> None:
    editor = shell.editor
    names = [name for name in COLOURINGS if name != "component"]
    if editor.state.target_mesh is None:
        names.remove("error")
    kind = editor.state.look.colour
    current = names.index(kind) if kind in names else -1
    editor.change_look(colour=names[(current + 1) % len(names)])


def _next_ghost(shell: Shell) -> None:
    editor = shell.editor
    has_target = editor.state.target_mesh is not None
    names = ["none", "reference", *(["target"] if has_target else [])]
    current = names.index(editor.state.look.ghost)
    editor.change_look(ghost=names[(current + 1) % len(names)])


def _turn_over(name: str) -> Callable[[Shell], Any]:
    """Toggle a boolean field of the look."""

    def run(shell: Shell) -> None:
        shell.editor.change_look(**{name: not getattr(shell.editor.state.look, name)})

    return run


def _paint(shell: Shell) -> None:
    state = shell.editor.state
    state.set_tool("drag" if state.tool == "paint" else "paint")


ACTIONS: Sequence[Action] = (
    Action("open-model", "File", "Open model…", _open_model, "Ctrl+O", "A model's folder",
           dialog=True, enabled=_always),
    Action("train", "File", "Train on shapes…", lambda s: s.train(), "Ctrl+T",
           "Learn a model from example shapes", dialog=True, enabled=_always),
    Action("open-session", "File", "Open session…", _open_session, "Ctrl+Shift+O", dialog=True,
           enabled=_always),
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
    Action("load-handles", "File", "Load handles…", _load_handles, "",
           "Those of deformer layout, or exported ones", dialog=True),
    Action("screenshot", "File", "Screenshot…", _screenshot, "F12", dialog=True, rule=True),
    Action("turntable", "File", "Turntable…", lambda s: s.turntable(), "",
           "A full turn as GIF or MP4", dialog=True),
    Action("record", "File", "Record", lambda s: s.record(), "Ctrl+R",
           "Record what happens as GIF or MP4; again to stop", dialog=True,
           retitled=lambda s: "Stop recording" if s.recording else None),
    Action("quit", "File", "Quit", lambda s: s.close(), "Ctrl+Q", rule=True, enabled=_always),
    Action("undo", "Edit", "Undo", lambda s: s.editor.undo(), "Ctrl+Z", tool="Undo",
           enabled=lambda e: e.is_open and e.session.can_undo),
    Action("redo", "Edit", "Redo", lambda s: s.editor.redo(), "Ctrl+Shift+Z", tool="Redo",
           enabled=lambda e: e.is_open and e.session.can_redo),
    Action("select-all", "Edit", "Select all handles", lambda s: s.editor.select_all(), "Ctrl+A",
           rule=True),
    Action("delete", "Edit", "Delete handles", lambda s: s.editor.delete(), "Del",
           "The selected ones"),
    Action("clear", "Edit", "Clear handles", lambda s: s.editor.clear(), "Ctrl+Del"),
    Action("reset", "Edit", "Reset to reference", lambda s: s.editor.reset(), "Ctrl+0",
           "The undeformed shape, without handles", rule=True),
    Action("use-as-base", "Edit", "Start from this pose", lambda s: s.editor.use_as_base(),
           "Ctrl+B", "From now on the prior keeps close to what is shown"),
    Action("start-from-mesh", "Edit", "Start from mesh…", _start_from_mesh, "",
           "The pose closest to a mesh of the same connectivity", dialog=True),
    Action("soft", "Handles", "Soft", lambda s: s.editor.set_kind("soft"), "S",
           "Close to its target; the examples have a say"),
    Action("exact", "Handles", "Exact", lambda s: s.editor.set_kind("exact"), "E",
           "On its target"),
    Action("pin", "Handles", "Pin", lambda s: s.editor.set_kind("pin"), "P",
           "Stays where it is, whatever is dragged"),
    Action("turn-freely", "Handles", "Turn freely", lambda s: s.editor.turn_freely(), "T",
           "Forget how a handle was turned: the rest decides"),
    Action("mirror", "Handles", "Mirror", lambda s: s.editor.mirror(), "M",
           "Copy the selected handles, or all, to the body's other side", rule=True,
           tool="Mirror"),
    Action("find-plane", "Handles", "Mirror plane: find", lambda s: s.editor.plane.find(), "",
           "Look for the plane across which the body is its own image"),
    *(
        Action(f"plane-across-{axis}", "Handles", f"Mirror plane: across {axis}",
               lambda s, a=axis: s.editor.plane.set_across(a))
        for axis in AXES
    ),
    Action("paint", "Handles", "Paint region", _paint, "B",
           "Paint a patch that moves and turns as one handle",
           checked=lambda e: e.state.tool == "paint", rule=True, tool="Paint region"),
    Action("smaller-brush", "Handles", "Smaller brush", lambda s: s.editor.stage.brush.resize(0.8),
           "["),
    Action("larger-brush", "Handles", "Larger brush", lambda s: s.editor.stage.brush.resize(1.25),
           "]"),
    Action("suggest", "Handles", "Suggest next handle", lambda s: s.editor.suggest(), "N",
           "Where one more handle would tell most; again to place it", rule=True, tool="Suggest"),
    Action("rig", "Handles", "Place a rig of handles…", _place_rig(False), "Shift+N",
           "As many as you like, where they tell most", dialog=True),
    Action("symmetric-rig", "Handles", "Place a symmetric rig…", _place_rig(True), "",
           "The same in left and right pairs", dialog=True),
    Action("gizmo-move", "Handles", "Manipulator: move",
           lambda s: s.editor.state.set_gizmo("move"), "1", "Along axes and in planes", rule=True,
           checked=lambda e: e.state.gizmo_mode == "move", tool="Move"),
    Action("gizmo-rotate", "Handles", "Manipulator: rotate",
           lambda s: s.editor.state.set_gizmo("rotate"), "2",
           "A handle in its place; several, or a region, about their centre",
           checked=lambda e: e.state.gizmo_mode == "rotate", tool="Rotate"),
    Action("gizmo-scale", "Handles", "Manipulator: scale",
           lambda s: s.editor.state.set_gizmo("scale"), "3",
           "Several handles or a region, about their centre",
           checked=lambda e: e.state.gizmo_mode == "scale", tool="Scale"),
    Action("frame", "View", "Frame all", lambda s: s.editor.frame(), "F", tool="Frame all"),
    Action("front", "View", "Front", lambda s: s.editor.frame(0, 0), "Ctrl+1", rule=True),
    Action("left", "View", "Left side", lambda s: s.editor.frame(90, 0), "Ctrl+2"),
    Action("back", "View", "Back", lambda s: s.editor.frame(180, 0), "Ctrl+3"),
    Action("right", "View", "Right side", lambda s: s.editor.frame(-90, 0), "Ctrl+4"),
    Action("top", "View", "Top", lambda s: s.editor.frame(0, 89), "Ctrl+5"),
    Action("next-colouring", "View", "Next colouring", _next_colour, "C",
           "Displacement, stretch, error, where to put the next handle", rule=True),
    Action("next-ghost", "View", "Next ghost", _next_ghost, "G",
           "The reference or the target mesh behind"),
    Action("wireframe", "View", "Wireframe", _turn_over("wireframe"), "W",
           checked=lambda e: e.state.look.wireframe, rule=True),
    Action("smooth", "View", "Smooth shading", _turn_over("smooth"), "L",
           checked=lambda e: e.state.look.smooth),
    Action("dark", "View", "Dark", _turn_over("dark"), "D", checked=lambda e: e.state.look.dark),
    Action("help", "Help", "Keys and mouse", lambda s: s.help(), "F1", enabled=_always),
    Action("tour", "Help", "Tour", lambda s: s.begin_tour(), "", enabled=_always),
)  # fmt: skip
