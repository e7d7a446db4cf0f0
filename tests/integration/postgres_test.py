"""A farm whose ledger is in PostgreSQL writes the same bytes as one process, over a SIGKILL of its
coordinator."""

import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

from access_test import SecureFarm
from farm import Farm, make_scene, run, wait_until
from with_postgres import WithPostgres

SETTINGS = ["--size", "96x72", "--spp", "64", "--seed", "5", "--save-film"]
PASSWORD = "secret"
SECURITY_PAGE = pathlib.Path(__file__).parents[2] / "docs" / "security.md"


class PostgresTest(WithPostgres):
    def test_the_picture_is_the_same_over_a_killed_coordinator(self):
        scene = make_scene("cornell-box", self.root)
        expected = self.root / "one-process.exr"
        run("lumifold", "render", scene, *SETTINGS, "--threads", "2", "-o", expected)
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = farm.client("submit", scene, *SETTINGS).stdout.strip()
            farm.start_worker()
            wait_until(lambda: farm.status(job)["units_done"] > 0, "the first unit")
            farm.server.kill()
            farm.start_server(listen=farm.address)
            self.assertGreater(farm.status(job)["units_done"], 0)
            farm.start_worker()
            farm.client("wait", job)
            result = self.root / "farm.exr"
            farm.client("download", job, "-o", result)
            self.assertEqual(result.read_bytes(), expected.read_bytes())
            self.assertFalse((pathlib.Path(data) / "ledger.db").exists())
            self.assertIn("done", farm.client("list").stdout)
            command_line = pathlib.Path(f"/proc/{farm.server.popen.pid}/cmdline").read_text()
            self.assertNotIn(PASSWORD, command_line)
            self.assertNotIn(PASSWORD, farm.server.log_text())

    def test_a_store_that_cannot_be_used_is_an_error_of_one_line_without_the_password(self):
        for store, expected in ((self.uri.replace("/farm?", "/none?"), 'database "none" does not exist'),
                                ("mysql://user:secret@host/farm", "postgresql://")):
            with tempfile.TemporaryDirectory() as data:
                done = run("lumifold-server",
                           "--data",
                           data,
                           "--listen",
                           "127.0.0.1:0",
                           "--store",
                           store,
                           check=False)
                self.assertEqual(done.returncode, 1)
                self.assertIn(expected, done.stderr)
                self.assertEqual(done.stderr.count("\n"), 1)
                self.assertNotIn(PASSWORD, done.stderr)


class SecondCoordinatorTest(WithPostgres):
    """The steps of docs/security.md, as they stand there."""

    NAME = "127.0.0.2"  # no certificate has it by itself

    def follow_the_steps(self, first, second):
        """Runs the lines before the start of the coordinator; `first` and `second` are data folders."""
        block = re.search(r"<!-- second coordinator: begin -->\n```sh\n(.*?)```", SECURITY_PAGE.read_text(),
                          re.DOTALL).group(1)
        for words, own in (("scp -p", "cp -p"), ("FIRST:DIR", str(first)), ("DIR", str(second)),
                           ("second.example.org", self.NAME)):
            self.assertIn(words, block)
            block = block.replace(words, own)
        *steps, start = block.strip().splitlines()
        self.assertEqual(start, f"lumifold-server --data {second} --listen {self.NAME}:7700")
        subprocess.run(["sh", "-euc", "\n".join(steps)], check=True, timeout=60)

    def profile_for(self, profile, farm, profiles):
        """A copy of a profile, for another coordinator; returns its name."""
        copy = f"{profile}-second"
        shutil.copytree(profiles / profile, profiles / copy)
        path = profiles / copy / "profile"
        path.write_text(re.sub(r"(?m)^server=.*$", f"server={farm.address}", path.read_text()))
        return copy

    def test_people_workers_and_revocations_are_known_to_both(self):
        scene = make_scene("cornell-box", self.root)
        with SecureFarm(self.root / "first") as first:
            for name in ("ann", "bob"):
                first.join("login", first.invite(name, "--scope", "submit"), profile=name)
            first.enroll("node-1", "node-1")
            left = first.client("submit", scene, *SETTINGS, "--profile", "ann").stdout.strip()
            second_data = self.root / "second"
            self.follow_the_steps(first.data, second_data)
            for path in (second_data, *second_data.rglob("*")):
                self.assertEqual(path.stat().st_mode & 0o077, 0, path)
            with Farm(second_data, listen=f"{self.NAME}:0") as second:
                ann, bob, node = (
                    self.profile_for(name, second, first.profiles) for name in ("ann", "bob", "node-1"))
                for profile in (ann, bob):
                    self.assertEqual(
                        json.loads(second.client("whoami", "--json", "--profile", profile).stdout)["scopes"],
                        ["submit"])
                first.client("revoke", "bob")  # at the first
                wait_until(
                    lambda: "was revoked" in second.client("list", "--profile", bob, check=False).stderr,
                    "the revocation at the second")
                first.server.stop()
                # The job is the second one's now, and waits for its scene.
                worker = second.start_worker("--profile", node)
                wait_until(
                    lambda: "submit the scene again" in second.client("explain", left, "--profile", ann).
                    stdout, "a job that says what it waits for")
                job = second.client("submit", scene, *SETTINGS, "--profile", ann).stdout.strip()
                for each in (job, left):
                    second.client("wait", each, "--profile", ann)
                self.assertTrue(worker.is_running())
                pictures = [self.root / "left.exr", self.root / "job.exr"]
                for each, path in zip((left, job), pictures):
                    second.client("download", each, "-o", path, "--profile", ann)
                self.assertEqual(pictures[0].read_bytes(), pictures[1].read_bytes())


if __name__ == "__main__":
    sys.exit(unittest.main())
