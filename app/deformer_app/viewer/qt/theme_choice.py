"""Whether the window is light or dark, remembered between two starts."""

from __future__ import annotations

from PySide6.QtWidgets import QApplication

from deformer_app.rendering.palette import DARK, Theme
from deformer_app.viewer.changes import Change, LookChanged
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.qt.theme import apply_theme, preferred_theme
from deformer_app.viewer.settings import Settings


class ThemeChoice:
    """Keeps widgets and picture in the theme of the user's choice, and remembers the choice.

    Args:
        editor: its picture has a theme of its own, which the widgets follow.
        settings: remember the choice between two starts.
    """

    def __init__(self, editor: Editor, settings: Settings) -> None:
        """Apply the theme of the last start, or the system's."""
        self._editor, self._settings = editor, settings
        self._shown: Theme | None = None
        editor.on_change.append(self._hear)
        self._show_preferred()
        QApplication.styleHints().colorSchemeChanged.connect(self._show_preferred)

    @property
    def is_dark(self) -> bool:
        """True while the dark theme is shown."""
        return self._shown is DARK

    def follow_system(self) -> None:
        """Forget the user's choice."""
        self._settings.note_dark(None)
        self._show_preferred()

    def choose(self, dark: bool) -> None:
        """Show the dark or the light theme, and remember it."""
        self._settings.note_dark(dark)
        self._show_preferred()

    def _show_preferred(self, *_: object) -> None:
        dark = preferred_theme(self._settings) is DARK
        self._editor.picture.change_look(dark=dark)

    def _hear(self, change: Change) -> None:
        theme = self._editor.state.view.theme
        if isinstance(change, LookChanged) and theme is not self._shown:
            self._shown = theme
            apply_theme(theme)
