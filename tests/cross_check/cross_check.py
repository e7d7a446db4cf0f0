"""Compares Lumifold with Blender's Cycles on scenes that Blender builds and exports itself.

    cross_check.py [--samples N] [--size WxH] [--bounces N] [--keep FOLDER] [SCENE ...]

prints for each scene and camera the difference of every region in percent of Cycles' mean, with its standard
deviation. Fails if a region differs by more than 1 % (8 % for rough metals, which Cycles models differently
until 3.6) and three standard deviations. Needs the Blender that LUMIFOLD_BLENDER names, else `blender`
(without it the test reports that it is skipped), and the programs of LUMIFOLD_BIN.
"""

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile

import regions

HERE = pathlib.Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "support"))

import blender
import exr
import gltf

PROGRAMS = pathlib.Path(os.environ.get("LUMIFOLD_BIN", HERE.parents[1] / "build/release/bin"))
SKIPPED = 77  # exit code that ctest reports as "skipped"
ALLOWED_PERCENT = 1
ALLOWED_DEVIATIONS = 3
# Multiple scattering between microfacets: both preserve its energy, but Cycles simulates it by random walks
# until 3.6 and Lumifold distributes it like single scattering (docs/results/cycles-cross-check.md, difference
# 4).
ALLOWED_PERCENT_OF_ROUGH_METAL = 8

SCENES = ("diffuse-room", "sun-and-points", "metal-balls", "glass-things", "instances", "environment",
          "animation", "lens")


def run(command, **options):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, **options)
    if done.returncode != 0:
        sys.exit(
            f"{' '.join(map(str, command))}\nexit {done.returncode}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
        )
    return done.stdout


def run_blender(script, *arguments):
    """Runs a script of ours in Blender; gives what it prints."""
    return run(blender.command(HERE / script, *arguments), env=blender.ENVIRONMENT)


def render_reference(scene, folder, samples, size, bounces):
    """Builds, exports and renders with Blender; gives the cameras' names."""
    run_blender("blender_scenes.py", scene, folder, samples, size, bounces)
    # Blender 3.4 writes Principled's specular 0, which reflects nothing, as a black specularColorFactor.
    gltf.turn_black_specular_off(folder / f"{scene}.glb")
    return sorted(path.name.split(".")[1] for path in folder.glob(f"{scene}.*.cycles-1.exr"))


def render_ours(scene, camera, folder, samples, size, bounces, seed):
    path = folder / f"{scene}.{camera}.lumifold-{seed}.exr"
    command = [
        PROGRAMS / "lumifold", "render", folder / f"{scene}.glb", "-o", path, "--size", size, "--spp",
        samples, "--seed", seed
    ]
    command += ["--camera", camera, "--method", "none", "--max-bounces", bounces, "--threads", 2]
    command += ["--frame", 10] if scene == "animation" else []
    command += ["--env", folder / "sky.exr"] if scene == "environment" else []
    command += ["--f-stop", 0.5, "--focus", 5] if scene == "lens" else []
    run(command)
    return exr.read(path)


def check(scene, camera, folder, samples, size, bounces):
    """Prints the table of one picture; gives the names of regions that differ too much."""
    pictures = [render_ours(scene, camera, folder, samples, size, bounces, seed) for seed in (1, 2)]
    references = [exr.read(folder / f"{scene}.{camera}.cycles-{seed}.exr") for seed in (1, 2)]
    ours = regions.Estimate(*(picture.mean_of_colors() for picture in pictures))
    reference = regions.Estimate(*(picture.mean_of_colors() for picture in references))
    areas = {"whole picture": range(len(ours.mean))}
    areas |= regions.grid_regions(pictures[0].width, pictures[0].height)
    areas |= regions.object_regions(pictures[0].channels["id.Y"])
    print(f"\n{scene}, {camera}\n{'region':24} {'Cycles':>9} {'difference %':>13} {'deviation %':>12}")
    bad = []
    for name, mean, difference, deviation in regions.compare(ours, reference, areas):
        random_walks = scene == "metal-balls" and blender.version() < (4, 0)
        allowed = ALLOWED_PERCENT_OF_ROUGH_METAL if random_walks else ALLOWED_PERCENT
        too_much = abs(difference) > allowed + ALLOWED_DEVIATIONS * deviation
        print(f"{name:24} {mean:9.4f} {difference:13.2f} {deviation:12.2f}{'  <--' if too_much else ''}",
              flush=True)
        if too_much:
            bad.append(f"{scene}, {camera}: {name} {difference:+.2f} %")
    return bad


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--samples", type=int, default=256, help="per pixel and seed; there are two seeds")
    parser.add_argument("--size", default="192x144")
    parser.add_argument("--bounces", type=int, default=8, help="after the first surface, for both")
    parser.add_argument("--keep", type=pathlib.Path, help="folder that keeps scenes and pictures")
    parser.add_argument("scenes", nargs="*", choices=[*SCENES, []], metavar="SCENE", help=", ".join(SCENES))
    return parser.parse_args()


def main():
    options = parse_arguments()
    if blender.PROGRAM is None:
        print(f"SKIPPED: {blender.MISSING}")
        return SKIPPED
    settings = (options.samples, options.size, options.bounces)
    bad = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.keep or pathlib.Path(temporary)
        folder.mkdir(exist_ok=True)
        for scene in options.scenes or SCENES:
            for camera in render_reference(scene, folder, *settings):
                bad += check(scene, camera, folder, *settings)
    print("\n" + "\n".join(bad or ["no region differs by more than is allowed"]))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
