"""A farm whose ledger is in PostgreSQL writes the same bytes as one process, over a SIGKILL of its coordinator."""

import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

from farm import Farm, make_scene, run, wait_until

SETTINGS = ["--size", "160x120", "--spp", "64", "--seed", "5", "--save-film"]
SCRIPT = pathlib.Path(__file__).parents[1] / "support" / "private_postgres.sh"
NOT_INSTALLED = 77
PASSWORD = "secret"


class PostgresTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.postgres = subprocess.Popen([SCRIPT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        cls.uri = cls.postgres.stdout.readline().strip()
        if not cls.uri:
            if cls.postgres.wait() == NOT_INSTALLED:
                raise unittest.SkipTest("PostgreSQL is not installed (deploy/setup.sh --tests)")
            raise AssertionError("PostgreSQL does not start")
        os.environ["LUMIFOLD_STORE"] = cls.uri

    @classmethod
    def tearDownClass(cls):
        cls.postgres.communicate()  # it ends with its input
        cls.folder.cleanup()

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
                done = run("lumifold-server", "--data", data, "--listen", "127.0.0.1:0", "--store", store, check=False)
                self.assertEqual(done.returncode, 1)
                self.assertIn(expected, done.stderr)
                self.assertEqual(done.stderr.count("\n"), 1)
                self.assertNotIn(PASSWORD, done.stderr)


if __name__ == "__main__":
    sys.exit(unittest.main())
