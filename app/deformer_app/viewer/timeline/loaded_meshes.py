"""Posed meshes that were loaded as a sequence, and their entry in a session."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import deformer
from deformer import DeformationModel, InputError, io

_SCENES = (".glb", ".gltf")


@dataclass(frozen=True, eq=False)
class LoadedMeshes:
    """Posed meshes of a model, and the file or directory that they are from.

    Args:
        path: absolute.
        sha256: checksum of the files, in hexadecimal digits.
        fps: frames a second at which they were sampled.
        shapes: (F, V, 3); None until a session's are loaded, or if they cannot be. The session
            keeps their path all the same.
    """

    path: str
    sha256: str
    fps: float
    shapes: NDArray[np.float64] | None = None

    @classmethod
    def load(cls, path: Path, model: DeformationModel, fps: float) -> LoadedMeshes:
        """Load a sequence with the connectivity of a model.

        Raises:
            InputError: no sequence, or one of another mesh.
            OSError: a file cannot be read.
        """
        # A scene's frames, not its morph targets, are a sequence.
        clip = 0 if path.suffix.lower() in _SCENES else None
        found = deformer.load_shapes(path, clip=clip, fps=fps)
        V, faces = len(model.reference.vertices), model.reference.faces
        if found.vertices.shape[1] != V or not np.array_equal(found.faces, faces):
            raise InputError(
                f"{path}: shapes of {found.vertices.shape[1]} vertices and {len(found.faces)} "
                f"faces, expected the model's {V} and {len(faces)} in the same order; choose "
                "another sequence"
            )
        return cls(str(path.resolve()), _checksum(path), fps, found.vertices)

    @classmethod
    def read(cls, entry: io.JsonValue) -> LoadedMeshes:
        """Read an entry of a session, without the meshes.

        Raises:
            InputError: the entry is damaged.
        """
        fps = entry["fps"].number(above=0, most=io.LARGEST)
        return cls(entry["path"].text(), entry["sha256"].text(), fps)

    def restored(self, model: DeformationModel) -> tuple[LoadedMeshes, str]:
        """Load the meshes of a session's entry.

        Returns:
            The meshes, without shapes where they cannot be loaded; and a message for the user, or
            an empty text.
        """
        try:
            found = LoadedMeshes.load(Path(self.path), model, self.fps)
        except (InputError, OSError) as error:
            return self, f"The loaded meshes of this session cannot be shown: {error}"
        same = found.sha256 == self.sha256
        told = f"{self.path}: the loaded meshes have changed since the session was saved"
        return replace(found, path=self.path), "" if same else told

    def as_json(self) -> dict[str, Any]:
        """Return the entry in a session."""
        return {"path": self.path, "sha256": self.sha256, "fps": self.fps}


def _checksum(path: Path) -> str:
    digest = hashlib.sha256()
    for file in io.shape_files(path):
        with file.open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return digest.hexdigest()
