"""GLB files of data whose z axis points up: glTF has y point up."""

from __future__ import annotations

import copy
from math import sqrt

from deformer.documents.document import Document
from deformer.io import GlbBuilder, GltfAsset

# A quarter turn about x, as a quaternion (x, y, z, w): z to y.
_UPRIGHT = [-sqrt(0.5), 0.0, 0.0, sqrt(0.5)]


def upright_glb(data: bytes, up: str, document: Document | None = None) -> bytes:
    """A GLB file with everything on a node that turns z up to y up.

    Positions in the file stay as they are. Skinned meshes go where their joints go, and stay roots.

    Args:
        data: the file.
        up: "y" or "z", the axis that points up; "y" changes nothing.
        document: of the file. One that is GLB or USD says itself which axis points up; GLB has y
            up, and nothing is changed.
    """
    own = document.up if document is not None else None
    if (own or up) == "y":
        return data
    source = GltfAsset(data, "the document")
    asset = GlbBuilder.of(copy.deepcopy(source.json), source.buffer(0, "the file"))
    for scene in asset.json["scenes"]:
        roots = scene["nodes"]
        skinned = [root for root in roots if "skin" in asset.json["nodes"][root]]
        turned = [root for root in roots if root not in skinned]
        node = {"name": "z up", "rotation": _UPRIGHT, "children": turned}
        scene["nodes"] = [*skinned, asset.add("nodes", node)]
    return asset.data
