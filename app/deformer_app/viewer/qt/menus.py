"""Menus and tool bar of the window, built from the table of actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QMainWindow, QMenu, QToolBar, QToolButton

from deformer_app.viewer.actions import ACTIONS, MENUS, Action, Shell
from deformer_app.viewer.qt.camera_menu import CameraMenu
from deformer_app.viewer.qt.icons import OF_ACTIONS, put_icon

_CAMERAS_AFTER = "save-camera"  # likewise of saved cameras
_RECENT_AFTER = "open-session"  # id of the action that the menu of recent files follows


def tip(action: Action) -> str:
    """Return the tool tip of an action: what it does, and its key."""
    about = action.about or action.title.rstrip("…")
    return f"{about}  {action.key}" if action.key else about


class Menus:
    """What the window offers to do.

    Args:
        window: gets the menus and the tool bar.
        run: called with the action that the user has chosen.

    Attributes:
        items: Qt's action by the id of the program's.
        menus: Qt's menu by its name.
        cameras: menu of saved cameras.
        recent: menu of recent files, to be filled when it is about to be shown.
    """

    def __init__(self, window: QMainWindow, run: Callable[[Action], Any]) -> None:
        """Add menus and tool bar to the window."""
        self.items: dict[str, QAction] = {}
        self.menus: dict[str, QMenu] = {
            name: window.menuBar().addMenu(f"&{name}") for name in MENUS
        }
        self.recent = QMenu("Open recent", window)
        self.cameras = CameraMenu(window)
        bar = QToolBar("Tools", window)
        bar.setObjectName("Tools")
        bar.setMovable(False)
        bar.setIconSize(QSize(18, 18))
        bar.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        window.addToolBar(bar)
        # Qt 6.11.3: a bar that unfolds with an animation shows no more tools in a wider window.
        window.setAnimated(False)
        # Shown when not all tools fit; the name is Qt's own, and nothing promises it.
        more = bar.findChild(QToolButton, "qt_toolbar_ext_button")
        if more is not None:
            put_icon(more, "chevrons-right")
            more.setToolTip("More tools")
        for action in ACTIONS:
            item = QAction(action.title, window)
            item.setShortcuts([QKeySequence(key) for key in action.keys])
            item.setStatusTip(action.about or action.title)
            item.setToolTip(tip(action))
            if action.id in OF_ACTIONS:
                put_icon(item, OF_ACTIONS[action.id])
            item.setCheckable(action.checked is not None)
            item.setIconVisibleInMenu(action.checked is None)  # an icon would hide the tick
            item.triggered.connect(lambda _=False, a=action: run(a))
            menu = self.menus[action.menu]
            if action.rule:
                menu.addSeparator()
            menu.addAction(item)
            if action.tool:
                if action.rule and bar.actions():
                    bar.addSeparator()
                item.setIconText(f"\u2009{action.tool}")  # a thin space between icon and text
                bar.addAction(item)
                bar.widgetForAction(item).setFocusPolicy(Qt.FocusPolicy.TabFocus)
            if action.id == _RECENT_AFTER:
                menu.addMenu(self.recent)
            if action.id == _CAMERAS_AFTER:
                menu.addMenu(self.cameras)
            self.items[action.id] = item
        self.menus["View"].addSeparator()  # above the docks

    def refresh(self, shell: Shell) -> None:
        """Update which actions are enabled and checked, and their titles."""
        self.cameras.refresh(shell.editor)
        for action in ACTIONS:
            item = self.items[action.id]
            item.setEnabled(action.enabled(shell.editor))
            item.setText(action.retitled(shell) or action.title)
            if action.checked is not None:
                item.setChecked(action.checked(shell.editor))
