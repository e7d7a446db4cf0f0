"""Scenes for the test of the add-on, built in Blender. Each is lit and seen so that Cycles and Lumifold can
be compared pixel by pixel."""

import math

import bpy
import numpy
from lumifold import versions
from mathutils import Vector


def start():
    """An empty file with a black world. Reading factory settings instead would switch the add-on off, since
    Blender 4."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("world")
    color_world(0, 0, 0)
    return scene


def color_world(*rgb):
    world = bpy.context.scene.world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*rgb, 1)


def input_of(node, what):
    """An input by what it is: a key of versions.PRINCIPLED, or an identifier in lower case with
    underscores."""
    name = what.replace("_", " ")
    name = name if name in versions.at(versions.PRINCIPLED) else name.title().replace("Ior", "IOR")
    return versions.principled_input(node, name)


def shader(name, kind, **inputs):
    """A material of one shader node."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    node, output = tree.nodes.new(kind), tree.nodes.new("ShaderNodeOutputMaterial")
    for key, value in inputs.items():
        input_of(node, key).default_value = value
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return made


def matt(name, *rgb):
    return shader(name, "ShaderNodeBsdfDiffuse", color=(*rgb, 1))


def add(shape, material, smooth=False, **where):
    getattr(bpy.ops.mesh, f"primitive_{shape}_add")(**where)
    thing = bpy.context.object
    thing.data.materials.append(material)
    if smooth:
        bpy.ops.object.shade_smooth()
    return thing


def box(material, low, high):
    thing = add("cube", material, size=1, location=[(a + b) / 2 for a, b in zip(low, high)])
    thing.scale = [b - a for a, b in zip(low, high)]
    return thing


def aim(thing, place, target):
    thing.location = place
    thing.rotation_euler = (Vector(target) - Vector(place)).to_track_quat("-Z", "Y").to_euler()
    bpy.context.collection.objects.link(thing)
    return thing


def camera(place, target, degrees=45):
    data = bpy.data.cameras.new("camera")
    data.angle = math.radians(degrees)
    bpy.context.scene.camera = aim(bpy.data.objects.new("camera", data), place, target)
    return data


def light(kind, energy, place, target=(0, 0, 0), color=(1, 1, 1), **values):
    data = bpy.data.lights.new(kind.lower(), kind)
    data.energy, data.color = energy, color
    for key, value in values.items():
        setattr(data, key, value)
    return aim(bpy.data.objects.new(kind.lower(), data), place, target)


def room():
    """Much light by many bounces, from a rectangle above the camera's view."""
    white = matt("white", 0.8, 0.8, 0.8)
    box(white, (-2, -2, -0.1), (2, 2, 0))
    box(white, (-2, -2, 3), (2, 2, 3.1))
    box(white, (-2.1, 2, -0.1), (2.1, 2.1, 3.1))
    box(matt("red", 0.7, 0.1, 0.1), (-2.1, -2, 0), (-2, 2, 3))
    box(matt("green", 0.1, 0.6, 0.1), (2, -2, 0), (2.1, 2, 3))
    box(matt("block", 0.7, 0.7, 0.75), (-1.2, 0.2, 0), (-0.3, 1.1, 1.2)).rotation_euler = (0, 0, 0.3)
    light("AREA", 60, (0, -0.5, 2.95), (0, -0.5, 0), (1, 0.9, 0.8), shape="RECTANGLE", size=1.6, size_y=0.8)
    camera((0, -5.2, 1.1), (0, 0, 0.9), 38)


def floor(**values):
    """A white floor under one light, seen from the side."""
    add("plane", matt("floor", 0.5, 0.5, 0.5), size=6)
    box(matt("block", 0.3, 0.4, 0.7), (0.6, -0.4, 0), (1.2, 0.2, 0.7))
    light(**{"place": (0, 0, 3), **values})
    camera((0, -4, 1.6), (0, 0, 0.2), 50)


def square_light():
    floor(kind="AREA", energy=100, shape="SQUARE", size=0.8)


def catcher():
    """The block's shadow on a floor that shows nothing else."""
    square_light()
    bpy.data.objects["Plane"].is_shadow_catcher = True


def ellipse_light():
    """Scaled and turned, as artists do: the power stays, the size does not."""
    floor(kind="AREA", energy=100, shape="ELLIPSE", size=1.2, size_y=0.6, place=(0.5, -0.5, 2.6))
    bpy.data.objects["area"].scale = (2, 1, 1)


