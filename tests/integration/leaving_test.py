"""Workers that leave lose no unit: those that are told to, those that are idle, and those that an operator
drains."""

import json
import pathlib
import signal
import tempfile
import time
import unittest

from farm import PATIENCE_SECONDS, Farm, Process, make_scene, run, wait_until

# One tile in sixteen passes of about half a second each.
SETTINGS = ["--size", "32x32", "--spp", "8192", "--seed", "3"]
SHORT = ["--size", "32x32", "--spp", "256", "--seed", "3"]
# Units that take minutes, but for those of the first pass: geometry and one sample of each of the four tiles.
# No plan unit.
NO_END = ["--size", "64x64", "--spp", "1048576", "--plan", "full"]
FIRST_PASS = 8


class LeavingTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.scene = make_scene("cornell-box", cls.root)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def submit(self, farm, *settings):
        return farm.client("submit", self.scene, *settings).stdout.strip()

    def wait_for_lease(self, farm, job):
        wait_until(lambda: farm.status(job)["workers"] == 1, "a worker has a lease")

    def test_units_of_workers_that_were_told_to_leave_are_not_lost(self):
        expected = self.root / "one-process.exr"
        run("lumifold", "render", self.scene, *SETTINGS, "-o", expected)
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = self.submit(farm, *SETTINGS)
            first = farm.start_worker("--log-level", "debug")
            wait_until(lambda: " pass=1 " in first.log_text(), "the short units are rendered")
            self.assertEqual(first.stop(), 0, first.log_text())
            for _ in range(7):  # as many losses of a worker would put a unit into quarantine
                worker = farm.start_worker("--drain-seconds", "0")
                self.wait_for_lease(farm, job)
                self.assertEqual(worker.stop(), 0, worker.log_text())
                self.assertIn("event=leases_handed_back", worker.log_text())
            farm.start_worker(threads=2)
            farm.client("wait", job)
            result = self.root / "left.exr"
            farm.client("download", job, "-o", result)
            self.assertEqual(result.read_bytes(), expected.read_bytes())
            log = farm.server.log_text()
            self.assertEqual(log.count("event=worker_leaving"), 8, log)
            for event in ("unit_in_quarantine", "unit_failed", "lease_expired", "unit_not_wanted"):
                self.assertNotIn(f"event={event}", log)

    def test_a_worker_rests_outside_its_hours(self):
        hour = time.localtime().tm_hour
        off = f"{(hour + 2) % 24:02}:00-{(hour + 3) % 24:02}:00"
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = self.submit(farm, *SHORT)
            worker = farm.start_worker("--hours", off)

            def listed():
                lines = farm.client("workers", "--json").stdout.splitlines()
                return json.loads(lines[0]) if lines else {}

            wait_until(lambda: listed().get("state") == "resting", "the worker rests")
            self.assertEqual(listed()["reason"], f"off hours until {off[:5]}")
            reasons = json.loads(farm.client("explain", job, "--json").stdout)["reasons"]
            self.assertIn(f"off hours until {off[:5]}", reasons[0]["text"])
            self.assertEqual(farm.status(job)["units_done"], 0)
            self.assertEqual(worker.stop(), 0, worker.log_text())
            farm.start_worker("--hours", f"00:00-24:00,{off}")
            farm.client("wait", job)

    def test_a_worker_whose_machine_others_use_hands_its_units_back(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = self.submit(farm, *NO_END)
            resting = farm.start_worker("--only-idle", "0.01", "--drain-seconds", "0")
            farm.start_worker()  # uses the machine
            self.wait_for_lease(farm, job)
            wait_until(lambda: "others use this machine" in resting.log_text(), "the load is known", seconds=60)
            self.assertTrue(resting.is_running())

    def test_units_that_are_nearly_done_are_delivered(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = self.submit(farm, *SETTINGS)
            worker = farm.start_worker("--drain-seconds", str(PATIENCE_SECONDS), "--log-level", "debug")
            wait_until(lambda: farm.status(job)["units_done"] > 0, "the first unit")
            self.assertEqual(worker.stop(), 0, worker.log_text())
            log = worker.log_text()
            rendered = log.count("event=unit_rendered") - log.count(
                "kind=plan")  # a plan counts no longer once it is made
            self.assertEqual(farm.status(job)["units_done"], rendered, log)
            self.assertLess(rendered, 17, log)

    def test_an_interrupt_ends_a_worker_that_leaves_at_once_and_further_terms_do_not(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = self.submit(farm, *NO_END)
            worker = farm.start_worker("--drain-seconds", str(PATIENCE_SECONDS))
            wait_until(lambda: farm.status(job)["units_done"] == FIRST_PASS, "the first pass")
            self.wait_for_lease(
                farm, job)  # of a unit that takes minutes: it cannot be delivered before the interrupt
            worker.popen.send_signal(signal.SIGTERM)
            wait_until(lambda: "event=leaving" in worker.log_text(), "the worker heard it")
            worker.popen.send_signal(signal.SIGTERM)
            time.sleep(0.5)
            self.assertIsNone(worker.popen.poll())
            worker.popen.send_signal(signal.SIGINT)
            self.assertEqual(worker.popen.wait(timeout=PATIENCE_SECONDS), 128 + signal.SIGINT)
            worker.popen.stdout.close()

    def test_an_idle_worker_leaves_and_says_whether_it_reached_a_coordinator(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = self.submit(farm, *SHORT)
            worker = farm.start_worker("--exit-when-idle", "1", threads=2)
            farm.client("wait", job)
            self.assertEqual(worker.popen.wait(timeout=PATIENCE_SECONDS), 0, worker.log_text())
            worker.popen.stdout.close()
            address = farm.address
        alone = Process("lumifold-worker", "--server", address, "--exit-when-idle", "1")
        self.assertEqual(alone.popen.wait(timeout=PATIENCE_SECONDS), 4, alone.log_text())
        self.assertIn("reached no coordinator within 1s", alone.log_text())
        alone.popen.stdout.close()

    def listed(self, farm):
        """Name, state and jobs of the only worker."""
        worker = json.loads(farm.client("workers", "--json").stdout)
        return worker["name"], worker["state"], worker["job_ids"]

    def test_a_drained_worker_leaves_and_a_blocked_one_waits(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = self.submit(farm, *NO_END)
            worker = farm.start_worker("--drain-seconds", "0", "--name", "ann")
            self.wait_for_lease(farm, job)
            # Between two leases it may have delivered a unit that is not committed yet: busy, but of no job.
            wait_until(lambda: self.listed(farm) == ("ann", "busy", [job]),
                       "the worker is listed with its job")
            farm.client("drain", "ann")
            self.assertEqual(worker.popen.wait(timeout=PATIENCE_SECONDS), 0, worker.log_text())
            worker.popen.stdout.close()

            blocked = farm.start_worker("--drain-seconds", "0", "--name", "ben")
            wait_until(lambda: farm.status(job)["units_done"] == FIRST_PASS, "the first pass")
            self.wait_for_lease(farm, job)
            farm.client("block", "ben", "--reason", "wrong pixels")
            wait_until(lambda: "event=lease_void" in blocked.log_text(), "the worker stops rendering")
            self.assertEqual(farm.status(job)["workers"], 0)
            farm.server.kill()
            farm.start_server(listen=farm.address)
            wait_until(lambda: blocked.log_text().count("event=joined") == 2, "the worker joins again")
            listed = json.loads(farm.client("workers", "--json").stdout)
            self.assertEqual((listed["state"], listed["reason"]), ("blocked", "wrong pixels"))
            time.sleep(1)
            self.assertEqual(farm.status(job)["workers"], 0)
            farm.client("readmit", "ben")
            self.wait_for_lease(farm, job)
            self.assertIn("event=worker_readmitted", farm.client("logs", "ben").stdout)

    def test_jobs_with_tags_wait_for_workers_that_have_them(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker("--tags", "night", "--name", "ann")
            job = self.submit(farm, *SHORT, "--tag", "gpu", "--tag", "night")
            self.assertRegex(farm.client("explain", job).stdout, r"(?m)^no_worker: .*gpu")
            other = self.submit(farm, *SHORT, "--tag", "night")
            farm.client("wait", other)
            self.assertEqual(farm.status(job)["units_done"], 0)
            farm.start_worker("--tags", "gpu,night", "--name", "ben")
            farm.client("wait", job)
            self.assertIn("worker=w-2/ben", farm.client("logs", "ben").stdout)


if __name__ == "__main__":
    unittest.main()
