"""Runs in Blender's Python (`pip install bpy`): imports a GLB file and renders it with Cycles.

BLENDER_PYTHON docs/render_in_blender.py FILE.glb PICTURE.png
"""

import math
import sys

import bpy
from mathutils import Vector


def main(path, picture):
    """Import a file, aim at it, and render."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=path)
    meshes = [each for each in bpy.data.objects if each.type == "MESH"]
    corners = [each.matrix_world @ Vector(corner) for each in meshes for corner in each.bound_box]
    low = Vector([min(c[k] for c in corners) for k in range(3)])
    high = Vector([max(c[k] for c in corners) for k in range(3)])
    middle, size = (low + high) / 2, (high - low).length
    for each in meshes:
        for polygon in each.data.polygons:
            polygon.use_smooth = True
    scene = bpy.context.scene
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = middle + size * Vector((0.5, -1.25, 0.3))
    camera.rotation_euler = (middle - camera.location).to_track_quat("-Z", "Y").to_euler()
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.rotation_euler = (math.radians(50), math.radians(10), math.radians(35))
    sun.data.energy, sun.data.angle = 3.0, 0.2
    for each in (camera, sun):
        bpy.context.collection.objects.link(each)
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs[0].default_value = (0.8, 0.85, 0.9, 1.0)
    world.node_tree.nodes["Background"].inputs[1].default_value = 0.6
    scene.camera, scene.world = camera, world
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples = "CPU", 48
    scene.view_settings.view_transform = "Standard"
    scene.render.resolution_x, scene.render.resolution_y = 800, 560
    scene.render.filepath = picture
    bpy.ops.render.render(write_still=True)


main(*sys.argv[1:])
