"""Truths of the first seconds of `deformer edit`, each in a process and on a display of its own."""

import os
import subprocess
import sys

import pytest

from display import virtual_display
from waiting import HANG

pytest.importorskip("PySide6", reason='needs Qt: pip install "deformer[app]"')
pytestmark = pytest.mark.window

# Closes the editor as soon as it is there; prints what has been on the screen, and what had been
# imported when the first window was.
WATCHER = """
import sys
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication
from deformer_app.viewer.qt.start import run_editor

app = QApplication([])
seen = []

def look():
    shown = [w for w in app.topLevelWidgets() if w.isVisible() and w.windowTitle()]
    for widget in shown:
        if type(widget).__name__ not in seen:
            seen.append(type(widget).__name__)
            print(seen[-1], "pyvista" in sys.modules, "torch" in sys.modules, flush=True)
    if "{close}" in seen:
        for widget in shown:
            if type(widget).__name__ == "_OpeningWindow" or widget.editor.is_open:
                widget.close()

timer = QTimer()
timer.timeout.connect(look)
timer.start(0)
print("session", run_editor(sys.argv[1], None, None) is not None)
"""


def run(code, folder, display, *arguments):
    environment = {**os.environ, "DISPLAY": display, "DEFORMER_SETTINGS": str(folder)}
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=HANG)


def test_a_window_is_there_before_what_draws_and_the_editor_takes_its_place(tmp_path, saved_model):
    with virtual_display() as display:
        done = run(WATCHER.replace("{close}", "Window"), tmp_path, display, saved_model)
    assert done.stdout.splitlines() == [
        "_OpeningWindow False False",
        "Window True False",
        "session True",
    ], done.stderr


def test_closing_the_first_window_ends_it(tmp_path, saved_model):
    with virtual_display() as display:
        done = run(WATCHER.replace("{close}", "_OpeningWindow"), tmp_path, display, saved_model)
    assert done.stdout.splitlines() == ["_OpeningWindow False False", "session False"], done.stderr
    assert done.returncode == 0


def test_a_model_that_is_none_is_one_line_and_no_window(tmp_path):
    code = "import sys; sys.argv[1:] = ['edit', 'no-such']\n"
    code += "from deformer_app.cli.main import main; main()"
    with virtual_display() as display:
        done = run(code, tmp_path, display)
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert "no-such: no such model" in done.stderr


def test_without_a_display_it_is_one_line(tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    code = "import sys; sys.argv[1:] = ['edit']\n"
    code += "from deformer_app.cli.main import main; main()"
    environment = {**os.environ, "DEFORMER_SETTINGS": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert "DISPLAY is not set" in done.stderr


EDIT = "import sys; sys.argv[1:] = {}\nfrom deformer_app.entry import main; main()"
HEED = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"


@pytest.mark.parametrize("arguments", [["edit"], ["edit", "--plain"]])
def test_with_a_dead_display_it_is_one_line(tmp_path, arguments):
    environment = {**os.environ, "DISPLAY": ":9977", "DEFORMER_SETTINGS": str(tmp_path)}
    for name in ("WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        environment.pop(name, None)
    done = subprocess.run(
        [sys.executable, "-c", EDIT.format(arguments)],
        env=environment,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "no X server answers at DISPLAY=:9977" in done.stderr


def test_what_makes_qt_abort_is_one_line(tmp_path):
    environment = {**os.environ, "QT_QPA_PLATFORM": "nonsense", "DEFORMER_SETTINGS": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", EDIT.format(["edit"])],
        env=environment,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "no window can be opened" in done.stderr and "nonsense" in done.stderr


# Sends Ctrl-C to its own process at a moment: while the first window is shown, or after a handle
# has been placed in the editor, with or without a question on the screen.
INTERRUPTED = """
import os, signal, sys
from PySide6.QtCore import QTimer
from PySide6.QtWidgets import QApplication
from deformer_app.entry import main

app = QApplication([])
sent = []

def look():
    for widget in app.topLevelWidgets():
        name = type(widget).__name__
        if sent or not widget.isVisible():
            continue
        if "{moment}" == "first" and name == "_OpeningWindow":
            send()
        if "{moment}" != "first" and name == "Window" and widget.editor.idle:
            if not widget.editor.session.changed:
                widget.editor.handles.place(100, add=True)
                widget.editor.commit("Place handle")
            elif "{moment}" == "question":
                sent.append(1)
                QTimer.singleShot(300, lambda: os.kill(os.getpid(), signal.SIGINT))
                widget.close()
            else:
                send()

def send():
    sent.append(1)
    os.kill(os.getpid(), signal.SIGINT)

timer = QTimer()
timer.timeout.connect(look)
timer.start(5)
sys.argv.insert(1, "edit")
main()
"""


@pytest.mark.parametrize("moment", ["first", "edited", "question"])
def test_ctrl_c_closes_the_window_and_keeps_the_session(tmp_path, saved_model, moment):
    from deformer_app.viewer.session import Session

    with virtual_display() as display:
        code = HEED + INTERRUPTED.replace("{moment}", moment)
        done = run(code, tmp_path, display, saved_model)
    assert (done.returncode, done.stderr.count("\n")) == (130, 1), done.stderr
    kept = list(tmp_path.glob("autosave-*.json"))
    if moment == "first":
        assert done.stderr == "deformer: interrupted\n" and not kept
        return
    assert f"deformer edit --session {kept[0]}" in done.stderr
    assert len(Session.load(kept[0]).edit.handles) == 1
    assert not list(tmp_path.glob("*.lock"))
