"""Builds a glTF 2.0 file with one binary file beside it. Needs no Blender."""

import copy
import json
import pathlib

import numpy

COMPONENT_TYPES = {"float32": 5126, "uint32": 5125}
SHAPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963

# From Blender's axes (Z up) to those of glTF (Y up).
Y_UP = numpy.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], float)


def y_up(vectors):
    """Points or directions, one a row, from Blender's axes to those of glTF."""
    return vectors @ Y_UP[:3, :3].T


def z_up(vectors):
    """The inverse of y_up."""
    return vectors @ Y_UP[:3, :3]


class GltfBuilder:
    def __init__(self):
        self.json = {
            "asset": {"version": "2.0", "generator": "Lumifold add-on for Blender"},
            "scene": 0,
            "scenes": [{"nodes": []}],
        }
        self.binary = bytearray()

    def fork(self):
        """A builder that begins with what this one has written: both files share the binary one."""
        made = GltfBuilder()
        made.json = copy.deepcopy(self.json)
        return made

    def append(self, section, value):
        """Appends to a list of the file; returns the index."""
        self.json.setdefault(section, []).append(value)
        return len(self.json[section]) - 1

    def use(self, extension):
        used = self.json.setdefault("extensionsUsed", [])
        if extension not in used:
            used.append(extension)

    def accessor(self, array, target=ARRAY_BUFFER, bounds=False):
        """Stores an array of (count,) or (count, components)."""
        array = numpy.ascontiguousarray(array)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": array.nbytes, "target": target}
        self.binary += array.tobytes()
        made = {
            "bufferView": self.append("bufferViews", view),
            "componentType": COMPONENT_TYPES[array.dtype.name],
            "count": len(array),
            "type": SHAPES[1 if array.ndim == 1 else array.shape[1]],
        }
        if bounds:
            made["min"], made["max"] = array.min(axis=0).tolist(), array.max(axis=0).tolist()
        return self.append("accessors", made)

    def primitive(self, positions, triangles, material=None, normals=None, uvs=(), colors=None):
        """A primitive of a mesh, in glTF's axes."""
        attributes = {"POSITION": self.accessor(positions.astype(numpy.float32), bounds=True)}
        if normals is not None:
            attributes["NORMAL"] = self.accessor(normals.astype(numpy.float32))
        for index, uv in enumerate(uvs):
            attributes[f"TEXCOORD_{index}"] = self.accessor(uv.astype(numpy.float32))
        if colors is not None:
            attributes["COLOR_0"] = self.accessor(colors.astype(numpy.float32))
        made = {
            "attributes": attributes,
            "indices": self.accessor(triangles.astype(numpy.uint32).ravel(), ELEMENT_ARRAY_BUFFER)
        }
        if material is not None:
            made["material"] = material
        return made

    def node(self, name, matrix, **parts):
        """A node at a world matrix in Blender's axes, of content that is in glTF's axes."""
        world = Y_UP @ numpy.array(matrix, float) @ Y_UP.T
        index = self.append("nodes", {"name": name, "matrix": world.T.ravel().tolist(), **parts})
        self.json["scenes"][0]["nodes"].append(index)
        return index

    def light(self, name, matrix, light):
        """A node with a light of KHR_lights_punctual; `matrix` is that of Blender's light, which shines along
        its -Z as glTF's does."""
        self.use("KHR_lights_punctual")
        lights = self.json.setdefault("extensions", {}).setdefault("KHR_lights_punctual",
                                                                   {"lights": []})["lights"]
        lights.append({"name": name, **light})
        self.oriented_node(name, matrix, extensions={"KHR_lights_punctual": {"light": len(lights) - 1}})

    def camera(self, name, matrix, camera):
        self.oriented_node(name, matrix, camera=self.append("cameras", camera))

    def oriented_node(self, name, matrix, **parts):
        """A node of what has the same axes in both worlds (looks along -Z, up is Y): only the world is
        turned."""
        world = Y_UP @ numpy.array(matrix, float)
        index = self.append("nodes", {"name": name, "matrix": world.T.ravel().tolist(), **parts})
        self.json["scenes"][0]["nodes"].append(index)

    def write(self, path):
        """Writes PATH and, beside it, the binary file."""
        path = pathlib.Path(path)
        if self.binary:
            binary = path.with_suffix(".bin")
            binary.write_bytes(self.binary)
            self.json["buffers"] = [{"uri": binary.name, "byteLength": len(self.binary)}]
        path.write_text(json.dumps(self.json))
