"""Stress test of the viewer: random events of mouse and keys, and checks of the result.

    python benchmarks/viewer_soak.py [MODEL] [--events 10000] [--seed 0]

The Qt window on DISPLAY (xvfb-run gives one) receives moves, presses, releases, turns of the wheel
and commands in an order that the seed determines. The test fails on an exception, on an error
message, if saving and loading, or undoing and redoing all steps, changes the session or its pose,
or if the memory in use grows by more than 5 % after the first fifth. That is measured after the
model has been opened anew, without the session's history and handles. In use is what the program
has asked the C library for and not given back; resident memory, printed beside it, also counts
what the library keeps for later and rounds up to huge pages, which grows and shrinks by itself.
"""

from __future__ import annotations

import argparse
import ctypes
import gc
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

HANG = 600.0  # seconds of waiting after which the viewer counts as hung
GROWTH = 0.05  # of memory since the first fifth
# Commands that end the program, ask for files or leave the window for a dialog.
_ASIDE = {"quit", "save", "help", "tour", "turntable", "record"}
# Commands on the clipboard, which leave the window for no dialog.
_POSES = ("copy-pose", "paste-pose", "paste-mirrored", "save-pose")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("model", nargs="?", default="humanoid")
    options.add_argument("--events", type=int, default=10_000)
    options.add_argument("--seed", type=int, default=0)
    chosen = options.parse_args()
    if os.environ.get("PYTHONMALLOC") != "malloc":  # so that the C library counts all memory
        os.execve(
            sys.executable, [sys.executable, *sys.argv], {**os.environ, "PYTHONMALLOC": "malloc"}
        )
    failures, growth = soak(chosen.model, chosen.events, chosen.seed, print)
    print(f"memory since the first fifth: {100 * growth:+.1f} %")
    if growth > GROWTH:
        failures.append(f"memory has grown by {100 * growth:.1f} %")
    for failure in failures:
        print(f"FAILED: {failure}", file=sys.stderr)
    sys.stdout.flush()
    os._exit(1 if failures else 0)  # without waiting for the threads and windows of three libraries


