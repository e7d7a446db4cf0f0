"""Frames are filtered on a device by the coordinator's child processes and by workers, inside their sandboxes: the
files are the processor's, byte for byte, also when the device fails meanwhile."""

import os
import pathlib
import re
import tempfile
import time
import unittest

from farm import Farm, make_scene, run, wait_until
from page_link import PageLink

FAULTY = os.environ["LUMIFOLD_FAULTY_OPENCL"]
CACHE = pathlib.Path(os.environ["LUMIFOLD_DEVICE_CACHE"])
ONE_PLACE = ["--finish-processes", "1", "--filter-threads", "1"]
ON_DEVICE = ["--device", "gpu:0"]
ON_PROCESSOR = ["--device", "cpu"]
SETTINGS = ["--size", "128x96", "--spp", "8", "--frames", "0-3"]
WIDE = ["--size", "4200x48", "--spp", "2"]  # four blocks: a side is longer than one may be


class DeviceTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        devices = run("lumifold", "doctor", check=False).stdout
        if not re.search(r"gpu:0 is .*: filters", devices):
            raise unittest.SkipTest("no device gives this processor's bits")
        cls.root = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        cls.scene = make_scene("cornell-box", cls.root)
        cls.expected = cls.results(SETTINGS, server=ON_PROCESSOR)[0]
        cls.expected_wide = cls.results(WIDE, server=ON_PROCESSOR)[0]

    def setUp(self):
        """The programs take a library of OpenCL that writes down its calls, and fails as it is told."""
        handle, calls = tempfile.mkstemp()
        os.close(handle)
        self.calls = pathlib.Path(calls)
        self.calls.chmod(0o666)  # workers become another user
        os.environ["LD_LIBRARY_PATH"] = FAULTY
        os.environ["FAULTY_OPENCL_CALLS"] = str(self.calls)
        # PoCL compiles at the niceness of a worker, which gets little of a loaded machine.
        os.environ["LUMIFOLD_DEVICE_SECONDS"] = "1000"
        self.use_cache("coordinator")

    def tearDown(self):
        self.calls.unlink()
        for name in ("LD_LIBRARY_PATH", "FAULTY_OPENCL", "FAULTY_OPENCL_CALLS", "LUMIFOLD_DEVICE_SECONDS"):
            os.environ.pop(name, None)

    @staticmethod
    def use_cache(name):
        folder = CACHE if name == "coordinator" else CACHE.with_name(f"{CACHE.name}-{name}")
        folder.mkdir(parents=True, exist_ok=True)
        folder.chmod(0o777)
        os.environ["POCL_CACHE_DIR"] = str(folder)

    @classmethod
    def results(cls, settings, server, workers=(("--finish", "never"),)):
        """The files of a job's frames, and the farm's logs."""
        with tempfile.TemporaryDirectory() as data, Farm(data, *server) as farm:
            cls.use_cache("worker")
            started = [farm.start_worker(*options, threads=2) for options in workers]
            wait_until(lambda: farm.server.log_text().count("event=worker_connected") == len(started), "all workers")
            job = farm.client("submit", cls.scene, *settings).stdout.strip()
            farm.client("wait", job)
            files = {path.name: path.read_bytes() for path in (pathlib.Path(data) / "results" / job).glob("*.exr")}
            for process in [*started, farm.server]:
                assert process.stop() == 0
            return files, farm.server.log_text(), [worker.log_text() for worker in started]

    def uses(self):
        return len(self.calls.read_text().splitlines())

    def test_the_coordinators_child_filters_on_a_device(self):
        files, log, _ = self.results(SETTINGS, server=ON_DEVICE)
        self.assertEqual(len(files), 4)
        self.assertEqual(files, self.expected)
        self.assertGreater(self.uses(), 4)
        self.assertIn("event=device name=", log)
        self.assertNotIn("device_warning", log)

    def test_workers_filter_frames_and_blocks_on_a_device(self):
        workers = [("--finish", "never"), ("--finish", "only", *ON_DEVICE), ("--finish", "only", *ON_DEVICE)]
        files, log, workers_logs = self.results(WIDE, server=[*ON_PROCESSOR, *ONE_PLACE], workers=workers)
        self.assertEqual(files, self.expected_wide)
        self.assertIn("event=block_leased", log)
        self.assertGreater(self.uses(), 0)
        self.assertIn("event=device name=", workers_logs[1])
        self.assertNotIn("device_warning", "".join(workers_logs))

    def preview(self, farm, job):
        """The preview of an unfinished frame whose work rests."""
        link = PageLink(farm.client("page").stdout.strip())
        return wait_until(lambda: link.preview(job), "a preview")

    def test_previews_of_unfinished_frames_are_filtered_on_a_device(self):
        with tempfile.TemporaryDirectory() as data, Farm(data, *ON_PROCESSOR) as farm:
            worker = farm.start_worker("--finish", "never")
            job = farm.client("submit", self.scene, "--size", "128x96", "--spp", "4096").stdout.strip()
            wait_until(lambda: farm.status(job)["units_done"] > 0, "a unit")
            self.assertEqual(worker.stop(), 0)
            expected = self.preview(farm, job)
            self.assertFalse(expected[0]["finished"])
            self.assertEqual(farm.server.stop(), 0)
            farm.server_arguments = ON_DEVICE
            farm.restart_server()
            self.assertEqual(self.preview(farm, job), expected)
            self.assertGreater(self.uses(), 0)
            self.assertNotIn("device_warning", farm.server.log_text())

    def test_a_device_that_hangs_costs_time_and_one_warning(self):
        os.environ["FAULTY_OPENCL"] = "clFinish:4:hang"
        os.environ["LUMIFOLD_DEVICE_SECONDS"] = "20"  # with the kernels' compilation
        files, log, _ = self.results(SETTINGS, server=ON_DEVICE)
        self.assertEqual(files, self.expected)
        failed = re.findall(r"warning event=device_warning error=.*", log)
        self.assertEqual(len(failed), 1, log)
        self.assertIn("does not answer", failed[0])

    def test_a_device_that_crashes_costs_one_warning_of_the_worker(self):
        os.environ["FAULTY_OPENCL"] = "clFinish:2:crash"
        files, _, logs = self.results(WIDE, server=[*ON_PROCESSOR, *ONE_PLACE],
                                      workers=[("--finish", "never"), ("--finish", "only", *ON_DEVICE)])
        self.assertEqual(files, self.expected_wide)
        self.assertEqual(logs[1].count("event=device_warning"), 1, logs[1])

    def test_a_coordinator_without_the_device_that_is_asked_for_does_not_start(self):
        with tempfile.TemporaryDirectory() as data:
            for choice, words in (("gpu:4000", "there is no device 4000"), ("gpus", "is no device")):
                start = time.monotonic()
                done = run("lumifold-server", "--data", data, "--listen", "127.0.0.1:0", "--device", choice,
                           check=False)
                self.assertNotEqual(done.returncode, 0)
                self.assertIn(words, done.stderr)
                self.assertLess(time.monotonic() - start, 60)


if __name__ == "__main__":
    unittest.main()
