"""Lights of Blender in glTF: punctual ones, and meshes of the same power and size for those with an area."""

import math

import numpy

from . import versions
from .gltf import y_up

LUMENS_PER_WATT = 683  # of KHR_lights_punctual, as Blender's own exporter uses it
DISK_SIDES = 32


def add_light(builder, name, light, matrix, soft_points):
    """Adds one of Blender's lights at its world matrix."""
    color, strength = versions.light_color(light), versions.light_power(light, matrix)
    if light.type == "AREA":
        add_area(builder, name, light, matrix, color, strength)
    elif light.type == "POINT" and soft_points and light.shadow_soft_size > 0:
        positions, triangles = icosphere(light.shadow_soft_size)
        place = numpy.eye(4)
        place[:3, 3] = numpy.array(matrix, float)[:3, 3]
        add_emitter(builder, name, place, positions, triangles, color, strength / math.pi)
    elif light.type == "SUN":
        builder.light(name, rigid(matrix), punctual("directional", color, LUMENS_PER_WATT * strength))
    else:
        made = punctual("point", color, LUMENS_PER_WATT * strength / (4 * math.pi))
        if light.type == "SPOT":
            outer = min(light.spot_size / 2, math.pi / 2)
            made["type"] = "spot"
            made["spot"] = {
                "innerConeAngle": min(outer * (1 - light.spot_blend), outer - 1e-4), "outerConeAngle": outer
            }
        builder.light(name, rigid(matrix), made)


def punctual(kind, color, intensity):
    return {"type": kind, "color": color, "intensity": intensity}


def rigid(matrix):
    """The matrix without scale, which punctual lights do not have."""
    made = numpy.array(matrix, float)
    made[:3, :3] /= numpy.maximum(numpy.linalg.norm(made[:3, :3], axis=0), 1e-12)
    return made


def add_area(builder, name, light, matrix, color, strength):
    """A rectangle or ellipse that emits along -Z. The light's power does not change with the object's scale,
    its size does."""
    width = light.size
    height = light.size_y if light.shape in ("RECTANGLE", "ELLIPSE") else light.size
    if light.shape in ("DISK", "ELLIPSE"):
        angles = 2 * math.pi * numpy.arange(DISK_SIDES) / DISK_SIDES
        outline = numpy.column_stack([numpy.cos(angles), numpy.sin(angles)]) / 2
    else:
        outline = numpy.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    positions = numpy.column_stack([outline * (width, height), numpy.zeros(len(outline))])
    corners = numpy.arange(1, len(outline) - 1)
    triangles = numpy.column_stack([numpy.zeros_like(corners), corners + 1,
                                    corners])  # clockwise: the front is -Z
    add_emitter(builder, name, matrix, positions, triangles, color,
                strength / versions.at(versions.AREA_LIGHT))


def add_emitter(builder, name, matrix, positions, triangles, color, flux):
    """A black mesh whose radiance is `flux` over its area."""
    world = numpy.array(matrix, float)
    placed = positions @ world[:3, :3].T + world[:3, 3]
    if numpy.linalg.det(world[:3, :3]) < 0:
        triangles = triangles[:, ::-1]
    a, b, c = (placed[triangles[:, i]] for i in range(3))
    area = numpy.linalg.norm(numpy.cross(b - a, c - a), axis=1).sum() / 2
    strength = max(color) * flux
    if area <= 0 or strength <= 0:
        return
    material = builder.append("materials", emitter(name, color, strength / area))
    builder.use("KHR_materials_emissive_strength")
    mesh = builder.append(
        "meshes", {"name": name, "primitives": [builder.primitive(y_up(placed), triangles, material)]})
    builder.node(name, numpy.eye(4), mesh=mesh)


def emitter(name, color, radiance):
    return {
        "name": name,
        "emissiveFactor": [channel / max(color) for channel in color],
        "pbrMetallicRoughness": {"baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0, "roughnessFactor": 1},
        "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": radiance},
            "KHR_materials_specular": {"specularFactor": 0},
        },
    }


def icosphere(radius):
    """An icosahedron whose triangles are divided once: 80 triangles."""
    g = (1 + math.sqrt(5)) / 2
    points = [(-1, g, 0), (1, g, 0), (-1, -g, 0), (1, -g, 0), (0, -1, g), (0, 1, g), (0, -1, -g), (0, 1, -g),
              (g, 0, -1), (g, 0, 1), (-g, 0, -1), (-g, 0, 1)]
    faces = [(0, 11, 5), (0, 5, 1), (0, 1, 7), (0, 7, 10), (0, 10, 11), (1, 5, 9), (5, 11, 4), (11, 10, 2),
             (10, 7, 6), (7, 1, 8), (3, 9, 4), (3, 4, 2), (3, 2, 6), (3, 6, 8), (3, 8, 9), (4, 9, 5),
             (2, 4, 11), (6, 2, 10), (8, 6, 7), (9, 8, 1)]
    middles = {}

    def middle(i, j):
        key = (min(i, j), max(i, j))
        if key not in middles:
            middles[key] = len(points)
            points.append(tuple((a + b) / 2 for a, b in zip(points[i], points[j])))
        return middles[key]

    triangles = []
    for a, b, c in faces:
        ab, bc, ca = middle(a, b), middle(b, c), middle(c, a)
        triangles += [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    directions = numpy.array(points, float)
    directions /= numpy.linalg.norm(directions, axis=1)[:, None]
    return radius * directions, numpy.array(triangles)
