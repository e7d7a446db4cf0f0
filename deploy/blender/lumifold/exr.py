"""Reads and writes OpenEXR files: scan lines, ZIP compression or none, as Lumifold and Blender write them.

Blender brings a module for pictures (OpenImageIO) only since 3.6, and Linux distributions package it apart
from Blender. The files read here are the program's own, so this one form suffices everywhere.
"""

import struct
import zlib

import numpy

MAGIC = 20000630
TYPES = {0: numpy.dtype("<u4"), 1: numpy.dtype("<f2"), 2: numpy.dtype("<f4")}
LINES_OF_BLOCK = {0: 1, 2: 1, 3: 16}  # no compression, ZIPS, ZIP


def read(path):
    """The channels by name, each a float32 array of (height, width), rows from the top."""
    with open(path, "rb") as file:
        data = file.read()
    magic, version = struct.unpack_from("<II", data)
    if magic != MAGIC or version & 0x1A00:
        raise ValueError(f"{path} is not an OpenEXR file of one part in scan lines")
    attributes, at = read_header(data, 8)
    channels = channel_list(attributes["channels"])
    compression = attributes["compression"][0]
    if compression not in LINES_OF_BLOCK:
        raise ValueError(f"{path}: compression {compression} is not supported")
    x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    pixels = {name: numpy.empty((height, width), numpy.float32) for name, _ in channels}
    row_size = width * sum(kind.itemsize for _, kind in channels)
    lines_of_block = LINES_OF_BLOCK[compression]
    for (offset,) in struct.iter_unpack("<Q", data[at : at + 8 * -(-height // lines_of_block)]):
        first, size = struct.unpack_from("<iI", data, offset)
        first -= y0
        lines = min(lines_of_block, height - first)
        block = numpy.frombuffer(unpack(data[offset + 8 : offset + 8 + size], row_size * lines), numpy.uint8)
        block = block.reshape(lines, row_size)
        column = 0
        for name, kind in channels:
            part = numpy.ascontiguousarray(block[:, column : column + width * kind.itemsize])
            pixels[name][first : first + lines] = part.view(kind)
            column += width * kind.itemsize
    return pixels


def read_header(data, at):
    """The attributes' bytes by name, and where the header ends."""
    attributes = {}
    while data[at]:
        name, at = read_text(data, at)
        _, at = read_text(data, at)
        (size,) = struct.unpack_from("<I", data, at)
        attributes[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    return attributes, at + 1


def read_text(data, at):
    end = data.index(0, at)
    return data[at:end].decode(), end + 1


def channel_list(data):
    channels, at = [], 0
    while data[at]:
        name, at = read_text(data, at)
        (kind,) = struct.unpack_from("<I", data, at)
        channels.append((name, TYPES[kind]))
        at += 16
    return channels


def unpack(block, size):
    if len(block) == size:  # what does not get smaller is stored as it is
        return block
    coded = numpy.frombuffer(zlib.decompress(block), numpy.uint8)
    # Each byte is the difference from the one before, plus 128.
    total = numpy.cumsum(coded, dtype=numpy.int64) - 128 * numpy.arange(size)
    plain = numpy.empty(size, numpy.uint8)
    half = (size + 1) // 2
    plain[0::2], plain[1::2] = (total[:half] & 255), (total[half:] & 255)
    return plain.tobytes()


def write_rgb(path, pixels):
    """Writes an array of (height, width, 3), rows from the top, uncompressed."""
    height, width, _ = pixels.shape
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channels = b"".join(
        name + b"\0" + struct.pack("<IIII", 2, 0, 1, 1) for name in (b"B", b"G", b"R")) + b"\0"
    header = struct.pack("<II", MAGIC, 2)
    for name, kind, value in (
        (b"channels", b"chlist", channels),
        (b"compression", b"compression", b"\0"),
        (b"dataWindow", b"box2i", window),
        (b"displayWindow", b"box2i", window),
        (b"lineOrder", b"lineOrder", b"\0"),
        (b"pixelAspectRatio", b"float", struct.pack("<f", 1)),
        (b"screenWindowCenter", b"v2f", struct.pack("<2f", 0, 0)),
        (b"screenWindowWidth", b"float", struct.pack("<f", 1)),
    ):
        header += name + b"\0" + kind + b"\0" + struct.pack("<I", len(value)) + value
    header += b"\0"
    rows = [numpy.asarray(row, "<f4").T[::-1].tobytes() for row in pixels]
    line_size = 8 + 12 * width
    first = len(header) + 8 * height
    with open(path, "wb") as file:
        file.write(header)
        file.write(b"".join(struct.pack("<Q", first + y * line_size) for y in range(height)))
        for y, row in enumerate(rows):
            file.write(struct.pack("<iI", y, len(row)) + row)
