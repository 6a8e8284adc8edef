"""Truths of the first seconds of `deformer edit`, each in a process and on a display of its own."""

import os
import subprocess
import sys

import pytest

from display import virtual_display

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
print("session", run_editor("humanoid", None, None) is not None)
"""


def run(code, folder, display):
    environment = {**os.environ, "DISPLAY": display, "DEFORMER_SETTINGS": str(folder)}
    return subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=120
    )


def test_a_window_is_there_before_what_draws_and_the_editor_takes_its_place(tmp_path):
    with virtual_display() as display:
        done = run(WATCHER.replace("{close}", "Window"), tmp_path, display)
    assert done.stdout.splitlines() == [
        "_OpeningWindow False False",
        "Window True False",
        "session True",
    ], done.stderr


def test_closing_the_first_window_ends_it(tmp_path):
    with virtual_display() as display:
        done = run(WATCHER.replace("{close}", "_OpeningWindow"), tmp_path, display)
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
