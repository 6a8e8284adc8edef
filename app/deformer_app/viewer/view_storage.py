"""What a session stores of the picture: camera, look, the mesh to compare with, the reference."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any

from deformer import io
from deformer_app.viewer.look import Look, read_look
from deformer_app.viewer.saved_cameras import SavedCameras, read_camera
from deformer_app.viewer.target import Target
from deformer_app.viewer.view_state import ViewState


def view_as_json(state: ViewState) -> dict[str, Any]:
    """Return the part of a picture's state that a session stores."""
    return {
        "camera": asdict(state.camera),
        "look": asdict(state.look),
        "target": None if state.target is None else state.target.as_json(),
        "cameras": state.cameras.as_json(),
        "picture": state.reference_picture.as_json(),
    }


def restore_view(state: ViewState, data: dict[str, Any]) -> list[str]:
    """Restore the result of `view_as_json`, as far as it is complete.

    Args:
        state: of the picture, which shows a model.
        data: of the session.

    Returns:
        Messages for the user.

    Raises:
        InputError: the data are damaged.
    """
    message = ""
    view = io.JsonValue(data, "session", "view")
    camera = read_camera(view["camera"]) if data.get("camera") else state.camera
    look = read_look(view["look"]) if "look" in data else Look(dark=state.look.dark)
    if data.get("target"):
        target = view["target"]
        state.target, message = Target.restore(
            target["path"].text(), target["sha256"].text(), state.reference
        )
    if state.target_mesh is None:
        ghost = "none" if look.ghost == "target" else look.ghost
        colour = "plain" if look.colour == "error" else look.colour
        look = replace(look, ghost=ghost, colour=colour)
    if "cameras" in view:  # sessions of earlier versions have none
        state.cameras = SavedCameras.read(view["cameras"])
    told = ""
    if "picture" in view:
        told = state.reference_picture.restore(view["picture"])
    else:
        state.reference_picture.close()
    state.change_look(**asdict(look))
    state.viewpoint.set_camera(camera)
    return [text for text in (message, told) if text]
