"""Compares `lumifold compare` with a second implementation of its metrics.

    metrics_oracle.py

computes two small pictures, writes them as OpenEXR, and computes their MSE255, PSNR, relMSE, SSIM, FLIP and
HDR-FLIP here: in double and with the published two-dimensional kernels, whereas the program uses float and
separable kernels. Fails if a figure differs by more than 1e-4 of itself. Needs the programs of LUMIFOLD_BIN
and Python only.
"""

import json
import math
import os
import pathlib
import struct
import subprocess
import sys
import tempfile

PROGRAMS = pathlib.Path(
    os.environ.get("LUMIFOLD_BIN",
                   pathlib.Path(__file__).parents[2] / "build/release/bin"))
WIDTH, HEIGHT = 20, 13
ALLOWED = 1e-4


# A picture is a list of (r, g, b), row by row from the top.


def as_float(value):
    return struct.unpack("<f", struct.pack("<f", value))[0]


def paint(wobble):
    """A ramp with a bright lamp, a hard edge and noise-like variation of amplitude `wobble`."""
    pixels = []
    for y in range(HEIGHT):
        for x in range(WIDTH):
            base = 0.05 + 0.5 * x / WIDTH + (0.3 if y > HEIGHT // 2 else 0.0) + (6.0 if
                                                                                 (x, y) in ((5, 4),
                                                                                            (6, 4)) else 0.0)
            noise = [wobble * math.sin(12.9898 * (x + 1) + 78.233 * (y + 1) + 37.7 * c) for c in range(3)]
            tint = (1.0, 0.8, 0.4 + 0.5 * y / HEIGHT)
            pixels.append(tuple(as_float(max(0.0, base * tint[c] * (1 + noise[c]))) for c in range(3)))
    return pixels


def write_exr(path, pixels):
    """One part, scan lines, no compression."""

    def attribute(name, kind, value):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(value)) + value

    channels = b"".join(
        name + b"\0" + struct.pack("<iIii", 2, 0, 1, 1) for name in (b"B", b"G", b"R")) + b"\0"
    window = struct.pack("<4i", 0, 0, WIDTH - 1, HEIGHT - 1)
    header = struct.pack("<II", 20000630, 2)
    header += attribute("channels", "chlist", channels) + attribute("compression", "compression", b"\0")
    header += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    header += attribute("lineOrder", "lineOrder", b"\0") + attribute("pixelAspectRatio", "float",
                                                                     struct.pack("<f", 1))
    header += attribute("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0))
    header += attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
    line = 12 * WIDTH
    offsets = [len(header) + 8 * HEIGHT + y * (8 + line) for y in range(HEIGHT)]
    data = header + struct.pack(f"<{HEIGHT}Q", *offsets)
    for y in range(HEIGHT):
        row = pixels[y * WIDTH:(y + 1) * WIDTH]
        data += struct.pack("<iI", y, line) + b"".join(
            struct.pack("<f", pixel[c]) for c in (2, 1, 0) for pixel in row)
    path.write_bytes(data)


def srgb(value):
    value = min(max(value, 0.0), 1.0)
    return 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055


def mean(values):
    values = list(values)
    return sum(values) / len(values)


def mse255(a, b):
    return mean((255 * (srgb(p) - srgb(q))) ** 2 for x, r in zip(a, b) for p, q in zip(x, r))


def rel_mse(a, b):
    return mean((p - q) ** 2 / (q * q + 0.01) for x, r in zip(a, b) for p, q in zip(x, r))


def luminance(pixel):
    return 0.2126 * pixel[0] + 0.7152 * pixel[1] + 0.0722 * pixel[2]


def ssim(a, b):
    window = [(dx, dy, math.exp(-(dx * dx + dy * dy) / 4.5)) for dx in range(-5, 6) for dy in range(-5, 6)]
    total = sum(weight for _, _, weight in window)
    grey_a, grey_b = ([luminance([srgb(v) for v in pixel]) for pixel in picture] for picture in (a, b))
    found = []
    for y in range(5, HEIGHT - 5):
        for x in range(5, WIDTH - 5):
            taken = [(w / total, grey_a[(y + dy) * WIDTH + x + dx], grey_b[(y + dy) * WIDTH + x + dx])
                     for dx, dy, w in window]
            ma, mb = sum(w * p for w, p, _ in taken), sum(w * q for w, _, q in taken)
            va, vb = sum(w * (p - ma) ** 2 for w, p, _ in taken), sum(w * (q - mb) ** 2 for w, _, q in taken)
            cov = sum(w * (p - ma) * (q - mb) for w, p, q in taken)
            found.append(
                (2 * ma * mb + 1e-4) * (2 * cov + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4)))
    return mean(found)


