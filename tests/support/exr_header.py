"""The header of an OpenEXR file."""

import struct

MAGIC, MAGIC_SIZE = b"\x76\x2f\x31\x01", 8


def metadata_of(path):
    """The attributes of type string, by name."""
    content = path.read_bytes()
    if not content.startswith(MAGIC):
        raise ValueError(f"{path} is no OpenEXR file")
    position, texts = MAGIC_SIZE, {}
    while content[position] != 0:
        name_end = content.index(0, position)
        type_end = content.index(0, name_end + 1)
        (size,) = struct.unpack_from("<i", content, type_end + 1)
        value = content[type_end + 5:type_end + 5 + size]
        if content[name_end + 1:type_end] == b"string":
            texts[content[position:name_end].decode()] = value.decode()
        position = type_end + 5 + size
    return texts
