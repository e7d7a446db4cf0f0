#!/usr/bin/env python3
"""Renders a picture of each model of a folder, such as the products of a shop, on a farm.

    catalogue.py MODELS PICTURES [--server HOST:PORT] [--size 256] [--samples 32]

MODELS has .glb and .gltf files. PICTURES gets an .exr of each, and report.csv. A few jobs are at the farm at
a time. A picture that is there is not made again: the program may be stopped and started at any time. Needs
the Python package, python3-lumifold.
"""

import argparse
import collections
import csv
import pathlib
import sys
import time

import lumifold

IN_FLIGHT = 32  # jobs at the farm: enough that no worker waits for the next upload
TRIES = 3


def catalogue(farm, models, pictures, **settings):
    """Yields (model, tries, seconds, error) when a picture is made, or could not be made TRIES times.
    `settings` are those of Farm.render."""
    waiting = collections.deque((model, 1) for model in models if not picture_of(model, pictures).exists())
    running = collections.deque()  # in the order in which the farm starts them
    while waiting or running:
        try:
            if waiting and len(running) < IN_FLIGHT:
                model, tries = waiting.popleft()
                start = time.monotonic()
                job = farm.render(model, name=model.stem, **settings)
                running.append((model, tries, start, job))
                continue
            model, tries, start, job = running.popleft()
            job.wait()
            job.save(picture_of(model, pictures))
            job.delete()
        except lumifold.FarmError as error:
            if tries < TRIES:
                waiting.append((model, tries + 1))
            else:
                yield model, tries, time.monotonic() - start, str(error)
        else:
            yield model, tries, time.monotonic() - start, ""


def picture_of(model, pictures):
    return pictures / f"{model.stem}.exr"


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("models", type=pathlib.Path)
    parser.add_argument("pictures", type=pathlib.Path)
    parser.add_argument("--server")
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--samples", type=int, default=32)
    options = parser.parse_args()
    options.pictures.mkdir(parents=True, exist_ok=True)
    models = sorted(path for path in options.models.iterdir() if path.suffix in (".glb", ".gltf"))
    settings = {"size": (options.size, options.size), "samples": options.samples, "environment": "studio"}
    failed = done = 0
    start = time.monotonic()
    report_file = options.pictures / "report.csv"
    with lumifold.Farm(options.server) as farm, open(report_file, "w", newline="") as file:
        report = csv.writer(file)
        report.writerow(["model", "tries", "seconds", "error"])
        for model, tries, seconds, error in catalogue(farm, models, options.pictures, **settings):
            report.writerow([model.name, tries, f"{seconds:.1f}", error])
            file.flush()
            failed, done = failed + bool(error), done + (not error)
            rate = 60 * done / (time.monotonic() - start)
            print(f"{done} pictures, {failed} failed, {rate:.1f} a minute", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
