"""A farm of real processes gives the picture one process gives, byte for byte, whatever is killed."""

import os
import pathlib
import tempfile
import unittest

from farm import Farm, make_scene, run, wait_until

SETTINGS = ["--size", "160x120", "--spp", "96", "--seed", "5", "--save-film"]


class FarmTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.scene = make_scene("cornell-box", cls.root)
        cls.expected = cls.root / "one-process.exr"
        run("lumifold", "render", cls.scene, *SETTINGS, "--threads", "2", "-o", cls.expected)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def submit(self, farm):
        return farm.client("submit", self.scene, *SETTINGS).stdout.strip()

    def expect_same_picture(self, farm, job):
        result = self.root / f"{job}.exr"
        farm.client("wait", job)
        farm.client("download", job, "-o", result)
        self.assertEqual(result.read_bytes(), self.expected.read_bytes())

    def await_units(self, farm, job, share):
        """Waits until this share of the job's units is merged, and no more than nine tenths."""
        wait_until(lambda: farm.status(job)["units_done"] >= share * farm.status(job)["units_total"], "units")
        self.assertLess(farm.status(job)["units_done"], 0.9 * farm.status(job)["units_total"], "too late to kill")

    def test_a_killed_worker_changes_nothing(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            workers = [farm.start_worker() for _ in range(3)]
            job = self.submit(farm)
            self.await_units(farm, job, 0.2)
            workers[0].kill()
            self.expect_same_picture(farm, job)

    def test_a_killed_coordinator_goes_on_from_its_ledger(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker()
            job = self.submit(farm)
            self.await_units(farm, job, 0.2)
            farm.server.kill()
            farm.start_server(listen=farm.address)
            self.assertGreater(farm.status(job)["units_done"], 0)
            self.expect_same_picture(farm, job)

    def test_a_worker_that_comes_late_is_put_to_work(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = self.submit(farm)
            self.assertEqual(farm.status(job)["units_done"], 0)
            farm.start_worker(threads=2)
            self.expect_same_picture(farm, job)

    def test_a_real_scene_renders(self):
        scenes = os.environ.get("LUMIFOLD_SCENES_DIR")
        if not scenes or not (pathlib.Path(scenes) / "staircase.glb").exists():
            self.skipTest("LUMIFOLD_SCENES_DIR names no folder with staircase.glb")
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker(threads=2)
            scene = pathlib.Path(scenes) / "staircase.glb"
            job = farm.client("submit", scene, "--size", "90x160", "--spp", "4").stdout.strip()
            farm.client("wait", job)
            result = self.root / "staircase.exr"
            farm.client("download", job, "-o", result)
            self.assertGreater(result.stat().st_size, 10_000)


if __name__ == "__main__":
    unittest.main()
