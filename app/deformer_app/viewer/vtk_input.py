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
) -> None:
    """Report the mouse over a view's picture to `handle`, and keys to `handle_key`."""
    interactor = view.plotter.iren.interactor
    view.plotter.iren.style = vtkInteractorStyleUser()

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
        "MouseMoveEvent": lambda: handle(MouseMoved(pixel(), keys())),
        "LeaveEvent": lambda: handle(MouseLeft()),
        "MouseWheelForwardEvent": lambda: handle(WheelTurned(1.0, pixel())),
        "MouseWheelBackwardEvent": lambda: handle(WheelTurned(-1.0, pixel())),
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
