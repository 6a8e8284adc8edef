"""Binary glTF (GLB) of positions and triangles."""

from __future__ import annotations

from deformer.geometry import FloatArray, IntArray
from deformer.io.glb_builder import INDICES, VERTICES, GlbBuilder


def write_glb(vertices: FloatArray, faces: IntArray) -> bytes:
    """GLB of vertices (V, 3) and faces (F, 3), positions as float32."""
    asset = GlbBuilder()
    attributes = {"POSITION": asset.add_array(vertices, VERTICES)}
    corners = asset.add_array(faces.ravel().astype("<u4"), INDICES)
    mesh = asset.add("meshes", {"primitives": [{"attributes": attributes, "indices": corners}]})
    asset.add("scenes", {"nodes": [asset.add("nodes", {"mesh": mesh})]})
    asset.json["scene"] = 0
    return asset.data
