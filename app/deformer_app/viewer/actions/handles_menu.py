"""Actions of the menu Handles: kinds, mirroring, painting, layouts, manipulator."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from deformer_app.viewer.actions.action import Action, Shell
from deformer_app.viewer.gizmo import Mode
from deformer_app.viewer.mirror_plane import AXES
from deformer_app.viewer.rigs import place_rig

_RIG = 20  # handles that the dialog of a rig proposes


def _place_rig(symmetric: bool) -> Callable[[Shell], Any]:
    """Ask how many handles to lay out."""

    def run(shell: Shell) -> None:
        most = len(shell.editor.model.reference.vertices)
        count = shell.ask_number("Place a rig", "Handles:", min(_RIG, most), most)
        if count is not None:
            place_rig(shell.editor, count, symmetric)

    return run


def _paint(shell: Shell) -> None:
    stage = shell.editor.stage
    stage.set_tool("drag" if stage.tool == "paint" else "paint")


def _choose_manipulator(mode: Mode) -> Callable[[Shell], Any]:
    """Choose what the manipulator does, and tell why it does not so with what is selected."""

    def run(shell: Shell) -> None:
        editor = shell.editor
        editor.state.set_gizmo(mode)
        moved = editor.state.movable(editor.edit.handles)
        if editor.handles.selected and not moved:
            editor.pins.tell()
        elif moved and mode == "scale" and not editor.state.manipulator.can_scale(moved):
            editor.note(
                "Nothing of a single point can be scaled: select several handles or a region"
            )

    return run


HANDLES: Sequence[Action] = (
    Action("soft", "Handles", "Soft", lambda s: s.editor.handles.set_kind("soft"), "S",
           "Close to its target; the examples have a say"),
    Action("exact", "Handles", "Exact", lambda s: s.editor.handles.set_kind("exact"), "E",
           "On its target"),
    Action("pin", "Handles", "Pin", lambda s: s.editor.pins.pin_here(), "P",
           "What is under the mouse, or selected: its patch stays, whatever is dragged"),
    Action("larger-pin", "Handles", "Larger pin", lambda s: s.editor.pins.resize_selected(1.0),
           "+", "Also Shift and the wheel over it"),
    Action("smaller-pin", "Handles", "Smaller pin", lambda s: s.editor.pins.resize_selected(-1.0),
           "-", "Also Shift and the wheel over it"),
    Action("turn-freely", "Handles", "Turn freely", lambda s: s.editor.handles.turn_freely(), "T",
           "Forget how a handle was turned: the rest decides"),
    Action("mirror", "Handles", "Mirror", lambda s: s.editor.mirror.mirror_handles(), "M",
           "Copy the selected handles, or all, to the body's other side", rule=True,
           tool="Mirror"),
    Action("live-mirror", "Handles", "Pose both sides", lambda s: s.editor.mirror.switch_live(),
           "Shift+M", "What is done to a handle is done on the other side, too",
           checked=lambda e: e.mirror.is_live, tool="Both sides"),
    Action("mirror-pose", "Handles", "Mirror the pose", lambda s: s.editor.mirror.mirror_pose(),
           "Ctrl+M", "The left side does what the right one did, and the other way round"),
    Action("find-plane", "Handles", "Mirror plane: find", lambda s: s.editor.mirror.plane.find(),
           "", "Look for the plane across which the body is its own image"),
    *(
        Action(f"plane-across-{axis}", "Handles", f"Mirror plane: across {axis}",
               lambda s, a=axis: s.editor.mirror.plane.set_across(a))
        for axis in AXES
    ),
    Action("paint", "Handles", "Paint region", _paint, "B",
           "Paint a patch that moves and turns as one handle",
           checked=lambda e: e.state.tool == "paint", rule=True, tool="Paint region"),
    Action("smaller-brush", "Handles", "Smaller brush", lambda s: s.editor.stage.resize_brush(0.8),
           "[", ends_drag=False),
    Action("larger-brush", "Handles", "Larger brush", lambda s: s.editor.stage.resize_brush(1.25),
           "]", ends_drag=False),
    Action("suggest", "Handles", "Suggest next handle", lambda s: s.editor.handles.suggest(), "N",
           "Where one more handle would tell most; again to place it", rule=True, tool="Suggest"),
    Action("rig", "Handles", "Place a rig of handles…", _place_rig(False), "Shift+N",
           "As many as you like, where they tell most", dialog=True),
    Action("symmetric-rig", "Handles", "Place a symmetric rig…", _place_rig(True), "",
           "The same in left and right pairs", dialog=True),
    Action("gizmo-move", "Handles", "Manipulator: move",
           _choose_manipulator("move"), "1", "Along axes and in planes", rule=True,
           checked=lambda e: e.state.manipulator.mode == "move", tool="Move"),
    Action("gizmo-rotate", "Handles", "Manipulator: rotate",
           _choose_manipulator("rotate"), "2",
           "A handle in its place; several, or a region, about their centre",
           checked=lambda e: e.state.manipulator.mode == "rotate", tool="Rotate"),
    Action("gizmo-scale", "Handles", "Manipulator: scale",
           _choose_manipulator("scale"), "3",
           "Several handles or a region, about their centre; of a single point nothing can grow",
           checked=lambda e: e.state.manipulator.mode == "scale", tool="Scale"),
    Action("axes-world", "Handles", "Manipulator axes: world",
           lambda s: s.editor.state.set_axes("world"), "4", "Those of the model's file", rule=True,
           checked=lambda e: e.state.manipulator.axes == "world"),
    Action("axes-surface", "Handles", "Manipulator axes: surface",
           lambda s: s.editor.state.set_axes("surface"), "5",
           "Z along the normal of the surface at the handles, X level",
           checked=lambda e: e.state.manipulator.axes == "surface"),
    Action("axes-screen", "Handles", "Manipulator axes: screen",
           lambda s: s.editor.state.set_axes("screen"), "6",
           "X to the right, Y up, Z towards you",
           checked=lambda e: e.state.manipulator.axes == "screen"),
)  # fmt: skip
