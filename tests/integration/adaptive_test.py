"""Adaptive sampling in a farm of processes: the same file for any workers, and whoever is killed in
mid-decision."""

import json
import pathlib
import tempfile
import unittest

from exr import metadata_of
from farm import Farm, run, wait_until
from farm_test import SceneTest

WIDTH, HEIGHT, SAMPLES = 96, 72, 320


def damage(file):
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)


class AdaptiveTest(SceneTest):
    SETTINGS = [
        "--size", f"{WIDTH}x{HEIGHT}", "--spp",
        str(SAMPLES), "--adaptive", "--seed", "3", "--save-film"
    ]

    def rounds(self, farm):
        return farm.server.log_text().count("event=round_estimated")

    def submit_and_wait_for_a_decision(self, farm):
        job = self.submit(farm)
        wait_until(lambda: self.rounds(farm) > 0, "the first estimate")
        return job

    def test_workers_do_not_matter(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            for _ in range(3):
                farm.start_worker()
            job = self.submit(farm)
            self.expect_same_picture(farm, job)
            status = farm.status(job)
            self.assertEqual(status["units_done"], status["units_total"])
            self.assertLessEqual(status["samples_done"], SAMPLES * WIDTH * HEIGHT * 1.02)
            self.assertGreater(status["samples_done"], 0.5 * SAMPLES * WIDTH * HEIGHT)

    def test_a_killed_worker_changes_nothing(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            workers = [farm.start_worker() for _ in range(2)]
            job = self.submit_and_wait_for_a_decision(farm)
            workers[0].kill()
            self.expect_same_picture(farm, job)

    def test_a_coordinator_killed_between_decisions_makes_the_same_ones(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker()
            job = self.submit_and_wait_for_a_decision(farm)
            farm.server.kill()
            farm.start_server(listen=farm.address)
            self.expect_same_picture(farm, job)

    def test_a_damaged_record_is_made_again(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            worker = farm.start_worker()
            job = self.submit_and_wait_for_a_decision(farm)
            worker.kill()
            farm.server.kill()
            damage(next(pathlib.Path(data).glob("**/frame-0000.rounds")))
            farm.start_server(listen=farm.address)
            self.assertIn("event=rounds_damaged", farm.server.log_text())
            farm.start_worker()
            self.expect_same_picture(farm, job)

    def test_a_budget_that_pays_for_no_estimate_is_spent_uniformly(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker(threads=2)
            job = farm.client("submit", self.scene, "--size", f"{WIDTH}x{HEIGHT}", "--spp", "100",
                              "--adaptive").stdout.strip()
            farm.client("wait", job)
            status = farm.status(job)
            self.assertEqual(status["samples_done"], 100 * WIDTH * HEIGHT)
            self.assertGreater(status["estimated_error"], 0, "the halves of the result tell it")
            self.assertEqual(self.rounds(farm), 1, "which says that none is worth its cost")

    def test_a_target_that_is_reached_ends_it(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker(threads=2)
            job = farm.client("submit", self.scene, "--size", f"{WIDTH}x{HEIGHT}", "--spp", "4096",
                              "--target-error", "20").stdout.strip()
            farm.client("wait", job)
            status = farm.status(job)
            self.assertLess(status["samples_done"], 1024 * WIDTH * HEIGHT)
            self.assertEqual(status["samples_done"], status["samples_total"])
            self.assertIn("final=true", farm.server.log_text())

    def test_a_target_out_of_reach_says_what_was_reached(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker(threads=2)
            job = farm.client("submit", self.scene, "--size", f"{WIDTH}x{HEIGHT}", "--spp", "128",
                              "--target-error", "0.001").stdout.strip()
            farm.client("wait", job)
            reached = farm.status(job)["estimated_error"]
            self.assertGreater(reached, 0.001)
            self.assertIn("target 0.001 not reached", farm.client("status", job).stdout)
            result = self.root / "reached.exr"
            farm.client("download", job, "-o", result)
            self.assertAlmostEqual(float(metadata_of(result)["lumifold.estimated_error"]),
                                   reached,
                                   delta=1e-3 * reached)
            farm.server.kill()
            farm.start_server(listen=farm.address)
            self.assertEqual(farm.status(job)["estimated_error"], reached)

    def test_the_schedule_of_a_time_gives_the_same_picture(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker(threads=2)
            size = ("--size", f"{WIDTH}x{HEIGHT}", "--seed", "3")
            timed, again = self.root / "timed.exr", self.root / "again.exr"
            job = farm.client("submit", self.scene, *size, "--time", "2s").stdout.strip()
            farm.client("wait", job)
            farm.client("download", job, "-o", timed)
            schedule = metadata_of(timed)["lumifold.schedule"]
            run("lumifold", "render", self.scene, *size, "--schedule", schedule, "-o", again)
            same = json.loads(run("lumifold", "compare", again, timed, "--json").stdout)
            self.assertEqual(same["mse255"], 0)
            self.assertEqual(metadata_of(again)["lumifold.schedule"], schedule)

    def test_a_time_is_shared_by_all_frames(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker(threads=2)
            size = ("--size", f"{WIDTH}x{HEIGHT}", "--seed", "3", "--force", "pass-samples=64")
            job = farm.client("submit", self.scene, *size, "--time", "6s", "--frames", "0-2").stdout.strip()
            farm.client("wait", job)
            farm.client("download", job, "--frames", "0-2", "-o", self.root / "shared-####.exr")
            schedules = [
                metadata_of(self.root / f"shared-{frame:04}.exr")["lumifold.schedule"] for frame in range(3)
            ]
            budgets = [float(schedule.split(",")[-1]) for schedule in schedules]
            self.assertLess(max(budgets), 3 * min(budgets))
            again = self.root / "again-####.exr"
            run("lumifold", "render", self.scene, *size, "--frames", "1", "--schedule", schedules[1], "-o",
                again)
            same = json.loads(
                run("lumifold", "compare", self.root / "again-0001.exr", self.root / "shared-0001.exr",
                    "--json").stdout)
            self.assertEqual(same["mse255"], 0)

    def test_what_does_not_fit_is_refused(self):
        for options, code, text in (
            (("--target-metric", "psnr", "--target-error", "1"), 2,
             "--target-metric must be mse255 or relmse"),
            (("--target-metric", "relmse"), 2, "--target-metric requires --target-error"),
            (("--adaptive", "--size", "4096x4096"), None, "too large for adaptive sampling"),
            (("--time", "soon"), 2, "--time: expected a duration"),
            (("--time", "10s", "--schedule", "20"), 2, "take each other's place"),
            (("--schedule", "20,x"), 2, "--schedule: expected samples per pixel"),
            (("--schedule", "20", "--frames", "0-1"), 2, "--schedule is of one frame"),
        ):
            refused = run("lumifold",
                          "render",
                          self.scene,
                          *options,
                          "-o",
                          self.root / "no-####.exr",
                          check=False)
            self.assertNotEqual(refused.returncode, 0)
            if code is not None:
                self.assertEqual(refused.returncode, code)
            self.assertIn(text, refused.stderr)


if __name__ == "__main__":
    unittest.main()
