"""A farm whose workers are jobs of a Slurm cluster, for tests."""

import os
import pathlib
import re
import shutil
import tempfile
import unittest

import farm
from slurm import Slurm, missing

ROOT = pathlib.Path(__file__).parents[3]
SCRIPT = ROOT / "deploy/slurm/worker.sbatch"
# Four tiles in several passes: units of about half a second.
SETTINGS = ["--size", "64x64", "--spp", "512", "--seed", "3"]


class SlurmTest(unittest.TestCase):
    """The tests of a module share a cluster, a scene, and its picture as one process renders it."""

    root = None

    @classmethod
    def setUpClass(cls):
        if SlurmTest.root is None:
            SlurmTest.start()

    @staticmethod
    def start():
        if why := missing(accounting=True):
            print(f"skipped: Slurm cannot be started here: {why}", flush=True)
            raise unittest.SkipTest(f"Slurm cannot be started here: {why}")
        SlurmTest.root = root = pathlib.Path(tempfile.mkdtemp(prefix="lumifold_slurm_"))
        unittest.addModuleCleanup(shutil.rmtree, root, ignore_errors=True)
        os.chmod(root, 0o755)  # MariaDB and the workers are other users
        SlurmTest.scene = farm.make_scene("cornell-box", root)
        SlurmTest.expected = root / "one-process.exr"
        farm.run("lumifold", "render", SlurmTest.scene, *SETTINGS, "-o", SlurmTest.expected)
        SlurmTest.slurm = unittest.enterModuleContext(Slurm(root / "slurm", accounting=True))

    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(dir=self.root))
        os.chmod(self.folder, 0o755)
        self.farm = self.enterContext(farm.Farm(self.folder / "data"))
        # Before the coordinator goes: a worker that has none waits for it.
        self.addCleanup(self.slurm.cancel_all)

    def submit_workers(self, *options, arguments=(), **environment):
        """Submits workers for this test's coordinator: `options` are those of sbatch, `arguments` those of
        the worker. Returns the id of the Slurm job."""
        environment = {"LUMIFOLD_SERVER": self.farm.address, "LUMIFOLD_IDLE_SECONDS": "900",
                       "LUMIFOLD_ASSET_CACHE": str(self.folder / "assets"),
                       "LUMIFOLD_WORKER": str(farm.BIN / "lumifold-worker"), **environment}
        return self.slurm.submit(f"--chdir={self.folder}",
                                 *options,
                                 SCRIPT,
                                 *arguments,
                                 environment=environment)

    def submit_job(self, *settings):
        return self.farm.client("submit", self.scene, *(settings or SETTINGS)).stdout.strip()

    def wait_for_units(self, job, count):
        farm.wait_until(lambda: self.farm.status(job)["units_done"] >= count, f"{count} units of {job}")

    def check_picture(self, job):
        self.farm.client("wait", job)
        result = self.folder / f"{job}.exr"
        self.farm.client("download", job, "-o", result)
        self.assertEqual(result.read_bytes(), self.expected.read_bytes())

    def log_of(self, slurm_job):
        """Log of a job; Slurm names it by the raw id, which differs from that of an element of an array."""
        return (self.folder / f"lumifold-worker-{self.slurm.field(slurm_job, 'JobId')}.log").read_text()

    def accounting(self, slurm_job, *fields):
        """What sacct says of a job: for each of its runs, requeued ones included, a list of fields."""
        text = self.slurm.run("sacct", "--duplicates", "--allocations", "--noheader", "--parsable2",
                              f"--jobs={slurm_job}", f"--format={','.join(fields)}").stdout
        return [line.split("|") for line in text.splitlines()]

    def wait_for_accounting(self, slurm_job, *states):
        """Waits until the last run of a job has one of these states in the accounting store; returns the
        states."""
        def states_of_runs():
            runs = [re.sub(" by .*", "", state) for state, in self.accounting(slurm_job, "State")]
            return runs if runs and runs[-1] in states else None
        return farm.wait_until(states_of_runs, f"{slurm_job} {states}", seconds=120)