# FLIP. Colours are triples.

PPD = 67.0
WHITE = (0.950428545, 1.0, 1.088900371)
TO_XYZ = ((10135552 / 24577794, 8788810 / 24577794, 4435075 / 24577794),
          (2613072 / 12288897, 8788810 / 12288897, 887015 / 12288897),
          (1425312 / 73733382, 8788810 / 73733382, 70074185 / 73733382))


def inverse(m):
    def minor(i, j):
        r, c = [k for k in range(3) if k != i], [k for k in range(3) if k != j]
        return m[r[0]][c[0]] * m[r[1]][c[1]] - m[r[0]][c[1]] * m[r[1]][c[0]]

    det = sum((-1) ** j * m[0][j] * minor(0, j) for j in range(3))
    return [[(-1) ** (i + j) * minor(j, i) / det for j in range(3)] for i in range(3)]


FROM_XYZ = inverse(TO_XYZ)


def apply(matrix, v):
    return [sum(row[k] * v[k] for k in range(3)) for row in matrix]


def relative_xyz(rgb):
    return [v / w for v, w in zip(apply(TO_XYZ, rgb), WHITE)]


def opponent(rgb):
    x, y, z = relative_xyz(rgb)
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def rgb_of_opponent(ycc):
    y = (ycc[0] + 16) / 116
    xyz = [(y + ycc[1] / 500) * WHITE[0], y * WHITE[1], (y - ycc[2] / 200) * WHITE[2]]
    return [min(max(v, 0.0), 1.0) for v in apply(FROM_XYZ, xyz)]


def hunt_lab(rgb):
    f = [v ** (1 / 3) if v > (6 / 29) ** 3 else v / (3 * (6 / 29) ** 2) + 4 / 29 for v in relative_xyz(rgb)]
    lightness = 116 * f[1] - 16
    return lightness, 0.01 * lightness * 500 * (f[0] - f[1]), 0.01 * lightness * 200 * (f[1] - f[2])


def hyab(a, b):
    return abs(a[0] - b[0]) + math.hypot(a[1] - b[1], a[2] - b[2])


def convolve(plane, kernel, radius):
    """kernel: {(dx, dy): weight}; clamped at the edges."""
    out = []
    for y in range(HEIGHT):
        for x in range(WIDTH):
            out.append(
                sum(weight * plane[min(max(y + dy, 0), HEIGHT - 1) * WIDTH + min(max(x + dx, 0), WIDTH - 1)]
                    for (dx, dy), weight in kernel.items()))
    return out


def square(radius, function):
    return {(dx, dy): function(dx, dy) for dx in range(-radius, radius + 1)
            for dy in range(-radius, radius + 1)}


def sensitivity_kernel(*gaussians):
    radius = math.ceil(3 * math.sqrt(0.04 / (2 * math.pi ** 2)) * PPD)
    kernel = square(
        radius, lambda dx, dy: sum(a * math.sqrt(math.pi / b) * math.exp(-math.pi**2 *
                                                                         (dx * dx + dy * dy) / PPD**2 / b)
                                   for a, b in gaussians))
    total = sum(kernel.values())
    return {at: weight / total for at, weight in kernel.items()}, radius


def feature_kernels(kind):
    sigma = 0.5 * 0.082 * PPD
    radius = math.ceil(3 * sigma)

    def along(dx, dy):
        gauss = math.exp(-(dx * dx + dy * dy) / (2 * sigma * sigma))
        return (-dx if kind == "edge" else dx * dx / sigma ** 2 - 1) * gauss

    kernel = square(radius, along)
    plus, minus = (abs(sum(v for v in kernel.values() if v * sign > 0)) for sign in (1, -1))
    kernel = {at: v / (plus if v > 0 else minus) for at, v in kernel.items()}
    return kernel, {(dy, dx): v for (dx, dy), v in kernel.items()}, radius


