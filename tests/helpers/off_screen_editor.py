"""An editor on an off-screen plotter, and the mouse and keys of a person on it."""

from contextlib import contextmanager

import numpy as np
import pyvista as pv

from deformer_app.rendering.offscreen import off_screen
from deformer_app.viewer.editor import Editor
from deformer_app.viewer.scene import MeshView
from deformer_app.viewer.vtk_input import listen
from waiting import wait_for

SIZE = (480, 360)


@contextmanager
def editing(model_path, density=lambda: 1.0):
    """An editor of a model that is at rest, until the end of the block.

    `density` gives the screen's pixels along each side of one that a person aims at.
    """
    with off_screen():
        plotter = pv.Plotter(off_screen=True, window_size=list(SIZE), lighting="none")
        plotter.show(auto_close=False)
    work = Editor(MeshView(plotter, density=density))
    listen(work.state.view, work.controller.handle, work.controller.handle_key)
    work.open_model(model_path)
    finish(work)
    yield work
    work.close()
    plotter.close()


def finish(editor):
    """Tick until nothing is left to do."""
    editor.tick()
    wait_for(lambda: not editor.busy, editor.tick, pause=0.001)


def texts(changes, kind):
    """What the user has been told by one kind of change."""
    return [change.text for change in changes if isinstance(change, kind)]


def event(editor, name, pixel, shift=False, control=False):
    """Have VTK report an event of the mouse at a pixel."""
    interactor = editor.state.view.plotter.iren.interactor
    x, y = pixel
    interactor.SetEventInformation(int(x), SIZE[1] - 1 - int(y), control, shift)
    interactor.InvokeEvent(f"{name}Event")


def press_key(editor, name, letter="\0", shift=False, control=False):
    """Have VTK report that a key, named as X does, goes down and up."""
    interactor = editor.state.view.plotter.iren.interactor
    interactor.SetControlKey(control)
    interactor.SetShiftKey(shift)
    interactor.SetKeyCode(letter)
    interactor.SetKeySym(name)
    for happens in ("KeyPressEvent", "CharEvent", "KeyReleaseEvent"):
        interactor.InvokeEvent(happens)
    interactor.SetControlKey(False)
    interactor.SetShiftKey(False)


def drag(editor, start, end, button="Left", steps=6, release=True):
    """Press a button, move, and release it unless told otherwise."""
    event(editor, "MouseMove", start)
    event(editor, f"{button}ButtonPress", start)
    for n in range(1, steps + 1):
        event(editor, "MouseMove", np.array(start) + (np.array(end) - start) * n / steps)
        editor.tick()
    if release:
        event(editor, f"{button}ButtonRelease", end)
    finish(editor)


def click(editor, at, button="Left"):
    """Press and release a button without a move."""
    event(editor, "MouseMove", at)
    event(editor, f"{button}ButtonPress", at)
    event(editor, f"{button}ButtonRelease", at)
    finish(editor)


def seen(editor, wanted):
    """A vertex that is seen at a share of the tube's length, and the middle of its pixel."""
    pixels = np.floor(editor.state.camera.project(editor.vertices, editor.stage.size)) + 0.5
    for vertex in np.argsort(np.abs(editor.vertices[:, 0] - 2 * wanted)):
        if editor.state.view.vertex_at(pixels[vertex]) == vertex:
            return int(vertex), pixels[vertex]
    raise AssertionError("no vertex is seen there")


def part_pixel(editor, part):
    """A pixel at which a part of the manipulator is pressed, and no handle."""
    gizmo, camera = editor.stage.gizmo, editor.state.camera
    for pixel in camera.project(gizmo.outline(part, camera, SIZE), SIZE)[::-1]:
        at = np.floor(pixel) + 0.5
        if gizmo.part_at(at, camera, SIZE) == part and editor.stage.handle_at(tuple(at)) is None:
            return at
    raise AssertionError(f"{part} is nowhere to be pressed")
