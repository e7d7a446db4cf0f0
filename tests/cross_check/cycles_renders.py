"""Renders a glTF file with Cycles as Blender imports it, picture by picture, on request.

    blender -b --factory-startup --python-exit-code 1 --python cycles_renders.py -- FILE.glb WxH MATERIALS
    SKY DEGREES

MATERIALS is "principled" (as imported) or "diffuse" (Diffuse BSDFs in their place). SKY is a
latitude-longitude picture around the scene, turned by DEGREES as `lumifold render --env-rotate` does, or "-".
Each line "SAMPLES SEED PATH" of standard input is answered with a line "SECONDS s": the processor time of all
threads. A line "EXPORT PATH" writes what was imported with Blender's own exporter.
"""

import json
import math
import pathlib
import struct
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent))

import blender_scenes
import bpy


def vertical_angle(glb):
    """Of the file's first camera."""
    with open(glb, "rb") as file:
        (length,) = struct.unpack("<12xI4x", file.read(20))
        return json.loads(file.read(length))["cameras"][0]["perspective"]["yfov"]


def show_sky(path, degrees):
    tree = bpy.context.scene.world.node_tree
    sky, coordinates, mapping = (
        tree.nodes.new(f"Shader{kind}") for kind in ("NodeTexEnvironment", "NodeTexCoord", "NodeMapping"))
    sky.image = bpy.data.images.load(path)
    mapping.inputs["Rotation"].default_value[2] = -math.radians(degrees)
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], sky.inputs["Vector"])
    tree.links.new(sky.outputs["Color"], tree.nodes["Background"].inputs["Color"])


def load(glb, size, materials, sky, degrees):
    blender_scenes.start_empty()
    bpy.ops.import_scene.gltf(filepath=glb)
    scene = bpy.context.scene
    scene.camera = next(thing for thing in bpy.data.objects if thing.type == "CAMERA")
    # The importer keeps the width of the file's aspect ratio; Lumifold keeps the height.
    scene.camera.data.sensor_fit = "VERTICAL"
    scene.camera.data.angle_y = vertical_angle(glb)
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    if sky != "-":
        show_sky(sky, float(degrees))
    if materials == "diffuse":
        for made in bpy.data.materials:
            made["cycles"] = blender_scenes.AS_DIFFUSE
            blender_scenes.replace_for_cycles(made)
    blender_scenes.set_up_cycles(samples=1)
    scene.render.threads = 1


def render(samples, seed, path):
    scene = bpy.context.scene
    scene.cycles.samples = int(samples)
    scene.cycles.seed = int(seed)
    scene.render.filepath = path
    start = time.process_time()
    bpy.ops.render.render(write_still=True)
    print("SECONDS", time.process_time() - start, flush=True)


def main(glb, size, *look):
    load(glb, tuple(map(int, size.split("x"))), *look)
    for line in sys.stdin:
        first, *others = line.split()
        if first == "EXPORT":
            blender_scenes.export(*others, moves=False)
            print("SECONDS 0", flush=True)
        else:
            render(first, *others)


if __name__ == "__main__":
    main(*sys.argv[sys.argv.index("--") + 1 :])
