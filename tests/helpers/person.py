"""A person at a window: real events of mouse and keys, and what a test waits for."""

import json
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

from waiting import wait_for


def rest(app, window):
    wait_for(lambda: window.idle, app.processEvents)


def place(window, *vertices):
    for vertex in vertices:
        window.editor.handles.place(vertex, add=True)
    window.editor.commit("Place handle")


class Person:
    """A program with a real mouse on it; what it did is read from its autosave."""

    def __init__(self, display, folder, *arguments):
        self.folder = folder
        self.environment = {
            **os.environ,
            "DISPLAY": display,
            "DEFORMER_SETTINGS": str(folder),
            "PYTHONPATH": str(Path(__file__).parent),
        }
        code = "from deformer_app.cli.main import main; main()"
        if "--plain" not in arguments:
            code = f"from eyes import open_eyes; open_eyes({str(folder)!r}); {code}"
        command = [sys.executable, "-c", code, "edit", *map(str, arguments)]
        self.program = subprocess.Popen(command, env=self.environment, stderr=subprocess.PIPE)
        self.window = None  # the number of the editor's window, once it is ready

    def xdotool(self, *words):
        command = ["xdotool", *map(str, words)]
        return subprocess.run(command, env=self.environment, capture_output=True, text=True).stdout

    def windows(self, title):
        """Numbers of the visible windows whose title has a regular expression in it."""
        return self.xdotool("search", "--onlyvisible", "--name", title).split()

    def wait(self, condition):
        return wait_for(condition, self._alive, pause=0.05)

    def _wait_a_little(self, condition):
        """Wait for what another key may be needed for."""
        end = time.monotonic() + 5.0
        self.wait(lambda: condition() or time.monotonic() > end)

    def _alive(self):
        assert self.program.poll() is None, self.program.stderr.read().decode()

    def drag(self, start, *ways, button=1):
        self.xdotool("mousemove", *start, "mousedown", button)
        for at in ways:
            self.xdotool("mousemove", *at)
            time.sleep(0.03)
        self.xdotool("mouseup", button)

    def key(self, name):
        # There is no window manager, which would give the keys back after a dialog.
        self.xdotool("windowfocus", "--sync", self.window, "key", name)

    def be_ready(self):
        """Wait until the program is prepared for drags, as its title says."""
        self.window = self.wait(lambda: self.windows(" Deformer$"))[-1]

    def sees(self, name):
        """Where a thing is on the screen, in pixels, as `eyes` tells it.

        "vertices" (V, 2); "picture": its left upper corner, width and height; "slider": the part
        of the first component's slider that is dragged; "tools": middles of the tool bar's
        buttons by their titles; "tour": those of the tour's buttons while it is shown; on the
        start page "cards": middles of its cards by their texts.
        """
        file = Path(self.folder) / "seen.json"
        return self.wait(lambda: file.is_file() and json.loads(file.read_text()).get(name))

    def write(self, key, title, file):
        """Open a dialog by a key and type the name of a file that it writes.

        Again where keys were lost: a dialog that has the focus may not take keys yet.
        """

        def has_focus():
            return self.xdotool("getwindowfocus").split() == self.windows(title)

        while not file.is_file():
            if not self.windows(title):
                self.key(key)
            self._wait_a_little(has_focus)
            if has_focus():  # else its letters would be keys of the window
                self.xdotool("key", "ctrl+a")
                self.xdotool("type", str(file))
            if self.windows(title):  # or a question about a name of which letters were lost
                self.xdotool("key", "Return")
            self._wait_a_little(file.is_file)

    def steps(self):
        """Labels of the history up to the entry that is shown."""
        with suppress(StopIteration, FileNotFoundError):  # none yet, or gone meanwhile
            path = next(Path(self.folder).glob("autosave-*.json"))
            data = json.loads(path.read_text())
            return [entry["label"] for entry in data["entries"][: data["cursor"] + 1]]
        return []

    def end(self):
        self.program.kill()
        self.program.wait()
