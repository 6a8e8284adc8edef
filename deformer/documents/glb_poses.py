"""Documents of any format as GLB files whose vertices can be found again."""

from __future__ import annotations

import numpy as np

from deformer.checks import checked_array
from deformer.documents.document import Document
from deformer.documents.glb import undeformed_glb
from deformer.documents.glb_polygons import glb_of_polygons
from deformer.geometry import FARTHEST, FloatArray, IntArray, Mesh
from deformer.io import GltfAsset, GltfScene, mesh_bytes


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
    points = checked_array(vertices, "vertices", (document.vertex_count, 3), largest=FARTHEST)
    polygons = document.polygons()
    return document.guarded(lambda: glb_of_polygons(points, polygons, document.faces))


def _posed(data: bytes, vertices: FloatArray) -> bytes:
    return undeformed_glb(GltfScene(GltfAsset(data, "the document")), vertices)
