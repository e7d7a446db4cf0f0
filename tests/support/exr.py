"""Reads the OpenEXR files of Blender and Lumifold: scan lines, ZIP compression or none."""

import array
import pathlib
import struct
import zlib

MAGIC = b"\x76\x2f\x31\x01"
HEADER_BEGIN = 8  # after the magic bytes and the version
HALF, FLOAT = 1, 2
LINES_A_BLOCK = {0: 1, 2: 1, 3: 16}  # no compression, ZIPS, ZIP


class Picture:
    """Width, height, and a list of numbers, row by row from the top, for each channel."""

    def __init__(self, width, height, channels):
        self.width, self.height, self.channels = width, height, channels

    def mean_of_colors(self):
        """(R + G + B) / 3, pixel by pixel."""
        return [sum(rgb) / 3 for rgb in zip(*(self.channels[name] for name in "RGB"))]


def read(path):
    data = read_bytes(path)
    (version,) = struct.unpack_from("<I", data, len(MAGIC))
    if version & ~0x4FF:
        raise ValueError(f"{path}: not a plain OpenEXR file")
    attributes, at = read_header(data)
    values = {name: value for name, (_, value) in attributes.items()}
    kinds = read_channel_list(values["channels"])
    compression = values["compression"][0]
    if compression not in LINES_A_BLOCK:
        raise ValueError(f"{path}: compression {compression} is not supported")
    x0, y0, x1, y1 = struct.unpack("<4i", values["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    channels = {name: array.array("f") for name, _ in kinds}
    blocks = -(-height // LINES_A_BLOCK[compression])
    for offset in struct.unpack_from(f"<{blocks}Q", data, at):
        first, size = struct.unpack_from("<iI", data, offset)
        lines = min(LINES_A_BLOCK[compression], y1 + 1 - first)
        add_lines(unpack(data[offset + 8:offset + 8 + size], compression, kinds, width, lines), kinds, width,
                  lines, channels)
    return Picture(width, height, channels)


def metadata_of(path):
    """The attributes of type string, by name; of a file of several parts, those of the first."""
    attributes, _ = read_header(read_bytes(path))
    return {name: value.decode() for name, (kind, value) in attributes.items() if kind == "string"}


def read_bytes(path):
    data = pathlib.Path(path).read_bytes()
    if not data.startswith(MAGIC):
        raise ValueError(f"{path}: not an OpenEXR file")
    return data


def read_header(data):
    """The attributes' types and bytes by name, and where the header ends."""
    attributes, at = {}, HEADER_BEGIN
    while data[at]:
        name, at = read_text(data, at)
        kind, at = read_text(data, at)
        (size,) = struct.unpack_from("<I", data, at)
        attributes[name] = (kind, data[at + 4 : at + 4 + size])
        at += 4 + size
    return attributes, at + 1


def read_text(data, at):
    end = data.index(0, at)
    return data[at:end].decode(), end + 1


def read_channel_list(data):
    """(name, kind) in the file's order."""
    kinds, at = [], 0
    while data[at]:
        name, at = read_text(data, at)
        (kind,) = struct.unpack_from("<I", data, at)
        if kind not in (HALF, FLOAT):
            raise ValueError(f"channel {name}: integers are not read here")
        kinds.append((name, kind))
        at += 16
    return kinds


def unpack(block, compression, kinds, width, lines):
    size = sum(2 if kind == HALF else 4 for _, kind in kinds) * width * lines
    if compression == 0 or len(block) == size:  # what would not get smaller is stored as it is
        return block
    coded = bytearray(zlib.decompress(block))
    for i in range(1, size):  # each byte is the difference from the one before, shifted by 128
        coded[i] = (coded[i - 1] + coded[i] + 128) & 255
    plain = bytearray(size)
    half = (size + 1) // 2
    plain[0::2], plain[1::2] = coded[:half], coded[half:]
    return bytes(plain)


def add_lines(block, kinds, width, lines, channels):
    at = 0
    for _ in range(lines):
        for name, kind in kinds:
            code, size = ("e", 2) if kind == HALF else ("f", 4)
            channels[name].extend(struct.unpack_from(f"<{width}{code}", block, at))
            at += width * size
