"""GLB files of data whose z axis points up: glTF has y point up."""

from __future__ import annotations

import copy

from deformer.documents.document import Document
from deformer.io import GlbBuilder, GltfAsset, is_upright_node, upright_node


def upright_glb(data: bytes, up: str, document: Document | None = None) -> bytes:
    """A GLB file with everything on a node that turns z up to y up.

    Positions in the file stay as they are. This program's readers leave the node out, and give the
    positions that were written. Skinned meshes go where their joints go, and stay roots.

    Args:
        data: the file.
        up: "y" or "z", the axis that points up; "y" changes nothing.
        document: of the file. One that is GLB or USD says itself which axis points up. That of
            other programs' GLB is y, and nothing is changed; one that this program has turned has
            its node already, and joints that are new go there, too.
    """
    own = document.up if document is not None else None
    if (own or up) == "y":
        return data
    source = GltfAsset(data, "the document")
    asset = GlbBuilder.of(copy.deepcopy(source.json), source.buffer(0, "the file"))
    nodes = asset.json["nodes"]
    joints = {joint for skin in asset.json.get("skins", []) for joint in skin["joints"]}
    for scene in asset.json["scenes"]:
        roots = scene["nodes"]
        there = next((root for root in roots if is_upright_node(nodes[root])), None)
        if there is None:
            turned = [root for root in roots if "skin" not in nodes[root]]
            there = asset.add("nodes", upright_node([]))
        else:
            turned = [root for root in roots if root in joints and root != there]
        nodes[there]["children"] = [*nodes[there].get("children", []), *turned]
        left = [root for root in roots if root not in (*turned, there)]
        scene["nodes"] = [*left, there]
    return asset.data
