"""Compares both programs' direct light on the back wall of the diffuse room with its closed form.

    cross_check.py --bounces 0 --keep FOLDER diffuse-room
    lamp_and_wall.py FOLDER

prints for rows of the picture the height on the wall, the light by Lambert's formula for a polygon, and each
program's difference.
"""

import math
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "support"))
import exr  # noqa: E402

WIDTH, HEIGHT = 192, 144  # pixels, cross_check.py's own
FOCAL_LENGTH = WIDTH / 2 / math.tan(math.radians(48 / 2))  # in pixels
CAMERA_HEIGHT, WALL_DISTANCE = 1.5, 7.6  # metres; the wall lies at y = 2
HALF, LAMP_HEIGHT = 0.6, 2.98
LAMP = [(-HALF, -HALF, LAMP_HEIGHT), (HALF, -HALF, LAMP_HEIGHT), (HALF, HALF, LAMP_HEIGHT),
        (-HALF, HALF, LAMP_HEIGHT)]
ALBEDO, RADIANCE = 0.8, (1.0 + 0.9 + 0.8) / 3
COLUMNS = range(114, 148)  # of the wall that neither block nor lamp occludes
GRID = 4  # points per side of a pixel


def form_factor(point):
    """Form factor: fraction of the cosine-weighted hemisphere of the wall that the lamp covers."""
    total = 0
    for i in range(4):
        a, b = ([c - p for c, p in zip(LAMP[k % 4], point)] for k in (i, i + 1))
        across = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
        length = math.hypot(*across)
        total += math.atan2(length, sum(x * y for x, y in zip(a, b))) * -across[1] / length
    return abs(total) / (2 * math.pi)


def place_on_wall(column, row):
    x = WALL_DISTANCE * (column - WIDTH / 2) / FOCAL_LENGTH
    z = CAMERA_HEIGHT + WALL_DISTANCE * (HEIGHT / 2 - row) / FOCAL_LENGTH
    return x, 2, z


def true_radiance(column, row):
    offsets = [(i + 0.5) / GRID for i in range(GRID)]
    points = [place_on_wall(column + dx, row + dy) for dy in offsets for dx in offsets]
    return ALBEDO * RADIANCE * sum(map(form_factor, points)) / len(points)


def mean_picture(folder, program):
    first, second = (
        exr.read(folder / f"diffuse-room.camera.{program}-{seed}.exr").mean_of_colors() for seed in (1, 2))
    return [(a + b) / 2 for a, b in zip(first, second)]


def main(folder):
    pictures = {program: mean_picture(pathlib.Path(folder), program) for program in ("lumifold", "cycles")}
    print(f"{'height m':>8} {'true':>9} {'lumifold %':>11} {'cycles %':>9}")
    for row in range(32, 68, 5):
        true = sum(true_radiance(column, row) for column in COLUMNS)
        ours, cycles = (100 * (sum(picture[row * WIDTH + column]
                                   for column in COLUMNS) / true - 1)
                        for picture in pictures.values())
        print(f"{place_on_wall(0, row + 0.5)[2]:8.2f} {true / len(COLUMNS):9.6f} {ours:11.2f} {cycles:9.2f}")


if __name__ == "__main__":
    main(sys.argv[1])
