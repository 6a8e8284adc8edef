"""Cameras that the user has given names to, in the order in which they were saved."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from deformer import InputError, io
from deformer_app.rendering.camera import Camera
from deformer_app.viewer.edit import point


class SavedCameras:
    """Named cameras of one session."""

    def __init__(self) -> None:
        """Start with none."""
        self._cameras: dict[str, Camera] = {}

    @property
    def names(self) -> list[str]:
        """Names, the first saved one first."""
        return list(self._cameras)

    def save(self, name: str, camera: Camera) -> None:
        """Keep a camera; one of the same name is replaced.

        Raises:
            InputError: the name is empty.
        """
        if not name.strip():
            raise InputError("camera: got an empty name; type one")
        self._cameras[name.strip()] = camera

    def __getitem__(self, name: str) -> Camera:
        """Return the camera with a name.

        Raises:
            InputError: there is none.
        """
        if name not in self._cameras:
            known = ", ".join(self._cameras) or "none"
            raise InputError(f"camera {name!r}: not saved; saved are: {known}")
        return self._cameras[name]

    def remove(self, name: str) -> None:
        """Forget a camera.

        Raises:
            InputError: there is none of this name.
        """
        self[name]
        del self._cameras[name]

    def as_json(self) -> list[dict[str, Any]]:
        """Return the cameras' entries in a session."""
        return [{"name": name, "camera": asdict(found)} for name, found in self._cameras.items()]

    @classmethod
    def read(cls, entries: io.JsonValue) -> SavedCameras:
        """Return the cameras of `as_json`.

        Raises:
            InputError: an entry is damaged.
        """
        found = cls()
        for entry in entries.items():
            found.save(entry["name"].text(), read_camera(entry["camera"]))
        return found


def read_camera(value: io.JsonValue) -> Camera:
    """Return the camera of a session's file.

    Raises:
        InputError: it is damaged.
    """
    position, focal, up = (point(value[name].numbers(3)) for name in ("position", "focal", "up"))
    angle = value["view_angle"].number(above=0, most=179)
    # Sessions of earlier versions have no height.
    flat = "height" in value and value["height"].value is not None
    if not flat:
        return Camera(position, focal, up, angle)
    return Camera(position, focal, up, angle, value["height"].number(above=0, most=io.LARGEST))
