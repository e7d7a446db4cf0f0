"""Builds a scene in Blender, exports it as an artist would, and renders it with Cycles.

    blender -b --factory-startup --python-exit-code 1 --python blender_scenes.py -- SCENE FOLDER SAMPLES WxH
    BOUNCES

writes FOLDER/SCENE.glb by Blender's own exporter, and for each camera and two seeds
FOLDER/SCENE.CAMERA.cycles-SEED.exr.
"""

import math
import pathlib
import random
import sys

import numpy

if not hasattr(numpy, "bool"):
    # Blender 3.4's glTF add-on uses the name that numpy dropped in 1.24; numpy 2 has it again, for its own
    # type
    numpy.bool = bool

import bpy

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "deploy/blender"))

from lumifold import versions

# Materials that Cycles and glTF model differently are replaced between export and render: Principled's
# diffuse lobe is Disney's and glTF's Lambert's; Principled adds a Fresnel term of its own to metals.
AS_DIFFUSE, AS_GLOSSY, AS_EXPORTED = "diffuse", "glossy", "as exported"


FRAME = 10
F_STOP, FOCUS = 0.5, 5  # of the scene "lens": as cross_check.py asks Lumifold for


def material(name, color=(1, 1, 1), cycles=AS_EXPORTED, **inputs):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    for key, value in {"base_color": (*color, 1), **inputs}.items():
        principled_input(made, key).default_value = value
    made["cycles"] = cycles
    return made


def principled_input(made, what):
    """An input of a material's Principled: a key of versions.PRINCIPLED, or an identifier in lower case with
    underscores."""
    name = what if what in versions.at(versions.PRINCIPLED) else what.replace("_", " ").title().replace(
        "Ior", "IOR")
    return versions.principled_input(made.node_tree.nodes["Principled BSDF"], name)


def matte(name, color):
    return material(name, color, AS_DIFFUSE, specular=0, roughness=1)


def glow(name, radiance, color=(0, 0, 0)):
    return material(name,
                    color,
                    AS_DIFFUSE,
                    specular=0,
                    roughness=1,
                    emission=(*radiance, 1),
                    emission_strength=1)


def strong_glow(name, color, strength):
    return material(
        name, (0, 0, 0), AS_DIFFUSE, specular=0, roughness=1, emission=(*color, 1), emission_strength=strength
    )


def white_metal(name, roughness):
    return material(name, (1, 1, 1), AS_GLOSSY, metallic=1, roughness=roughness)


def glass(name):
    """Solid: the exporter writes KHR_materials_volume where its own output group has a thickness."""
    made = material(name, (1, 1, 1), transmission=1, roughness=0, ior=1.5, specular=0.5)
    group = bpy.data.node_groups.get("glTF Material Output")
    if group is None:
        group = bpy.data.node_groups.new("glTF Material Output", "ShaderNodeTree")
        if versions.running() < (4, 0):
            group.inputs.new("NodeSocketFloat", "Thickness")
        else:
            group.interface.new_socket("Thickness", in_out="INPUT", socket_type="NodeSocketFloat")
    node = made.node_tree.nodes.new("ShaderNodeGroup")
    node.node_tree = group
    node.inputs["Thickness"].default_value = 1
    return made


def add(shape, made, name=None, smooth=False, **where):
    """Adds a primitive of bpy.ops.mesh with a material."""
    getattr(bpy.ops.mesh, f"primitive_{shape}_add")(**where)
    thing = bpy.context.object
    thing.data.materials.append(made)
    thing.name = name or made.name
    if smooth:
        bpy.ops.object.shade_smooth()
    return thing


def box(made, low, high, name=None):
    middle = [(a + b) / 2 for a, b in zip(low, high)]
    thing = add("cube", made, name, size=1, location=middle)
    thing.scale = [b - a for a, b in zip(low, high)]
    return thing


def camera(name, place, target, degrees):
    data = bpy.data.cameras.new(name)
    data.angle = math.radians(degrees)
    thing = bpy.data.objects.new(name, data)
    bpy.context.collection.objects.link(thing)
    thing.location = place
    forward = [b - a for a, b in zip(place, target)]
    thing.rotation_euler = numpy_to_euler(forward)
    return thing


def numpy_to_euler(forward):
    from mathutils import Vector

    return Vector(forward).to_track_quat("-Z", "Y").to_euler()