def features(grey, kind):
    across, down, radius = feature_kernels(kind)
    return [math.hypot(p, q) for p, q in zip(convolve(grey, across, radius), convolve(grey, down, radius))]


def perceived(opponents):
    kernels = (sensitivity_kernel((1, 0.0047)), sensitivity_kernel(
        (1, 0.0053)), sensitivity_kernel((34.1, 0.04), (13.5, 0.025)))
    planes = [convolve([pixel[c] for pixel in opponents], *kernels[c]) for c in range(3)]
    return [hunt_lab(rgb_of_opponent(pixel)) for pixel in zip(*planes)]


def flip_map(a, b):
    greatest = hyab(hunt_lab((0, 1, 0)), hunt_lab((0, 0, 1))) ** 0.7
    a, b = ([opponent([min(max(v, 0.0), 1.0) for v in pixel]) for pixel in picture] for picture in (a, b))
    grey_a, grey_b = ([(pixel[0] + 16) / 116 for pixel in picture] for picture in (a, b))
    edges, points = ([abs(p - q)
                      for p, q in zip(features(grey_a, kind), features(grey_b, kind))]
                     for kind in ("edge", "point"))
    out = []
    for p, q, edge, point in zip(perceived(a), perceived(b), edges, points):
        color = hyab(p, q) ** 0.7
        knee = 0.4 * greatest
        color = 0.95 * color / knee if color < knee else 0.95 + 0.05 * (color - knee) / (greatest - knee)
        out.append(color ** (1 - math.sqrt(max(edge, point) / math.sqrt(2))))
    return out


K = (0.36 * 2.51, 0.6 * 0.03, 0.0, 0.36 * 2.43, 0.6 * 0.59, 0.14)


def aces(x):
    return min(max((K[0] * x * x + K[1] * x + K[2]) / (K[3] * x * x + K[4] * x + K[5]), 0.0), 1.0)


def hdr_flip_map(a, b):
    low, high = 0.0, 100.0
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if aces(middle) < 0.85 else (low, middle)
    greys = sorted(luminance(pixel) for pixel in b)
    start, stop = math.log2(low / greys[-1]), math.log2(low / greys[(len(greys) - 1) // 2])
    count = max(2, math.ceil(stop - start))
    worst = [0.0] * len(a)
    for i in range(count):
        factor = 2 ** (start + (stop - start) * i / (count - 1))
        shown = [[tuple(aces(factor * v) for v in pixel) for pixel in picture] for picture in (a, b)]
        worst = [max(p, q) for p, q in zip(worst, flip_map(*shown))]
    return worst


def main():
    picture, reference = paint(0.35), paint(0.0)
    found = {
        "mse255": mse255(picture, reference), "rel_mse": rel_mse(picture,
                                                                 reference), "ssim": ssim(picture, reference),
        "flip": mean(flip_map(picture, reference)), "flip_hdr": mean(hdr_flip_map(picture, reference))
    }
    found["psnr_db"] = 10 * math.log10(65025 / found["mse255"])
    with tempfile.TemporaryDirectory(prefix="lumifold-oracle-") as folder:
        paths = [pathlib.Path(folder) / name for name in ("picture.exr", "reference.exr")]
        write_exr(paths[0], picture)
        write_exr(paths[1], reference)
        done = subprocess.run([
            PROGRAMS / "lumifold", "compare", *paths, "--json", "--metric",
            "mse255,psnr,relmse,ssim,flip,flip-hdr"
        ],
                              capture_output=True,
                              text=True,
                              check=True)
    told = json.loads(done.stdout)
    wrong = 0
    for name, value in found.items():
        off = abs(told[name] / value - 1)
        wrong += off > ALLOWED
        print(
            f"{name:8} here {value:.8g}  lumifold {told[name]:.8g}  off by {off:.1e}{'  TOO MUCH' if off > ALLOWED else ''}"
        )
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
