"""The colours of all widgets."""

from __future__ import annotations

from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication

from deformer_app.rendering.palette import Theme


def apply_theme(theme: Theme) -> None:
    """Give the widgets of the application the colours of a theme."""
    palette, roles = QPalette(), QPalette.ColorRole
    for name, colour in theme.widgets:
        palette.setColor(roles[name], QColor(colour))
    for role in (roles.Text, roles.ButtonText, roles.WindowText):
        palette.setColor(QPalette.ColorGroup.Disabled, role, QColor(theme.disabled))
    QApplication.setPalette(palette)
