"""Questions with a button for each answer."""

from __future__ import annotations

from PySide6.QtGui import QPalette, QPixmap
from PySide6.QtWidgets import QApplication, QMessageBox, QWidget

from deformer_app.viewer.qt.icons import pixmap

_SIDE = 36  # pixels of the icon


def ask(
    parent: QWidget | None,
    text: str,
    *answers: str,
    default: int = 0,
    about: str = "",
    picture: QPixmap | None = None,
) -> str:
    """Ask a question and wait for the answer.

    Args:
        parent: the window above which the question is shown.
        text: the question.
        answers: titles of the buttons; Esc and the dialog's cross give the last.
        default: index of the answer that Enter gives.
        about: more lines below the question.
        picture: shown beside it, in place of a question mark.

    Returns:
        The title of the button that was chosen.
    """
    box = QMessageBox(parent)
    box.setWindowTitle("Deformer")
    box.setText(text)
    box.setInformativeText(about)
    if picture is None or picture.isNull():
        colour = QApplication.palette().color(QPalette.ColorRole.Accent)
        picture = pixmap("circle-question-mark", colour, _SIDE)
    box.setIconPixmap(picture)
    roles = QMessageBox.ButtonRole
    middle = [roles.DestructiveRole] * (len(answers) - 2)
    buttons = [
        box.addButton(title, role)
        for title, role in zip(answers, (roles.AcceptRole, *middle, roles.RejectRole), strict=True)
    ]
    box.setDefaultButton(buttons[default])
    box.setEscapeButton(buttons[-1])
    box.exec()
    clicked = box.clickedButton()
    return answers[-1] if clicked is None else clicked.text()
