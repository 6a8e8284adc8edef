"""Icons: drawings of Lucide's set in the colours of the theme.

The files lie in `icons/`, with their licence.
"""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QByteArray, QRectF, Qt
from PySide6.QtGui import QAction, QColor, QIcon, QPainter, QPalette, QPixmap
from PySide6.QtSvg import QSvgRenderer
from PySide6.QtWidgets import QAbstractButton, QApplication

_FOLDER = Path(__file__).with_name("icons")
_SIDE = 18  # pixels of the screen that an icon is wide
_DENSITY = 3  # drawn so much larger, for dense screens
_WINDOW_SIDES = (16, 24, 32, 48, 64)  # pixels of the screen that a window's icon is wide
_NAME = "icon-name"  # property of a widget or action

# Icon of each action that has one, by the action's id.
OF_ACTIONS = {
    "open-model": "folder-open",
    "train": "graduation-cap",
    "open-session": "file-clock",
    "save": "save",
    "save-as": "save-all",
    "close-model": "house",
    "load-target": "target",
    "export-pose": "upload",
    "export-handles": "upload",
    "load-handles": "download",
    "screenshot": "camera",
    "turntable": "rotate-3d",
    "record": "circle-dot",
    "quit": "log-out",
    "undo": "undo-2",
    "redo": "redo-2",
    "select-all": "square-dashed",
    "delete": "trash-2",
    "clear": "eraser",
    "reset": "rotate-ccw",
    "use-as-base": "anchor",
    "start-from-mesh": "file-box",
    "soft": "circle",
    "exact": "target",
    "pin": "pin",
    "turn-freely": "rotate-cw",
    "mirror": "flip-horizontal-2",
    "live-mirror": "flip-horizontal",
    "find-plane": "scan-search",
    "paint": "paintbrush",
    "smaller-brush": "minus",
    "larger-brush": "plus",
    "suggest": "lightbulb",
    "rig": "waypoints",
    "symmetric-rig": "network",
    "gizmo-move": "move-3d",
    "gizmo-rotate": "rotate-3d",
    "gizmo-scale": "scale-3d",
    "frame": "scan",
    "frame-all": "maximize",
    "save-camera": "video",
    "reference-picture": "image",
    "export-poses": "upload",
    "import-poses": "download",
    "export-script": "file-code",
    "copy-python": "clipboard-copy",
    "cube": "box",
    "next-colouring": "palette",
    "next-ghost": "ghost",
    "wireframe": "grid-3x3",
    "smooth": "sun",
    "dark": "moon",
    "system-theme": "sun-moon",
    "help": "keyboard",
    "tour": "compass",
    "about": "info",
}


def pixmap(name: str, colour: QColor, side: int = _SIDE) -> QPixmap:
    """Draw an icon in one colour, `side` pixels of the screen wide."""
    drawing = (_FOLDER / f"{name}.svg").read_text().replace("currentColor", colour.name())
    picture = QPixmap(_DENSITY * side, _DENSITY * side)
    picture.fill(Qt.GlobalColor.transparent)
    painter = QPainter(picture)
    QSvgRenderer(QByteArray(drawing.encode())).render(painter, QRectF(picture.rect()))
    painter.end()
    picture.setDevicePixelRatio(_DENSITY)
    return picture


def put_icon(target: QAction | QAbstractButton, name: str) -> None:
    """Give an action or a button an icon, in the colours of every theme that follows."""
    target.setProperty(_NAME, name)
    target.setIcon(icon(name))


def recolour_icons() -> None:
    """Draw all icons of `put_icon` anew, in the colours of the application's palette."""
    known: dict[str, QIcon] = {}
    for window in QApplication.topLevelWidgets():
        for target in (*window.findChildren(QAction), *window.findChildren(QAbstractButton)):
            name = target.property(_NAME)
            if name:
                target.setIcon(known.setdefault(name, icon(name)))


def window_icon() -> QIcon:
    """Return the icon of the program's windows."""
    picture = QIcon()
    for side in _WINDOW_SIDES:
        picture.addPixmap(pixmap("deformer", QColor(), side))
    return picture


def icon(name: str) -> QIcon:
    """Return an icon in the colours of the present palette."""
    palette, found = QApplication.palette(), QIcon()
    for group, mode in (
        (QPalette.ColorGroup.Active, QIcon.Mode.Normal),
        (QPalette.ColorGroup.Disabled, QIcon.Mode.Disabled),
    ):
        found.addPixmap(pixmap(name, palette.color(group, QPalette.ColorRole.ButtonText)), mode)
    return found
