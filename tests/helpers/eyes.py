"""What a person sees of the editor: the program writes where things are on its screen.

Positions depend on the layout, the fonts and the window's size, so no test may know them.
"""

import json
from pathlib import Path

import numpy as np


def open_eyes(folder):
    """From now on, write `seen.json` whenever the editor rests and something has moved."""
    from PySide6.QtCore import QTimer
    from PySide6.QtWidgets import QApplication

    app = QApplication.instance() or QApplication([])
    file, last = Path(folder) / "seen.json", [""]

    def look():
        for window in app.topLevelWidgets():
            if type(window).__name__ == "Window" and (window.idle or not window.editor.is_open):
                found = json.dumps(_seen(window) if window.editor.is_open else _offered(window))
                if found != last[0]:
                    last[0] = found
                    file.with_suffix(".tmp").write_text(found)
                    file.with_suffix(".tmp").replace(file)

    timer = QTimer(app)
    timer.timeout.connect(look)
    timer.start(100)


def _offered(window):
    """The middle of each card of the start page, by its text."""
    cards = [*window.start_page.models, *window.start_page.recent]
    return {"cards": {card.text(): _middle(card) for card in cards if card.isVisible()}}


def _seen(window):
    from PySide6.QtCore import QPoint

    from deformer_app.viewer.qt.component_panel import ComponentPanel

    editor, corner = window.editor, window.plotter.mapToGlobal(QPoint(0, 0))
    pixels = editor.stage.camera.project(editor.vertices, editor.stage.size)[:, :2]
    sliders = window.docks.panel(ComponentPanel).sliders.values()
    return {
        "vertices": np.add(pixels, (corner.x(), corner.y())).round().astype(int).tolist(),
        "picture": [corner.x(), corner.y(), window.plotter.width(), window.plotter.height()],
        "slider": next((_handle_of(slider) for slider in sliders), None),
        "tour": {b.text(): _middle(b) for b in _tour_buttons(window)},
        "tools": {a.text(): _middle(button) for a, button in _tools(window) if button.isVisible()},
    }


def _tour_buttons(window):
    """The buttons of the tour while it is shown."""
    from PySide6.QtWidgets import QPushButton

    return [b for b in window.tour.findChildren(QPushButton) if b.isVisible()]


def _tools(window):
    """Actions of the tool bar with their buttons."""
    from PySide6.QtWidgets import QToolBar

    bar = window.findChild(QToolBar, "Tools")
    return [(a, bar.widgetForAction(a)) for a in bar.actions() if not a.isSeparator()]


def _middle(widget):
    at = widget.mapToGlobal(widget.rect().center())
    return [at.x(), at.y()]


def _handle_of(slider):
    """The middle of the part of a slider that is dragged."""
    from PySide6.QtWidgets import QStyle, QStyleOptionSlider

    option = QStyleOptionSlider()
    slider.initStyleOption(option)
    part = slider.style().subControlRect(
        QStyle.ComplexControl.CC_Slider, option, QStyle.SubControl.SC_SliderHandle, slider
    )
    at = slider.mapToGlobal(part.center())
    return [at.x(), at.y()]
