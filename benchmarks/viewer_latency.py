"""Latency of the viewer: time from the last move of the mouse to the last frame.

    python benchmarks/viewer_latency.py [MODEL] [--subdivide 0] [--window] [--handles 1] [--exact]

Handles are spread over the mesh, and events of the plotter drag one of them with 125 moves a
second, however busy the window is. Prints times in milliseconds: from the last move to the frame
that shows its pose; from any move to its frame; between two frames; and the two parts of a frame,
the solve (on its own thread) and the drawing.

Without --window it draws off-screen in a plain loop; with it, in the Qt window on DISPLAY.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from drag_latency import subdivided

import deformer
from deformer import Geodesics, farthest_points
from deformer_app.viewer.changes import Change, FrameDrawn
from deformer_app.viewer.editor import Editor

SIZE = (1000, 800)
RATE = 125  # moves a second
MOVES = 120  # of a drag
DISTANCE = 150  # pixels of a drag


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("model", nargs="?", default="humanoid")
    options.add_argument(
        "--subdivide", type=int, default=0, help="number of subdivisions of each face into four"
    )
    options.add_argument("--window", action="store_true", help="in the Qt window on DISPLAY")
    options.add_argument("--handles", type=int, default=1)
    options.add_argument("--exact", action="store_true", help="exact handles")
    options.add_argument("--drags", type=int, default=10)
    chosen = options.parse_args()
    model = subdivided_model(chosen.model, chosen.subdivide)
    editor, pump = (in_window if chosen.window else off_screen)(model)
    wait(pump, lambda: editor.activations is not None and not editor.busy)
    place_handles(editor, chosen.handles, chosen.exact)
    wait(pump, lambda: not editor.busy)
    drag(editor, pump, np.array([DISTANCE, 0.0]))  # compiled, cached, warm
    last, solves, draws, gaps = [], [], [], []
    editor.latencies.clear()
    for n in range(chosen.drags):
        angle = 2 * np.pi * n / chosen.drags
        found = drag(editor, pump, DISTANCE * np.array([np.cos(angle), np.sin(angle)]))
        for total, part in zip((last, solves, draws, gaps), found, strict=True):
            total += part
    mesh = editor.model.reference
    width, height = editor.stage.size
    kind = "exact" if chosen.exact else "soft"
    shell = "Qt window" if chosen.window else "off-screen"
    print(f"{len(mesh.vertices)} vertices, {chosen.handles} {kind} handles, {shell}")
    print(f"{width}x{height} pixels, {chosen.drags} drags of {MOVES} moves, load {os.getloadavg()}")
    for name, values in (
        ("last move to last frame", last),
        ("a move to its frame", list(editor.latencies)),
        ("frame to frame", gaps),
        ("solve", solves),
        ("drawing", draws),
    ):
        ms = 1000 * np.array(values)
        p50, p95, worst = np.percentile(ms, [50, 95, 100])
        print(f"  {name:<24} p50 {p50:6.1f}   p95 {p95:6.1f}   worst {worst:6.1f}")
    os._exit(0)  # without waiting for the threads and windows of three libraries


def subdivided_model(name: str, times: int) -> str:
    """A model's name, or the folder of the same model on a finer mesh."""
    if not times:
        return name
    model = deformer.load_model(name)
    for _ in range(times):
        model = subdivided(model)
    folder = Path(tempfile.mkdtemp()) / f"{Path(name).name}-{times}"
    model.save(folder)
    return str(folder)


def off_screen(model: str) -> tuple[Editor, Callable[[], None]]:
    import pyvista as pv

    from deformer_app.rendering.offscreen import off_screen as without_display
    from deformer_app.viewer.scene import MeshView
    from deformer_app.viewer.vtk_input import listen

    with without_display():
        plotter = pv.Plotter(off_screen=True, window_size=list(SIZE), lighting="none")
        plotter.show(auto_close=False)
    editor = Editor(MeshView(plotter))
    listen(editor.state.view, editor.controller.handle)
    editor.open_model(model)

    def pump() -> None:
        editor.tick()
        time.sleep(0.001)

    return editor, pump


def in_window(model: str) -> tuple[Editor, Callable[[], None]]:
    from PySide6.QtWidgets import QApplication

    from deformer_app.viewer.qt.window import Window
    from deformer_app.viewer.settings import Settings

    app = QApplication([])
    settings = Settings(Path(tempfile.mkdtemp()))
    settings.note_tour()
    window = Window(settings)
    window.show()
    window.begin(model, None, None)

    def pump() -> None:
        app.processEvents()
        time.sleep(0.0005)

    pump.window = window  # pyright: ignore: keeps it alive
    return window.editor, pump


def wait(pump: Callable[[], None], condition: Callable[[], bool]) -> None:
    while not condition():
        pump()


def place_handles(editor: Editor, count: int, exact: bool) -> None:
    """Place handles all over the mesh; the dragged one is the visible vertex nearest the centre."""
    dragged = None
    for radius in range(0, 300, 4):
        for angle in np.linspace(0, 2 * np.pi, 16):
            at = np.array(editor.stage.size) / 2 + radius * np.array([np.cos(angle), np.sin(angle)])
            dragged = (
                editor.stage.vertex_at((float(at[0]), float(at[1]))) if dragged is None else dragged
            )
    assert dragged is not None, "no vertex is visible"
    far = farthest_points(Geodesics(editor.model.reference), count, start=[dragged])
    for vertex in far[::-1]:
        editor.handles.place(int(vertex), add=True)
    editor.commit("Place")
    if exact:
        editor.handles.set_kind("exact")
    editor.handles.select([editor.handles.place(dragged)])


def drag(editor: Editor, pump: Callable[[], None], offset: np.ndarray) -> tuple[list, ...]:
    """Drag a handle by an offset in pixels and back; lists of the times in seconds."""
    handle = next(iter(editor.handles.selected))
    start = editor.stage.camera.project([editor.stage.position_of(handle)], editor.stage.size)[0]
    interactor = editor.state.view.plotter.iren.interactor

    def send(name: str, at: np.ndarray) -> None:
        interactor.SetEventInformation(int(at[0]), editor.stage.size[1] - 1 - int(at[1]), 0, 0)
        interactor.InvokeEvent(name)

    solves, draws, frames = [], [], []

    def hear(change: Change) -> None:
        if not isinstance(change, FrameDrawn):
            return
        frames.append(time.perf_counter())
        draws.append(editor.state.view.frame_milliseconds / 1000)
        if editor.answer is not None:
            solves.append(editor.answer.pose.milliseconds / 1000)

    send("MouseMoveEvent", start)
    send("LeftButtonPressEvent", start)
    editor.on_change.append(hear)
    begun = time.perf_counter()
    for n in range(1, MOVES + 1):
        while time.perf_counter() < begun + n / RATE:
            pump()
        share = np.sin(np.pi * n / MOVES) if n < MOVES else 0.05
        send("MouseMoveEvent", start + share * offset)
    moved = time.perf_counter()
    wanted = editor.edit
    count = len(frames)
    wait(
        pump,
        lambda: (
            editor.answer is not None
            and editor.answer.request.edit == wanted
            and len(frames) > count
        ),
    )
    last = frames[-1] - moved
    editor.on_change.remove(hear)
    send("LeftButtonReleaseEvent", start + 0.05 * offset)
    wait(pump, lambda: not editor.busy)
    editor.undo()
    wait(pump, lambda: not editor.busy)
    return [last], solves, draws, list(np.diff(frames[:count]))


if __name__ == "__main__":
    main()
