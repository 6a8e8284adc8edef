"""This program's files as programs read them that do not know its marks."""

import deformer
from deformer.documents.glb_file import GlbFile
from deformer.io import read_gltf


def unmarked(path):
    """Path of a copy of a GLB file without what `extras` say of it."""
    file = GlbFile(read_gltf(path))
    for item in [*file.json["nodes"], *file.json.get("animations", [])]:
        item.pop("extras", None)
    other = path.with_name(f"unmarked-{path.name}")
    other.write_bytes(file.data)
    return other


def as_other_programs_read(path, **options):
    """Shapes (N, V, 3) of a GLB file where its scene shows them."""
    return deformer.load_shapes(unmarked(path), **options).vertices
