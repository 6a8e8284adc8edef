"""Runs in Blender's Python: exports a textured tube of quads that deforms, in several formats.

`python from_blender.py FOLDER` writes keys.glb (shape keys), skin.glb (an armature that bends over
13 frames), walk.usdc (as time samples), frames/0000.obj … (as files), still.ply,
and positions.npz with what Blender had: `keys` (2, V, 3), and `frames` (13, V, 3).
"""

import math
import sys
from pathlib import Path

import bpy
import numpy as np

FRAMES = 13


def tube():
    """A tube along z of 8 by 6 vertices, with a seam in its texture coordinates."""
    around, rings = 8, 6
    vertices, faces, corners = [], [], []
    for i in range(rings):
        for j in range(around):
            t = 2 * math.pi * j / around
            vertices.append((0.3 * math.cos(t), 0.3 * math.sin(t), 0.4 * i))
    for i in range(rings - 1):
        for j in range(around):
            a, b = i * around + j, i * around + (j + 1) % around
            faces.append((a, b, b + around, a + around))
            corners += [(j, i), (j + 1, i), (j + 1, i + 1), (j, i + 1)]
    mesh = bpy.data.meshes.new("Tube")
    mesh.from_pydata(vertices, [], faces)
    layer = mesh.uv_layers.new(name="UVMap")
    for loop, (u, v) in zip(layer.data, corners, strict=True):
        loop.uv = (u / around, v / (rings - 1))
    for n, name in enumerate(("skin", "cuff")):
        material = bpy.data.materials.new(name)
        material.use_nodes = True
        colour = (0.8, 0.4 * n, 0.2, 1.0)
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = colour
        mesh.materials.append(material)
    for polygon in mesh.polygons:
        polygon.use_smooth = True
        polygon.material_index = int(polygon.index >= 32)
    made = bpy.data.objects.new("Tube", mesh)
    bpy.context.collection.objects.link(made)
    made.location = (0.5, 0.25, 0.0)
    return made


def bent(position, angle):
    """A point of the tube, its axis bent to an arc."""
    x, y, z = position
    radius = 2.0 / angle
    return (radius - (radius - x) * math.cos(z / radius), y, (radius - x) * math.sin(z / radius))


def evaluated(mesh_object):
    """World positions (V, 3) at the present frame."""
    shown = mesh_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    matrix = np.array(shown.matrix_world)
    local = np.array([tuple(vertex.co) for vertex in shown.data.vertices])
    return local @ matrix[:3, :3].T + matrix[:3, 3]


def add_keys(mesh_object):
    """Shape keys `bend` and `flat`; gives their world positions."""
    mesh_object.shape_key_add(name="Basis")
    found = []
    for name, moved in (
        ("bend", lambda p: bent(p, 0.8)),
        ("flat", lambda p: (p[0], 0.4 * p[1], p[2])),
    ):
        key = mesh_object.shape_key_add(name=name)
        for point, vertex in zip(key.data, mesh_object.data.vertices, strict=True):
            point.co = moved(vertex.co)
        key.value = 1.0
        bpy.context.view_layer.update()
        found.append(evaluated(mesh_object))
        key.value = 0.0
    return found


def add_armature(mesh_object):
    """An armature of two bones, whose upper one turns over the frames."""
    armature = bpy.data.armatures.new("Rig")
    rig = bpy.data.objects.new("Rig", armature)
    bpy.context.collection.objects.link(rig)
    rig.location = mesh_object.location
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    for n, name in enumerate(("lower", "upper")):
        bone = armature.edit_bones.new(name)
        bone.head, bone.tail = (0, 0, 1.0 * n), (0, 0, 1.0 * n + 1.0)
        if n:
            bone.parent = armature.edit_bones["lower"]
    bpy.ops.object.mode_set(mode="OBJECT")
    for n, name in enumerate(("lower", "upper")):
        group = mesh_object.vertex_groups.new(name=name)
        for vertex in mesh_object.data.vertices:
            share = min(max(vertex.co.z - 0.5, 0.0), 1.0)
            group.add([vertex.index], share if n else 1.0 - share, "REPLACE")
    mesh_object.parent = rig
    mesh_object.matrix_parent_inverse = rig.matrix_world.inverted()
    mesh_object.modifiers.new("rig", "ARMATURE").object = rig
    upper = rig.pose.bones["upper"]
    upper.rotation_mode = "XYZ"
    for frame in range(FRAMES):
        upper.rotation_euler = (0.1 * frame, 0.0, 0.05 * frame)
        upper.keyframe_insert("rotation_euler", frame=frame)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.render.fps = 0, FRAMES - 1, 24
    return rig


def main(folder):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    made = tube()
    bpy.ops.wm.ply_export(filepath=str(folder / "still.ply"), export_normals=True)
    keys = add_keys(made)
    bpy.ops.export_scene.gltf(filepath=str(folder / "keys.glb"), export_morph=True)
    made.shape_key_clear()
    add_armature(made)
    bpy.ops.export_scene.gltf(
        filepath=str(folder / "skin.glb"), export_animation_mode="ACTIONS", export_frame_range=True
    )
    bpy.ops.wm.usd_export(filepath=str(folder / "walk.usdc"), export_animation=True)
    (folder / "frames").mkdir()
    frames = []
    for frame in range(FRAMES):
        bpy.context.scene.frame_set(frame)
        frames.append(evaluated(made))
        bpy.ops.wm.obj_export(filepath=str(folder / "frames" / f"{frame:04d}.obj"))
    np.savez(folder / "positions.npz", keys=np.array(keys), frames=np.array(frames))


main(Path(sys.argv[1]))
