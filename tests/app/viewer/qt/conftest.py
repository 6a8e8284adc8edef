"""A display, an application and a window on it, with the model of a tube."""

import os
import subprocess

import pytest

from deformer_app.viewer.gizmo import translation
from display import virtual_display
from person import place, rest
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


@pytest.fixture
def mouse(app):
    """Events of Qt's mouse at points of a widget."""
    from PySide6.QtCore import QPoint, Qt
    from PySide6.QtTest import QTest

    class Mouse:
        def click(self, widget, at, modifier=Qt.KeyboardModifier.NoModifier):
            point = QPoint(round(at.x()), round(at.y()))
            QTest.mouseClick(widget, Qt.MouseButton.LeftButton, modifier, point)
            app.processEvents()

        def drag(self, widget, start, end):
            first, last = (QPoint(round(p.x()), round(p.y())) for p in (start, end))
            QTest.mousePress(widget, Qt.MouseButton.LeftButton, pos=first)
            for n in range(1, 9):
                QTest.mouseMove(widget, first + (last - first) * n / 8)
                app.processEvents()
            QTest.mouseRelease(widget, Qt.MouseButton.LeftButton, pos=last)
            app.processEvents()

    return Mouse()


@pytest.fixture
def panel(window):
    """The panel of the timeline."""
    from deformer_app.viewer.qt.timeline_panel import TimelinePanel

    return window.docks.panel(TimelinePanel)


@pytest.fixture
def keyed(app, window):
    """Keys of two exact handles at frames 0 and 20 of 41."""
    editor, timeline = window.editor, window.editor.timeline
    place(window, 100, 60)
    editor.handles.select_all()
    editor.handles.set_kind("exact")
    timeline.set_clip(length=41)
    timeline.keys.set()
    timeline.seek(20)
    editor.handles.select([editor.edit.handles[0].id])
    editor.handles.move_selected(translation([0.0, 0.2, 0.1]))
    editor.commit("Drag")
    editor.handles.select([])
    rest(app, window)
    return timeline
