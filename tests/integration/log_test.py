"""Logs as JSON: each line of coordinator and worker is one object, whatever names and errors are in it."""

import json
import pathlib
import tempfile
import unittest

from farm import Farm, make_scene, wait_until

JSON = ("--log-format", "json")
SETTINGS = ("--size", "64x48", "--spp", "4")


def lines_of(process):
    """The lines of a log, as objects."""
    return [json.loads(line) for line in process.log_text().splitlines()]


def events(process, name):
    return [line for line in lines_of(process) if line["event"] == name]


class LogTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.scene = make_scene("cornell-box", cls.root)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def farm(self, *arguments):
        return Farm(tempfile.mkdtemp(dir=self.root), *JSON, *arguments)

    def test_each_line_is_an_object_whatever_the_text_of_others(self):
        hostile = 'a "quoted" name\\ job=j-2 \u00e9\u20ac\x07'
        with self.farm() as farm:
            worker = farm.start_worker(*JSON, "--name", hostile)
            scene = self.root / 'odd "name" job=j-3.glb'
            scene.write_bytes(self.scene.read_bytes())
            job = farm.client("submit", scene, *SETTINGS, "--user", hostile).stdout.strip()
            farm.client("wait", job)
            submitted, = events(farm.server, "job_submitted")
            self.assertEqual((submitted["job"], submitted["scene"]), (job, scene.name))
            self.assertRegex(submitted["time"], r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}Z$")
            self.assertEqual(submitted["level"], "info")
            finished, = events(farm.server, "frame_finished")
            self.assertGreater(float(finished["filter_seconds"]), 0)
            wait_until(lambda: events(worker, "job_account"), "the worker hears of the end")
            self.assertEqual(worker.stop(), 0)
            self.assertEqual(events(worker, "stop")[0]["threads"], "1")
            connected, = events(farm.server, "worker_connected")
            self.assertRegex(connected["worker"], r"^w-\d+/a")
            self.assertNotIn("job", connected)
        self.assertTrue(all(line["event"] for line in lines_of(farm.server)), farm.server.log_text())


if __name__ == "__main__":
    unittest.main()
