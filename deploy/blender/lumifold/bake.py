"""Bakes what glTF has no nodes for, procedural textures and bumps, into pictures of each object: on request."""

import hashlib
import json
import pathlib
import subprocess
import tempfile

import bpy
import numpy

from . import exr, materials, node_digest

cache = {}  # (height, width, 3) by digest: those of the last export


class BakedImage:
    """A baked picture with the parts of Blender's images that `textures` reads: linear, of floats."""

    is_dirty, is_float, source, channels = True, True, "BAKED", 3

    class colorspace_settings:
        name = "Non-Color"

    def __init__(self, name, planes):
        self.name, self.planes = name, planes
        self.size = planes.shape[1], planes.shape[0]
        self.pixels = self

    def foreach_get(self, flat):
        flat[:] = self.planes[::-1].ravel()


class Bakes:
    """The pictures that the materials of a scene need, of one export."""

    def __init__(self, resolution):
        self.resolution, self.images = resolution, {}

    def prepare(self, depsgraph):
        """Bakes all that is not in the cache, in one other Blender."""
        if self.resolution <= 0:
            return
        wanted, frame = {}, depsgraph.scene.frame_current
        for instance in depsgraph.object_instances:
            thing = instance.object.original
            if thing.type == "MESH" and instance.show_self and thing.data.uv_layers:
                for slot in thing.material_slots:
                    for place in places_of(slot.material):
                        wanted[thing.name, slot.material.name, *place] = thing, slot.material
        digests = {key: self.digest(*owners, key, frame, depsgraph) for key, owners in wanted.items()}
        missing = {key: owners[0] for key, owners in wanted.items() if digests[key] not in cache}
        if missing:
            for key, planes in run(missing, self.resolution, frame).items():
                cache[digests[key]] = planes
        for digest in set(cache) - set(digests.values()):
            del cache[digest]
        self.images = {
            key: BakedImage(" ".join(key), cache[digest]) for key, digest in digests.items() if digest in cache
        }

    def of(self, thing, material):
        """What `materials.translate` asks for the picture at an input."""
        return lambda node, socket, kind: self.images.get((thing.name, material.name, node, socket, kind))

    def has_any(self, thing, material):
        return any(key[:2] == (thing.name, material.name) for key in self.images)

    def digest(self, thing, material, key, frame, depsgraph):
        mesh = thing.evaluated_get(depsgraph).to_mesh()
        positions = numpy.empty(3 * len(mesh.vertices), numpy.float32)
        mesh.vertices.foreach_get("co", positions)
        uvs = numpy.empty(2 * len(mesh.loops), numpy.float32)
        layer = next((one for one in mesh.uv_layers if one.active_render), None)
        if layer is not None:
            layer.data.foreach_get("uv", uvs)
        animated = material.animation_data or material.node_tree.animation_data
        parts = (key[2:], self.resolution, frame if animated else 0, node_digest.of(material.node_tree),
                 tuple(map(tuple, thing.matrix_world)))
        whole = hashlib.sha256(repr(parts).encode() + positions.tobytes() + uvs.tobytes()).hexdigest()
        thing.evaluated_get(depsgraph).to_mesh_clear()
        return whole


def places_of(material):
    """(node, socket, kind) of each input of a material that only a baked picture carries."""
    found = []
    if material is not None:
        materials.translate(material, lambda *place: found.append(place))
    return found


def run(missing, resolution, frame):
    """Bakes in a Blender of its own: this one may be rendering, and its scenes stay as they are. What could
    not be baked is left out, and its input's own value is rendered."""
    with tempfile.TemporaryDirectory(prefix="lumifold-bake-") as folder:
        folder = pathlib.Path(folder)
        library = folder / "objects.blend"
        bpy.data.libraries.write(str(library), set(missing.values()), path_remap="ABSOLUTE", fake_user=True)
        wanted = [[*key, str(folder / f"{i}.exr")] for i, key in enumerate(missing)]
        (folder / "wanted.json").write_text(json.dumps(wanted))
        script = pathlib.Path(__file__).with_name("bake_objects.py")
        done = subprocess.run([
            bpy.app.binary_path, "-b", "--factory-startup", "--python-exit-code", "1", "--python",
            str(script), "--",
            str(library),
            str(folder / "wanted.json"),
            str(resolution),
            str(frame)
        ], capture_output=True, text=True, errors="replace", stdin=subprocess.DEVNULL)
        made = {}
        for key, (*_, path) in zip(missing, wanted):
            if pathlib.Path(path).exists():
                film = exr.read(path)
                made[key] = numpy.dstack([film[channel] for channel in "RGB"])
        if len(made) < len(missing):
            print(f"Lumifold: {len(missing) - len(made)} textures could not be baked: "
                  f"{done.stderr.strip()[-300:]}", flush=True)
        return made
