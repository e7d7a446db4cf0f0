#!/usr/bin/env python3
"""What viewers of the status page cost: time of a job, and processor time of the coordinator and of its child
processes, with 0, 1 and 50 of them. Prints a table in Markdown.

    LUMIFOLD_BIN=build/release/bin PYTHONPATH=tests/support python3 tests/bench/page_viewers.py [--spp 512]
    [--repeat 3]

A viewer is what a browser is: a stream of events, and a loop that fetches the picture. Viewers, coordinator
and worker share this machine, so that the time of the job has the viewers' own work too.
"""

import argparse
import contextlib
import http.client
import os
import pathlib
import statistics
import tempfile
import threading
import time

from farm import Farm, make_scene
from page_link import PageLink


def look(link, job, stop):
    newer = 0
    while not stop.is_set():
        with contextlib.suppress(OSError, AssertionError, http.client.HTTPException):
            picture = link.preview(job, newer=newer)
            newer = picture[0]["units"] if picture else newer
        stop.wait(0.3)


def listen(link, stop):
    with contextlib.suppress(OSError, AssertionError):
        for _ in link.events():
            if stop.is_set():
                return


def measure(farm, scene, viewers, spp):
    """Seconds of a job, and processor seconds of the coordinator, its children and the viewers."""
    link, stop = PageLink(farm.client("page").stdout.strip()), threading.Event()
    before, mine, start = farm.server.cpu_seconds(), time.process_time(), time.monotonic()
    job = farm.client("submit", scene, "--size", "640x480", "--spp", spp).stdout.strip()
    threads = [threading.Thread(target=call, args=arguments, daemon=True) for _ in range(viewers)
               for call, arguments in ((look, (link, job, stop)), (listen, (link, stop)))]
    for thread in threads:
        thread.start()
    farm.client("wait", job)
    seconds = time.monotonic() - start
    cost = seconds, *(after - earlier for earlier, after in zip(before, farm.server.cpu_seconds())
                     ), time.process_time() - mine
    stop.set()
    farm.client("delete", job)  # an event, with which those that listen end
    for thread in threads:
        thread.join()
    return cost


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spp", type=int, default=512)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    print("| viewers | job | coordinator | its children | viewers themselves |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        scene = make_scene("meeting-room", pathlib.Path(folder))
        with Farm(pathlib.Path(folder) / "data") as farm:
            farm.start_worker(threads=os.cpu_count())
            counts = (0, 1, 50)
            runs = {viewers: [] for viewers in counts}
            for _ in range(options.repeat):
                for viewers in counts:
                    runs[viewers].append(measure(farm, scene, viewers, options.spp))
            for viewers in counts:
                print(f"| {viewers} | " +
                      " | ".join(f"{statistics.median(column):.1f} s" for column in zip(*runs[viewers])) +
                      " |")


if __name__ == "__main__":
    main()
