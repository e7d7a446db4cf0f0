"""Pictures of Blender as PNG or JPEG files beside a glTF file."""

import math
import os
import pathlib
import struct
import zlib

import numpy

CHANNELS = "RGBA"
WRAP = {"REPEAT": 10497, "EXTEND": 33071, "CLIP": 33071, "MIRROR": 33648}
SIGNATURES = {b"\x89PNG\r\n\x1a\n": ".png", b"\xff\xd8\xff": ".jpg"}


class TextureFiles:
    """Writes the pictures of a scene into a folder, each once."""

    def __init__(self, builder, folder):
        self.builder, self.folder = builder, pathlib.Path(folder)
        self.images = {}

    def info(self, texture, image_index, uv_names):
        """The textureInfo of glTF for a picture that is used as `texture` says."""
        sampler = {"wrapS": WRAP[texture.extension], "wrapT": WRAP[texture.extension]}
        index = self.once(
            ("texture", image_index, texture.extension),
            lambda: self.builder.append(
                "textures", {"source": image_index, "sampler": self.builder.append("samplers", sampler)}),
        )
        made = {
            "index": index, "texCoord": uv_names.index(texture.uv_map) if texture.uv_map in uv_names else 0
        }
        if texture.transform:
            self.builder.use("KHR_texture_transform")
            made["extensions"] = {"KHR_texture_transform": gltf_transform(*texture.transform)}
        return made

    def once(self, key, make):
        if key not in self.images:
            self.images[key] = make()
        return self.images[key]

    def color(self, texture, alpha=None):
        """Index of a picture of colours in sRGB, with the alpha of another picture."""
        key = ("color", texture.image.name, alpha and (alpha.image.name, alpha.channels))

        def make():
            plain = alpha is None or (alpha.image == texture.image and alpha.channels == "A")
            if plain and texture.image.colorspace_settings.name == "sRGB":
                file = self.copy(texture.image)
                if file:
                    return file
            pixels = srgb_pixels(texture.image)
            opacity = None if alpha is None else data_pixels(alpha.image)[..., CHANNELS.index(alpha.channels)]
            return self.write(compose([pixels[..., 0], pixels[..., 1], pixels[..., 2], opacity]))

        return self.once(key, make)

    def data(self, *channels):
        """Index of a picture whose channels are those of Textures or numbers, not colours."""
        key = ("data",
               *((one.image.name, one.channels) if hasattr(one, "image") else one for one in channels))
        return self.once(key, lambda: self.write(compose([self.channel(one) for one in channels])))

    def normal(self, texture):
        def make():
            is_data = texture.image.colorspace_settings.name == "Non-Color"
            pixels = None if is_data and (file := self.copy(texture.image)) is not None else data_pixels(
                texture.image)
            return file if pixels is None else self.write(compose([pixels[..., i] for i in range(3)]))

        return self.once(("normal", texture.image.name), make)

    @staticmethod
    def channel(source):
        if not hasattr(source, "image"):
            return source
        return data_pixels(source.image)[..., CHANNELS.index(source.channels)]

    def copy(self, image):
        """Index of the picture's own file, if that is PNG or JPEG and unchanged; otherwise None."""
        if image.is_dirty or image.source != "FILE":
            return None
        data = bytes(image.packed_file.data) if image.packed_file else read_file(image.filepath_from_user())
        for signature, ending in SIGNATURES.items():
            if data.startswith(signature):
                return self.store(data, ending)
        return None

    def write(self, pixels):
        return self.store(png(pixels), ".png")

    def store(self, data, ending):
        name = f"texture-{len(self.builder.json.get('images', []))}{ending}"
        (self.folder / name).write_bytes(data)
        return self.builder.append("images", {"uri": name})


def read_file(path):
    return pathlib.Path(path).read_bytes() if os.path.isfile(path) else b""


def gltf_transform(x, y, rotation, scale_x, scale_y):
    """A Mapping node's transform, for V that grows downwards."""
    offset = [x - scale_y * math.sin(rotation), 1 - y - scale_y * math.cos(rotation)]
    return {"offset": offset, "rotation": rotation, "scale": [scale_x, scale_y]}


def stored_pixels(image):
    """(height, width, 4), rows from the top, as stored: bytes as coded, floats linear."""
    width, height = image.size
    if not width or not height or image.channels < 1:
        raise ValueError(f"the picture '{image.name}' has no data; is its file missing?")
    pixels = numpy.empty(width * height * image.channels, numpy.float32)
    image.pixels.foreach_get(pixels)
    pixels = pixels.reshape(height, width, image.channels)[::-1]
    if image.channels < 3:
        pixels = numpy.repeat(pixels[..., :1], 3, axis=2)
    return pixels if pixels.shape[2] == 4 else numpy.dstack(
        [pixels, numpy.ones((height, width), numpy.float32)])


def is_coded(image):
    return not image.is_float and image.colorspace_settings.name == "sRGB"


def srgb_pixels(image):
    pixels = stored_pixels(image)
    return pixels if is_coded(image) else numpy.dstack([srgb_from_linear(pixels[..., :3]), pixels[..., 3]])


def data_pixels(image):
    """Linear values, as a shader sees them."""
    pixels = stored_pixels(image)
    return numpy.dstack([linear_from_srgb(pixels[..., :3]), pixels[..., 3]]) if is_coded(image) else pixels


def srgb_from_linear(x):
    x = numpy.clip(x, 0, 1)
    return numpy.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def linear_from_srgb(x):
    return numpy.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)


def compose(channels):
    """Bytes of (height, width, channels) from planes and numbers; smaller planes are enlarged to the
    largest."""
    channels = [channel for channel in channels if channel is not None]
    planes = [channel for channel in channels if isinstance(channel, numpy.ndarray)]
    height, width = (max(plane.shape[axis] for plane in planes) for axis in (0, 1))
    rows, columns = numpy.arange(height), numpy.arange(width)

    def fitted(channel):
        if not isinstance(channel, numpy.ndarray):
            return numpy.full((height, width), channel, numpy.float32)
        return channel[rows * channel.shape[0] // height][:, columns * channel.shape[1] // width]

    whole = numpy.dstack([fitted(channel) for channel in channels])
    return numpy.rint(numpy.clip(whole, 0, 1) * 255).astype(numpy.uint8)


def png(pixels):
    """An 8-bit PNG of (height, width, 3 or 4)."""
    height, width, channels = pixels.shape
    rows = numpy.hstack([numpy.zeros((height, 1), numpy.uint8), pixels.reshape(height, -1)])

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2 if channels == 3 else 6, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(
        rows.tobytes(), 6)) + chunk(b"IEND", b"")
