#!/usr/bin/env python3
"""Writes docs/results/unit-bytes.md: what the encodings of planes save, what compression saves, and what
features in half precision would do to the filtered picture.

    unit_bytes.py [--bin FOLDER] [--before FOLDER] [--pairs N] [--seconds N] [--out FILE]

--before names a folder with farm-load and lumifold-server of an earlier version, whose farm-load takes
--scene; without it "before" is the present coordinator with units whose planes are all float32.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENES = ["cornell-box", "meeting-room"]
LOAD = ["--workers", "64", "--size", "512"]


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=pathlib.Path, default=ROOT / "build/release/bin")
    parser.add_argument("--before", type=pathlib.Path)
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--seconds", default="4")
    parser.add_argument("--half-scenes",
                        nargs="*",
                        default=["cornell-box", "meeting-room", "bedroom", "atrium"])
    parser.add_argument("--out", type=pathlib.Path, default=ROOT / "docs/results/unit-bytes.md")
    return parser.parse_args()


def farm_load(folder, scene, samples, seconds, *more):
    command = [
        folder / "farm-load", *LOAD, "--seconds", seconds, "--scene", scene, "--pass-samples",
        str(samples), *more
    ]
    done = subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True)
    return {name: float(value) for name, value in (line.split() for line in done.stdout.splitlines())}


def spread(runs, name, form):
    values = [run[name] for run in runs]
    text = [form.format(value) for value in (statistics.median(values), min(values), max(values))]
    return f"{text[0]} ({text[1]} to {text[2]})"


def ratio(before, now, name):
    return "{:.2f}".format(statistics.median(b[name] and n[name] / b[name] for b, n in zip(before, now)))


def load_table(arguments, samples):
    lines = []
    rows = [("bytes_per_unit", "bytes of a unit", "{:.0f}"), ("units_per_second", "units a second", "{:.0f}"),
            ("mb_per_second", "MB a second", "{:.0f}"),
            ("server_cpu_seconds_per_1000_units", "processor seconds of the coordinator for 1000 units",
             "{:.3f}"), ("disk_mb_per_second", "the disk's own limit, MB a second", "{:.0f}")]
    for scene in SCENES:
        before, now = [], []
        for pair in range(arguments.pairs):
            earlier = (before, arguments.before, []) if arguments.before else (before, arguments.bin,
                                                                               ["--float32"])
            for runs, folder, more in (earlier, (now, arguments.bin, [])):
                runs.append(farm_load(folder, scene, samples, arguments.seconds, *more))
            print(f"{scene}: pair {pair + 1}", file=sys.stderr)
        lines += [f"| {scene} | before | now | now / before, median of pairs |", "|---|---|---|---|"]
        lines += [
            f"| {title} | {spread(before, name, form)} | {spread(now, name, form)} | {ratio(before, now, name)} |"
            for name, title, form in rows
        ]
        lines.append("")
    return lines


def codec_table(arguments):
    command = [str(arguments.bin / "unit-codec-bench"), "--benchmark_format=json", "--benchmark_min_time=0.3"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found = {}
    for run in json.loads(done.stdout)["benchmarks"]:
        kind, name, samples = run["name"].split("/")
        found[kind, name, int(samples)] = run
    lines = [
        "| scene | samples of a pass | raw | encoded | and compressed | encode | encode, compressed | decode | decode, compressed |",
        "|---|---|---|---|---|---|---|---|---|"
    ]
    for scene in SCENES:
        stem = scene.replace("-", "_")
        for samples in sorted({key[2] for key in found}):
            plain = found["BM_Encode", stem + "_plain", samples]
            cells = [
                scene,
                str(samples) if samples else "geometry unit", f"{plain['raw_bytes_per_unit']:.0f}",
                f"{plain['bytes_per_unit']:.0f}"
            ]
            size = found["BM_Encode", stem + "_zstd", samples]["bytes_per_unit"]
            cells.append(f"{size:.0f} (-{100 * (1 - size / plain['bytes_per_unit']):.0f} %)")
            cells += [f"{found[kind, stem + codec, samples]['bytes_per_second'] / 1e6:.0f} MB/s"
                      for kind in ("BM_Encode", "BM_Decode") for codec in ("_plain", "_zstd")]
            lines.append("| " + " | ".join(cells) + " |")
    return lines + [""]


def half_table(arguments):
    command = [str(arguments.bin / "half-features"), "--scenes", *arguments.half_scenes]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines() + [""]


def main():
    arguments = parse_arguments()
    load = [os.getloadavg()[0]]
    tables = load_table(arguments, 16)
    load.append(os.getloadavg()[0])
    before = "an earlier version" if arguments.before else "the same coordinator with planes that are all float32"
    lines = [
        "# Bytes of a unit", "",
        "Written by `tests/bench/unit_bytes.py`. What follows from it: [decision 20](../decisions/0020-plane-encodings.md).",
        "", "## On the wire and on the disk", "",
        f"`farm-load {' '.join(LOAD)} --seconds {arguments.seconds} --pass-samples 16 --scene ...`: units of 32x32 pixels that the renderer"
        f" made, {arguments.pairs} pairs in turns; median (least to most). Before: {before}. Load average {load[0]:.1f} at the start,"
        f" {load[1]:.1f} at the end, on {os.cpu_count()} cores: compare the figures of one row.", "", *tables,
        "## What compression saves", "",
        "`unit-codec-bench`: bytes of a unit, mean of 32 tiles of a frame of 512x512 pixels, by the encodings that need no library and"
        " with zstd for the planes that stay float32. MB of raw pixels a second on one core.", "",
        *codec_table(arguments), "## What features in half precision would do", "",
        "`half-features`: films of 320x240 pixels with 32 samples a pixel, filtered by the default method with and without the planes"
        " rounded to half precision. Moves are relative to the value or 0.01; MSE255 is between the two pictures.",
        "", *half_table(arguments)
    ]
    arguments.out.write_text("\n".join(lines).rstrip() + "\n")


if __name__ == "__main__":
    main()
