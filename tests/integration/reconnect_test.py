"""Workers whose coordinator is lost come back to it, or go to another coordinator of their list; what it had
not committed is rendered again."""

import pathlib
import re
import tempfile
import time
import unittest

from farm import Farm, Process, make_scene, run, wait_until

# Units of some seconds.
SETTINGS = ["--size", "64x64", "--spp", "1024", "--seed", "3"]
SMALL = ["--size", "32x32", "--spp", "16", "--seed", "3"]
# 8 short units, a geometry unit and a first pass of each tile; all others take minutes.
NO_END = ["--size", "64x64", "--spp", "1048576", "--plan", "full"]
# A silent coordinator is noticed within 5 s; half a minute would be that of a channel without quick pings.
NOTICED_SECONDS = 20
# Of a worker of one thread: so many units that it has rendered may not be committed.
LEASES = 2


def units_of(log):
    """The units that a worker has rendered, each time."""
    return re.findall(r"event=unit_rendered (job=\S+ frame=\d+ tile=\d+ pass=\d+ kind=\w+)", log)


class ReconnectTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.scene = make_scene("cornell-box", cls.root)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def submit(self, farm, settings):
        return farm.client("submit", self.scene, *settings).stdout.strip()

    def expect_same_picture(self, farm, job, settings):
        expected, result = self.root / f"{job}-alone.exr", self.root / f"{job}.exr"
        farm.client("wait", job)
        farm.client("download", job, "-o", result)
        run("lumifold", "render", self.scene, *settings, "-o", expected)
        self.assertEqual(result.read_bytes(), expected.read_bytes())

    def start_worker(self, *farms):
        """A worker of one thread that knows the coordinators of these farms."""
        worker = Process("lumifold-worker", "--threads", 1, "--log-level", "debug", "--server",
                         ",".join(farm if isinstance(farm, str) else farm.address for farm in farms))
        self.addCleanup(worker.kill)
        return worker

    def test_a_coordinator_that_was_killed_and_started_again_leases_what_it_has_not_committed(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            workers = [self.start_worker(farm) for _ in range(2)]
            job = self.submit(farm, SETTINGS)
            for worker in workers:
                wait_until(lambda w=worker: " pass=1 " in w.log_text(), "each worker has rendered a long pass")
            farm.server.kill()
            for worker in workers:
                wait_until(lambda w=worker: "event=disconnected" in w.log_text(), "the workers notice")
            farm.restart_server()
            self.expect_same_picture(farm, job, SETTINGS)
            log = farm.server.log_text()
            self.assertEqual(len(re.findall("event=worker_connected", log)), 2, log)
            total = farm.status(job)["units_total"]
            rendered = [unit for worker in workers for unit in units_of(worker.log_text())]
            self.assertEqual(len(set(rendered)), total, log)
            self.assertLessEqual(len(rendered) - total, LEASES * len(workers), log)
            for event in ("unit_in_quarantine", "unit_failed", "worker_set_aside"):
                self.assertNotIn(f"event={event}", log)

    def test_a_worker_leaves_a_silent_coordinator_for_the_next_of_its_list(self):
        with (tempfile.TemporaryDirectory() as data, tempfile.TemporaryDirectory() as other_data,
              Farm(data) as farm, Farm(other_data) as other):
            elsewhere = self.submit(farm, NO_END)
            worker = self.start_worker(farm, other)
            wait_until(lambda: farm.status(elsewhere)["units_done"] == 8, "the worker has one long unit, and no other")
            job = self.submit(other, SMALL)
            farm.server.pause()
            start = time.monotonic()
            wait_until(lambda: "event=worker_connected" in other.server.log_text(), "it goes to the second",
                       seconds=NOTICED_SECONDS)
            print(f"the worker was at the second coordinator after {time.monotonic() - start:.1f} s")
            # Its only thread was busy with a unit of the first, which is stopped.
            self.expect_same_picture(other, job, SMALL)

    def test_a_worker_passes_over_a_coordinator_that_is_not_there(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            worker = self.start_worker("127.0.0.1:1", farm)
            job = self.submit(farm, SMALL)
            self.expect_same_picture(farm, job, SMALL)
            self.assertIn("retry_in=0.0s", worker.log_text())

    def test_a_list_that_is_not_valid_is_named(self):
        for wrong, why in (("a:7700,,b:7700", "HOST:PORT"), ("a:7700,a:7700", "twice")):
            done = run("lumifold-worker", "--insecure", "--server", wrong, check=False)
            self.assertEqual(done.returncode, 1, done.stderr)
            self.assertIn(why, done.stderr)


if __name__ == "__main__":
    unittest.main()