def soak(
    model: str, events: int, seed: int, report: Callable[[str], Any]
) -> tuple[list[str], float]:
    """Send the events; returns failures, and the relative growth of the memory."""
    from PySide6.QtWidgets import QApplication

    from deformer_app.viewer.changes import Change, MistakeMade
    from deformer_app.viewer.qt.window import Window
    from deformer_app.viewer.settings import Settings

    app = QApplication.instance() or QApplication([])
    settings = Settings(Path(tempfile.mkdtemp()))
    settings.note_tour()
    window = Window(settings)
    failures: list[str] = []
    before = sys.excepthook
    sys.excepthook = lambda kind, error, trace: failures.append(f"{kind.__name__}: {error}")
    editor = window.editor

    def hear(change: Change) -> None:
        if isinstance(change, MistakeMade):
            failures.append(change.text)

    editor.on_change.append(hear)
    window.show()
    window.begin(model, None, None)

    def pump() -> None:
        app.processEvents()
        time.sleep(0.0005)

    try:
        wait(pump, lambda: editor.activations is not None and editor.idle)
        monkey, begun, first = Monkey(window, np.random.default_rng(seed)), time.perf_counter(), 0.0
        for n in range(1, events + 1):
            monkey.act()
            pump()
            if n % max(events // 10, 1) == 0:
                monkey.rest()
                if editor.timeline.playing:  # a clip plays on until it is stopped
                    editor.timeline.play_or_stop()
                wait(pump, lambda: editor.idle)
                gc.collect()
                report(
                    f"{n:6} events  {time.perf_counter() - begun:6.0f} s  {in_use()}  "
                    f"{len(editor.session.entries)} steps  {len(editor.edit.handles)} handles"
                )
            if n == max(events // 5, 1):
                first = opened_anew(window, model, pump)
                report(f"opened anew: {in_use()}")
        failures += inconsistencies(editor, pump)
        last = opened_anew(window, model, pump)
        report(f"opened anew: {in_use()}")
        growth = last / first - 1.0
    finally:
        sys.excepthook = before
        window.close_unsaved()
    return failures, growth


def opened_anew(window: Any, model: str, pump: Callable[[], None]) -> float:
    """Memory in use after a model has been opened in place of the session, without asking."""
    window.begin(model, None, None)
    editor = window.editor
    wait(pump, lambda: editor.activations is not None and editor.idle)
    gc.collect()
    return memory()


class Monkey:
    """Sends random events."""

    def __init__(self, window: Any, chance: np.random.Generator) -> None:
        from deformer_app.viewer.actions import ACTIONS

        self._window, self._chance = window, chance
        self._at = np.array([400.0, 400.0])
        self._button = ""
        self._commands = [
            window.menus.items[action.id]
            for action in ACTIONS
            if not action.dialog and action.id not in _ASIDE
        ]
        self._poses = [window.menus.items[name] for name in _POSES]
        self._poses[0].trigger()  # so that there is a pose to paste

    def act(self) -> None:
        """Send one event."""
        chance = self._chance
        kind = chance.choice(["move", "button", "wheel", "command", "panel", "pose", "escape"],
                             p=[0.65, 0.2, 0.03, 0.07, 0.03, 0.01, 0.01])  # fmt: skip
        if kind == "move":
            width, height = self._window.editor.stage.size
            jump = chance.random() < 0.1
            step = chance.uniform(0, [width, height]) - self._at if jump else chance.normal(0, 9, 2)
            self._at = np.clip(self._at + step, 0, [width - 1, height - 1])
            self._send("MouseMoveEvent")
        elif kind == "button" and self._button:
            self.rest()
        elif kind == "button":
            # Half of the presses of the left button are aimed at the body.
            self._button = str(chance.choice(["Left", "Middle", "Right"], p=[0.8, 0.1, 0.1]))
            if chance.random() < 0.5:
                editor = self._window.editor
                vertex = editor.vertices[chance.integers(len(editor.vertices))]
                stage = editor.stage
                pixel = stage.camera.project([vertex], stage.size)[0]
                self._at = np.clip(pixel, 0, np.subtract(stage.size, 1))
            self._send("MouseMoveEvent")
            self._send(f"{self._button}ButtonPressEvent")
        elif kind == "wheel":
            self._send(f"MouseWheel{chance.choice(['Forward', 'Backward'])}Event")
        elif kind == "command":
            self._commands[chance.integers(len(self._commands))].trigger()
        elif kind == "panel":
            self._slide()
        elif kind == "pose":
            self._change_pose()
        else:
            self._window.escape()

    def rest(self) -> None:
        """Release the button, if one is pressed."""
        if self._button:
            self._send(f"{self._button}ButtonReleaseEvent")
            self._button = ""

    def _slide(self) -> None:
        from deformer_app.viewer.qt.component_panel import ComponentPanel
        from deformer_app.viewer.qt.model_panel import ModelPanel

        docks, chance = self._window.docks, self._chance
        components, prior = docks.panel(ComponentPanel).sliders, docks.panel(ModelPanel).prior
        sliders = [*components.values(), prior]
        slider = sliders[chance.integers(len(sliders))]
        slider.setValue(int(chance.integers(slider.maximum() + 1)))

    def _change_pose(self) -> None:
        """Copy, paste or save the pose, start from one of the strip or blend with it."""
        from deformer_app.viewer.qt.pose_strip import PoseStrip

        chance = self._chance
        strip = self._window.docks.panel(PoseStrip)
        shown = strip.saved if strip.saved.count() and chance.random() < 0.5 else strip.examples
        row = int(chance.integers(shown.count()))
        kind = chance.choice(["command", "start", "blend"])
        if kind == "command":
            self._poses[chance.integers(len(self._poses))].trigger()
        elif kind == "start":
            shown.started.emit(row)
        else:
            shown.setCurrentRow(row)
            strip.blend.setValue(int(chance.integers(strip.blend.maximum() + 1)))

    def _send(self, name: str) -> None:
        view, chance = self._window.editor.state.view, self._chance
        interactor = view.plotter.iren.interactor
        x, y = (int(view.density * side) for side in self._at)
        height = view.plotter.render_window.GetSize()[1]
        shift, control = chance.random(2) < 0.1
        interactor.SetEventInformation(x, height - 1 - y, bool(control), bool(shift))
        interactor.InvokeEvent(name)


def inconsistencies(editor: Any, pump: Callable[[], None]) -> list[str]:
    """Differences of the session after saving, loading, undoing and redoing."""
    from deformer_app.viewer.pose_worker import replay
    from deformer_app.viewer.session import Session

    found = []
    diagonal = editor.model.reference.bounding_diagonal
    final, entries = editor.vertices.copy(), list(editor.session.entries)
    if not np.isfinite(final).all():
        found.append("vertices are not finite")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "session.json"
        editor.save_session(file)
        loaded = Session.load(file)
    if loaded.entries != editor.session.entries:
        found.append("the session is another one after saving and loading")
    off = np.abs(replay(loaded, editor.model).vertices - final).max() / diagonal
    if off > 1e-6:
        found.append(f"replayed, the pose is off by {off:.1e} of the diagonal")
    cursor = editor.session.cursor
    for _ in range(cursor):
        editor.undo()
    wait(pump, lambda: editor.idle)
    start = editor.model.decode(np.array(entries[0].edit.base))
    off = np.abs(editor.vertices - start).max() / diagonal
    if off > 1e-5:
        found.append(f"undone, the start is off by {off:.1e} of the diagonal")
    for _ in range(cursor):
        editor.redo()
    wait(pump, lambda: editor.idle)
    off = np.abs(editor.vertices - final).max() / diagonal
    if off > 1e-6:
        found.append(f"redone, the pose is off by {off:.1e} of the diagonal")
    return found


def wait(pump: Callable[[], None], condition: Callable[[], bool]) -> None:
    end = time.monotonic() + HANG
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("the viewer never came to rest")
        pump()


class _Allocated(ctypes.Structure):
    """What glibc's mallinfo2 returns, in bytes."""

    _names = "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost"
    _fields_ = [(name, ctypes.c_size_t) for name in _names.split()]


def memory() -> float:
    """Memory in MB that this process has asked the C library (glibc) for and not given back."""
    count = ctypes.CDLL(None).mallinfo2
    count.restype = _Allocated
    found = count()
    return (found.uordblks + found.hblkhd) / 1e6


def in_use() -> str:
    """Memory as words of the report."""
    return f"{memory():.1f} MB in use, {resident():.1f} MB resident"


def resident() -> float:
    """Resident memory of this process in MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


if __name__ == "__main__":
    main()
