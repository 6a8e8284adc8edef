"""Events of VTK's interactor, from whatever window, to the controller."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vtkmodules.vtkCommonCore import vtkCommand
from vtkmodules.vtkInteractionStyle import vtkInteractorStyleUser

from deformer_app.viewer.controller import Button, Controller, Keys, Pixel
from deformer_app.viewer.scene import MeshView

_BEFORE_CAMERA = 0.25  # priority: after VTK's widgets, before its camera


def listen(
    view: MeshView,
    controller: Controller,
    key: Callable[[str, Keys], Any] = lambda name, keys: None,
) -> None:
    """Send the events of a view's plotter to a controller, and keys by name to `key`."""
    interactor = view.plotter.iren.interactor
    view.plotter.iren.style = vtkInteractorStyleUser()

    def where() -> Pixel:
        x, y = interactor.GetEventPosition()
        density, (_, height) = view.density, view.plotter.render_window.GetSize()
        return (x + 0.5) / density, (height - y - 0.5) / density  # the middle of the pixel

    def held() -> Keys:
        return Keys(
            bool(interactor.GetShiftKey()),
            bool(interactor.GetControlKey()),
            bool(interactor.GetAltKey()),
        )

    def on_key(*_: Any) -> None:
        key(interactor.GetKeySym() or "", held())

    def on_button(name: str, button: Button) -> None:
        press, release = f"{name}ButtonPressEvent", f"{name}ButtonReleaseEvent"
        observers[press] = lambda *_: controller.press(button, where(), held())
        observers[release] = lambda *_: controller.release(button, where(), held())

    observers: dict[str, Any] = {
        "MouseMoveEvent": lambda *_: controller.move(where(), held()),
        "LeaveEvent": lambda *_: controller.leave(),
        "MouseWheelForwardEvent": lambda *_: controller.wheel(1.0, where()),
        "MouseWheelBackwardEvent": lambda *_: controller.wheel(-1.0, where()),
        "KeyPressEvent": on_key,
    }
    on_button("Left", "left")
    on_button("Middle", "middle")
    on_button("Right", "right")
    for event, action in observers.items():
        interactor.AddObserver(event, action, _BEFORE_CAMERA)
    # VTK's own letters (e ends, w shows wires, …) would come beside ours.
    interactor.RemoveObservers(vtkCommand.CharEvent)
