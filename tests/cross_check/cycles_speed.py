"""Times Cycles on a glTF file that Blender imports.

    blender -b --factory-startup --python-exit-code 1 --python cycles_speed.py -- FILE.glb OUT MATERIALS FEW
    MANY WxH

MATERIALS is "diffuse" (Diffuse BSDFs replace the imported Principled ones) or "principled". Writes OUT-1.exr
and OUT-2.exr with MANY samples and two seeds, and prints "SECONDS few many": processor time of all threads.
"""

import pathlib
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).parent))

import blender_scenes
import bpy


def load(glb, size, materials):
    blender_scenes.start_empty()
    bpy.ops.import_scene.gltf(filepath=glb)
    scene = bpy.context.scene
    scene.camera = next(thing for thing in bpy.data.objects if thing.type == "CAMERA")
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    if materials == "diffuse":
        for made in bpy.data.materials:
            made["cycles"] = blender_scenes.AS_DIFFUSE
            blender_scenes.replace_for_cycles(made)


def seconds_of_render(path, samples, seed):
    scene = bpy.context.scene
    scene.cycles.samples = samples
    scene.cycles.seed = seed
    scene.render.filepath = str(path)
    start = time.process_time()
    bpy.ops.render.render(write_still=True)
    return time.process_time() - start


def main(glb, out, materials, few, many, size):
    load(glb, tuple(map(int, size.split("x"))), materials)
    blender_scenes.set_up_cycles(int(few))
    seconds_of_render(f"{out}-few.exr", int(few), 1)  # the first render also loads what all of them need
    short = seconds_of_render(f"{out}-few.exr", int(few), 1)
    long = min(seconds_of_render(f"{out}-{seed}.exr", int(many), seed) for seed in (1, 2))
    print("SECONDS", short, long)


if __name__ == "__main__":
    main(*sys.argv[sys.argv.index("--") + 1 :])
