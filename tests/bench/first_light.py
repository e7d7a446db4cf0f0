#!/usr/bin/env python3
"""When a viewer of the status page sees what: follows previews of jobs from their submission on. Prints a
table in Markdown, and draws a chart.

    LUMIFOLD_BIN=build/release/bin PYTHONPATH=tests/support python3 tests/bench/first_light.py [--threads 2]
    [--spp 64] [--chart FILE.svg]

Errors are those of what is seen against the finished picture: mean squared difference of 8-bit sRGB values.
Tiles without samples are black and count as such. The coordinator, the worker, the viewer and the filter
share this machine.
"""

import argparse
import array
import math
import pathlib
import struct
import tempfile
import time

from farm import Farm, make_scene
from page_link import PageLink

JOBS = (("cornell-box", "512x512"), ("meeting-room", "512x384"), ("bedroom", "512x384"), ("meeting-room",
                                                                                          "1920x1080"))
LIMITS = (1000, 300, 100, 30)
SRGB = [
    round(255 * (12.92 * x if x <= 0.0031308 else 1.055 * x**(1 / 2.4) - 0.055))
    for x in (i / 4095 for i in range(4096))
]


def steps_of(description, body, size):
    """8-bit sRGB values of all channels of a preview, enlarged to this size as the page does it."""
    width, height = description["preview_width"], description["preview_height"]
    count = width * height
    pixels = [
        (y * height // size[1]) * width + x * width // size[0] for y in range(size[1]) for x in range(size[0])
    ]
    steps, at = [], 0
    for kind in description["types"]:
        size = 2 if kind == "half" else 4
        values = struct.unpack_from(f"<{count}{'e' if kind == 'half' else 'f'}", body, at)
        shown = array.array(
            "B", (SRGB[int(4095 * min(max(value, 0), 1))] if value == value else 0 for value in values))
        steps.append(array.array("B", (shown[pixel] for pixel in pixels)))
        at += count * size
    return steps


def error(seen, truth):
    """Mean squared difference."""
    pairs = [(a, b) for mine, theirs in zip(seen, truth) for a, b in zip(mine, theirs)]
    return sum((a - b) ** 2 for a, b in pairs) / len(pairs)


def follow(farm, scene, size, spp):
    """The time of submission, and of each preview its time, samples and pictures: filtered and noisy."""
    link = PageLink(farm.client("page").stdout.strip())
    start = time.monotonic()
    job = farm.client("submit", scene, "--size", size, "--spp", spp).stdout.strip()
    seen, units = [], 0
    while not seen or not seen[-1][0]["finished"]:
        filtered = link.preview(job, newer=units)
        if filtered is None:
            continue
        now = time.monotonic() - start
        units = filtered[0]["units"]
        seen.append((filtered[0], now, filtered, link.preview(job, layer="noisy")))
    return seen


def errors_of(seen):
    """Of each preview its time, and the errors of the filtered and of the noisy picture."""
    last = seen[-1][0]
    shown = (last["preview_width"], last["preview_height"])
    truth = steps_of(*seen[-1][2], shown)
    return [(now, *(error(steps_of(*picture, shown), truth)
                    for picture in pictures))
            for _, now, *pictures in seen]


def line_of(name, errors):
    first = [f"{now:.1f} s" for now, *_ in errors[:3]]
    cells = []
    for limit in LIMITS:
        filtered = next(now for now, error_now, _ in errors if error_now <= limit)
        noisy = next((f"{now:.1f} s" for now, _, error_now in errors if error_now <= limit), "never")
        cells.append(f"{filtered:.1f} s, {noisy}")
    return f"| {name} | {', '.join(first)} | {' | '.join(cells)} | {errors[-1][0]:.1f} s |"


WIDTH, HEIGHT, MARGIN = 360, 200, 44
DECADES = (0, 4.3)  # of the error, as powers of ten


def panel(name, errors, left, top):
    """Errors over time as steps: a picture stays until the next one comes."""
    end = errors[-1][0]
    low, high = DECADES
    x_of = lambda now: left + (WIDTH - MARGIN) * now / end
    y_of = lambda error_now: top + HEIGHT * (high - min(max(math.log10(max(error_now, 1)), low), high)) / (
        high - low)
    parts = [
        f'<text x="{left}" y="{top - 8}" font-weight="bold">{name}</text>',
        f'<rect x="{left}" y="{top}" width="{WIDTH - MARGIN}" height="{HEIGHT}" fill="none" stroke="#888"/>'
    ]
    for decade in range(math.ceil(low), math.floor(high) + 1):
        parts.append(
            f'<line x1="{left}" x2="{left + WIDTH - MARGIN}" y1="{y_of(10 ** decade):.1f}" y2="{y_of(10 ** decade):.1f}" stroke="#ddd"/>'
            f'<text x="{left - 4}" y="{y_of(10 ** decade) + 4:.1f}" text-anchor="end">{10 ** decade}</text>')
    for now in (0, end / 2, end):
        parts.append(
            f'<text x="{x_of(now):.1f}" y="{top + HEIGHT + 14}" text-anchor="middle">{now:.1f} s</text>')
    for column, colour in ((2, "#c60"), (1, "#06c")):
        path, before = [], 10 ** high
        for step in errors:
            path += [
                f"{x_of(step[0]):.1f},{y_of(before):.1f}", f"{x_of(step[0]):.1f},{y_of(step[column]):.1f}"
            ]
            before = step[column]
        parts.append(f'<polyline points="{" ".join(path)}" fill="none" stroke="{colour}" stroke-width="2"/>')
    return parts


def chart(curves):
    parts = []
    for i, (name, errors) in enumerate(curves):
        parts += panel(name, errors, MARGIN + i % 2 * WIDTH, 40 + i // 2 * (HEIGHT + 50))
    height = 30 + (len(curves) + 1) // 2 * (HEIGHT + 50)
    parts.append(f'<text x="{MARGIN}" y="16">Error of what a viewer sees (8-bit steps, mean square): '
                 '<tspan fill="#06c">filtered</tspan>, <tspan fill="#c60">noisy</tspan></text>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {2 * WIDTH + MARGIN // 2} {height}" font-family="sans-serif" font-size="11">\n'
        '<rect width="100%" height="100%" fill="#fff"/>\n' + "\n".join(parts) + "\n</svg>\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--threads", type=int, default=2, help="of the worker")
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--chart", type=pathlib.Path)
    options = parser.parse_args()
    print(
        f"| scene | first pictures | {' | '.join(f'error {limit}: filtered, noisy' for limit in LIMITS)} | finished |"
    )
    print("|---" * (3 + len(LIMITS)) + "|")
    curves = []
    with tempfile.TemporaryDirectory() as folder:
        root = pathlib.Path(folder)
        for name, size in JOBS:
            with Farm(root / f"{name}-{size}") as farm:
                farm.start_worker(threads=options.threads)
                time.sleep(1)  # it has connected
                curves.append(
                    (f"{name} {size}", errors_of(follow(farm, make_scene(name, root), size, options.spp))))
                print(line_of(*curves[-1]), flush=True)
    if options.chart:
        options.chart.write_text(chart(curves), encoding="utf-8")


if __name__ == "__main__":
    main()
