"""The world as a picture of all directions for `--env`."""

import pathlib
import subprocess

import bpy
import numpy

from . import exr, node_digest, versions
from .versions import find_input

CONSTANT_SIZE = (4, 8)  # rows, columns of the picture of a constant colour
cache = {}  # bytes of a baked picture by what it was baked from; the last one only


class WorldError(Exception):
    """Blender could not bake the world; the text is its own."""


def write_environment(world, folder, width, frame):
    """Writes the picture of a world into a folder; returns its path, or "" for a black world."""
    color = constant_color(world)
    path = pathlib.Path(folder) / "environment.exr"
    if color is not None:
        if max(color) <= 0:
            return ""
        exr.write_rgb(path, numpy.broadcast_to(numpy.array(color, numpy.float32), (*CONSTANT_SIZE, 3)))
        return str(path)
    bake(world, path, width, frame)
    return str(path)


def constant_color(world):
    """Radiance of a world that is the same in all directions; None for others."""
    if world is None:
        return (0.0, 0.0, 0.0)
    tree = versions.node_tree(world)
    if tree is None:
        return tuple(world.color)
    outputs = [node for node in tree.nodes if node.type == "OUTPUT_WORLD" and node.is_active_output]
    links = find_input(outputs[0], "Surface").links if outputs else ()
    if not links:
        return (0.0, 0.0, 0.0)
    node = links[0].from_node
    if node.type != "BACKGROUND" or any(find_input(node, name).is_linked for name in ("Color", "Strength")):
        return None
    strength = find_input(node, "Strength").default_value
    return tuple(channel * strength for channel in find_input(node, "Color").default_value[:3])


def bake(world, path, width, frame):
    """Renders the world with a panoramic camera of Cycles. A second Blender does it: this one is rendering
    already, and its scenes stay as they are."""
    library = path.with_name("world.blend")
    bpy.data.libraries.write(str(library), {world.original}, path_remap="ABSOLUTE", fake_user=True)
    try:
        key = (node_digest.of(world.node_tree), width,
               frame if world.original.animation_data or world.node_tree.animation_data else 0)
        if key not in cache:
            script = pathlib.Path(__file__).with_name("bake_world.py")
            command = [
                bpy.app.binary_path, "-b", "--factory-startup", "--python-exit-code", "1", "--python",
                str(script), "--",
                str(library), world.name,
                str(path),
                str(width),
                str(frame)
            ]
            done = subprocess.run(command,
                                  capture_output=True,
                                  text=True,
                                  errors="replace",
                                  stdin=subprocess.DEVNULL)
            if done.returncode != 0 or not path.exists():
                raise WorldError(f"The world '{world.name}' could not be baked: {done.stderr.strip()[-300:]}")
            cache.clear()
            cache[key] = path.read_bytes()
        path.write_bytes(cache[key])
    finally:
        library.unlink(missing_ok=True)
