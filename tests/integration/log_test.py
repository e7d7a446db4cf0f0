"""Logs as JSON: each line of coordinator and worker is one object, whatever names and errors are in it; and
one id is in all lines about a job, from the command that submits it to the one that downloads its picture."""

import json
import os
import pathlib
import tempfile
import unittest

from farm import Farm, make_scene, wait_until

JSON = ("--log-format", "json")
TRACE = "4bf92f3577b34da6a3ce929d0e0e4736"
PARENT = f"00-{TRACE}-00f067aa0ba902b7-01"
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
            self.assertEqual({line["worker"] for line in lines_of(worker) if "job" in line},
                             {connected["worker"]})
        self.assertTrue(all(line["event"] for line in lines_of(farm.server)), farm.server.log_text())

    def test_one_id_follows_a_job_through_all_programs(self):
        with self.farm("--log-level", "debug") as farm:
            worker = farm.start_worker(*JSON, "--log-level", "debug", "--name", "node")
            job = self.submit_without_its_scene(farm)
            farm.restart_server()  # what it knows of the trace is in its ledger
            farm.client("resume", job)
            wait_until(lambda: events(farm.server, "asset_wanted"),
                       "the worker fails a unit, for want of the scene")
            again = self.client(farm, "submit", self.scene, *SETTINGS, "--paused",
                                "--json")  # uploads it again
            farm.client("wait", job)
            downloaded = self.client(farm, "download", job, "-o", self.root / "picture.exr", "--json")
            status = farm.status(job)
            self.assertEqual({line["trace_id"] for line in (again, downloaded, status)}, {TRACE})
            for event in ("job_restored", "lease_granted", "asset_wanted", "asset_found", "unit_committed",
                          "frame_committed", "frame_finished", "job_ended", "result_opened"):
                self.expect_trace(farm.server, event, job)
            for event in ("unit_failed", "unit_rendered", "job_account"):
                wait_until(lambda e=event: events(worker, e), event)
                self.expect_trace(worker, event, job)
            self.expect_all_lines_traced([farm.server, worker], job)
            self.expect_lines_of_the_worker(farm, job)
            audit = pathlib.Path(farm.data, "audit.log").read_text().splitlines()
            submissions = [line for line in audit if "rpc=lumifold.v1.FarmService/SubmitJob" in line]
            self.assertEqual([line.count(f" trace={TRACE} ") for line in submissions], [1, 1], audit)

    def submit_without_its_scene(self, farm):
        """Submits a paused job under TRACE, and then loses its scene on the disk of the coordinator."""
        submitted = self.client(farm, "submit", self.scene, *SETTINGS, "--paused", "--user", "ann", "--json")
        self.assertEqual(submitted["trace_id"], TRACE)
        for asset in pathlib.Path(farm.data, "assets").iterdir():
            if asset.is_file():
                asset.unlink()
        farm.server.stop()
        self.expect_trace(farm.server, "job_submitted", submitted["job_id"])
        return submitted["job_id"]

    def client(self, farm, *arguments):
        """The line of JSON that a command under TRACE prints."""
        return json.loads(farm.client(*arguments, env={**os.environ, "TRACEPARENT": PARENT}).stdout)

    def expect_trace(self, process, event, job):
        found = [line for line in events(process, event) if line.get("job") == job]
        self.assertTrue(found, f"{event}\n{process.log_text()}")
        for line in found:
            self.assertEqual(line.get("trace"), TRACE, line)

    def expect_all_lines_traced(self, processes, job):
        """Each line about a job has the id, and those of the coordinator have the user, whoever wrote
        them."""
        for process in processes:
            for line in lines_of(process):
                self.assertEqual(line.get("trace"), TRACE if "job" in line or "unit" in line else None, line)
        self.assertEqual({line.get("user") for line in lines_of(processes[0]) if line.get("job") == job},
                         {"ann"})

    def expect_lines_of_the_worker(self, farm, job):
        """`lumifold logs` has the lines of coordinator and worker, by time."""
        log = [json.loads(line) for line in farm.client("logs", job, "--json").stdout.splitlines()]
        failed, = [line for line in log if "event=unit_failed" in line["text"]]
        self.assertRegex(failed["worker"], r"^w-\d+/node$")
        self.assertIn(f"trace={TRACE}", failed["text"])
        self.assertEqual([line["unix_ms"] for line in log], sorted(line["unix_ms"] for line in log))
        coordinator = [line["text"] for line in log if "worker" not in line]
        self.assertIn("event=asset_wanted", " ".join(coordinator))
        self.assertRegex(farm.client("logs", job).stdout, r"Z error w-\d+/node: event=unit_failed job=\S+ ")
        of_worker = farm.client("logs", "node").stdout
        for expected in (r"info  event=worker_connected", r"error w-\d+/node: event=unit_failed"):
            self.assertRegex(of_worker, expected)


if __name__ == "__main__":
    unittest.main()