def point_light():
    floor(kind="POINT", energy=200, shadow_soft_size=0.3, place=(-0.4, 0.3, 3.2))


def sun_light():
    floor(kind="SUN", energy=3, angle=0, place=(1, -1, 3))


def light_of_4_5():
    """What lights have since Blender 4.5: a temperature, an exposure, and a power for each square metre."""
    floor(kind="AREA",
          energy=60,
          shape="ELLIPSE",
          size=1.2,
          size_y=0.6,
          exposure=1,
          normalize=False,
          use_temperature=True,
          temperature=3000)
    bpy.data.objects["area"].scale = (2, 1, 1)
    light("POINT", 40, (-1.5, -0.5, 2), shadow_soft_size=0.3, normalize=False)


def world():
    """All light from a sky that differs in each direction, on a matt and on a mirror ball."""
    add("plane", matt("ground", 0.5, 0.4, 0.3), size=5)
    add("uv_sphere",
        matt("ball", 0.8, 0.8, 0.8),
        True,
        radius=0.6,
        location=(-0.8, 0, 0.6),
        segments=64,
        ring_count=32)
    mirror = shader("mirror", "ShaderNodeBsdfGlossy", color=(1, 1, 1, 1), roughness=0)
    add("uv_sphere", mirror, True, radius=0.6, location=(0.8, 0, 0.6), segments=96, ring_count=48)
    camera((0, -4.5, 1.4), (0, 0, 0.6), 40)
    tree = bpy.context.scene.world.node_tree
    coordinates, scale = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeVectorMath")
    scale.operation = "MULTIPLY_ADD"
    scale.inputs[1].default_value, scale.inputs[2].default_value = (0.4, 0.3, 0.5), (0.5, 0.4, 0.6)
    tree.links.new(coordinates.outputs["Generated"], scale.inputs[0])
    tree.links.new(scale.outputs[0], tree.nodes["Background"].inputs["Color"])


def textures():
    """A textured floor, rough metal, plastic; depth of field."""
    ground = matt("ground", 1, 1, 1)
    tree = ground.node_tree
    picture = tree.nodes.new("ShaderNodeTexImage")
    picture.image = checker()
    picture.interpolation = "Closest"
    tree.links.new(picture.outputs["Color"], tree.nodes["Diffuse BSDF"].inputs["Color"])
    add("plane", ground, size=6)
    gold = shader("gold",
                  "ShaderNodeBsdfPrincipled",
                  base_color=(0.9, 0.6, 0.2, 1),
                  metallic=1,
                  roughness=0.35)
    add("uv_sphere", gold, True, radius=0.6, location=(-0.9, 0, 0.6), segments=64, ring_count=32)
    plastic = shader("plastic", "ShaderNodeBsdfPrincipled", base_color=(0.1, 0.3, 0.6, 1), roughness=0.4)
    add("uv_sphere", plastic, True, radius=0.6, location=(0.9, 0.6, 0.6), segments=64, ring_count=32)
    light("AREA", 150, (0, -1, 4), shape="DISK", size=2)
    color_world(0.2, 0.25, 0.3)
    data = camera((0, -4, 1.8), (0, 0, 0.4), 45)
    data.dof.use_dof, data.dof.focus_distance, data.dof.aperture_fstop = True, 3.5, 0.4


def surfaces():
    """Principled as glass, under a coat, and glowing."""
    add("plane", matt("ground", 0.5, 0.5, 0.5), size=6)
    kinds = {
        "glass": {"base_color": (1, 1, 1, 1), "transmission": 1, "roughness": 0, "ior": 1.5},
        "coat": {"base_color": (0.6, 0.1, 0.1, 1), "roughness": 0.6, "coat": 1, "coat_roughness": 0.05},
        "glow": {"base_color": (0.2, 0.2, 0.2, 1), "emission": (1, 0.5, 0.2, 1), "emission_strength": 3},
    }
    for i, (name, values) in enumerate(kinds.items()):
        made = shader(name, "ShaderNodeBsdfPrincipled", **values)
        add("uv_sphere",
            made,
            True,
            radius=0.55,
            location=(1.25 * i - 1.25, 0, 0.56),
            segments=64,
            ring_count=32)
    light("AREA", 100, (0, -1, 4), shape="SQUARE", size=2)
    color_world(0.2, 0.25, 0.3)
    camera((0, -4, 1.8), (0, 0, 0.4), 45)


