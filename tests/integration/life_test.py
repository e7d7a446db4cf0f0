"""Jobs get more samples, are rendered again in part, wait for each other and are deleted, whatever is killed
meanwhile.

Each picture is equal byte for byte to that of an undisturbed job.
"""

import contextlib
import json
import os
import pathlib
import random
import tempfile
import time
import unittest

from farm import Farm, make_scene, run, wait_until
from gltf import animate

FEW, MANY = 96, 200  # passes of 64 samples: 64 and 32; 64, 64, 64 and 8
SETTINGS = ["--size", "64x48", "--seed", "5", "--save-film"]
# The kills of a test fall anywhere within this time after the command.
KILL_WITHIN_SECONDS = 0.5


class LifeTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.scene = make_scene("cornell-box", cls.root)
        cls.expected = {}
        for samples in (FEW, MANY):
            picture = cls.root / f"{samples}.exr"
            run("lumifold", "render", cls.scene, *SETTINGS, "--spp", samples, "--threads", "2", "-o", picture)
            cls.expected[samples] = picture.read_bytes()

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @contextlib.contextmanager
    def farm(self, *server_arguments, workers=1):
        with tempfile.TemporaryDirectory() as data, Farm(data, *server_arguments) as farm:
            for _ in range(workers):
                farm.start_worker()
            yield farm

    def submit(self, farm, *arguments, samples=FEW):
        return farm.client("submit", self.scene, *SETTINGS, "--spp", samples, *arguments).stdout.strip()

    def done_job(self, farm, *arguments):
        job = self.submit(farm, *arguments)
        farm.client("wait", job)
        return job

    def expect_picture(self, farm, job, samples):
        farm.client("wait", job)
        result = self.root / f"{job}.exr"
        result.unlink(missing_ok=True)
        farm.client("download", job, "-o", result)
        self.assertEqual(result.read_bytes(), self.expected[samples])

    def kill_server_sometime(self, farm, seed):
        """SIGKILL at a moment that depends on the seed, then a start with the same data folder."""
        moment = random.Random(seed).uniform(0, KILL_WITHIN_SECONDS)
        time.sleep(moment)
        farm.server.kill()
        farm.start_server(listen=farm.address)
        return moment

    def test_added_samples_give_the_same_picture(self):
        with self.farm() as farm:
            job = self.done_job(farm)
            self.expect_picture(farm, job, FEW)
            farm.client("add-samples", job, MANY)
            self.assertGreater(farm.status(job)["units_done"], 0)  # what fits was kept
            self.expect_picture(farm, job, MANY)
            self.assertEqual(farm.status(job)["state"], "done")
            farm.client("add-samples", job, MANY)  # again: no effect
            self.assertEqual(farm.status(job)["state"], "done")

    def test_samples_are_added_while_the_job_runs(self):
        with self.farm(workers=2) as farm:
            job = self.submit(farm)
            wait_until(lambda: farm.status(job)["units_done"] > 0, "a unit")
            farm.client("add-samples", job, MANY)
            self.expect_picture(farm, job, MANY)

    def test_added_samples_survive_a_killed_coordinator(self):
        for seed in range(4):
            with self.subTest(seed=seed), self.farm() as farm:
                job = self.done_job(farm)
                farm.client("add-samples", job, MANY)
                self.kill_server_sometime(farm, seed)
                self.expect_picture(farm, job, MANY)

    def test_a_coordinator_killed_while_it_reopens_a_job(self):
        """The command may be lost, but nothing is half done: it can be repeated."""
        for seed in range(4):
            with self.subTest(seed=seed), self.farm() as farm:
                job = self.done_job(farm)
                for _ in range(5):
                    client = farm.start_client("retry", job, "--region", "0,0,40,40")
                    time.sleep(random.Random(seed).uniform(0, 0.2))
                    farm.server.kill()
                    client.wait()
                    farm.start_server(listen=farm.address)
                farm.client("add-samples", job, MANY)
                self.expect_picture(farm, job, MANY)

    def test_parts_are_rendered_again(self):
        with self.farm() as farm:
            job = self.done_job(farm)
            for arguments in (["--region", "10,10,40,20"], ["--filter-only"], ["--frames", "0"]):
                farm.client("retry", job, *arguments)
                self.expect_picture(farm, job, FEW)

    def test_a_cancelled_job_goes_on(self):
        with self.farm() as farm:
            job = self.submit(farm, samples=MANY)
            done = wait_until(lambda: farm.status(job)["units_done"], "a unit")
            farm.client("cancel", job)
            farm.client("retry", job)
            self.assertGreaterEqual(farm.status(job)["units_done"], done)
            self.kill_server_sometime(farm, 7)
            self.expect_picture(farm, job, MANY)

    def test_frames_that_cannot_be_rendered_are_skipped(self):
        """A block leaves the largest scene that is allowed from frame 3 on. Coordinators are killed meanwhile."""
        moving = animate(self.scene, self.root / "leaving.glb", "short block", 24 * 4e8)
        settings = [*SETTINGS, "--spp", 2, "--frames", "0-4", "--reproducible"]
        with self.farm(workers=2) as farm:
            job = farm.client("submit", moving, *settings[:-1]).stdout.strip()
            self.assertEqual(farm.client("wait", job, check=False).returncode, 1)
            self.assertIn("geometry reaches beyond", farm.status(job)["error"])
            farm.client("retry", job, "--skip")
            self.kill_server_sometime(farm, 5)
            waited = farm.client("wait", job, check=False)
            self.assertEqual((waited.returncode, waited.stdout), (6, "done-with-gaps\n"))
            status = farm.status(job)
            self.assertEqual((status["skipped"], status["frames_done"], status["frames_total"]), ("3-4", 3, 5))
            farm.server.kill()
            farm.start_server(listen=farm.address)
            self.assertEqual(farm.status(job)["skipped"], "3-4")
            pictures = self.root / "gaps.#.exr"
            done = farm.client("download", job, *settings[-3:], "-o", pictures, check=False)
            self.assertEqual(done.returncode, 6)
            self.assertIn("no picture of the frames 3-4", done.stderr)
            run("lumifold", "render", moving, *SETTINGS, "--spp", 2, "--frames", "0-2", "--threads", 2,
                "--reproducible", "-o", self.root / "alone.#.exr")
            for frame in range(3):
                self.assertEqual((self.root / f"gaps.{frame}.exr").read_bytes(),
                                 (self.root / f"alone.{frame}.exr").read_bytes())
            self.assertFalse((self.root / "gaps.3.exr").exists())
            farm.client("retry", job, "--frames", "4")
            self.assertEqual(farm.status(job)["skipped"], "3")

    def test_usage_counts_once_and_outlives_jobs(self):
        with self.farm(workers=2) as farm:
            jobs = [self.submit(farm, "--user", user) for user in ("ann", "ben")]
            self.kill_server_sometime(farm, 2)
            for job in jobs:
                farm.client("wait", job)

            def usage():
                lines = farm.client("usage", "--json").stdout.splitlines()
                return {line["job_id"]: line for line in map(json.loads, lines)}

            before = usage()
            for job, user in zip(jobs, ("ann", "ben")):
                status = farm.status(job)
                self.assertEqual((before[job]["user"], before[job]["units"], before[job]["frames"]),
                                 (user, status["units_done"], 1))
                self.assertGreater(before[job]["render_core_seconds"], 0)
                self.assertGreater(before[job]["finish_core_seconds"], 0)
            farm.client("delete", jobs[0])
            self.kill_server_sometime(farm, 4)
            self.assertEqual(usage(), before)
            self.assertIn("ann", farm.client("usage", "--since", "2026-01-01").stdout)
            self.assertEqual(farm.client("usage", "--until", "2026-01-01", "--json").stdout, "")

    def test_jobs_wait_for_each_other_over_restarts(self):
        with self.farm(workers=0) as farm:
            first = self.submit(farm)
            second = self.submit(farm, "--after", first, samples=MANY)
            self.assertEqual(farm.status(second)["state"], "submitted")
            farm.server.kill()
            farm.start_server(listen=farm.address)
            farm.start_worker()

            def first_has_begun():
                units = farm.status(second)["units_done"]
                status = farm.status(first)
                if status["state"] != "done":  # nor was it when the second job was asked for
                    self.assertEqual(units, 0)
                return status["units_done"] > 0

            wait_until(first_has_begun, "a unit of the first job")
            self.kill_server_sometime(farm, 3)
            self.expect_picture(farm, second, MANY)
            self.assertEqual(farm.status(first)["state"], "done")

    def test_a_deletion_survives_a_killed_coordinator(self):
        with self.farm() as farm:
            for seed in range(5):
                job = self.done_job(farm)
                client = farm.start_client("delete", job)
                time.sleep(random.Random(seed).uniform(0, 0.2))
                farm.server.kill()
                client.wait()
                farm.start_server(listen=farm.address)
                if farm.client("status", job,
                               check=False).returncode == 0:  # the call was lost before its first step
                    farm.client("delete", job)
                for folder in ("film", "results", "deleted"):
                    path = pathlib.Path(farm.data, folder, job)
                    wait_until(lambda path=path: not path.exists(), f"{path} goes", seconds=60)

    def test_the_quota_keeps_the_folder_small(self):
        size = len(self.expected[FEW])
        with self.farm("--quota-gb", 12 * size / 1e9) as farm:
            jobs = [self.done_job(farm) for _ in range(16)]
            wait_until(lambda: farm.client("status", jobs[0], check=False).returncode != 0,
                       "the first job goes",
                       seconds=120)
            self.expect_picture(farm, jobs[-1], FEW)

    def test_an_upload_that_does_not_fit_is_refused(self):
        with self.farm("--quota-gb", 1e-6, workers=0) as farm:
            done = farm.client("submit", self.scene, *SETTINGS, "--spp", FEW, check=False)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn("bytes are to come", done.stderr)
            self.assertEqual(os.listdir(pathlib.Path(farm.data, "incoming")), [])


if __name__ == "__main__":
    unittest.main()
