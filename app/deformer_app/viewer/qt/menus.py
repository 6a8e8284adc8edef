"""Menus and tool bar of the window, built from the table of actions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QMainWindow, QMenu, QToolBar

from deformer_app.viewer.actions import ACTIONS, MENUS, Action, Shell

_RECENT_AFTER = "open-session"  # id of the action that the menu of recent files follows


class Menus:
    """What the window offers to do.

    Args:
        window: gets the menus and the tool bar.
        run: called with the action that the user has chosen.

    Attributes:
        items: Qt's action by the id of the program's.
        menus: Qt's menu by its name.
        recent: menu of recent files, to be filled when it is about to be shown.
    """

    def __init__(self, window: QMainWindow, run: Callable[[Action], Any]) -> None:
        """Add menus and tool bar to the window."""
        self.items: dict[str, QAction] = {}
        self.menus: dict[str, QMenu] = {
            name: window.menuBar().addMenu(f"&{name}") for name in MENUS
        }
        self.recent = QMenu("Open recent", window)
        bar = QToolBar("Tools", window)
        bar.setObjectName("Tools")
        bar.setMovable(False)
        window.addToolBar(bar)
        for action in ACTIONS:
            item = QAction(action.title, window)
            if action.key:
                item.setShortcut(QKeySequence(action.key))
            item.setStatusTip(action.about or action.title)
            item.setToolTip(f"{action.about or action.title}  {action.key}")
            item.setCheckable(action.checked is not None)
            item.triggered.connect(lambda _=False, a=action: run(a))
            menu = self.menus[action.menu]
            if action.rule:
                menu.addSeparator()
            menu.addAction(item)
            if action.tool:
                item.setIconText(action.tool)
                bar.addAction(item)
            if action.id == _RECENT_AFTER:
                menu.addMenu(self.recent)
            self.items[action.id] = item
        self.menus["View"].addSeparator()  # above the docks

    def refresh(self, shell: Shell) -> None:
        """Update which actions are enabled and checked, and their titles."""
        for action in ACTIONS:
            item = self.items[action.id]
            item.setEnabled(action.enabled(shell.editor))
            item.setText(action.retitled(shell) or action.title)
            if action.checked is not None:
                item.setChecked(action.checked(shell.editor))
