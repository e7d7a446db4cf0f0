"""A client with a list of coordinators goes on at the next one where one is killed, or stopped and silent."""

import json
import pathlib
import shutil
import subprocess
import tempfile
import unittest

from access_test import SecureFarm
from farm import BIN, PATIENCE_SECONDS, Farm, make_scene, run

SETTINGS = ["--size", "64x48", "--spp", "4", "--seed", "5"]
EXIT_UNREACHABLE = 3
# A client begins at random. Of so many, all begin at the coordinator that answers in one run of 64.
CALLS = 6


def take_over(source, farm):
    """Starts the farm's coordinator again with a copy of another data folder, as storage that they share
    would do."""
    farm.server.stop()
    shutil.rmtree(farm.data)
    shutil.copytree(source, farm.data)
    farm.restart_server()


class FailoverTest(unittest.TestCase):
    """Two coordinators that know the same finished job."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)
        self.scene = make_scene("cornell-box", self.root)
        self.farms = [self.enterContext(Farm(self.root / name)) for name in ("a", "b")]
        self.servers = ",".join(farm.address for farm in self.farms)
        first, second = self.farms
        worker = first.start_worker()
        self.job = first.client("submit", self.scene, *SETTINGS).stdout.strip()
        first.client("wait", self.job)
        first.client("download", self.job, "-o", self.root / "expected.exr")
        worker.stop()
        first.server.stop()
        take_over(first.data, second)
        first.restart_server()

    def client(self, command, *arguments, **options):
        return run("lumifold", command, "--server", self.servers, *arguments, **options)

    def expect_answers(self):
        for _ in range(CALLS):
            self.assertEqual(json.loads(self.client("status", self.job, "--json").stdout)["state"], "done")
        result = self.root / "result.exr"
        self.client("download", self.job, "-o", result)
        self.assertEqual(result.read_bytes(), (self.root / "expected.exr").read_bytes())
        self.assertRegex(self.client("submit", self.scene, *SETTINGS).stdout, r"\A\S+\n\Z")

    def test_calls_go_on_where_a_coordinator_is_silent(self):
        self.farms[0].server.pause()
        self.expect_answers()

    def test_calls_go_on_where_a_coordinator_was_killed_until_all_were(self):
        self.farms[0].server.kill()
        self.expect_answers()
        self.farms[1].server.kill()
        done = self.client("status", self.job, check=False)
        addresses = self.servers.replace(",", ", ")
        self.assertEqual(done.stderr,
                         f"lumifold: cannot reach any of the coordinators {addresses}: Connection refused\n")
        self.assertEqual(done.returncode, EXIT_UNREACHABLE)

    def test_a_job_is_watched_on_where_its_coordinator_falls_silent(self):
        first, second = self.farms
        self.job = first.client("submit", self.scene, *SETTINGS).stdout.strip()  # no worker renders it
        first.server.stop()
        take_over(first.data, second)
        first.restart_server()
        watches = [
            subprocess.Popen([BIN / "lumifold", "watch", self.job, "--json", "--server", self.servers],
                             stdout=subprocess.PIPE,
                             stderr=subprocess.PIPE,
                             text=True) for _ in range(CALLS)
        ]
        for watch in watches:
            self.addCleanup(watch.stdout.close)
            self.addCleanup(watch.stderr.close)
            self.addCleanup(watch.kill)
            line = watch.stdout.readline()
            self.assertIn('"submitted"', line, "" if line else watch.stderr.read())
        first.server.pause()
        second.start_worker()
        for watch in watches:
            out, _ = watch.communicate(timeout=PATIENCE_SECONDS)
            self.assertEqual((watch.returncode, json.loads(out.splitlines()[-1])["state"]), (0, "done"))


class SecureFailoverTest(unittest.TestCase):
    def test_a_profile_gets_into_all_coordinators_of_its_authority(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            with SecureFarm(root / "a") as first, Farm(root / "b") as second:
                code = first.invite("ann")
                first.join("login", code, address=f"{first.address},{second.address}", profile="ann")
                first.server.stop()
                take_over(first.data, second)
                first.restart_server()
                for farm in (first, second):
                    farm.server.pause()
                    for _ in range(CALLS):
                        caller = json.loads(run("lumifold", "whoami", "--json", "--profile", "ann").stdout)
                        self.assertEqual(caller["name"], "ann")
                        self.assertIn("encrypted: yes",
                                      run("lumifold", "server-status", "--profile", "ann").stdout)
                    farm.server.resume()


if __name__ == "__main__":
    unittest.main()
