"""The filter never makes a picture worse: for every generated scene and sample count the error of the
filtered picture is at most that of the noisy one, in the whole picture and on edges, mirrors, shadow bands,
textures and flat surfaces."""

import json
import math
import pathlib
import tempfile
import typing
import unittest

from farm import make_scene, run

MINUTES = 60
SLACK_SIGMAS = 2


class Series(typing.NamedTuple):
    """Scenes and sample counts; the reference has at least four times the largest sample count."""

    scenes: tuple[str, ...]
    width: int
    height: int
    sample_counts: tuple[int, ...]
    reference_samples: int
    seeds: int = 1


SCENES = ("cornell-box", "meeting-room", "bedroom", "atrium")
NOISY = Series(SCENES, 128, 96, (1, 4, 16, 64), 1024)
CLEAN = Series(SCENES, 64, 48, (256, 1024, 4096), 16384)
# Most pixels are on edges, beside pixels that are many times brighter and noisier. A part of two pixels can
# have next to no noise by chance, so errors are means over seeds.
SMALL = tuple(
    Series(SCENES, width, height, (256, 1024), 16384, seeds=8) for width, height in ((16, 12), (24, 18)))


class Part(typing.NamedTuple):
    """A part of a picture: its number of pixels and its MSE255, the mean over all seeds."""

    pixels: float
    error: float


def slack(part):
    """Allowed increase of a part's mean squared error: SLACK_SIGMAS standard deviations. For Gaussian noise
    the mean of the squared errors of n pixels has a relative standard deviation of sqrt(2 / n). The channels
    of a pixel are correlated and count once. The noise of the reference is in the errors of both pictures, so
    its effect on their difference is within the same bound."""
    return SLACK_SIGMAS * math.sqrt(2 / part.pixels) * part.error


class QualityTest(unittest.TestCase):
    def render(self, scene, series, samples, seed, method, output):
        run("lumifold",
            "render",
            scene,
            "--size",
            f"{series.width}x{series.height}",
            "--spp",
            samples,
            "--seed",
            seed,
            "--method",
            method,
            "--save-film",
            "-o",
            output,
            timeout=10 * MINUTES)

    def errors(self, series, picture, layer, reference, reference_layer):
        """The Part of each region of the picture, and of the 'whole'."""
        found = json.loads(
            run("lumifold", "compare", picture, reference, *layer, "--reference-layer", reference_layer,
                "--by-region", "--json").stdout)
        pixels = series.width * series.height
        parts = {
            name: Part(region["share"] * pixels, region["mse255"])
            for name, region in found["regions"].items()
        }
        return {"whole": Part(pixels, found["mse255"]), **parts}

    def mean_errors(self, series, pictures, layer, reference):
        """The Parts over all pictures."""
        parts = [self.errors(series, picture, layer, reference, "noisy") for picture in pictures]
        return {name: Part(parts[0][name].pixels, sum(part[name].error for part in parts) / len(parts))
                for name in parts[0]}

    def check_pictures(self, series, pictures, reference, title):
        # The halves of the reference differ by twice its noise, so it adds a quarter of their squared
        # difference to each error.
        halves = self.errors(series, reference, ("--layer", "noisy_a"), reference, "noisy_b")
        noisy = self.mean_errors(series, pictures, ("--layer", "noisy"), reference)
        filtered = self.mean_errors(series, pictures, (), reference)
        for name, part in noisy.items():
            with self.subTest(picture=title, part=name):
                own = halves[name].error / 4
                before = part._replace(error=part.error - own)
                after = filtered[name].error - own
                print(
                    f"{title}, {name}: {part.pixels:.0f} pixels, MSE255 {before.error:.3f} noisy, {after:.3f} filtered"
                )
                self.assertLessEqual(after, before.error + slack(before))

    def check_series(self, series):
        for name in series.scenes:
            with tempfile.TemporaryDirectory() as folder:
                root = pathlib.Path(folder)
                scene = make_scene(name, root)
                reference = root / "reference.exr"
                self.render(scene, series, series.reference_samples, 777, "none", reference)
                for samples in series.sample_counts:
                    pictures = [root / f"{samples}.{seed}.exr" for seed in range(1, series.seeds + 1)]
                    for seed, picture in enumerate(pictures, 1):
                        self.render(scene, series, samples, seed, "default", picture)
                    self.check_pictures(series, pictures, reference,
                                        f"{name} {series.width}x{series.height}, {samples} spp")

    def test_no_noisy_picture_gets_worse(self):
        self.check_series(NOISY)

    def test_no_picture_of_many_samples_gets_worse(self):
        self.check_series(CLEAN)

    def test_no_picture_of_few_pixels_gets_worse(self):
        for series in SMALL:
            self.check_series(series)


if __name__ == "__main__":
    unittest.main()
