"""One farm of two Debians: a coordinator and a worker of this machine, and a worker in the root of another
system. Each job is rendered by workers of one system, and its pixels are those of that system alone."""

import json
import os
import pathlib
import shutil
import tempfile
import types
import unittest

from farm import BIN, Farm, Process, make_scene, run, wait_until

ROOT = pathlib.Path(os.environ["LUMIFOLD_OTHER_SYSTEM"])
OTHER_BIN = pathlib.Path("/lumifold/build/release/bin")
SETTINGS = ["--size", "160x120", "--spp", "64", "--seed", "5"]


class TwoSystemsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        cls.other_folder = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory(dir=ROOT / "tmp")))
        cls.inside = types.SimpleNamespace(prefix=("chroot", str(ROOT)))
        cls.scene = make_scene("cornell-box", cls.root)
        shutil.copy(cls.scene, cls.other_folder)
        in_root = pathlib.Path("/") / cls.other_folder.relative_to(ROOT)
        run("lumifold", "render", cls.scene, *SETTINGS, "--threads", 2, "-o", cls.root / "ours.exr")
        run(OTHER_BIN / "lumifold",
            "render",
            in_root / cls.scene.name,
            *SETTINGS,
            "--threads",
            2,
            "-o",
            in_root / "other.exr",
            host=cls.inside)

    def mse(self, one, other):
        return json.loads(run("lumifold", "compare", one, other, "--json").stdout)["mse255"]

    def classes(self, farm):
        lines = farm.client("workers", "--json").stdout.splitlines()
        return {worker["name"]: worker["class"] for worker in map(json.loads, lines)}

    def picture(self, farm, job):
        result = self.root / f"{job}.exr"
        farm.client("wait", job)
        farm.client("download", job, "-o", result)
        return result

    def test_each_job_is_of_one_system(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.workers.append(
                Process(OTHER_BIN / "lumifold-worker",
                        "--server",
                        farm.address,
                        "--threads",
                        1,
                        "--name",
                        "other",
                        host=self.inside))
            begun = farm.client("submit", self.scene, *SETTINGS).stdout.strip()
            wait_until(lambda: farm.status(begun)["units_done"] > 0, "a unit of the other system")
            farm.start_worker("--name", "ours")
            classes = wait_until(lambda: len(found := self.classes(farm)) == 2 and found, "both workers")
            self.assertNotEqual(classes["other"], classes["ours"])
            new = farm.client("submit", self.scene, *SETTINGS, "--class", classes["ours"]).stdout.strip()
            for job, reference in ((begun, self.other_folder / "other.exr"), (new, self.root / "ours.exr")):
                self.assertEqual(self.mse(self.picture(farm, job), reference), 0, job)
        print(
            f"the systems' pictures of one seed differ by {self.mse(self.root / 'ours.exr', self.other_folder / 'other.exr'):.4g} MSE255"
        )


if __name__ == "__main__":
    unittest.main()
