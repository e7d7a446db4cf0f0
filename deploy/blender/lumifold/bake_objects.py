"""Bakes inputs of materials of objects into pictures by their UV maps; a script for a Blender of its own.

    blender -b --factory-startup --python bake_objects.py -- LIBRARY WANTED.json RESOLUTION FRAME

WANTED.json is a list of [OBJECT, MATERIAL, NODE, SOCKET, KIND, OUT.exr]; the kind is COLOR or NORMAL.
"""

import json
import sys
import traceback

import bpy

SAMPLES = 4  # per pixel: a texture may have detail within one
MARGIN = 8  # pixels beyond each island of the UV map, for the texels beside it


def main(library, wanted, resolution, frame):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    names = sorted({one[0] for one in wanted})
    with bpy.data.libraries.load(library) as (_, to):
        to.objects = list(names)  # Blender replaces each name by the object
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.frame_set(frame)
    for thing in to.objects:
        scene.collection.objects.link(thing)
        thing.hide_render = thing.hide_viewport = False
        thing.hide_set(False)
    things = dict(zip(names, to.objects))
    for name, material, node, socket, kind, path in wanted:
        try:
            bake(things[name], material, node, socket, kind, path, resolution)
        except (RuntimeError, KeyError):
            traceback.print_exc()


def bake(thing, material_name, node_name, socket_name, kind, path, resolution):
    image = bpy.data.images.new("baked", resolution, resolution, float_buffer=True, is_data=True)
    unused = bpy.data.images.new("unused", 4, 4)
    undo = []
    for slot in thing.material_slots:
        if slot.material is None or not slot.material.node_tree:
            continue
        nodes = slot.material.node_tree.nodes
        target = nodes.new("ShaderNodeTexImage")
        target.image = image if slot.material.name == material_name else unused
        nodes.active = target
        undo.append((nodes, target))
        if slot.material.name == material_name:
            undo += show(slot.material.node_tree, nodes[node_name], socket_name, kind)
    for other in bpy.context.view_layer.objects:
        other.select_set(other == thing)
    bpy.context.view_layer.objects.active = thing
    thing.data.uv_layers.active = next(layer for layer in thing.data.uv_layers if layer.active_render)
    bpy.context.scene.cycles.samples = SAMPLES
    bpy.ops.object.bake(type="EMIT" if kind == "COLOR" else "NORMAL", margin=MARGIN, use_clear=True)
    image.file_format = "OPEN_EXR"
    image.filepath_raw = path
    image.save()
    for nodes, node in undo:
        nodes.remove(node)
    for one in (image, unused):
        bpy.data.images.remove(one)


def show(tree, node, socket_name, kind):
    """Makes the surface show what comes in at a socket; returns the nodes that are to be removed."""
    source = next(one for one in node.inputs if one.identifier == socket_name).links[0].from_socket
    made = tree.nodes.new("ShaderNodeEmission" if kind == "COLOR" else "ShaderNodeBsdfDiffuse")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(source, made.inputs["Color" if kind == "COLOR" else "Normal"])
    tree.links.new(made.outputs[0], output.inputs["Surface"])
    output.is_active_output = True
    return [(tree.nodes, made), (tree.nodes, output)]


if __name__ == "__main__":
    library, wanted, resolution, frame = sys.argv[sys.argv.index("--") + 1 :]
    with open(wanted, encoding="utf-8") as file:
        main(library, json.load(file), int(resolution), int(frame))