def light(kind, name, place, energy, direction=(0, 0, -1), color=(1, 1, 1)):
    data = bpy.data.lights.new(name, kind)
    data.energy = energy
    data.color = color
    if kind == "SUN":
        data.angle = 0
    else:
        data.shadow_soft_size = 0
    thing = bpy.data.objects.new(name, data)
    bpy.context.collection.objects.link(thing)
    thing.location = place
    thing.rotation_euler = numpy_to_euler(direction)


def room(white, left, right):
    """Five walls, 4 m wide and deep and 3 m high, open towards -Y."""
    box(white, (-2, -2, -0.1), (2, 2, 0), "floor")
    box(white, (-2, -2, 3), (2, 2, 3.1), "ceiling")
    box(white, (-2.1, 2, -0.1), (2.1, 2.1, 3.1), "back wall")
    box(left, (-2.1, -2, 0), (-2, 2, 3), "left wall")
    box(right, (2, -2, 0), (2.1, 2, 3), "right wall")
    camera("camera", (0, -5.6, 1.5), (0, 0, 1.5), 48)


def downward_lamp(radiance, half=0.6, height=2.98):
    lamp = add("plane", glow("lamp", radiance), size=2 * half, location=(0, 0, height))
    lamp.rotation_euler = (math.pi, 0, 0)


def diffuse_room():
    """Much light by many bounces: a bright room with a lamp and two blocks."""
    room(matte("white", (0.8, 0.8, 0.8)), matte("red", (0.7, 0.1, 0.1)), matte("green", (0.1, 0.6, 0.1)))
    downward_lamp((1.0, 0.9, 0.8))
    block = matte("block", (0.7, 0.7, 0.75))
    box(block, (-1.2, 0.2, 0), (-0.3, 1.1, 1.6), "tall block").rotation_euler = (0, 0, 0.3)
    box(block, (0.4, -0.9, 0), (1.2, -0.1, 0.7), "short block").rotation_euler = (0, 0, -0.4)


def sun_and_points():
    """Lights without size on a floor with a picture."""
    floor = matte("floor", (1, 1, 1))
    nodes = floor.node_tree.nodes
    picture = nodes.new("ShaderNodeTexImage")
    picture.image = checker_picture()
    picture.interpolation = "Closest"  # Cycles interpolates coded sRGB values, glTF asks for light
    # repeated, a pixel's footprint at the floor's border would hold texels of the other side
    picture.extension = "EXTEND"
    floor.node_tree.links.new(picture.outputs["Color"], principled_input(floor, "base_color"))
    add("plane", floor, size=8)
    add("uv_sphere",
        matte("ball", (0.6, 0.5, 0.4)),
        radius=0.7,
        location=(-0.8, 0, 0.7),
        segments=48,
        ring_count=24)
    box(matte("block", (0.3, 0.4, 0.7)), (0.5, -0.4, 0), (1.3, 0.4, 1.2))
    light("SUN", "sun", (0, 0, 5), 2, (0.5, 0.4, -1), (1, 0.95, 0.8))
    light("POINT", "blue point", (1.8, -1.5, 1.6), 60, color=(0.4, 0.6, 1))
    light("POINT", "red point", (-2.2, 1.2, 1.2), 40, color=(1, 0.4, 0.3))
    camera("camera", (0.5, -5, 2.6), (0, 0, 0.5), 44)


def checker_picture(size=64, squares=8):
    image = bpy.data.images.new("checker", size, size)
    row, column = numpy.indices((size, size)) * squares // size
    odd = ((row + column) % 2)[..., None]
    pixels = numpy.where(odd, (0.8, 0.7, 0.2, 1.0), (0.1, 0.2, 0.5, 1.0))
    image.pixels = pixels.astype(numpy.float32).ravel()
    image.pack()
    return image


def metal_balls():
    """Metals that reflect everything, from polished to matt, in a room."""
    room(matte("white", (0.6, 0.6, 0.6)), matte("blue", (0.2, 0.3, 0.7)), matte("yellow", (0.7, 0.6, 0.2)))
    downward_lamp((2, 2, 2))
    for i, roughness in enumerate((0.0, 0.2, 0.4, 0.7, 1.0)):
        metal = white_metal(f"roughness {roughness}", roughness)
        add("uv_sphere",
            metal,
            smooth=True,
            radius=0.36,
            location=(-1.5 + 0.75 * i, -0.6, 0.36),
            segments=64,
            ring_count=32)


