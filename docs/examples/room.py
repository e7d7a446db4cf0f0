"""Makes a first scene in Blender: room.blend, and room.glb of the same. A script for Blender:

    blender -b --factory-startup --python docs/examples/room.py
"""

import math
import os

import bpy


def material(name, colour, roughness=0.5, metallic=0.0):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    inputs = made.node_tree.nodes["Principled BSDF"].inputs
    inputs["Base Color"].default_value = (*colour, 1)
    inputs["Roughness"].default_value = roughness
    inputs["Metallic"].default_value = metallic
    return made


def place(name, made_of):
    thing = bpy.context.object
    thing.name = name
    thing.data.materials.append(made_of)
    return thing


bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
bpy.ops.mesh.primitive_plane_add(size=6)
place("floor", material("oak", (0.35, 0.2, 0.1)))
bpy.ops.mesh.primitive_plane_add(size=6, location=(0, 3, 3), rotation=(math.pi / 2, 0, 0))
place("wall", material("plaster", (0.8, 0.78, 0.74)))
bpy.ops.mesh.primitive_monkey_add(size=1.6, location=(-0.9, 0.6, 0.8), rotation=(-0.6, 0, 0.3))
place("monkey", material("clay", (0.7, 0.25, 0.15)))
bpy.ops.object.shade_smooth()
bpy.ops.mesh.primitive_uv_sphere_add(radius=0.6, location=(1, 0.4, 0.6))
place("ball", material("steel", (0.8, 0.8, 0.82), roughness=0.1, metallic=1))
bpy.ops.object.shade_smooth()
bpy.ops.object.light_add(type="POINT", location=(1.5, -2, 4))
bpy.context.object.data.energy = 600
bpy.ops.object.camera_add(location=(0, -6.5, 2.2), rotation=(math.radians(78), 0, 0))

scene = bpy.context.scene
scene.camera = bpy.context.object
scene.render.resolution_x, scene.render.resolution_y = 640, 480
bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath("room.blend"))
bpy.ops.export_scene.gltf(filepath=os.path.abspath("room.glb"), export_cameras=True, export_lights=True)
