"""The dialog about the program: version, licences, and the card of the open model."""

from __future__ import annotations

import sys
from importlib import metadata
from pathlib import Path

from PySide6.QtCore import QSize, Qt
from PySide6.QtWidgets import (
    QApplication,
    QDialog,
    QHBoxLayout,
    QLabel,
    QTabWidget,
    QTextBrowser,
    QVBoxLayout,
    QWidget,
)

from deformer_app.viewer.editor import Editor
from deformer_app.viewer.model_card import model_card

_SIZE = QSize(620, 460)
_ICON = 64  # pixels
_SHOWN = ("torch", "numba", "pyvista", "vtk", "PySide6")  # distributions whose version is shown
_PAPER = (
    "Q. Tan, L. Gao, Y.-K. Lai, J. Yang, S. Xia: <i>Mesh-based Autoencoders for Localized "
    "Deformation Component Analysis</i>, AAAI 2018"
)


class AboutDialog(QDialog):
    """Version, licences and model.

    Args:
        parent: the window.
        editor: has the model.
    """

    def __init__(self, parent: QWidget, editor: Editor) -> None:
        """Lay out."""
        super().__init__(parent)
        self.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        self.setWindowTitle("About Deformer")
        self.resize(_SIZE)
        picture, title = QLabel(), QLabel("Deformer")
        picture.setPixmap(QApplication.windowIcon().pixmap(_ICON, _ICON))
        title.setProperty("rank", "title")
        about = QLabel(f"Version {_version('deformer')}, MIT licence")
        about.setProperty("rank", "second")
        words = QVBoxLayout()
        words.addWidget(title)
        words.addWidget(about)
        top = QHBoxLayout()
        top.addWidget(picture)
        top.addLayout(words, 1)
        self.pages = QTabWidget()
        self.pages.setDocumentMode(True)
        if editor.is_open:
            card = model_card(editor.session.model.path, editor.model)
            self._add_page("Model").setMarkdown(card)
        self._add_page("Versions").setHtml(_versions())
        self._add_page("Licences").setPlainText(_licences())
        column = QVBoxLayout(self)
        column.addLayout(top)
        column.addWidget(self.pages, 1)

    def _add_page(self, title: str) -> QTextBrowser:
        page = QTextBrowser()
        page.setOpenExternalLinks(True)
        self.pages.addTab(page, title)
        return page


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


def _versions() -> str:
    rows = [("Python", sys.version.split()[0]), *((name, _version(name)) for name in _SHOWN)]
    table = "".join(f"<tr><td>{name}&nbsp;&nbsp;</td><td>{text}</td></tr>" for name, text in rows)
    return f"<p>After {_PAPER}.</p><table>{table}</table>"


def _licences() -> str:
    icons = Path(__file__).with_name("icons") / "LICENSE"
    return (
        "Deformer: MIT licence.\n\n"
        "Qt and PySide6: LGPL 3. VTK and PyVista: BSD and MIT. PyTorch, Numba, NumPy and SciPy: "
        "BSD. Each package has its licence beside it.\n\n"
        f"Icons:\n\n{icons.read_text('utf-8')}"
    )
