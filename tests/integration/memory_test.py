"""Workers that have little memory: they say so in one line, and the jobs are rendered by others."""

import json
import pathlib
import re
import resource
import tempfile
import unittest

import gltf
from farm import Farm, make_scene, wait_until

MIB = 1 << 20
SETTINGS = ["--size", "64x48", "--spp", "8"]
SECONDS = 400


class MemoryTest(unittest.TestCase):
    def limited_worker(self, farm, mib, *arguments):
        """A worker whose address space is limited, as by `ulimit -v`."""
        before = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (mib * MIB, before[1]))
        try:
            return farm.start_worker(*arguments)
        finally:
            resource.setrlimit(resource.RLIMIT_AS, before)

    @staticmethod
    def reasons(farm, job):
        """The codes of what holds a job up."""
        return [reason["code"] for reason in json.loads(farm.client("explain", job, "--json").stdout)["reasons"]]

    def farm_and_scene(self):
        root = self.enterContext(tempfile.TemporaryDirectory())
        farm = self.enterContext(Farm(self.enterContext(tempfile.TemporaryDirectory())))
        return farm, make_scene("cornell-box", root)

    def test_a_worker_without_memory_says_so_in_one_line(self):
        farm, _ = self.farm_and_scene()
        for mib in (120, 200):
            worker = self.limited_worker(farm, mib)
            self.assertEqual(worker.popen.wait(timeout=SECONDS), 1, f"{mib} MiB: {worker.log_text()}")
            self.assertRegex(worker.log_text(), r"\Alumifold-worker: [^\n]*memory[^\n]*\n\Z")
            worker.popen.stdout.close()

    def test_with_little_memory_a_worker_renders_or_says_why_not(self):
        farm, scene = self.farm_and_scene()
        told = []
        for mib in (280, 340, 400, 500, 700, 1000):
            job = farm.client("submit", scene, *SETTINGS).stdout.strip()
            worker = self.limited_worker(farm, mib)
            state = wait_until(
                lambda: "ended" if not worker.is_running() else farm.status(job)["state"] == "done" and "done" or
                "memory" in self.reasons(farm, job) and "explained", f"what becomes of {mib} MiB", seconds=SECONDS)
            told.append(f"{mib} MiB: {state}")
            if state == "ended":
                self.assertEqual(worker.popen.wait(), 1, worker.log_text())
                self.assertRegex(worker.log_text(), "lumifold-worker: .*memory")
                worker.popen.stdout.close()
            else:
                worker.stop()
            self.assertNotEqual(farm.status(job)["state"], "failed")
        print(", ".join(told))
        self.assertIn("done", told[-1])
        good = farm.start_worker()
        for line in farm.client("list", "--json").stdout.splitlines():
            farm.client("wait", json.loads(line)["job_id"])
        good.stop()

    def test_a_scene_that_no_worker_holds_waits_for_one_that_does(self):
        farm, box = self.farm_and_scene()
        folder = self.enterContext(tempfile.TemporaryDirectory())
        scene = gltf.add_texture(box, pathlib.Path(folder) / "large.glb", 6144)  # 151 MB, and its mip levels
        job = farm.client("submit", scene, *SETTINGS).stdout.strip()
        small = self.limited_worker(farm, 560)
        said = wait_until(lambda: re.search(r"memory: .*", farm.client("explain", job).stdout), "why it waits",
                          seconds=SECONDS)
        self.assertRegex(said[0], r"[0-9.]+ GiB of memory.*the largest worker of .* has 0\.\d GiB")
        workers = [json.loads(line) for line in farm.client("workers", "--json").stdout.splitlines()]
        self.assertLess(workers[0]["memory_bytes"], 560 * MIB)
        self.assertTrue(small.is_running())
        other = farm.client("submit", box, *SETTINGS).stdout.strip()
        farm.client("wait", other)  # it goes on with what it holds
        farm.start_worker()
        farm.client("wait", job)


if __name__ == "__main__":
    unittest.main()
