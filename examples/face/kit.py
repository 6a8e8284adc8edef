"""The neutral face and the expressions of ICT-FaceKit, from its OBJ files or from an NPZ.

Source: ICT Face Model Light (University of Southern California, Institute for Creative
Technologies; MIT), github.com/ICT-VGL/ICT-FaceKit. The first 11,248 vertices of its meshes are the
skin of face, head and neck; the others (teeth, eyeballs, lashes, …) are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import deformer

NEUTRAL = "generic_neutral_mesh"
SKIN = 11_248  # vertices of face, head and neck, which come first
# The expressions in the order of their file names.
EXPRESSIONS = (
    *("browDown_L", "browDown_R", "browInnerUp_L", "browInnerUp_R"),
    *("browOuterUp_L", "browOuterUp_R", "cheekPuff_L", "cheekPuff_R"),
    *("cheekRaiser_L", "cheekRaiser_R", "cheekSquint_L", "cheekSquint_R"),
    *("eyeBlink_L", "eyeBlink_R", "eyeLookDown_L", "eyeLookDown_R", "eyeLookIn_L", "eyeLookIn_R"),
    *("eyeLookOut_L", "eyeLookOut_R", "eyeLookUp_L", "eyeLookUp_R"),
    *("eyeSquint_L", "eyeSquint_R", "eyeWide_L", "eyeWide_R"),
    *("jawForward", "jawLeft", "jawOpen", "jawRight", "mouthClose"),
    *("mouthDimple_L", "mouthDimple_R", "mouthFrown_L", "mouthFrown_R", "mouthFunnel"),
    *("mouthLeft", "mouthLowerDown_L", "mouthLowerDown_R", "mouthPress_L", "mouthPress_R"),
    *("mouthPucker", "mouthRight", "mouthRollLower", "mouthRollUpper"),
    *("mouthShrugLower", "mouthShrugUpper", "mouthSmile_L", "mouthSmile_R"),
    *("mouthStretch_L", "mouthStretch_R", "mouthUpperUp_L", "mouthUpperUp_R"),
    *("noseSneer_L", "noseSneer_R"),
)


@dataclass(frozen=True, eq=False)
class Face:
    """A face and what its expressions add to it: y up, looking along +z, centimetres.

    Args:
        neutral: (V, 3) the face at rest.
        faces: (F, 3) triangles, counter-clockwise seen from outside.
        offsets: name of an expression → (V, 3) displacement of the vertices at its full strength.
    """

    neutral: NDArray
    faces: NDArray
    offsets: dict[str, NDArray]


def load_face(source: Path) -> Face:
    """Read the kit.

    Args:
        source: the kit's folder `FaceXModel`, with `generic_neutral_mesh.obj` and an OBJ for each
            of `EXPRESSIONS`; or an NPZ with `vertices` (56, V, 3), the neutral face and the
            expressions in this order, and `faces` (F, 3).

    Raises:
        deformer.InputError: a file is missing or not as said.
    """
    if source.is_dir():
        paths = [source / f"{name}.obj" for name in (NEUTRAL, *EXPRESSIONS)]
        meshes = [deformer.load_mesh(path) for path in paths]
        for path, mesh in zip(paths, meshes, strict=True):
            if len(mesh.vertices) != len(meshes[0].vertices):
                raise deformer.InputError(
                    f"{path}: {len(mesh.vertices)} vertices, expected "
                    f"{len(meshes[0].vertices)} as in {paths[0].name}; take both from one kit"
                )
        vertices = np.stack([mesh.vertices for mesh in meshes])
        faces = meshes[0].faces
    else:
        shapes = deformer.load_shapes(source)
        vertices, faces = shapes.vertices, shapes.faces
        if len(vertices) != 1 + len(EXPRESSIONS):
            raise deformer.InputError(
                f"{source}: {len(vertices)} shapes, expected the neutral face and the "
                f"{len(EXPRESSIONS)} expressions of the kit, in the order of their names"
            )
    faces = faces[(faces < SKIN).all(axis=1)]
    vertices = vertices[:, : faces.max() + 1]
    offsets = dict(zip(EXPRESSIONS, vertices[1:] - vertices[0], strict=True))
    return Face(vertices[0], faces, offsets)
