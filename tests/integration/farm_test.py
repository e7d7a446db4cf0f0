"""A farm of processes writes the same file as one process, byte for byte, whichever of them is killed."""

import json
import os
import pathlib
import re
import tempfile
import unittest

from farm import Farm, make_scene, run, wait_until
from gltf import animate


class SceneTest(unittest.TestCase):
    """One scene, rendered in one process with the SETTINGS of the class."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.scene = make_scene("cornell-box", cls.root)
        cls.expected = cls.root / "one-process.exr"
        run("lumifold", "render", cls.scene, *cls.SETTINGS, "--threads", "2", "-o", cls.expected)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def submit(self, farm):
        return farm.client("submit", self.scene, *self.SETTINGS).stdout.strip()

    def expect_same_picture(self, farm, job):
        result = self.root / f"{job}.exr"
        farm.client("wait", job)
        farm.client("download", job, "-o", result)
        self.assertEqual(result.read_bytes(), self.expected.read_bytes())


class FarmTest(SceneTest):
    SETTINGS = ["--size", "112x84", "--spp", "96", "--seed", "5", "--save-film"]

    def submit_and_wait_for_units(self, farm):
        """Submits a job and waits until a fifth of its units is committed; nearly all must not be committed
        yet.

        On a busy machine a poll may come so late that the job is nearly done. Then there is nothing left to
        disturb, and a new job is submitted.
        """
        for _ in range(20):
            job = self.submit(farm)

            def share():
                status = farm.status(job)
                done = status["units_done"] / status["units_total"]
                return done if done >= 0.2 else None

            if wait_until(share, "a fifth of the units") < 0.9:
                return job
        raise AssertionError("each of 20 jobs was nearly done when it was polled")

    def test_a_killed_worker_changes_nothing(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            workers = [farm.start_worker() for _ in range(3)]
            job = self.submit_and_wait_for_units(farm)
            workers[0].kill()
            self.expect_same_picture(farm, job)

    def test_a_killed_coordinator_goes_on_from_its_ledger(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker()
            job = self.submit_and_wait_for_units(farm)
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

    def test_a_worker_yields_to_other_programs(self):
        own = os.getpriority(os.PRIO_PROCESS, 0)
        for arguments, niceness in (((), max(own, 10)), (("--nice", "0"), own)):
            with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
                worker = farm.start_worker(*arguments)
                self.expect_same_picture(farm, self.submit(farm))
                threads = [
                    int(task.name) for task in pathlib.Path(f"/proc/{worker.popen.pid}/task").iterdir()
                ]
                found = {os.getpriority(os.PRIO_PROCESS, thread) for thread in threads}
                self.assertEqual(found, {niceness}, arguments)

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


class PlanTest(SceneTest):
    """Jobs obey their plans: the planned picture is the full one, and whoever is killed, a job has one
    plan."""

    SETTINGS = ["--size", "96x72", "--spp", "16", "--seed", "3", "--save-film"]
    # The units of a full plan: with them the bits are those of a full plan.
    UNITS = ["--force", "tile-size=32", "--force", "pass-samples=64"]

    def explain(self, farm, job):
        return json.loads(farm.client("explain", job, "--json").stdout)

    def plan(self, farm, job):
        """The values of the plan's decisions by name; None while the job has none."""
        plan = self.explain(farm, job).get("plan")
        return {d["name"]: d["value"] for d in plan["decisions"]} if plan else None

    def test_the_planned_picture_is_the_full_one(self):
        planned, full = self.root / "auto.exr", self.root / "full.exr"
        run("lumifold", "render", self.scene, *self.SETTINGS, *self.UNITS, "-o", planned)
        run("lumifold", "render", self.scene, *self.SETTINGS, "--plan", "full", "-o", full)
        difference = json.loads(run("lumifold", "compare", planned, full, "--json").stdout)
        self.assertEqual(difference["mse255"], 0)
        self.assertEqual(difference["rel_mse"], 0)
        self.assertIn(b"glossy=off:scene", planned.read_bytes())
        self.assertIn(b"tile-size=32:forced", planned.read_bytes())
        self.assertIn(b"glossy=on:full", full.read_bytes())
        self.assertIn(b"glossy_albedo.R", full.read_bytes())
        self.assertNotIn(b"glossy_albedo.R", planned.read_bytes())

    def test_tiles_are_leased_costliest_first_and_the_picture_has_the_same_bits(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            pictures = []
            for order in ["on", "off"]:
                job = farm.client("submit", self.scene, *self.SETTINGS, *self.UNITS,
                                  "--force", f"costliest-first={order}").stdout.strip()
                if order == "on":
                    worker = farm.start_worker("--log-level", "debug")
                farm.client("wait", job)
                pictures.append(self.root / f"{order}.exr")
                farm.client("download", job, "-o", pictures[-1])
                planned = self.explain(farm, job)["plan"]["tile_order"]
                rendered = re.findall(rf"event=unit_rendered job={job} .*tile=(\d+) pass=1 kind=pass",
                                      worker.log_text())
                if order == "on":
                    self.assertEqual([int(tile) for tile in rendered], planned)
                else:
                    self.assertEqual(planned, [])
            difference = json.loads(run("lumifold", "compare", *pictures, "--json").stdout)
            self.assertEqual(difference["mse255"], 0)
            self.assertEqual(difference["rel_mse"], 0)

    def test_explain_shows_the_plan(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = self.submit(farm)
            self.assertIsNone(self.plan(farm, job))
            self.assertEqual(farm.status(job)["state"], "submitted")
            farm.start_worker(threads=2)
            self.expect_same_picture(farm, job)
            printed = json.loads(run("lumifold", "plan", self.scene, *self.SETTINGS, "--json").stdout)
            shown = self.explain(farm, job)["plan"]
            self.assertEqual(shown, printed)
            self.assertIn("glossy ", farm.client("explain", job).stdout)
            farm.client("delete", job)
            self.assertNotEqual(farm.client("explain", job, check=False).returncode, 0)

    def test_a_worker_killed_while_it_plans_changes_nothing(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            worker = farm.start_worker()
            wait_until(lambda: "worker_connected" in farm.server.log_text(), "a connected worker")
            worker.pause()
            job = self.submit(farm)
            wait_until(lambda: farm.status(job)["workers"] == 1, "a lease of the plan unit")
            self.assertEqual(farm.status(job)["units_total"], 1)
            worker.kill()
            farm.start_worker()
            self.expect_same_picture(farm, job)

    def test_a_coordinator_killed_before_and_after_the_plan_has_one(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = self.submit(farm)
            farm.server.kill()
            farm.start_server(listen=farm.address)
            self.assertIsNone(self.plan(farm, job))
            farm.start_worker()
            plan = wait_until(lambda: self.plan(farm, job), "a plan")
            farm.server.kill()
            farm.start_server(listen=farm.address)
            self.assertEqual(self.plan(farm, job), plan)
            self.expect_same_picture(farm, job)
            self.assertEqual(self.plan(farm, job), plan)

    def test_what_cannot_be_forced_is_refused(self):
        bad = run("lumifold",
                  "render",
                  self.scene,
                  *self.SETTINGS,
                  "--force",
                  "levels=9",
                  "-o",
                  self.root / "no.exr",
                  check=False)
        self.assertEqual(bad.returncode, 2)
        self.assertIn("levels is a whole number from 0 to 3", bad.stderr)


class FramesTest(unittest.TestCase):
    """Animations from the command line to the files."""

    SETTINGS = ["--size", "96x72", "--spp", "32", "--fps", "8"]

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.still = make_scene("cornell-box", cls.root)
        cls.moving = animate(cls.still, cls.root / "moving.glb", "short block", 4)
        for scene in (cls.still, cls.moving):
            run("lumifold", "render", scene, *cls.SETTINGS, "--frames", "3-5", "-o",
                cls.root / f"{scene.stem}.###.exr")

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def difference(self, first, second):
        """Mean squared error in 8-bit steps between two of the pictures."""
        done = run("lumifold", "compare", self.root / first, self.root / second, "--json")
        return json.loads(done.stdout)["mse255"]

    def test_frames_of_a_still_scene_differ_by_noise_alone(self):
        difference = self.difference("cornell-box.003.exr", "cornell-box.005.exr")
        self.assertGreater(difference, 0)
        self.assertLess(difference, 15)

    def test_an_animated_scene_moves(self):
        self.assertGreater(self.difference("moving.003.exr", "moving.004.exr"), 60)
        self.assertGreater(self.difference("moving.003.exr", "moving.005.exr"), 60)

    def test_a_frame_is_the_same_alone_and_from_any_worker(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker()
            farm.start_worker(threads=2)
            job = farm.client("submit", self.moving, *self.SETTINGS, "--frames", "3-5").stdout.strip()
            alone = farm.client("submit", self.moving, *self.SETTINGS, "--frame", "4").stdout.strip()
            farm.client("wait", job)
            self.assertEqual(farm.status(job)["frames_done"], 3)
            farm.client("download", job, "--frames", "3-5", "-o", self.root / "farm.###.exr")
            farm.client("wait", alone)
            farm.client("download", alone, "--frame", "4", "-o", self.root / "alone.exr")
        for frame in ("003", "004", "005"):
            expected = (self.root / f"moving.{frame}.exr").read_bytes()
            self.assertEqual((self.root / f"farm.{frame}.exr").read_bytes(), expected, frame)
        self.assertEqual((self.root / "alone.exr").read_bytes(), (self.root / "moving.004.exr").read_bytes())


if __name__ == "__main__":
    unittest.main()
