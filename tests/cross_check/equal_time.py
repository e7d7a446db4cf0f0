"""Measures how fast Lumifold and Cycles trace, and the noise of their unfiltered pictures after equal time.

    equal_time.py [--blender PROGRAM]... [--size WxH] [--few N] [--many N] [--rounds N] [SCENE ...]

SCENE is a generated scene; one of LUMIFOLD_SCENES_DIR, whose sky is NAME-sky.exr, turned by 90 degrees; or
"exported-NAME", a generated scene as the first Blender's exporter writes it. A round renders FEW and MANY
samples with each renderer in turns, on one thread. Speed is that of the samples between the two, so that
loading is excluded, in samples per second of processor time. "relMSE" is the variance of a picture of MANY
samples over the rounds' seeds, relative to the squared mean with 1 % of the picture's own squared mean added.
Ratios are Lumifold's over Cycles': "speed", the median over rounds, and "error x time", what Cycles' relMSE
would be over ours after equal time. "mean" is Cycles' mean over ours, which tells whether both show the same.
Needs the Blenders named, else that of LUMIFOLD_BLENDER, else `blender`, and the programs of LUMIFOLD_BIN.
"""

import argparse
import os
import pathlib
import resource
import shlex
import statistics
import subprocess
import sys
import tempfile
from typing import NamedTuple

from cross_check import HERE, PROGRAMS, SKIPPED, blender, exr, run

DEFAULT_SCENES = ("cornell-box", "exported-cornell-box", "meeting-room", "atrium")
SKY_DEGREES = 90  # of the scenes of LUMIFOLD_SCENES_DIR
EXPORTED = "exported-"


class SceneFile(NamedTuple):
    name: str
    glb: pathlib.Path
    sky: pathlib.Path | None


class Lumifold:
    label = "Lumifold"

    def __init__(self, scene, size):
        self.command = [
            PROGRAMS / "lumifold", "render", scene.glb, "--size", size, "--method", "none", "--threads", 1
        ]
        if scene.sky is not None:
            self.command += ["--env", scene.sky, "--env-rotate", SKY_DEGREES]

    def render(self, samples, seed, path):
        """Seconds of processor time."""

        def used():
            children = resource.getrusage(resource.RUSAGE_CHILDREN)
            return children.ru_utime + children.ru_stime

        before = used()
        run([*self.command, "--spp", samples, "--seed", seed, "-o", path])
        return used() - before

    def close(self):
        pass


class Cycles:
    """A Blender that has loaded the scene and renders on request."""

    def __init__(self, program, scene, size, materials="principled"):
        sky = scene.sky or "-"
        command = blender.command(HERE / "cycles_renders.py", scene.glb, size, materials, sky, SKY_DEGREES)
        self.process = subprocess.Popen([*shlex.split(program), *map(str, command[1:])],
                                        env=blender.ENVIRONMENT,
                                        stdin=subprocess.PIPE,
                                        stdout=subprocess.PIPE,
                                        text=True)
        self.label = f"Cycles, {program} {materials}"

    def ask(self, *words):
        print(*words, file=self.process.stdin, flush=True)
        for line in self.process.stdout:
            if line.startswith("Blender "):
                self.label = f"{line.strip().split(' (')[0]}, {self.label.split()[-1]}"
            if line.startswith("SECONDS "):
                return float(line.split()[1])
        sys.exit(f"{self.label} ended without an answer to {words}")

    def render(self, samples, seed, path):
        return self.ask(samples, seed, path)

    def close(self):
        self.process.stdin.close()
        self.process.stdout.read()
        self.process.wait()


def generate(name, folder):
    run([PROGRAMS / "lumifold-scenes", "--out", folder, name])
    return folder / f"{name}.glb"


