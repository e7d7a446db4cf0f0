"""Compares two programs' pictures region by region; each program renders twice, with different seeds.

The difference of a region is that of its mean, in percent of the reference's. Its standard deviation follows
from the pixel-wise difference of the two renders of each program.
"""

import math

GRID = (4, 3)
DARK = 0.02  # regions darker than this fraction of the picture's mean are skipped


class Estimate:
    """Two independent renders of the same picture."""

    def __init__(self, first, second):
        self.mean = [(a + b) / 2 for a, b in zip(first, second)]
        self.variance = [(a - b) ** 2 / 4 for a, b in zip(first, second)]


def grid_regions(width, height):
    columns, rows = GRID
    regions = {}
    for pixel in range(width * height):
        row = pixel // width * rows // height
        column = pixel % width * columns // width
        regions.setdefault(f"row {row + 1} column {column + 1}", []).append(pixel)
    return regions


def object_regions(ids, fewest=100):
    regions = {}
    for pixel, number in enumerate(ids):
        regions.setdefault(f"object {round(number)}" if number else "no object", []).append(pixel)
    return {name: pixels for name, pixels in regions.items() if len(pixels) >= fewest}


def compare(ours, reference, regions):
    """Per region: name, mean of the reference, difference in percent, its standard deviation in percent."""
    whole = sum(reference.mean) / len(reference.mean)
    for name, pixels in regions.items():
        true = sum(reference.mean[p] for p in pixels) / len(pixels)
        if true < DARK * whole:
            continue
        mean = sum(ours.mean[p] for p in pixels) / len(pixels)
        variance = sum(ours.variance[p] + reference.variance[p] for p in pixels) / len(pixels) ** 2
        yield name, true, 100 * (mean / true - 1), 100 * math.sqrt(variance) / true
