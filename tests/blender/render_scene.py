"""Builds scenes in Blender and renders each with the add-on, and with Cycles if asked for; a script for
Blender.

    blender -b --factory-startup --addons lumifold --python render_scene.py -- JSON

JSON is a list of [SCENE, FOLDER, WANTED]. WANTED has settings of scene.lumifold, and of `render`: see `main`.
Writes FOLDER/lumifold.exr with all passes, FOLDER/cycles.exr, and FOLDER/report.json.
"""

import json
import pathlib
import sys

import bpy

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import scenes

PASSES = ("z", "normal", "diffuse_direct", "diffuse_indirect", "diffuse_color", "emit", "environment")


def data_blocks():
    """Names of all data, and what of the objects could have been moved or left behind."""
    names = {name: sorted(one.name for one in getattr(bpy.data, name))
             for name, kind in bpy.data.bl_rna.properties.items() if kind.type == "COLLECTION"}
    for name in ("images",
                 "all_ids"):  # Blender's own 'Render Result' comes with any render; the second is since 5.0
        names.pop(name, None)
    names["selected"] = sorted(one.name for one in bpy.context.selected_objects)
    names["matrices"] = [[round(x, 6) for row in one.matrix_world for x in row] for one in bpy.data.objects]
    names["frame"] = bpy.context.scene.frame_current
    return names


def set_up(scene, folder, wanted):
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = 256, 192, 50
    if hasattr(render.image_settings,
               "media_type"):  # since Blender 5.0, which also writes each pass as a part by default
        render.image_settings.media_type = "MULTI_LAYER_IMAGE"
        render.image_settings.use_exr_interleave = True
    render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
    render.image_settings.exr_codec = "ZIP"
    render.image_settings.color_depth = "32"
    for name in PASSES:
        setattr(scene.view_layers[0], f"use_pass_{name}", True)
    for name, value in wanted.get("render", {}).items():
        setattr(render, name, value)
    for name, value in wanted.get("settings", {}).items():
        setattr(scene.lumifold, name, value)


def render_cycles(scene, path, samples):
    cycles = scene.cycles
    scene.render.engine = "CYCLES"
    cycles.device, cycles.samples = "CPU", samples
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = 8
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = cycles.blur_glossy = 0
    cycles.pixel_filter_type = "BOX"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def main(name, folder, wanted):
    folder = pathlib.Path(folder)
    scene = scenes.start()
    scenes.SCENES[name]()
    set_up(scene, folder, wanted)
    from lumifold import unsupported

    report = {"losses": unsupported.losses_of(scene)}
    scene.render.engine = "LUMIFOLD"
    scene.render.filepath = str(folder / "lumifold.exr")
    bpy.context.view_layer.update()
    before = data_blocks()
    try:
        bpy.ops.render.render(write_still=True)
    except RuntimeError as error:
        report["error"] = str(error)
    report["changes"] = [kind for kind, names in data_blocks().items() if names != before[kind]]
    if "cycles" in wanted:
        render_cycles(scene, folder / "cycles.exr", wanted["cycles"])
    (folder / "report.json").write_text(json.dumps(report))


if __name__ == "__main__":
    for name, folder, wanted in json.loads(sys.argv[-1]):
        main(name, folder, wanted)