def mixture(name, kind, parts, share=None):
    """A material of two shaders, each (type, inputs), behind a 'Mix Shader' with a share or an 'Add
    Shader'."""
    made = shader(name, parts[0][0], **parts[0][1])
    tree = made.node_tree
    first, output = tree.nodes[0], next(one for one in tree.nodes if one.type == "OUTPUT_MATERIAL")
    second, both = tree.nodes.new(parts[1][0]), tree.nodes.new(kind)
    for key, value in parts[1][1].items():
        input_of(second, key).default_value = value
    if share is not None:
        both.inputs["Fac"].default_value = share
    for node, socket in zip((first, second), both.inputs[-2:]):
        tree.links.new(node.outputs[0], socket)
    tree.links.new(both.outputs[0], output.inputs["Surface"])
    return made


def mixtures():
    """Two shaders at once, and colours of vertices."""
    matt_red = ("ShaderNodeBsdfDiffuse", {"color": (0.7, 0.2, 0.1, 1)})
    matt_blue = ("ShaderNodeBsdfDiffuse", {"color": (0.1, 0.3, 0.7, 1)})
    glow = ("ShaderNodeEmission", {"color": (1, 0.6, 0.2, 1), "strength": 1.0})
    kinds = (mixture("two colours", "ShaderNodeMixShader", (matt_red, matt_blue), 0.25),
             mixture("half glow", "ShaderNodeMixShader", (matt_blue, glow), 0.4),
             mixture("glow on top", "ShaderNodeAddShader", (matt_red, glow)))
    for i, made in enumerate(kinds):
        add("uv_sphere", made, True, radius=0.5, location=(1.2 * i - 1.2, 0, 0.5), segments=64, ring_count=32)
    ground = add("plane", shader("ground", "ShaderNodeBsdfDiffuse"), size=6)
    colors = ground.data.color_attributes.new("paint", "FLOAT_COLOR", "POINT")
    for i, color in enumerate(((0.8, 0.2, 0.2, 1), (0.2, 0.8, 0.2, 1), (0.2, 0.2, 0.8, 1), (0.7, 0.7, 0.7, 1))):
        colors.data[i].color = color
    tree = ground.data.materials[0].node_tree
    paint = tree.nodes.new("ShaderNodeVertexColor")
    paint.layer_name = "paint"
    tree.links.new(paint.outputs["Color"], tree.nodes[0].inputs["Color"])
    light("AREA", 150, (0, -2, 4), shape="SQUARE", size=1.5)
    color_world(0.2, 0.2, 0.2)
    camera((0, -5, 2), (0, 0, 0.4), 42)


def procedural():
    """Textures that Cycles computes, as colours and as bumps."""
    ground, ball = (shader(name, "ShaderNodeBsdfDiffuse") for name in ("ground", "ball"))
    tree = ground.node_tree
    checks = tree.nodes.new("ShaderNodeTexChecker")
    checks.inputs["Scale"].default_value = 6
    tree.links.new(checks.outputs["Color"], tree.nodes[0].inputs["Color"])
    add("plane", ground, size=6)
    tree = ball.node_tree
    noise, bump, waves = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexNoise", "Bump", "TexWave"))
    noise.inputs["Scale"].default_value = waves.inputs["Scale"].default_value = 2
    bump.inputs["Strength"].default_value, bump.inputs["Distance"].default_value = 1, 0.1
    tree.links.new(noise.outputs["Color"], tree.nodes[0].inputs["Color"])
    tree.links.new(waves.outputs["Fac"], bump.inputs["Height"])
    tree.links.new(bump.outputs[0], tree.nodes[0].inputs["Normal"])
    for x in (-0.8, 0.8):
        add("uv_sphere", ball, True, radius=0.7, location=(x, 0, 0.7), segments=64, ring_count=32)
    light("AREA", 150, (0, -2, 4), shape="SQUARE", size=1.5)
    color_world(0.2, 0.2, 0.2)
    camera((0, -5, 2), (0, 0, 0.4), 42)


def brushed():
    """Brushed metal: highlights that are wider around the axis of the UV map."""
    add("plane", matt("ground", 0.5, 0.5, 0.5), size=6)
    for i, anisotropic in enumerate((0.0, 0.6, 0.9)):
        made = shader(f"brushed {i}", "ShaderNodeBsdfPrincipled", base_color=(0.8, 0.7, 0.5, 1), metallic=1,
                      roughness=0.35, anisotropic=anisotropic)
        made.node_tree.nodes["Principled BSDF"].distribution = "MULTI_GGX"
        add("uv_sphere", made, True, radius=0.5, location=(1.2 * i - 1.2, 0, 0.5), segments=96, ring_count=48)
    light("AREA", 150, (0, -2, 4), shape="SQUARE", size=1.5)
    color_world(0.2, 0.2, 0.2)
    camera((0, -5, 2), (0, 0, 0.4), 42)


