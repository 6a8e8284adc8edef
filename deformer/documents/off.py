"""OFF files of polygon meshes: the format has polygons, and nothing else beside positions."""

from __future__ import annotations

from deformer.documents.polygons import PolygonMesh
from deformer.geometry import FloatArray


def off_of(vertices: FloatArray, mesh: PolygonMesh) -> bytes:
    """An OFF file of positions (V, 3) and the polygons of a description."""
    lines = ["OFF", f"{len(vertices)} {len(mesh.counts)} 0"]
    lines += [f"{x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    corners, at = mesh.corners.astype(str).tolist(), 0
    for count in mesh.counts.tolist():
        lines.append(" ".join([str(count), *corners[at : at + count]]))
        at += count
    return ("\n".join(lines) + "\n").encode("ascii")
