"""Small pictures of frames that are being rendered."""

from __future__ import annotations

import array
import dataclasses
import struct

from lumifold.errors import FarmError
from lumifold.v1 import farm_pb2, image_pb2


@dataclasses.dataclass(frozen=True)
class Preview:
    """A layer of a frame, reduced. `channels`: numbers by name, such as "R", in rows from the top."""
    width: int
    height: int
    reduction: int  # pixels of the frame, across and down, for each of the preview
    samples_per_pixel: float
    is_finished: bool
    units: int
    layers: tuple[str, ...]  # that the frame has
    channels: dict[str, array.array] = dataclasses.field(repr=False)


def preview_of(message: farm_pb2.Preview) -> Preview:
    layout = message.layout
    count = layout.width * layout.height
    encodings = list(layout.encodings) or [image_pb2.PLANE_ENCODING_FLOAT] * len(layout.channels)
    channels, at = {}, 0
    for name, encoding in zip(layout.channels, encodings):
        if encoding == image_pb2.PLANE_ENCODING_ZSTD:
            raise FarmError(f"the channel {name} is compressed, which previews of this package cannot read")
        kind, values = {
            image_pb2.PLANE_ENCODING_FLOAT: ("f", count), image_pb2.PLANE_ENCODING_CONSTANT: ("f", 1),
            image_pb2.PLANE_ENCODING_HALF: ("e", count)
        }[encoding]
        numbers = struct.unpack_from(f"<{values}{kind}", message.planes, at)
        at += struct.calcsize(f"<{values}{kind}")
        channels[name] = array.array("f", numbers if values == count else numbers * count)
    return Preview(width=layout.width, height=layout.height, reduction=message.reduction,
                   samples_per_pixel=message.samples_per_pixel, is_finished=message.finished,
                   units=message.units, layers=tuple(message.layers), channels=channels)
