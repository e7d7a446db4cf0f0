"""What differs between the versions of Blender, 3.4 and later. No other module asks for the version. Needs no
Blender.

Tables have an entry for each version that changed something; it holds until the next one.
"""

import math

PRINCIPLED = {  # identifiers of Principled's inputs, by what they are
    (3, 4): {
        "coat": "Clearcoat",
        "coat roughness": "Clearcoat Roughness",
        "emission": "Emission",
        "specular": "Specular",
        "transmission": "Transmission",
    },
    (4, 0): {
        "coat": "Coat Weight",
        "coat roughness": "Coat Roughness",
        "emission": "Emission Color",
        "sheen": "Sheen Weight",  # before, a model that glTF does not have
        "specular": "Specular IOR Level",
        "transmission": "Transmission Weight",
    },
}
WHITE = (1.0, 1.0, 1.0)
# Inputs by type of node that glTF or the renderer does not have, and the value that has no effect; None: only
# a link has one. Those of a later version within an entry are not there before.
LOST_INPUTS = {
    (3, 4): {
        "BSDF_PRINCIPLED": {
            "Subsurface": 0, "Sheen": 0, "Specular Tint": 0, "Transmission Roughness": 0,
            "Clearcoat Normal": None, "Tangent": None
        },
        "BSDF_DIFFUSE": {"Roughness": 0},
    },
    (4, 0): {
        "BSDF_PRINCIPLED": {
            "Subsurface Weight": 0, "Specular Tint": WHITE, "Coat IOR": 1.5,
            "Coat Tint": WHITE, "Coat Normal": None, "Tangent": None, "Thin Film Thickness": 0,
            "Diffuse Roughness": 0, "Thin Wall": None
        },
        "BSDF_DIFFUSE": {"Roughness": 0},
        "BSDF_GLOSSY": {"Anisotropy": 0},
        "BSDF_GLASS": {"Thin Film Thickness": 0},
    },
}
LAMBERT = (
    4, 0
# Principled's diffuse lobe is Lambert's from here on, takes light from below its highlight, and its coat has
# its whole weight
)
DISNEY_COAT = 0.25  # the share of the coat's weight before
PASSES = {  # names of passes that are not the same in all versions
    (3, 4): {"Diffuse Direct": "DiffDir", "Diffuse Indirect": "DiffInd", "Diffuse Color": "DiffCol", "Emission": "Emit", "Environment": "Env"},
    (5, 0): {},
}
# Radiance of an area light of power P and area A is P / (f A). A Lambertian emitter of power P has f = pi.
AREA_LIGHT = {(3, 4): 4, (4, 0): math.pi}
GREASE_PENCIL = ("GPENCIL", "GREASEPENCIL")  # types of object: until 4.2, since 4.3
# Panels of Blender that show what the engine reads; its own say which engines they are for.
COMMON_PANELS = {
    "DATA_PT_light",
    "DATA_PT_EEVEE_light",
    "DATA_PT_camera_dof",
    "DATA_PT_camera_dof_aperture",
    "EEVEE_MATERIAL_PT_context_material",
    "EEVEE_MATERIAL_PT_surface",
    "EEVEE_WORLD_PT_surface",
    "WORLD_PT_context_world",
    "RENDER_PT_color_management",
    "RENDER_PT_color_management_curves",
    "MATERIAL_PT_preview",
}


MULTIPLIED = {  # nodes that multiply two colours: the share of the product and both; by type, both since 3.4
    "MIX": ("Factor_Float", "A_Color", "B_Color"),
    "MIX_RGB": ("Fac", "Color1", "Color2"),
}


def is_number(value):
    return isinstance(value, (int, float))


def luminance(color):
    return 0.2126 * color[0] + 0.7152 * color[1] + 0.0722 * color[2]


def running():
    """Major and minor number of this Blender."""
    import bpy

    return tuple(bpy.app.version[:2])


def at(table):
    """The entry of a table for this Blender."""
    return table[max(version for version in table if version <= running())]


def find_input(node, identifier):
    """The input of a node; None if this version has no such input. Names change with the interface,
    identifiers with files."""
    return next((socket for socket in node.inputs if socket.identifier == identifier), None)


def principled_input(node, what):
    """An input of Principled by a key of PRINCIPLED, or by its identifier where that is the same in all
    versions."""
    return find_input(node, at(PRINCIPLED).get(what, what))


def is_disney():
    """Whether Principled is Disney's model of 2012, as until Blender 3.6."""
    return running() < LAMBERT


def reflectance(specular, ior):
    """Reflectance of Principled at normal incidence. Until 3.6 its IOR is that of transmission alone."""
    return 0.08 * specular if is_disney() else 2 * specular * ((ior - 1) / (ior + 1)) ** 2


def pass_name(name):
    return at(PASSES).get(name, name)


def node_tree(owner):
    """The nodes of a material, world or light that count, or None. Blender 5 has no switch any more, and
    drops its name in 6."""
    return owner.node_tree if getattr(owner, "use_nodes", True) else None


def corner_normals(mesh):
    """A collection with a normal for each corner of a face, and the property that holds it."""
    if running() >= (4, 1):
        return mesh.corner_normals, "vector"
    mesh.calc_normals_split()
    return mesh.loops, "normal"


def corner_uvs(layer):
    """A collection with the UV of each corner of a face, and the property that holds it."""
    return (layer.uv, "vector") if running() >= (3, 5) else (layer.data, "uv")


def light_color(light):
    """The colour of a light, with its temperature since 4.5."""
    warmth = light.temperature_color if getattr(light, "use_temperature", False) else WHITE
    return [channel * tint for channel, tint in zip(light.color, warmth)]


def light_power(light, matrix):
    """Watts of a light, with its exposure since 4.5, where the power may also be one for each square
    metre."""
    area = 1 if getattr(light, "normalize", True) else light.area(matrix_world=matrix)
    return light.energy * area * 2 ** getattr(light, "exposure", 0)


def has_light_linking(thing):
    """Whether a light reaches some objects only, which is so since 4.0."""
    linking = getattr(thing, "light_linking", None)
    return linking is not None and bool(linking.receiver_collection or linking.blocker_collection)


def panorama_settings(camera):
    """What holds the kind of a panoramic camera: Cycles' settings, since 4.5 the camera."""
    return camera if "panorama_type" in camera.bl_rna.properties else camera.cycles
