"""Writes the evaluated scene that Blender hands to the engine as glTF, with its camera, lights and world.

Blender renders in a thread of its own, where its glTF exporter, an operator, is not safe. That one also takes
modifiers at their viewport's settings, and neither instances nor area lights. This module reads Blender's
evaluated scene (the dependency graph of the render), which belongs to the render, and changes nothing.
"""

import pathlib
import re

from . import bake, camera, lights, meshes, world
from .gltf import GltfBuilder
from .material_writer import MaterialWriter
from .program import Picture
from .textures import TextureFiles


# Property of a node whose mesh shows shadows alone, where the film is transparent.
SHADOW_CATCHER = "lumifold_shadow_catcher"


class ExportError(Exception):
    """The scene cannot be rendered; the text says why."""


def export(depsgraph, folder, size, is_cancelled=lambda: False):
    """Writes scene and environment into a folder; returns the Picture to render."""
    scene = depsgraph.scene
    if scene.camera is None:
        raise ExportError("The scene has no camera")
    if not camera.is_supported(scene.camera.data):
        raise ExportError(
            f"The camera '{scene.camera.name}' is neither perspective nor orthographic: glTF has no others")
    builder = GltfBuilder()
    add_objects(depsgraph, builder, folder, is_cancelled)
    f_stop, focus = add_camera(depsgraph, builder, size)
    path = pathlib.Path(folder) / f"{file_name(scene)}.gltf"
    builder.write(path)
    environment = world.write_environment(scene.world, folder, scene.lumifold.world_width,
                                          scene.frame_current)
    frame = max(scene.frame_current, 0)
    return Picture(str(path), size, frame, environment, f_stop, focus,
                   transparent=scene.render.film_transparent)


def add_objects(depsgraph, builder, folder, is_cancelled=lambda: False):
    """Adds all lights and meshes, with pictures in a folder."""
    bakes = bake.Bakes(depsgraph.scene.lumifold.bake_resolution)
    bakes.prepare(depsgraph)
    writer = MaterialWriter(builder, TextureFiles(builder, folder), bakes)
    meshes_by_key = {}
    soft_points = depsgraph.scene.lumifold.soft_points
    for instance in depsgraph.object_instances:
        if is_cancelled():
            return
        thing = instance.object
        if not instance.show_self:
            continue
        if thing.type == "LIGHT":
            lights.add_light(builder, thing.name, thing.data, instance.matrix_world, soft_points)
        elif thing.type in meshes.TYPES:
            key = mesh_key(thing, bakes)
            if key not in meshes_by_key:
                primitives = meshes.primitives_of(builder, thing, writer)
                made = builder.append(
                    "meshes", {"name": thing.data.name, "primitives": primitives}) if primitives else None
                meshes_by_key[key] = made
            if meshes_by_key[key] is not None:
                extras = {"extras": {SHADOW_CATCHER: True}} if thing.is_shadow_catcher else {}
                builder.node(thing.name, instance.matrix_world, mesh=meshes_by_key[key], **extras)


def mesh_key(thing, bakes):
    """Objects with equal keys have the same evaluated mesh and materials."""
    data = thing.data.as_pointer() if thing.type == "MESH" else thing.as_pointer()
    used = [slot.material for slot in thing.material_slots if slot.material]
    baked = thing.name if any(bakes.has_any(thing, material) for material in used) else ""
    return data, baked, tuple(slot.material.name if slot.material else "" for slot in thing.material_slots)


def add_camera(depsgraph, builder, size):
    """Adds the camera of the scene; returns the f-stop and the focus of its lens."""
    thing = depsgraph.scene.camera.evaluated_get(depsgraph)
    projection = thing.calc_matrix_camera(depsgraph, x=size[0], y=size[1])
    made = camera.gltf_camera(projection)
    matrix = lights.rigid(thing.matrix_world)
    builder.camera(thing.name, matrix, made)
    if made["type"] != "perspective":
        return 0.0, 0.0
    return camera.lens(thing.data, matrix, made["perspective"]["yfov"])


def file_name(scene):
    """A name for the job that says what it is: scene and frame."""
    plain = re.sub(r"[^A-Za-z0-9_-]+", "_", scene.name).strip("_") or "scene"
    return f"{plain}-{scene.frame_current:04d}"