def find_scene(name, folder, program):
    others = pathlib.Path(os.environ.get("LUMIFOLD_SCENES_DIR", "/nonexistent"))
    if (others / f"{name}.glb").exists():
        sky = others / f"{name}-sky.exr"
        return SceneFile(name, others / f"{name}.glb", sky if sky.exists() else None)
    if not name.startswith(EXPORTED):
        return SceneFile(name, generate(name, folder), None)
    exporter = Cycles(program, SceneFile(name, generate(name.removeprefix(EXPORTED), folder), None), "64x48")
    exporter.ask("EXPORT", folder / f"{name}.glb")
    exporter.close()
    return SceneFile(name, folder / f"{name}.glb", None)


def relative_error(pictures):
    """The variance of one of several pictures that differ only by their seeds, over the squared mean."""
    variances = [statistics.variance(values) for values in zip(*pictures)]
    means = [statistics.fmean(values) for values in zip(*pictures)]
    floor = 0.01 * statistics.fmean(means) ** 2
    return statistics.fmean(v / (m * m + floor) for v, m in zip(variances, means))


class Measured(NamedTuple):
    label: str
    rates: list  # of each round, samples per second
    error: float
    mean: float


def measure(renderers, options, folder):
    """All renderers of a scene in turns."""
    width, height = map(int, options.size.split("x"))
    samples = width * height * (options.many - options.few)
    rates, pictures = [[] for _ in renderers], [[] for _ in renderers]
    for renderer in renderers:
        renderer.render(1, 1, folder / "first.exr")  # loads what all renders need
    for seed in range(1, options.rounds + 1):
        for i, renderer in enumerate(renderers):
            few = renderer.render(options.few, seed, folder / "few.exr")
            many = renderer.render(options.many, seed, folder / "many.exr")
            rates[i].append(samples / (many - few))
            pictures[i].append(exr.read(folder / "many.exr").mean_of_colors())
    return [
        Measured(renderer.label, rates[i], relative_error(pictures[i]),
                 statistics.fmean(map(statistics.fmean, pictures[i]))) for i, renderer in enumerate(renderers)
    ]


def print_scene(name, ours, others):
    print(f"{name}, {ours.label:27} {statistics.median(ours.rates) / 1e6:8.3f} {ours.error:9.5f}")
    for other in others:
        speed = [a / b for a, b in zip(ours.rates, other.rates)]
        at_equal_time = statistics.median(speed) * other.error / ours.error
        print(f"{name}, {other.label:27} {statistics.median(other.rates) / 1e6:8.3f} {other.error:9.5f}"
              f" {statistics.median(speed):6.2f} [{min(speed):.2f}, {max(speed):.2f}] {at_equal_time:7.2f}"
              f" {other.mean / ours.mean:6.3f}",
              flush=True)


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--blender", action="append", help="a command; may be given several times")
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--few", type=int, default=2)
    parser.add_argument("--many", type=int, default=10)
    parser.add_argument("--rounds", type=int, default=5, help="2 or more")
    parser.add_argument("scenes", nargs="*", default=DEFAULT_SCENES, metavar="SCENE")
    return parser.parse_args()


def main():
    options = parse_arguments()
    programs = options.blender or [blender.PROGRAM]
    if programs == [None]:
        print(f"SKIPPED: {blender.MISSING}")
        return SKIPPED
    print(f"M samples/s, relMSE of {options.many} samples, speed [least, most], error x time, mean")
    with tempfile.TemporaryDirectory() as temporary:
        folder = pathlib.Path(temporary)
        for name in options.scenes:
            scene = find_scene(name, folder, programs[0])
            renderers = [Lumifold(scene, options.size)]
            renderers += [Cycles(program, scene, options.size) for program in programs]
            if name == "cornell-box":  # every surface in it is matte: what the scene asks for
                renderers += [Cycles(program, scene, options.size, "diffuse") for program in programs]
            ours, *others = measure(renderers, options, folder)
            for renderer in renderers:
                renderer.close()
            print_scene(name, ours, others)
    return 0


if __name__ == "__main__":
    sys.exit(main())
