"""Renders a world into a latitude-longitude picture; a script for a Blender of its own.

    blender -b --factory-startup --python bake_world.py -- LIBRARY WORLD OUT.exr WIDTH FRAME
"""

import math
import pathlib
import sys

import bpy

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import versions

SAMPLES = 16  # per pixel: a texture may have detail within one


def bake(library, name, path, width, frame):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(library) as (_, to):
        to.worlds = [name]
    scene = bpy.context.scene
    scene.world = to.worlds[0]
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.pixel_filter_type = "BOX"
    scene.cycles.sample_clamp_direct = 0
    data = bpy.data.cameras.new("camera")
    data.type = "PANO"
    versions.panorama_settings(data).panorama_type = "EQUIRECTANGULAR"
    camera = bpy.data.objects.new("camera", data)
    camera.rotation_euler = (math.pi / 2, 0, -math.pi / 2)  # towards +X, which is the centre of the picture
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.frame_set(frame)
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, width // 2, 100
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGB"
    render.image_settings.color_depth = "32"
    render.image_settings.exr_codec = "ZIP"
    render.filepath = path
    render.use_file_extension = False
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    library, name, path, width, frame = sys.argv[sys.argv.index("--") + 1 :]
    bake(library, name, path, int(width), int(frame))
