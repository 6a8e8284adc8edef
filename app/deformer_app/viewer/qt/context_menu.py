"""Menus of the right mouse button, by what lies under it."""

from __future__ import annotations

from PySide6.QtCore import QPoint
from PySide6.QtWidgets import QMenu, QWidget

from deformer_app.viewer.actions import Shell
from deformer_app.viewer.colouring import COLOURINGS
from deformer_app.viewer.events import Pixel
from deformer_app.viewer.qt.icons import put_icon
from deformer_app.viewer.qt.menus import Menus
from deformer_app.viewer.stage import Hover

# Ids of actions; None is a rule.
_ON_HANDLE = (
    *("soft", "exact", "pin", "turn-freely", None, "mirror", None),
    *("gizmo-move", "gizmo-rotate", "gizmo-scale", None, "delete"),
)
_ON_SURFACE = ("paint", "suggest", None, "frame", "next-colouring")
_BESIDE = (
    *("frame", "front", "left", "back", "right", "top", None),
    *("next-colouring", "next-ghost", "wireframe", "smooth", "dark", None, "screenshot"),
)


class ContextMenu:
    """Shows a menu of actions for a handle, for the surface, or for the view.

    Args:
        picture: the widget that the pixels count in.
        shell: the window.
        menus: have the actions.
    """

    def __init__(self, picture: QWidget, shell: Shell, menus: Menus) -> None:
        """No menu is shown yet."""
        self._picture, self._shell, self._menus = picture, shell, menus
        self.shown: QMenu | None = None

    def popup(self, pixel: Pixel, under: Hover) -> None:
        """Show the menu of what is under a pixel of the picture."""
        editor, menu = self._shell.editor, QMenu(self._picture)
        if under.handle is not None:
            if under.handle not in editor.handles.selected:
                editor.handles.select([under.handle])
            self._add(menu, _ON_HANDLE)
        elif under.vertex is not None:
            vertex = under.vertex
            for title, icon, run in (
                ("Place handle", "circle", lambda: self._place(vertex)),
                ("Pin here", "pin", lambda: editor.pins.pin_at(vertex)),
            ):
                put_icon(menu.addAction(title, run), icon)
            menu.addSeparator()
            self._add(menu, _ON_SURFACE)
        else:
            self._add(menu, _BESIDE)
            menu.insertMenu(self._menus.items["next-colouring"], self._colours(menu))
        self._menus.refresh(self._shell)
        self.shown = menu
        menu.aboutToHide.connect(menu.deleteLater)
        menu.popup(self._picture.mapToGlobal(QPoint(round(pixel[0]), round(pixel[1]))))

    def _colours(self, parent: QMenu) -> QMenu:
        """A menu of what the surface can be coloured by."""
        editor, menu = self._shell.editor, QMenu("Colour by", parent)
        for name, title in COLOURINGS.items():
            if name == "component" or (name == "error" and editor.state.target_mesh is None):
                continue
            item = menu.addAction(title)
            item.setCheckable(True)
            item.setChecked(editor.state.look.colour == name)
            item.triggered.connect(lambda _=False, n=name: editor.picture.change_look(colour=n))
        return menu

    def _place(self, vertex: int) -> None:
        editor = self._shell.editor
        editor.handles.place(vertex)
        editor.commit("Place handle")

    def _add(self, menu: QMenu, ids: tuple[str | None, ...]) -> None:
        for name in ids:
            if name is None:
                menu.addSeparator()
            else:
                menu.addAction(self._menus.items[name])
