"""Measures how fast Lumifold and Cycles trace, and the noise of their unfiltered pictures after equal time.

    equal_time.py [SCENE ...]        generated scenes; default cornell-box meeting-room atrium

Time is processor time of all threads for MANY samples minus that for FEW, so that loading is excluded. "error
x time" is the mean relative squared error (squared error over the squared mean, with 1 % of the picture's own
squared mean added) of a picture times the seconds it took: it does not depend on the number of samples. The
ratio says how much larger Cycles' error is after equal time. Needs the Blender that LUMIFOLD_BLENDER names,
else `blender`, and the programs of LUMIFOLD_BIN.
"""

import pathlib
import resource
import sys
import tempfile

from cross_check import PROGRAMS, SKIPPED, blender, exr, run, run_blender

WIDTH, HEIGHT = 256, 192
FEW, MANY = 8, 64
THREADS = 2


def relative_error(first, second):
    """Mean relative squared error of one of two renders that differ only by their seed."""
    a, b = exr.read(first).mean_of_colors(), exr.read(second).mean_of_colors()
    floor = 0.01 * (sum(a) / len(a)) ** 2
    return sum((x - y) ** 2 / 2 / (((x + y) / 2) ** 2 + floor) for x, y in zip(a, b)) / len(a)


def time_cycles(glb, materials, folder):
    """Seconds of MANY minus FEW samples, and error of MANY."""
    out = folder / f"{glb.stem}-{materials}"
    printed = run_blender("cycles_speed.py", glb, out, materials, FEW, MANY, f"{WIDTH}x{HEIGHT}")
    line = next(line for line in printed.splitlines() if line.startswith("SECONDS "))
    few, many = map(float, line.split()[1:])
    return many - few, relative_error(f"{out}-1.exr", f"{out}-2.exr")


def seconds_of_ours(glb, path, samples, seed):
    def used():
        children = resource.getrusage(resource.RUSAGE_CHILDREN)
        return children.ru_utime + children.ru_stime

    before = used()
    options = [
        "--size", f"{WIDTH}x{HEIGHT}", "--spp", samples, "--seed", seed, "--method", "none", "--threads",
        THREADS
    ]
    run([PROGRAMS / "lumifold", "render", glb, "-o", path, *options])
    return used() - before


def time_ours(glb, folder):
    paths = [folder / f"{glb.stem}-ours-{seed}.exr" for seed in (1, 2)]
    few = min(seconds_of_ours(glb, folder / "few.exr", FEW, seed) for seed in (1, 2))
    many = min(seconds_of_ours(glb, path, MANY, seed) for path, seed in zip(paths, (1, 2)))
    return many - few, relative_error(*paths)


def print_line(name, seconds, error, ours=None):
    samples = WIDTH * HEIGHT * (MANY - FEW) * THREADS / seconds / 1e6
    cost = seconds * error
    ratio = f"{cost / ours:7.2f}" if ours else ""
    print(f"{name:28} {samples:12.3f} {error:12.5f} {cost:13.4f} {ratio}", flush=True)
    return cost


def main():
    if blender.PROGRAM is None:
        print(f"SKIPPED: {blender.MISSING}")
        return SKIPPED
    print(f"{'':28} {'M samples/s':>12} {'relMSE':>12} {'error x time':>13} {'ratio':>7}")
    print(f"{'':28} {'2 threads':>12} {f'{MANY} spp':>12}")
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        for scene in sys.argv[1:] or ("cornell-box", "meeting-room", "atrium"):
            run([PROGRAMS / "lumifold-scenes", "--out", folder, scene])
            glb = folder / f"{scene}.glb"
            ours = print_line(f"{scene}, lumifold", *time_ours(glb, folder))
            print_line(f"{scene}, Cycles principled", *time_cycles(glb, "principled", folder), ours)
            if scene == "cornell-box":  # every surface in it is matte: what the scene asks for
                print_line(f"{scene}, Cycles diffuse", *time_cycles(glb, "diffuse", folder), ours)
    return 0


if __name__ == "__main__":
    sys.exit(main())
