"""Takes a matte out of a picture with Blender's Cryptomatte node; a script for Blender.

    blender -b --factory-startup --python compositor.py -- PICTURE.exr LAYER NAME WIDTH HEIGHT MATTE.exr
"""

import sys

import bpy

picture, layer, name, width, height, matte = sys.argv[sys.argv.index("--") + 1:]
scene = bpy.context.scene
if hasattr(scene, "compositing_node_group"):  # since Blender 5.0
    tree = scene.compositing_node_group = bpy.data.node_groups.new("matte", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    output = tree.nodes.new("NodeGroupOutput")
else:
    scene.use_nodes = True
    tree = scene.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("CompositorNodeComposite")
node = tree.nodes.new("CompositorNodeCryptomatteV2")
node.source = "IMAGE"
node.image = bpy.data.images.load(picture)
node.layer_name = layer
node.matte_id = name
tree.links.new(node.outputs["Matte"], output.inputs["Image"])
bpy.ops.object.camera_add()
scene.camera = bpy.context.object
scene.view_settings.view_transform = "Raw"
render = scene.render
render.resolution_x, render.resolution_y, render.resolution_percentage = int(width), int(height), 100
render.image_settings.file_format, render.image_settings.exr_codec = "OPEN_EXR", "ZIP"
render.image_settings.color_depth = "32"
render.filepath = matte
bpy.ops.render.render(write_still=True)
