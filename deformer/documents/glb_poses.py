"""Documents of any format as GLB files whose vertices can be found again."""

from __future__ import annotations

import numpy as np

from deformer.documents.document import Document
from deformer.documents.glb import undeformed_glb
from deformer.geometry import FloatArray, IntArray, Mesh
from deformer.io import GltfAsset, GltfScene, mesh_bytes

# Whole numbers below it, and their quotients by it, are exact in single precision.
_STEP = 4096


def posed_glb(
    document: Document | None, vertices: FloatArray, faces: IntArray
) -> tuple[bytes, IntArray]:
    """A GLB file of a pose without morph targets, skins and animations of it.

    Args:
        document: what it has beside positions and triangles; None for nothing.
        vertices: (V, 3) positions.
        faces: (F, 3) triangles, where there is no document.

    Returns:
        the file, and for each vertex of its scene, as `GltfScene` counts them, the vertex of the
        pose: formats without seams are split at them.

    Raises:
        InputError: as of `Document.write`.
    """
    if document is None:
        return mesh_bytes(Mesh(vertices, faces), ".glb"), np.arange(len(vertices))
    if document.suffix == ".glb":
        data = document.guarded(lambda: _posed(document.data, vertices))
        return data, np.arange(len(vertices))
    # How vertices are split does not depend on where they are: each is put where its number is.
    numbers = np.arange(document.vertex_count)
    probe = np.stack([numbers % _STEP, numbers // _STEP, np.zeros_like(numbers)], axis=1)
    scene = GltfScene(GltfAsset(document.write(probe, ".glb"), "the document"))
    found = scene.vertices({}, {}, 1)[0].astype(np.int64) @ np.array([1, _STEP, 0])
    return document.write(vertices, ".glb"), found


def _posed(data: bytes, vertices: FloatArray) -> bytes:
    return undeformed_glb(GltfScene(GltfAsset(data, "the document")), vertices)