def pictures():
    """Each input that may be a picture, on panels before a grey wall."""
    add("plane", matt("wall", 0.5, 0.5, 0.5), size=8, location=(0, 1, 0)).rotation_euler = (math.pi / 2, 0, 0)
    for i, what in enumerate(("base_color", "roughness", "alpha", "emission")):
        made = shader(f"panel {what}",
                      "ShaderNodeBsdfPrincipled",
                      base_color=(0.7, 0.5, 0.3, 1),
                      metallic=float(what == "roughness"),
                      roughness=0.6,
                      emission=(0, 0, 0, 1),
                      emission_strength=1)
        tree = made.node_tree
        tree.nodes["Principled BSDF"].distribution = "MULTI_GGX"
        picture = tree.nodes.new("ShaderNodeTexImage")
        is_data = what in ("roughness", "alpha")
        picture.image, picture.interpolation = checker("Non-Color" if is_data else "sRGB"), "Closest"
        if is_data:
            split = tree.nodes.new("ShaderNodeSeparateColor")
            tree.links.new(picture.outputs["Color"], split.inputs[0])
            source = split.outputs["Red"]
        else:
            source = picture.outputs["Color"]
        tree.links.new(source, input_of(tree.nodes["Principled BSDF"], what))
        add("plane", made, size=1, location=(1.2 * i - 1.8, 0, 0)).rotation_euler = (math.pi / 2, 0, 0)
    light("AREA", 150, (0, -4, 3), shape="SQUARE", size=2)
    camera((0, -6, 0), (0, 0, 0), 45)


def checker(space="sRGB", size=1024, squares=8):
    image = bpy.data.images.new("checker", size, size)
    image.colorspace_settings.name = space  # a change drops the pixels
    row, column = numpy.indices((size, size)) * squares // size
    odd = ((row + column) % 2)[..., None]
    image.pixels = numpy.where(odd, (0.8, 0.7, 0.2, 1.0), (0.1, 0.2, 0.5, 1.0)).astype(numpy.float32).ravel()
    return image


def animation():
    """Frame 10 of a ball that moves; modifiers at render settings, an array, instances of a collection;
    something hidden."""
    scene = bpy.context.scene
    add("plane", matt("ground", 0.5, 0.5, 0.5), size=8)
    ball = add("cube", matt("ball", 0.7, 0.4, 0.3), True, size=1, location=(0, 0, 0.7))
    rounding = ball.modifiers.new("rounding", "SUBSURF")
    rounding.levels, rounding.render_levels = 0, 3
    for frame, x in ((1, -2.5), (20, 2)):
        ball.location.x = x
        ball.keyframe_insert("location", frame=frame)
    posts = box(matt("post", 0.3, 0.4, 0.7), (-2, 1, 0), (-1.7, 1.3, 1.2))
    posts.modifiers.new("array", "ARRAY").count = 4
    posts.modifiers["array"].relative_offset_displace = (3, 0, 0)
    group = bpy.data.collections.new("group")
    cone = add("cone", matt("cone", 0.3, 0.6, 0.3), radius1=0.25, depth=0.6, location=(0, 0, 0.3))
    scene.collection.objects.unlink(cone)
    group.objects.link(cone)
    for x in (-1, 1.2):
        instance = bpy.data.objects.new(f"instance {x}", None)
        instance.instance_type, instance.instance_collection = "COLLECTION", group
        instance.location = (x, -0.9, 0)
        scene.collection.objects.link(instance)
    add("cube", matt("hidden", 1, 0, 0), size=1, location=(1, 0, 1)).hide_render = True
    light("AREA", 200, (-1, -1, 4), shape="SQUARE", size=1.5)
    color_world(0.3, 0.3, 0.35)
    camera((0, -6, 2.4), (0, 0, 0.6), 42)
    scene.frame_set(10)


SCENES = {
    made.__name__: made for made in (room, square_light, catcher, ellipse_light, point_light, sun_light,
                                     light_of_4_5, world, textures, surfaces, mixtures, procedural, brushed,
                                     animation, pictures)
}
