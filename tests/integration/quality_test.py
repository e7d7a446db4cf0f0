"""The filter never makes a picture worse: on every generated scene and sample count its error is below the unfiltered one."""

import json
import pathlib
import tempfile
import unittest

from farm import make_scene, run

SIZE = ["--size", "128x96"]
REFERENCE_SAMPLES = 1024
SAMPLE_COUNTS = (1, 4, 16, 64)
MINUTES = 60


class QualityTest(unittest.TestCase):
    def render(self, scene, samples, seed, method, output):
        run("lumifold", "render", scene, *SIZE, "--spp", samples, "--seed", seed, "--filter", method, "-o", output, timeout=10 * MINUTES)

    def error(self, picture, reference, *layer):
        return json.loads(run("lumifold", "compare", picture, reference, *layer, "--json").stdout)["mse255"]

    def test_filtered_error_is_below_the_noisy_one(self):
        for name in ("cornell-box", "meeting-room", "bedroom", "atrium"):
            with tempfile.TemporaryDirectory() as folder:
                root = pathlib.Path(folder)
                scene = make_scene(name, root)
                reference = root / "reference.exr"
                self.render(scene, REFERENCE_SAMPLES, 777, "none", reference)
                for samples in SAMPLE_COUNTS:
                    with self.subTest(scene=name, samples=samples):
                        picture = root / f"{samples}.exr"
                        self.render(scene, samples, 1, "default", picture)
                        noisy = self.error(picture, reference, "--layer", "noisy")
                        filtered = self.error(picture, reference)
                        print(f"{name} {samples} spp: MSE255 {noisy:.2f} noisy, {filtered:.2f} filtered")
                        self.assertLess(filtered, noisy)


if __name__ == "__main__":
    unittest.main()
