"""A textured flag as a GLB file, and a pose of it that is written into that file.

python docs/textured_flag.py FOLDER        writes flag.glb and posed.glb
BLENDER_PYTHON docs/render_in_blender.py FOLDER/posed.glb docs/gallery/blender.png
"""

import io
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

import deformer
from deformer.io import INDICES, VERTICES, GlbBuilder

COLUMNS, ROWS = 61, 41  # vertices of the flag
# The model's z axis points up; that of GLB files is y.
UPRIGHT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def texture() -> bytes:
    """A PNG: a chequered edge, stripes, and a sun."""
    picture = Image.new("RGB", (1220, 820), "#f4efe2")
    draw = ImageDraw.Draw(picture)
    for n in range(0, 820, 164):
        draw.rectangle((0, n, 1220, n + 81), fill="#16697a")
    for n in range(10):
        draw.rectangle((61 * (n % 2), 82 * n, 61 * (n % 2) + 60, 82 * n + 81), fill="#22223b")
    draw.ellipse((480, 210, 880, 610), fill="#ffa62b", outline="#f4efe2", width=24)
    stream = io.BytesIO()
    picture.save(stream, "PNG")
    return stream.getvalue()


def flag_document(mesh: deformer.Mesh) -> bytes:
    """The flat flag as an exporter writes it: texture coordinates, a material, names."""
    asset = GlbBuilder()
    span = np.ptp(mesh.vertices, axis=0)
    across, up = np.argsort(-span)[:2]
    low = mesh.vertices.min(axis=0)
    uv = np.stack(
        [
            (mesh.vertices[:, across] - low[across]) / span[across],
            1 - (mesh.vertices[:, up] - low[up]) / span[up],
        ],
        axis=1,
    )
    image = asset.add("images", {"bufferView": asset.add_bytes(texture()), "mimeType": "image/png"})
    look = {"baseColorTexture": {"index": asset.add("textures", {"source": image})}}
    look |= {"metallicFactor": 0.0, "roughnessFactor": 0.8}
    cloth = {"name": "cloth", "pbrMetallicRoughness": look, "doubleSided": True}
    attributes = {
        "POSITION": asset.add_array(mesh.vertices, VERTICES),
        "NORMAL": asset.add_array(deformer.vertex_normals(mesh.vertices, mesh.faces), VERTICES),
        "TEXCOORD_0": asset.add_array(uv, VERTICES),
    }
    corners = asset.add_array(mesh.faces.ravel().astype("<u4"), INDICES)
    primitive = {"attributes": attributes, "indices": corners}
    primitive["material"] = asset.add("materials", cloth)
    shape = asset.add("meshes", {"name": "Flag", "primitives": [primitive]})
    asset.add("scenes", {"nodes": [asset.add("nodes", {"name": "Flag", "mesh": shape})]})
    asset.json["scene"] = 0
    return asset.data


def main(folder: Path) -> None:
    """Write both files."""
    model = deformer.load_model("flag")
    folder.mkdir(parents=True, exist_ok=True)
    faces = model.reference.faces
    flat = deformer.Mesh(model.reference.vertices @ UPRIGHT, faces)
    (folder / "flag.glb").write_bytes(flag_document(flat))
    grid = np.arange(COLUMNS * ROWS).reshape(COLUMNS, ROWS)
    handles = [*grid[0, [0, -1]], *grid[-1, [0, -1, ROWS // 2]]]
    targets = model.reference.vertices[handles].copy()
    targets[2:] = [[1.3, -0.25, 0.0], [0.95, -0.5, 0.65], [1.3, -0.35, 0.45]]
    solver = deformer.HandleSolver(model)
    solver.set_handles(handles, targets, hard=True)
    posed = deformer.Mesh(solver.solve().vertices @ UPRIGHT, faces)
    deformer.save_mesh(folder / "posed.glb", posed, like=folder / "flag.glb")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
