"""Contents of the help: all keys and the use of the mouse."""

from __future__ import annotations

from deformer_app.viewer.actions import ACTIONS, MENUS

MOUSE = (
    ("Click the surface", "place a handle"),
    ("Drag the surface or a handle", "pull it"),
    ("Shift while dragging", "a tenth of the way"),
    ("Shift-click", "select one more"),
    ("Ctrl-drag", "select by a box"),
    ("Drag beside the body, or right button", "orbit, during a drag, too"),
    ("Middle button, or Shift and right", "pan, during a drag, too"),
    ("Click the cube in the corner", "look from that side; drag it to turn"),
    ("Wheel", "zoom to the cursor, during a drag, too"),
    ("Shift and wheel over a pin", "its size"),
    ("Right click", "what can be done here"),
    ("0…9 - . ⌫ Tab Enter", "an exact value while the manipulator moves"),
    ("Esc", "give up a drag, also of a slider, or the animation that is being written"),
)

PANELS = (
    ("Enter or Esc", "leave a field, with its new value or the one before"),
    ("Arrows or a click in the history", "show that step"),
    ("F2", "rename the selected component or pose"),
    ("Alt+Left, Alt+Right", "move a saved pose in its row"),
    ("Alt+1 to Alt+9", "bring a saved camera back"),
    ("Press on a slider", "bring its handle to the mouse, and drag on"),
    ("Double click on a component's slider", "back to zero"),
    ("Drag a diamond of All keys", "move all keys of its frame"),
)


def help_groups() -> dict[str, list[tuple[str, str]]]:
    """Return pairs of key or mouse action and effect, by menu."""
    groups = {"Mouse": list(MOUSE), "Panels": list(PANELS)}
    for menu in MENUS:
        groups[menu] = [
            (" or ".join(a.keys), a.title.rstrip("…")) for a in ACTIONS if a.keys and a.menu == menu
        ]
    return groups


def help_text() -> str:
    """Return all keys and the use of the mouse, as lines of text."""
    rows = [row for group in help_groups().values() for row in group]
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {what}" for name, what in rows)
