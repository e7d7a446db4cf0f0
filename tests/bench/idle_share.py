#!/usr/bin/env python3
"""How long workers wait for units: the share of their render threads' time, with 8 workers and uniform or
adaptive passes. Prints a table in Markdown.

    LUMIFOLD_BIN=build/release/bin PYTHONPATH=tests/support python3 tests/bench/idle_share.py [--workers 8]
    [--spp 256]

Counted from the first unit of a job to the last one. Workers, coordinator and filter share this machine: with
fewer processors than workers a unit takes longer, and threads wait less often for the next one.
"""

import argparse
import pathlib
import tempfile
import time

from farm import Farm, make_scene
from metrics import address_of, samples, scrape

ACTIVITIES = ("rendering", "sending", "waiting")
JOBS = (("uniform", ()), ("adaptive", ("--adaptive",)))


def seconds_of(workers):
    """Of all render threads, by what they did."""
    name = "lumifold_worker_thread_seconds_total"
    figures = [samples(scrape(address_of(worker))) for worker in workers]
    return {
        activity: sum(each[f'{name}{{activity="{activity}"}}'] for each in figures) for activity in ACTIVITIES
    }


def wait_for(condition):
    """Seldom, since this machine has other work to do."""
    while not condition():
        time.sleep(0.5)


def measure(farm, workers, scene, settings):
    """Seconds of the job's units, and of the threads meanwhile by what they did."""
    job = farm.client("submit", scene, *settings).stdout.strip()
    wait_for(lambda: farm.status(job)["units_done"] > 0)
    before, start = seconds_of(workers), time.monotonic()
    wait_for(lambda: farm.status(job)["state"] != "running")
    seconds, after = time.monotonic() - start, seconds_of(workers)
    farm.client("wait", job)
    return seconds, {activity: after[activity] - before[activity] for activity in ACTIVITIES}


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--workers", type=int, default=8)
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--size", default="512x384")
    parser.add_argument("--scenes", default="cornell-box,meeting-room")
    options = parser.parse_args()
    print("| scene | passes | time | rendering | sending | waiting |\n|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        with Farm(pathlib.Path(folder) / "data") as farm:
            workers = [
                farm.start_worker("--metrics-address", "127.0.0.1:0", threads=1)
                for _ in range(options.workers)
            ]
            for name in options.scenes.split(","):
                scene = make_scene(name, pathlib.Path(folder))
                for passes, settings in JOBS:
                    seconds, threads = measure(farm, workers, scene,
                                               ("--size", options.size, "--spp", options.spp, *settings))
                    shares = [
                        f"{100 * threads[activity] / sum(threads.values()):.1f} %" for activity in ACTIVITIES
                    ]
                    print(f"| {name} | {passes} | {seconds:.1f} s | {' | '.join(shares)} |", flush=True)


if __name__ == "__main__":
    main()
