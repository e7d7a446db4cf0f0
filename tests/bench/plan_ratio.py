#!/usr/bin/env python3
"""What plans save of a farm's time: jobs with `--plan full` and `--plan auto` in turns, on a coordinator and
a worker of one thread that run already and have the scene. Processor time is that of both processes and their
children, planning and filter included; time is that from the submission to the filtered picture. Prints a
table in Markdown: means of the ratios, ± their standard errors.

    LUMIFOLD_BIN=build/release/bin PYTHONPATH=tests/support python3 tests/bench/plan_ratio.py [--size WxH]
    [--spp N] [--pairs N]
"""

import argparse
import pathlib
import statistics
import tempfile
import time

from farm import Farm, make_scene

PLANS = ("full", "auto")


def measure(farm, worker, scene, settings):
    """Seconds of a job by the clock, and of the processor."""

    def busy():
        return sum(farm.server.cpu_seconds() + worker.cpu_seconds())

    before, start = busy(), time.monotonic()
    job = farm.client("submit", scene, *settings).stdout.strip()
    farm.client("wait", job)
    return time.monotonic() - start, busy() - before


def ratio_text(ratios):
    return f"{statistics.mean(ratios):.3f} ± {statistics.stdev(ratios) / len(ratios) ** 0.5:.3f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="256x192")
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--pairs", type=int, default=4)
    parser.add_argument("--scenes", default="cornell-box,tiny-diffuse,tiny-textured")
    options = parser.parse_args()
    print(
        "| scene | processor time, full | planned | ratio | time, full | planned | ratio |\n|---|---|---|---|---|---|---|"
    )
    with tempfile.TemporaryDirectory() as folder, Farm(pathlib.Path(folder) / "data", "--filter-threads",
                                                       1) as farm:
        worker = farm.start_worker(threads=1)
        for name in options.scenes.split(","):
            scene = make_scene(name, pathlib.Path(folder))
            measure(farm, worker, scene, ("--size", "16x16", "--spp", 4))  # the worker fetches the scene
            runs = {plan: [] for plan in PLANS}
            for pair in range(options.pairs):
                for plan in PLANS if pair % 2 == 0 else reversed(PLANS):
                    settings = ("--size", options.size, "--spp", options.spp, "--seed", pair + 1, "--plan",
                                plan)
                    runs[plan].append(measure(farm, worker, scene, settings))
            cells = [name]
            for kind in (1, 0):  # of the pairs that measure() returns
                full, planned = ([run[kind] for run in runs[plan]] for plan in PLANS)
                cells += [f"{statistics.mean(full):.2f} s", f"{statistics.mean(planned):.2f} s",
                          ratio_text([p / f for f, p in zip(full, planned)])]
            print(f"| {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
