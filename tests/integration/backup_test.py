"""The commands of docs/operations.md for backup and restore, run while jobs are rendered; then everything
else is lost."""

import os
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest

from access_test import SecureFarm
from farm import Farm, make_scene, run, wait_until
from with_postgres import WithPostgres

PAGE = pathlib.Path(__file__).parents[2] / "docs" / "operations.md"
SETTINGS = ["--size", "112x84", "--seed", "5", "--save-film"]
FEW, MANY = "64", "512"


def run_block(name, **words):
    """Runs a block of the page, with words such as DIR replaced."""
    block = re.search(rf"<!-- {name}: begin -->\n```sh\n(.*?)```\n<!-- {name}: end -->", PAGE.read_text(),
                      re.DOTALL).group(1)
    for word, value in words.items():
        assert word in block
        block = re.sub(rf"\b{word}\b", lambda _, value=value: str(value), block)
    done = subprocess.run(["sh", "-euxc", block], capture_output=True, text=True, timeout=300)
    assert done.returncode in (0, 24), done.stderr  # 24: files were removed meanwhile


class BackupTest(WithPostgres):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.scene = make_scene("cornell-box", cls.root)
        cls.expected = {}
        for samples in (FEW, MANY):
            picture = cls.root / f"{samples}.exr"
            run("lumifold", "render", cls.scene, *SETTINGS, "--spp", samples, "--threads", "2", "-o", picture)
            cls.expected[samples] = picture.read_bytes()

    def submit(self, farm, samples):
        return farm.client("submit", self.scene, *SETTINGS, "--spp", samples).stdout.strip()

    def expect_same_picture(self, farm, job, samples):
        result = self.root / f"{job}.exr"
        farm.client("wait", job)
        farm.client("download", job, "-o", result)
        self.assertEqual(result.read_bytes(), self.expected[samples])

    def jobs_at_the_backup(self, farm):
        """A job that is done, and one that is being rendered."""
        done = self.submit(farm, FEW)
        farm.client("wait", done)
        running = self.submit(farm, MANY)
        wait_until(lambda: farm.status(running)["units_done"] > 3, "some units")
        return done, running

    def test_a_ledger_in_the_data_folder_with_access_control(self):
        store = os.environ.pop("LUMIFOLD_STORE")
        self.addCleanup(os.environ.__setitem__, "LUMIFOLD_STORE", store)
        with tempfile.TemporaryDirectory() as folder, SecureFarm(folder) as farm:
            data, backup = pathlib.Path(folder) / "data", pathlib.Path(folder) / "backup"
            farm.enroll("node-1", "node-1")
            farm.start_worker("--profile", "node-1")
            done, running = self.jobs_at_the_backup(farm)
            for _ in range(2):  # the second one copies what is new
                run_block("backup sqlite", DIR=data, BACKUP=backup)
            self.assertEqual(backup.stat().st_mode & 0o777, 0o700)
            later = self.submit(farm, FEW)
            farm.client("cancel", running)  # not in the backup
            farm.server.kill()
            shutil.rmtree(data)
            run_block("restore sqlite", DIR=data, BACKUP=backup)
            farm.restart_server()
            self.assertGreater(farm.status(running)["units_done"], 3)
            self.expect_same_picture(farm, running, MANY)  # by the worker that has been there all the time
            self.expect_same_picture(farm, done, FEW)
            self.assertNotIn(later, farm.client("list").stdout)

    def test_a_ledger_in_postgresql(self):
        with tempfile.TemporaryDirectory() as folder:
            data, backup = pathlib.Path(folder) / "data", pathlib.Path(folder) / "backup"
            with Farm(data) as farm:
                farm.start_worker()
                done, running = self.jobs_at_the_backup(farm)
                run_block("backup postgresql", DIR=data, BACKUP=backup, STORE=self.uri)
                farm.client("delete", done)
                farm.client("cancel", running)
                farm.server.kill()
                shutil.rmtree(data)
                run_block("restore postgresql", DIR=data, BACKUP=backup, STORE=self.uri)
                farm.restart_server()
                self.assertGreater(farm.status(running)["units_done"], 3)
                self.expect_same_picture(farm, running, MANY)
                self.expect_same_picture(farm, done, FEW)


if __name__ == "__main__":
    unittest.main()
