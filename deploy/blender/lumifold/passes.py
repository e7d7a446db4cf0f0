"""Blender's passes of a result: arrays of pixels from the file's layers. Needs no Blender."""

import dataclasses

import numpy

from . import versions
from .gltf import z_up

BACKGROUND_DEPTH = 1e10  # as Cycles has it


@dataclasses.dataclass(frozen=True)
class Pass:
    """A pass of Blender, and the layers of the file that it is made of."""

    name: str
    channels: str
    kind: str  # "COLOR", "VECTOR" or "VALUE"
    view_layer_property: str = ""  # of Blender's view layer; else `setting`, of ours
    setting: str = ""

    def name_in_blender(self):
        return versions.pass_name(self.name)


PASSES = (
    Pass("Combined", "RGBA", "COLOR", "use_pass_combined"),
    Pass("Depth", "Z", "VALUE", "use_pass_z"),
    Pass("Normal", "XYZ", "VECTOR", "use_pass_normal"),
    Pass("Diffuse Direct", "RGB", "COLOR", "use_pass_diffuse_direct"),
    Pass("Diffuse Indirect", "RGB", "COLOR", "use_pass_diffuse_indirect"),
    Pass("Diffuse Color", "RGB", "COLOR", "use_pass_diffuse_color"),
    Pass("Emission", "RGB", "COLOR", "use_pass_emit"),
    Pass("Environment", "RGB", "COLOR", "use_pass_environment"),
    Pass("Noisy Image", "RGBA", "COLOR", setting="pass_noisy"),
    Pass("Reflection", "RGB", "COLOR", setting="pass_reflection"),
)
LAYERS = {
    "Diffuse Direct": "direct", "Diffuse Indirect": "indirect", "Diffuse Color": "albedo",
    "Reflection": "reflection1"
}


def wanted(view_layer, settings):
    """The passes that a view layer asks for; the picture itself always."""
    return [
        one for one in PASSES if one.name == "Combined" or getattr(*(
            (view_layer, one.view_layer_property) if one.view_layer_property else (settings, one.setting)))
    ]


def pixels_of(name, film, background=None, transparent=False):
    """Array of (height, width, channels), rows from the top. `film` has the file's channels, `background`
    what a ray without a hit sees in each pixel (None: nothing). A transparent film is without it already."""
    alpha = film["A"]
    empty = (1 - alpha)[..., None]
    sky = numpy.zeros((*alpha.shape, 3), numpy.float32) if background is None else empty * background
    if name in ("Combined", "Noisy Image"):
        rgb = layer(film, "noisy" if name == "Noisy Image" else "")
        if transparent:
            return numpy.dstack([rgb, alpha])
        return numpy.dstack([rgb, numpy.ones_like(alpha)])
    if name == "Depth":
        return numpy.where(alpha > 0, film["Z"], BACKGROUND_DEPTH)[..., None]
    if name == "Normal":
        return z_up(numpy.dstack([film[f"N.{axis}"] for axis in "XYZ"]))
    if name == "Environment":
        return sky
    if name == "Emission":
        if transparent:
            return layer(film, "emission")
        return numpy.maximum(layer(film, "emission") - sky, 0) * (alpha > 0)[..., None]
    return layer(film, LAYERS[name])


def layer(film, name):
    return numpy.dstack([film[f"{name}.{channel}" if name else channel] for channel in "RGB"])


def background_of(environment, size, camera_matrix, projection):
    """What rays through the centres of the pixels see of an environment (height, width, 3), rows from the
    top."""
    width, height = size
    x = (2 * (numpy.arange(width) + 0.5) / width - 1) / projection[0][0]
    y = (1 - 2 * (numpy.arange(height) + 0.5) / height) / projection[1][1]
    x, y = numpy.meshgrid(x, y)
    if projection[3][3] == 1:
        x, y = numpy.zeros_like(x), numpy.zeros_like(y)
    directions = numpy.dstack([x, y, -numpy.ones_like(x)]) @ numpy.array(camera_matrix, float)[:3, :3].T
    directions /= numpy.linalg.norm(directions, axis=2, keepdims=True)
    rows, columns, _ = environment.shape
    u = 0.5 - numpy.arctan2(directions[..., 1], directions[..., 0]) / (2 * numpy.pi)
    v = numpy.arccos(numpy.clip(directions[..., 2], -1, 1)) / numpy.pi
    return bilinear(environment, u * columns - 0.5, numpy.clip(v * rows - 0.5, 0, rows - 1))


def bilinear(picture, x, y):
    rows, columns, _ = picture.shape
    x0, y0 = numpy.floor(x).astype(int), numpy.floor(y).astype(int)
    fx, fy = (x - x0)[..., None], (y - y0)[..., None]
    y1 = numpy.minimum(y0 + 1, rows - 1)
    upper = picture[y0, x0 % columns] * (1 - fx) + picture[y0, (x0 + 1) % columns] * fx
    lower = picture[y1, x0 % columns] * (1 - fx) + picture[y1, (x0 + 1) % columns] * fx
    return (upper * (1 - fy) + lower * fy).astype(numpy.float32)


def fitted(pixels, size):
    """A preview enlarged to the size of the picture, each pixel as it is."""
    width, height = size
    rows = numpy.arange(height) * pixels.shape[0] // height
    columns = numpy.arange(width) * pixels.shape[1] // width
    return pixels[rows][:, columns]


def from_the_bottom(pixels):
    """The rows in Blender's order."""
    return numpy.ascontiguousarray(pixels[::-1], dtype=numpy.float32)


@dataclasses.dataclass(frozen=True)
class Part:
    """A rectangle of the frame's pixels, from the bottom left as Blender counts."""

    left: int
    bottom: int
    size: tuple

    def region(self, frame):
        """X0, Y0, X1, Y1 from the top left, as the program counts."""
        top = frame[1] - self.bottom - self.size[1]
        return self.left, top, self.left + self.size[0], top + self.size[1]

    def cropped(self, pixels):
        """The part of an array of the whole frame, rows from the top."""
        x0, y0, x1, y1 = self.region((pixels.shape[1], pixels.shape[0]))
        return pixels[y0:y1, x0:x1]


def part_of(frame, border):
    """The pixels within a border (shares of the frame: left, bottom, right, top), rounded as Blender does;
    all without one."""
    if border is None:
        return Part(0, 0, frame)
    # Blender multiplies in single precision.
    left, bottom, right, top = (
        int(numpy.float32(share) * numpy.float32(frame[i % 2])) for i, share in enumerate(border))
    return Part(left, bottom, (right - left, top - bottom))
