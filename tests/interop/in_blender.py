"""Runs in Blender's Python: imports a file, and says what Blender has of it at chosen frames.

`python in_blender.py FILE OUTPUT.npz FRAME [FRAME …] [--base MESH]` writes an NPZ with `vertices`
(frames, V, 3), in the coordinates that Blender has them in, and `facts`, a JSON text. With `--base`
the file is a point cache, which is played on that mesh.
"""

import json
import sys
from pathlib import Path

import bpy
import numpy as np


def import_mesh(path):
    """Import a file of any format; gives its mesh objects in the order of their names' numbers."""
    suffix = Path(path).suffix.lower()
    if suffix in (".glb", ".gltf"):
        # Vertices are merged by default where the file splits them.
        bpy.ops.import_scene.gltf(filepath=path, merge_vertices=False)
    elif suffix == ".obj":
        bpy.ops.wm.obj_import(filepath=path)
    elif suffix == ".ply":
        bpy.ops.wm.ply_import(filepath=path)
    else:
        bpy.ops.wm.usd_import(filepath=path)
    return [each for each in bpy.data.objects if each.type == "MESH" and each.name != "Icosphere"]


def facts_of(mesh_object):
    """Names and counts of what a mesh has."""
    mesh = mesh_object.data
    keys = mesh.shape_keys
    rig = mesh_object.find_armature()
    blocks = list(keys.key_blocks) if keys else []
    return {
        "name": mesh_object.name,
        "vertices": len(mesh.vertices),
        "faces": [len(polygon.vertices) for polygon in mesh.polygons],
        "uv": {layer.name: [list(loop.uv) for loop in layer.data] for layer in mesh.uv_layers},
        "materials": [slot.name for slot in mesh_object.material_slots],
        "polygon_materials": [polygon.material_index for polygon in mesh.polygons],
        "colours": [layer.name for layer in mesh.color_attributes],
        "shape_keys": [key.name for key in blocks],
        "key_shapes": {key.name: [list(point.co) for point in key.data] for key in blocks[1:]},
        "base_shape": [list(vertex.co) for vertex in mesh.vertices],
        "groups": [group.name for group in mesh_object.vertex_groups],
        "bones": [bone.name for bone in rig.data.bones] if rig else [],
        "custom_normals": bool(mesh.has_custom_normals),
    }


def positions(mesh_object):
    """World positions (V, 3) of the mesh as it is deformed at the present frame."""
    graph = bpy.context.evaluated_depsgraph_get()
    shown = mesh_object.evaluated_get(graph)
    mesh = shown.to_mesh()
    found = np.empty(3 * len(mesh.vertices))
    mesh.vertices.foreach_get("co", found)
    matrix = np.array(shown.matrix_world)
    shown.to_mesh_clear()
    return found.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def main(arguments):
    base = None
    if "--base" in arguments:
        at = arguments.index("--base")
        base = arguments[at + 1]
        del arguments[at : at + 2]
    path, output, *frames = arguments
    bpy.ops.wm.read_factory_settings(use_empty=True)
    meshes = import_mesh(base or path)
    if base:
        for each in meshes:
            cache = each.modifiers.new("cache", "MESH_CACHE")
            cache.cache_format = "MDD" if path.lower().endswith(".mdd") else "PC2"
            cache.filepath = path
            cache.frame_start = 0.0
    shapes = []
    for frame in frames:
        whole, part = divmod(float(frame), 1.0)
        bpy.context.scene.frame_set(int(whole), subframe=part)
        shapes.append(np.concatenate([positions(each) for each in meshes]))
    facts = {
        "meshes": [facts_of(each) for each in meshes],
        "fps": bpy.context.scene.render.fps / bpy.context.scene.render.fps_base,
        "empties": sorted(each.name for each in bpy.data.objects if each.type == "EMPTY"),
        "actions": sorted(action.name for action in bpy.data.actions),
    }
    np.savez(output, vertices=np.array(shapes), facts=json.dumps(facts))


main(sys.argv[1:])
