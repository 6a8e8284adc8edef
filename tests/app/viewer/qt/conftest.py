"""A display, an application and a window on it, with the model of a tube."""

import os
import subprocess

import pytest

from display import virtual_display
from waiting import wait_for
from windows import new_window


@pytest.fixture(scope="module")
def display():
    # A small screen: without a graphics card, each pixel of the window takes its time.
    with virtual_display("xdotool", size=(1280, 720)) as name:
        yield name


@pytest.fixture(scope="module")
def app(display):
    before = {name: os.environ.get(name) for name in ("DISPLAY", "QT_QPA_PLATFORM")}
    os.environ.update(DISPLAY=display, QT_QPA_PLATFORM="xcb")
    from PySide6.QtWidgets import QApplication

    from deformer_app.rendering.palette import LIGHT
    from deformer_app.viewer.qt.project_style import ProjectStyle
    from deformer_app.viewer.qt.theme import apply_theme

    application = QApplication.instance() or QApplication([])
    application.setStyle(ProjectStyle())
    apply_theme(LIGHT)  # before the first window, as in the program
    yield application
    application.shutdown()  # before its display ends: X would end the whole process
    for name, value in before.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


@pytest.fixture
def window(app, model_path, tmp_path):
    from deformer_app.viewer.settings import Settings

    settings = Settings(tmp_path / "settings")
    settings.note_tour()
    with new_window(app, settings) as made:
        made.begin(str(model_path), None, None)
        wait_for(
            lambda: made.editor.activations is not None and made.editor.idle, app.processEvents
        )
        yield made


@pytest.fixture
def answers(monkeypatch):
    """Titles of the buttons that are clicked, one a question; `asked` has the questions' boxes."""
    from PySide6.QtWidgets import QMessageBox

    class Answers(list):
        pass

    given = Answers()
    given.asked = []

    def exec_(box):
        given.asked.append(box)
        title = given.pop(0)
        next(button for button in box.buttons() if button.text() == title).click()
        return 0

    monkeypatch.setattr(QMessageBox, "exec", exec_)
    return given


@pytest.fixture
def hand(app, window):
    """xdotool on the window: words of its command line; pixels are those of the picture."""
    from PySide6.QtCore import QPoint

    def act(*words):
        command = ["xdotool"]
        for word in words:
            if isinstance(word, str):
                command.append(word)
            else:
                at = window.plotter.mapToGlobal(QPoint(*(int(c) for c in word)))
                command += ["mousemove", str(at.x()), str(at.y())]
        done = subprocess.Popen(command, env=os.environ)
        wait_for(lambda: done.poll() is not None, app.processEvents)
        app.processEvents()

    window.activateWindow()
    act("windowfocus", "--sync", str(int(window.winId())))
    yield act
    act("mouseup", "1", "mouseup", "2", "mouseup", "3")