def glass_things():
    """Solid glass, a ball and a pane: reflection, refraction, and light that comes only through them."""
    room(matte("white", (0.6, 0.6, 0.6)), matte("blue", (0.2, 0.3, 0.7)), matte("yellow", (0.7, 0.6, 0.2)))
    downward_lamp((2, 2, 2), half=1.2)
    clear = glass("glass")
    add("uv_sphere", clear, "ball", True, radius=0.6, location=(-0.7, -0.3, 0.7), segments=96, ring_count=48)
    box(clear, (0.3, -0.6, 0.05), (1.6, -0.5, 1.6), "pane").rotation_euler = (0, 0, 0.4)
    box(matte("block", (0.7, 0.3, 0.2)), (0.6, 0.6, 0), (1.3, 1.3, 0.9), "block")


def instances():
    """A glowing mesh, one mesh placed many times, modifiers, smooth shading, two cameras."""
    add("plane", matte("ground", (0.5, 0.5, 0.5)), size=12)
    add("torus",
        strong_glow("ring", (1, 0.7, 0.4), 6),
        location=(0, 0, 2.2),
        major_radius=0.7,
        minor_radius=0.12)
    head = add("monkey", matte("head", (0.7, 0.5, 0.4)), smooth=True, size=1.2, location=(0, 0, 0.8))
    head.modifiers.new("subdivision", "SUBSURF").render_levels = 2
    head.modifiers["subdivision"].levels = 2
    stone = add("ico_sphere",
                matte("stone", (0.3, 0.5, 0.3)),
                radius=0.25,
                location=(-2, -1.5, 0.2),
                subdivisions=2)
    choose = random.Random(1)
    for i in range(24):
        copy = bpy.data.objects.new(f"stone {i}", stone.data)
        bpy.context.collection.objects.link(copy)
        angle = 2 * math.pi * i / 24
        copy.location = (2.2 * math.cos(angle), 2.2 * math.sin(angle), 0.2)
        copy.rotation_euler = [choose.uniform(0, 6) for _ in range(3)]
        copy.scale = [choose.uniform(0.6, 1.3) for _ in range(3)]
    camera("front", (0, -6, 2.5), (0, 0, 0.8), 40)
    camera("above", (2.5, 2.5, 6), (0, 0, 0.3), 45)


def environment():
    """A picture of the sky is all the light there is."""
    add("plane", matte("ground", (0.5, 0.5, 0.5)), size=6)
    add("uv_sphere",
        matte("ball", (0.8, 0.8, 0.8)),
        smooth=True,
        radius=0.6,
        location=(-0.7, 0, 0.6),
        segments=64,
        ring_count=32)
    box(matte("block", (0.6, 0.3, 0.3)), (0.3, -0.4, 0), (1.1, 0.4, 0.9))
    camera("camera", (0, -4.5, 1.8), (0, 0, 0.5), 45)
    world = bpy.context.scene.world
    nodes = world.node_tree.nodes
    sky = nodes.new("ShaderNodeTexEnvironment")
    sky.image = bpy.data.images.load(str(sky_picture()))
    world.node_tree.links.new(sky.outputs["Color"], nodes["Background"].inputs["Color"])


def animation():
    """A ball that moves, a block that turns, a cube that changes its shape, a bar that a bone breaks: frame
    10 of 20."""
    add("plane", matte("ground", (0.5, 0.5, 0.5)), size=8)
    downward_lamp((3, 3, 3), half=1.5, height=4)
    ball = add("uv_sphere",
               matte("ball", (0.7, 0.4, 0.3)),
               smooth=True,
               radius=0.5,
               segments=48,
               ring_count=24)
    key(ball, "location", {1: (-2.5, -1, 0.5), 20: (1.5, -1, 0.5)})
    block = box(matte("block", (0.3, 0.4, 0.7)), (-1.4, 0.4, 0), (-0.6, 1.2, 1))
    key(block, "rotation_euler", {1: (0, 0, 0), 20: (0, 0, 2)})
    cube = add("cube", matte("cube", (0.6, 0.6, 0.3)), size=0.7, location=(0.4, 0.8, 0.35))
    cube.shape_key_add(name="rest")
    tall = cube.shape_key_add(name="tall")
    for point in tall.data:
        point.co.z = 3 * point.co.z + 0.7
    key(tall, "value", {1: 0, 20: 1})
    bend(bar(matte("bar", (0.3, 0.6, 0.4)), (2, 0.5)))
    camera("camera", (0, -7, 2.8), (0, 0, 0.7), 42)


