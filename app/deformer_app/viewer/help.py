"""Contents of the help: all keys and the use of the mouse."""

from __future__ import annotations

from deformer_app.viewer.actions import ACTIONS, MENUS

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
    """Return pairs of key or mouse action and effect, by menu."""
    groups = {"Mouse": list(MOUSE)}
    for menu in MENUS:
        groups[menu] = [(a.key, a.title.rstrip("…")) for a in ACTIONS if a.key and a.menu == menu]
    return groups


def help_text() -> str:
    """Return all keys and the use of the mouse, as lines of text."""
    rows = [row for group in help_groups().values() for row in group]
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {what}" for name, what in rows)
