#!/usr/bin/env python3
"""Times our manifolds against OpenCV's port of the same method at equal work: 1024x768, 3 channels of signal,
9 of guide, 7 manifolds, sigma_s 16, one thread each, in turns. Prints processor seconds, the least of some
runs, and their ratio.

    opencv_ratio.py [FILTER_BENCH]

Needs numpy and OpenCV with ximgproc (Debian: apt-get install python3-opencv); says so and ends well where
they are missing.
"""

import json
import pathlib
import subprocess
import sys
import time

try:
    import cv2
    import numpy
    from cv2 import ximgproc
except ImportError as error:
    print(f"SKIPPED: {error}; Debian has it in python3-opencv")
    sys.exit(0)

WIDTH, HEIGHT = 1024, 768
ROUNDS = 5
BENCH = pathlib.Path(__file__).resolve().parents[2] / "build/release/bin/filter-bench"


def noisy_steps(channels, seed):
    """The planes of filter-bench: steps of 64 pixels with noise on top, in [0, 1]."""
    noise = numpy.random.default_rng(seed).random((HEIGHT, WIDTH, channels), dtype=numpy.float32)
    y, x = numpy.mgrid[0:HEIGHT, 0:WIDTH] // 64
    steps = numpy.stack([(x * (k + 3) + y * (2 * k + 1)) % 5 for k in range(channels)], axis=-1)
    return ((steps + noise) / 6).astype(numpy.float32)


def opencv_seconds(signal, guide):
    # The same sigma_r as ours, whose planes run from 0 to 6. Its tree has ceil(3 (1 - sigma_r)) = 3 levels: 7
    # manifolds.
    manifolds = ximgproc.createAMFilter(16, 1 / 6, False)
    start = time.process_time()
    manifolds.filter(signal, None, guide)
    return time.process_time() - start


def our_seconds(bench):
    done = subprocess.run(
        [bench, "--benchmark_filter=BM_SevenManifolds", "--benchmark_format=json"],
        check=True, capture_output=True, text=True)
    return json.loads(done.stdout)["benchmarks"][0]["cpu_time"] / 1000


def main(bench=BENCH):
    cv2.setNumThreads(1)
    signal, guide = noisy_steps(3, 1), noisy_steps(9, 2)
    rounds = [(opencv_seconds(signal, guide), our_seconds(bench)) for _ in range(ROUNDS)]
    theirs, ours = (min(column) for column in zip(*rounds))
    print(f"OpenCV {cv2.__version__}: {theirs:.3f} s; ours: {ours:.3f} s; ratio {theirs / ours:.1f}")


if __name__ == "__main__":
    main(*sys.argv[1:])
