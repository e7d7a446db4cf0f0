"""Makes tall OpenEXR files out of short ones by repeating their compressed blocks of rows: no pixel is decoded or encoded."""

import struct

LINES = 16  # of a ZIP block


def _text(file):
    text = b""
    while (byte := file.read(1)) != b"\0":
        text += byte
    return text


def _attributes(file):
    while name := _text(file):
        kind = _text(file)
        (size,) = struct.unpack("<i", file.read(4))
        yield name, kind, file.read(size)


def repeat_rows(source, target, times):
    """Writes `source`, a ZIP file of one part, scan lines from row 0 on and a multiple of 16 rows, `times` times below itself."""
    with open(source, "rb") as file, open(target, "wb") as out:
        out.write(file.read(8))
        for name, kind, value in _attributes(file):
            if name in (b"dataWindow", b"displayWindow"):
                x0, y0, x1, y1 = struct.unpack("<4i", value)
                assert y0 == 0 and (y1 + 1) % LINES == 0
                rows = y1 + 1
                value = struct.pack("<4i", x0, y0, x1, times * rows - 1)
            out.write(name + b"\0" + kind + b"\0" + struct.pack("<i", len(value)) + value)
        out.write(b"\0")
        file.seek(8 * (rows // LINES), 1)  # the table of blocks
        blocks = []
        for _ in range(rows // LINES):
            _, size = struct.unpack("<ii", file.read(8))
            blocks.append(file.read(size))
        blocks *= times
        place = out.tell() + 8 * len(blocks)
        for block in blocks:
            out.write(struct.pack("<Q", place))
            place += 8 + len(block)
        for number, block in enumerate(blocks):
            out.write(struct.pack("<ii", LINES * number, len(block)) + block)
