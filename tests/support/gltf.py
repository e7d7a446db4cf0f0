"""Changes scenes of ours for tests."""

import base64
import json
import pathlib
import struct
import zlib

JSON_CHUNK = 0x4E4F534A


def animate(glb, path, node_name, rise_metres):
    """Writes the scene with a node that rises within its first second, and gives the new file's path."""
    scene, binary_chunk = unpack_glb(glb)
    times, places = (0, 1), (0, 0, 0, 0, rise_metres, 0)
    keys = struct.pack("<8f", *times, *places)
    uri = "data:application/octet-stream;base64," + base64.b64encode(keys).decode()
    buffer = append(scene, "buffers", {"uri": uri, "byteLength": len(keys)})
    view = append(scene, "bufferViews", {"buffer": buffer, "byteLength": len(keys)})
    float_type = {"bufferView": view, "componentType": 5126, "count": 2}
    input_ = append(scene, "accessors", {**float_type, "type": "SCALAR", "min": [0], "max": [1]})
    output = append(scene, "accessors", {**float_type, "type": "VEC3", "byteOffset": 8})
    node = [node.get("name") for node in scene["nodes"]].index(node_name)
    channel = {"sampler": 0, "target": {"node": node, "path": "translation"}}
    scene["animations"] = [{"samplers": [{"input": input_, "output": output}], "channels": [channel]}]
    pathlib.Path(path).write_bytes(pack_glb(scene, binary_chunk))
    return pathlib.Path(path)


def turn_black_specular_off(glb):
    """Where a file's specular colour is black, sets the specular factor to 0 as well, in place.

    A black colour alone leaves the reflection at grazing angles: F90 stays 1.
    """
    scene, binary_chunk = unpack_glb(glb)
    for material in scene["materials"]:
        specular = material.get("extensions", {}).get("KHR_materials_specular", {})
        if specular.get("specularColorFactor") == [0, 0, 0]:
            specular["specularFactor"] = 0
    pathlib.Path(glb).write_bytes(pack_glb(scene, binary_chunk))


def add_texture(glb, path, edge):
    """Writes the scene with a grey picture of edge x edge pixels as the colour of its first material: a small file
    that takes much memory. Gives the new file's path."""
    scene, binary_chunk = unpack_glb(glb)
    rows = zlib.compressobj(1)
    packed = b"".join(rows.compress(b"\0" + b"\x80" * edge) for _ in range(edge)) + rows.flush()
    png = b"\x89PNG\r\n\x1a\n"
    header = struct.pack(">IIBBBBB", edge, edge, 8, 0, 0, 0, 0)
    for kind, content in ((b"IHDR", header), (b"IDAT", packed), (b"IEND", b"")):
        png += struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
    uri = "data:image/png;base64," + base64.b64encode(png).decode()
    texture = append(scene, "textures", {"source": append(scene, "images", {"uri": uri})})
    scene["materials"][0].setdefault("pbrMetallicRoughness", {})["baseColorTexture"] = {"index": texture}
    # Its texture coordinates: all the same point.
    for mesh in scene["meshes"]:
        for primitive in mesh["primitives"]:
            if primitive.get("material", 0) != 0 or "TEXCOORD_0" in primitive["attributes"]:
                continue
            count = scene["accessors"][primitive["attributes"]["POSITION"]]["count"]
            primitive["attributes"]["TEXCOORD_0"] = append(
                scene, "accessors", {"componentType": 5126, "count": count, "type": "VEC2"})
    pathlib.Path(path).write_bytes(pack_glb(scene, binary_chunk))
    return pathlib.Path(path)


def unpack_glb(glb):
    """The scene as JSON and what follows it in the file."""
    data = pathlib.Path(glb).read_bytes()
    length, kind = struct.unpack_from("<II", data, 12)
    assert kind == JSON_CHUNK
    return json.loads(data[20 : 20 + length]), data[20 + length :]


def append(scene, section, value):
    scene.setdefault(section, []).append(value)
    return len(scene[section]) - 1


def pack_glb(scene, binary_chunk):
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), JSON_CHUNK) + text + binary_chunk
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
