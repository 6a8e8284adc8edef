"""The colours and shapes of all widgets.

The first window uses this module, so it imports nothing heavy.
"""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication

from deformer_app.rendering.palette import DARK, LIGHT, Theme
from deformer_app.viewer.qt.icons import recolour_icons
from deformer_app.viewer.qt.style import stylesheet
from deformer_app.viewer.settings import Settings


def apply_theme(theme: Theme) -> None:
    """Give the widgets of the application the colours of a theme."""
    application = QApplication.instance()
    assert isinstance(application, QApplication)
    palette, roles = QPalette(), QPalette.ColorRole
    for name, colour in theme.widgets:
        palette.setColor(roles[name], QColor(colour))
    palette.setColor(roles.Accent, QColor(theme.accent))
    palette.setColor(roles.Link, QColor(theme.accent))
    for role in (roles.Text, roles.ButtonText, roles.WindowText):
        palette.setColor(QPalette.ColorGroup.Disabled, role, QColor(theme.disabled))
    QApplication.setPalette(palette)
    sheet = stylesheet(theme)
    if application.styleSheet() != sheet:  # a tenth of the time that a window takes to open
        application.setStyleSheet(sheet)
        recolour_icons()


def preferred_theme(settings: Settings) -> Theme:
    """Return the theme that the user has chosen, or else the system's."""
    chosen = settings.dark
    if chosen is None:
        scheme = QApplication.styleHints().colorScheme()
        chosen = scheme == Qt.ColorScheme.Dark
    return DARK if chosen else LIGHT
