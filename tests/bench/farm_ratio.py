#!/usr/bin/env python3
"""Compares a farm of one worker with `lumifold render`: the same scene, settings and threads, in turns.
Prints for both the time and the processor time and, pair by pair, the farm's share of the throughput of one
process. Time is that of the commands from their start to the finished file; coordinator and worker run
already, and the scene is not stored yet. Processor time is that of all processes from their start to their
end, which is what to compare on a busy machine.

    farm_ratio.py [--bin FOLDER] [--scene NAME] [--size WxH] [--spp N] [--threads N] [--pairs N] [--least
    SHARE]

NAME is one that lumifold-scenes makes. With --least it exits with 1 where the median share is below SHARE.
"""

import argparse
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default=ROOT / "build/release/bin")
    parser.add_argument("--scene", default="cornell-box")
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--least", type=float, default=0)
    return parser.parse_args()


def processor_seconds():
    """Of all processes that were started from here and have ended, and of those that they started."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def with_processor_seconds(run, *arguments):
    """The seconds that `run` returns, and the processor seconds that it took."""
    before = processor_seconds()
    return run(*arguments), processor_seconds() - before


def timed(command):
    """Runs a command; returns its output and its seconds."""
    start = time.monotonic()
    done = subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True)
    return done.stdout, time.monotonic() - start


def render(arguments, scene, settings, folder):
    command = [
        "lumifold", "render", scene, *settings, "--threads", arguments.threads, "-o", folder / "one.exr"
    ]
    return timed([arguments.bin / command[0], *command[1:]])[1]


def farm(arguments, scene, settings, folder):
    """A new farm each time: the worker of a used one already has the scene."""
    from farm import Farm, wait_until

    filter_threads = ["--filter-threads", arguments.threads]
    with tempfile.TemporaryDirectory(dir=folder) as data, Farm(data, *filter_threads) as running:
        worker = running.start_worker(threads=arguments.threads)
        wait_until(lambda: "event=joined" in worker.log_text(), "a connected worker")
        client = [arguments.bin / "lumifold"]
        server = ["--server", running.address]
        job, submitting = timed([*client, "submit", *server, scene, *settings])
        waiting = timed([*client, "wait", *server, job.strip()])[1]
        loading = timed([*client, "download", *server, job.strip(), "-o", folder / "farm.exr"])[1]
        return submitting + waiting + loading


def main():
    arguments = parse_arguments()
    arguments.bin = pathlib.Path(arguments.bin).resolve()
    os.environ["LUMIFOLD_BIN"] = str(arguments.bin)
    sys.path.insert(0, str(ROOT / "tests/support"))
    settings = ["--size", arguments.size, "--spp", arguments.spp, "--seed", 1]
    shares, processor_shares = [], []
    with tempfile.TemporaryDirectory() as root:
        folder = pathlib.Path(root)
        timed([arguments.bin / "lumifold-scenes", "--out", folder, arguments.scene])
        scene = folder / f"{arguments.scene}.glb"
        for pair in range(arguments.pairs):
            runs = {"render": render, "farm": farm}
            order = list(runs) if pair % 2 == 0 else list(reversed(runs))  # neither is always the first
            done = {
                name: with_processor_seconds(runs[name], arguments, scene, settings, folder) for name in order
            }
            if (folder / "one.exr").read_bytes() != (folder / "farm.exr").read_bytes():
                sys.exit("farm_ratio: the pictures differ")
            shares.append(done["render"][0] / done["farm"][0])
            processor_shares.append(done["render"][1] / done["farm"][1])
            print("  ".join(
                f"{name} {done[name][0]:.2f} s ({done[name][1]:.2f} s processor)" for name in runs),
                  flush=True)
    print_shares("share of the throughput", shares)
    print_shares("share by processor time", processor_shares)
    sys.exit(1 if statistics.median(shares) < arguments.least else 0)


def print_shares(name, shares):
    print(f"{name}: median {statistics.median(shares):.3f} (min {min(shares):.3f}, max {max(shares):.3f})")


if __name__ == "__main__":
    main()
