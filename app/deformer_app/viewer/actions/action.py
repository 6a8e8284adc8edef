"""What an action is, and what it asks of the window that runs it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from deformer import io
from deformer_app.viewer.editor import Editor

_OF_THE_VIEW = ("View", "Help")  # menus
MESH_FILES = f"Meshes ({' '.join(f'*{suffix}' for suffix in io.MESH_SUFFIXES)})"


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

    def ask_text(self, title: str, about: str, start: str) -> str | None:
        """Ask for a line of text."""
        ...

    def copy_text(self, text: str) -> None:
        """Put a text on the clipboard."""
        ...

    def copied_text(self) -> str:
        """Return the text on the clipboard; empty if there is none."""
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

    def history(self) -> None:
        """Show or hide the steps of the history."""
        ...

    def about(self) -> None:
        """Show the version, licences and the model's card."""
        ...

    def close_model(self) -> None:
        """Close the model, unless the user wants to keep unsaved work."""
        ...

    def act(self, action: str) -> None:
        """Run an action by its id."""
        ...

    def choose_theme(self, dark: bool | None) -> None:
        """Show the dark or the light theme from now on, or the system's for None."""
        ...

    def begin_tour(self) -> None:
        """Begin the tour."""
        ...

    def close(self) -> Any:
        """End the program, unless the user wants to keep unsaved work."""
        ...


def always(editor: Editor) -> bool:
    """Return True: the action can be run without a model, too."""
    return True


def with_model(editor: Editor) -> bool:
    """Return True once a model is open."""
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
        ends_drag: false if a drag can go on while it runs, as it can for all of the menu View.
        second_key: another shortcut, which menus do not show.
    """

    id: str
    menu: str
    title: str
    run: Callable[[Shell], Any]
    key: str = ""
    about: str = ""
    enabled: Callable[[Editor], bool] = with_model
    checked: Callable[[Editor], bool] | None = None
    retitled: Callable[[Shell], str | None] = lambda shell: None
    dialog: bool = False
    rule: bool = False
    tool: str = ""
    ends_drag: bool = True
    second_key: str = ""

    @property
    def keys(self) -> tuple[str, ...]:
        """Its shortcuts; the first is the one that menus show."""
        return tuple(key for key in (self.key, self.second_key) if key)


def carry_out(action: Action, shell: Shell) -> None:
    """Run an action; one that does more than change the view ends the current drag first.

    Raises:
        InputError, OSError: a mistake of the user, or a file that cannot be read or written.
    """
    if action.ends_drag and action.menu not in _OF_THE_VIEW:
        shell.editor.controller.finish()
    action.run(shell)


def unless_cancelled(path: Path | None, use: Callable[[Path], Any]) -> None:
    """Use a path unless the user has cancelled the dialog that asks for it."""
    if path is not None:
        use(path)
