"""A mesh to compare the pose with, and its entry in a session."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from deformer import InputError, Mesh, io


@dataclass(frozen=True, eq=False)
class Target:
    """A mesh of the model's connectivity, and the file that it is from.

    Args:
        path: absolute path of the file.
        sha256: checksum of the file, in hexadecimal digits.
        mesh: None while the file cannot be loaded; a session keeps its name all the same.
    """

    path: str
    sha256: str
    mesh: Mesh | None

    @classmethod
    def load(cls, path: str | Path, reference: Mesh) -> Target:
        """Load a mesh with as many vertices as `reference` has.

        Raises:
            InputError: the file is no mesh, or has another number of vertices.
            OSError: the file cannot be read.
        """
        mesh, file = load_alike(path, reference), Path(path).resolve()
        with file.open("rb") as opened:
            return cls(str(file), hashlib.file_digest(opened, "sha256").hexdigest(), mesh)

    @classmethod
    def restore(cls, path: str, sha256: str, reference: Mesh) -> tuple[Target, str]:
        """Load the mesh that a session was compared with.

        Returns:
            The target, without a mesh where that cannot be loaded; and a message for the user,
            or an empty text.
        """
        try:
            found = cls.load(path, reference)
        except (InputError, OSError) as error:
            message = f"The target mesh of this session cannot be loaded: {error}"
            return cls(path, sha256, None), message
        same = (found.path, found.sha256) == (path, sha256)
        return found, "" if same else f"{path}: the target mesh has changed since it was saved"

    def as_json(self) -> dict[str, str]:
        """Return the file's entry in a session."""
        return {"path": self.path, "sha256": self.sha256}


def load_alike(path: str | Path, reference: Mesh) -> Mesh:
    """Load a mesh with as many vertices as `reference` has.

    Raises:
        InputError: the file is no mesh, or has another number of vertices.
    """
    mesh = io.load_mesh(path)
    if mesh.vertices.shape != reference.vertices.shape:
        raise InputError(
            f"{path}: {len(mesh.vertices)} vertices, expected {len(reference.vertices)} as the "
            "model has; choose a mesh of the same connectivity"
        )
    return mesh