def lens():
    """A wide lens in focus at the ball: foliage before it, a floor of squares to the horizon, small lamps behind."""
    floor = matte("floor", (1, 1, 1))
    nodes = floor.node_tree.nodes
    picture = nodes.new("ShaderNodeTexImage")
    picture.image = checker_picture(squares=16)
    picture.interpolation = "Closest"
    picture.extension = "EXTEND"
    floor.node_tree.links.new(picture.outputs["Color"], principled_input(floor, "base_color"))
    add("plane", floor, size=12)
    add("uv_sphere", matte("ball", (0.7, 0.3, 0.2)), smooth=True, radius=0.6, location=(0, 0, 0.6), segments=64,
        ring_count=32)
    choose = random.Random(2)
    leaf = matte("leaf", (0.2, 0.5, 0.15))
    for i in range(40):
        place = (choose.uniform(-1.2, 1.2), choose.uniform(-3.4, -2.4), choose.uniform(0, 1))
        turn = [choose.uniform(0, 3) for _ in range(3)]
        add("plane", leaf, f"leaf {i}", size=0.12, location=place, rotation=turn)
    bulb = strong_glow("bulb", (1, 0.8, 0.5), 30)
    for i in range(6):
        add("ico_sphere", bulb, f"bulb {i}", radius=0.06, location=(i - 2.5, 4, 1 + 0.3 * (i % 3)), subdivisions=3)
    downward_lamp((4, 4, 4), half=1.5, height=5)
    view = camera("camera", (0, -5, 1.2), (0, 0, 0.6), 40)
    # Where Blender and Lumifold mean the same focal length: a sensor 24 mm high
    view.data.sensor_fit, view.data.sensor_height = "VERTICAL", 24
    view.data.angle_y = math.radians(32)
    view.data.dof.use_dof = True
    view.data.dof.aperture_fstop, view.data.dof.focus_distance = F_STOP, FOCUS


def key(thing, what, values):
    """Keyframes of a property, by frame."""
    for frame, value in values.items():
        setattr(thing, what, value)
        thing.keyframe_insert(what, frame=frame)


def bar(made, foot):
    """Two blocks, one above the other, as one mesh. They share no vertex: where a skin shears a face, Blender
    computes its a new normal and glTF rotates the old one."""
    upper = add("cube", made, size=1, location=(*foot, 1.5))
    lower = add("cube", made, size=1, location=(*foot, 0.5))
    for half in (upper, lower):
        half.scale = (0.3, 0.3, 0.98)
        half.select_set(True)
    bpy.ops.object.join()
    bpy.ops.object.transform_apply()
    return lower


def bend(bar):
    """Gives a bar a bone for each half; the upper one turns."""
    foot = bar.data.vertices[0].co
    bpy.ops.object.armature_add(location=(foot.x, foot.y, 0))
    rig = bpy.context.object
    bpy.ops.object.mode_set(mode="EDIT")
    lower = rig.data.edit_bones[0]
    lower.name = "lower"
    upper = rig.data.edit_bones.new("upper")
    upper.head, upper.tail, upper.parent = lower.tail, (0, 0, 2), lower
    bpy.ops.object.mode_set(mode="POSE")
    upper = rig.pose.bones["upper"]
    upper.rotation_mode = "XYZ"
    key(upper, "rotation_euler", {1: (0, 0, 0), 20: (0, 0, 1.2)})
    key(upper, "location", {1: (0, 0, 0), 20: (0.4, 0, 0)})
    bpy.ops.object.mode_set(mode="OBJECT")
    for name, below in (("lower", True), ("upper", False)):
        vertices = [vertex.index for vertex in bar.data.vertices if (vertex.co.z < 1) == below]
        bar.vertex_groups.new(name=name).add(vertices, 1, "REPLACE")
    bar.modifiers.new("armature", "ARMATURE").object = rig
    bar.parent = rig
    bpy.context.view_layer.update()
    bar.matrix_parent_inverse = rig.matrix_world.inverted()


