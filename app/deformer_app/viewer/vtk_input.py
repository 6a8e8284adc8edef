"""Events for the controller from mouse and keys of any window's VTK interactor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vtkmodules.vtkCommonCore import vtkCommand
from vtkmodules.vtkInteractionStyle import vtkInteractorStyleUser

from deformer_app.viewer.events import (
    Button,
    ButtonPressed,
    ButtonReleased,
    KeyPressed,
    Keys,
    MouseEvent,
    MouseLeft,
    MouseMoved,
    Pixel,
    WheelTurned,
)
from deformer_app.viewer.scene import MeshView

_BEFORE_CAMERA = 0.25  # priority: after VTK's widgets, before its camera
_BUTTONS: dict[str, Button] = {"Left": "left", "Middle": "middle", "Right": "right"}


def listen(
    view: MeshView,
    handle: Callable[[MouseEvent], Any],
    handle_key: Callable[[KeyPressed], Any] = lambda event: None,
    buttons: Callable[[], frozenset[Button] | None] = lambda: None,
) -> None:
    """Report the mouse over a view's picture and the keys; VTK and pyvista act on neither.

    Args:
        view: the picture.
        handle: called with what the mouse does.
        handle_key: called with each key.
        buttons: gives the buttons that are down while the mouse moves; None where the window
            cannot tell.
    """
    interactor = view.plotter.iren.interactor
    view.plotter.iren.style = vtkInteractorStyleUser()
    # pyvista zooms, picks and ends by keys of its own.
    view.plotter.iren.clear_key_event_callbacks()

    def pixel() -> Pixel:
        x, y = interactor.GetEventPosition()
        density, (_, height) = view.density, view.plotter.render_window.GetSize()
        return (x + 0.5) / density, (height - y - 0.5) / density  # the middle of the pixel

    def keys() -> Keys:
        return Keys(
            bool(interactor.GetShiftKey()),
            bool(interactor.GetControlKey()),
            bool(interactor.GetAltKey()),
        )

    observers: dict[str, Callable[[], Any]] = {
        "MouseMoveEvent": lambda: handle(MouseMoved(pixel(), keys(), buttons())),
        "LeaveEvent": lambda: handle(MouseLeft()),
        "MouseWheelForwardEvent": lambda: handle(WheelTurned(1.0, pixel(), keys())),
        "MouseWheelBackwardEvent": lambda: handle(WheelTurned(-1.0, pixel(), keys())),
        "KeyPressEvent": lambda: handle_key(KeyPressed(interactor.GetKeySym() or "", keys())),
    }
    for name, button in _BUTTONS.items():
        observers[f"{name}ButtonPressEvent"] = lambda b=button: handle(
            ButtonPressed(b, pixel(), keys())
        )
        observers[f"{name}ButtonReleaseEvent"] = lambda b=button: handle(
            ButtonReleased(b, pixel(), keys())
        )
    for event, report in observers.items():
        interactor.AddObserver(event, lambda *_, r=report: r(), _BEFORE_CAMERA)
    # VTK would also act on its own letters (e ends, w shows wires, …).
    interactor.RemoveObservers(vtkCommand.CharEvent)