def sky_picture(width=256, height=128):
    """Blue above, brown below, a warm patch like the sun's: FOLDER/sky.exr."""
    image = bpy.data.images.new("sky", width, height, float_buffer=True)
    v, u = (numpy.indices((height, width)) + 0.5) / numpy.array([[[height]], [[width]]])
    up = numpy.clip(2 * v - 1, 0, 1)[..., None]
    pixels = numpy.where(v[..., None] > 0.5, 0.3 + up * numpy.array([0.1, 0.3, 0.9]), [0.2, 0.15, 0.1])
    pixels[(abs(u - 0.3) < 0.03) & (abs(v - 0.75) < 0.04)] = (60, 50, 35)
    image.pixels = numpy.dstack([pixels, numpy.ones((height, width))]).astype(numpy.float32).ravel()
    image.filepath_raw = str(folder / "sky.exr")
    image.file_format = "OPEN_EXR"
    image.save()
    return folder / "sky.exr"


def export(path, moves):
    """Modifiers are applied where nothing moves: the exporter would leave out the shapes of what does."""
    options = {"export_apply": not moves, "export_cameras": True, "export_lights": True}
    bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLB", **options)


def replace_for_cycles(made):
    """Puts the model glTF means in place of Principled."""
    tree = made.node_tree
    output = next(node for node in tree.nodes if node.type == "OUTPUT_MATERIAL")
    if made["cycles"] == AS_GLOSSY:
        closure = tree.nodes.new("ShaderNodeBsdfGlossy")
        roughness = principled_input(made, "roughness").default_value
        # A mirror has a distribution of its own until 3.6.
        closure.distribution = "SHARP" if roughness == 0 and versions.running() < (4, 0) else "MULTI_GGX"
        closure.inputs["Roughness"].default_value = roughness
    else:
        closure = tree.nodes.new("ShaderNodeBsdfDiffuse")
    color = principled_input(made, "base_color")
    closure.inputs["Color"].default_value = color.default_value
    if color.is_linked:
        tree.links.new(color.links[0].from_socket, closure.inputs["Color"])
    surface = closure.outputs[0]
    glow, strength = (
        principled_input(made, what).default_value for what in ("emission", "emission_strength"))
    if strength * max(glow[:3]) > 0:
        emission = tree.nodes.new("ShaderNodeEmission")
        emission.inputs["Color"].default_value, emission.inputs["Strength"].default_value = glow, strength
        both = tree.nodes.new("ShaderNodeAddShader")
        tree.links.new(surface, both.inputs[0])
        tree.links.new(emission.outputs[0], both.inputs[1])
        surface = both.outputs[0]
    tree.links.new(surface, output.inputs["Surface"])


def set_up_cycles(samples, bounces=8):
    """Cycles without anything that trades truth for less noise, and with the renderer's own limits."""
    scene = bpy.context.scene
    cycles = scene.cycles
    scene.render.engine = "CYCLES"
    cycles.device = "CPU"
    cycles.samples = samples
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = bounces
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0
    cycles.blur_glossy = 0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    cycles.pixel_filter_type = "BOX"
    scene.render.threads_mode = "FIXED"
    scene.render.threads = 2
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.image_settings.exr_codec = "ZIP"


def start_empty():
    """Nothing at all, and black all round: a file without a world would get Cycles' grey one."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    bpy.context.scene.world = world


def main(name, samples, size, bounces):
    start_empty()
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.frame_start, scene.frame_end = 1, 20
    SCENES[name]()
    cameras = [thing for thing in bpy.data.objects if thing.type == "CAMERA"]
    scene.camera = cameras[0]
    export(folder / f"{name}.glb", moves=name == "animation")
    scene.frame_set(FRAME)
    for made in bpy.data.materials:
        if made.get("cycles", AS_EXPORTED) != AS_EXPORTED:
            replace_for_cycles(made)
    set_up_cycles(samples, bounces)
    for view in cameras:
        scene.camera = view
        for seed in (1, 2):
            scene.cycles.seed = seed
            scene.render.filepath = str(folder / f"{name}.{view.name}.cycles-{seed}.exr")
            bpy.ops.render.render(write_still=True)


SCENES = {
    scene.__name__.replace("_", "-"): scene
    for scene in (diffuse_room, sun_and_points, metal_balls, glass_things, instances, environment, animation, lens)
}

if __name__ == "__main__":
    name, folder, samples, size, bounces = sys.argv[sys.argv.index("--") + 1 :]
    folder = pathlib.Path(folder)
    main(name, int(samples), tuple(map(int, size.split("x"))), int(bounces))
