"""Workers as Slurm jobs: an array renders a job, signals drain it, requeueing gives the workers back, and
exit codes say what Slurm shall do. The bits of the picture are those of one process each time."""

import json
import os
import re
import subprocess
import unittest

import farm
import slurm
from slurm_farm import ROOT, SlurmTest


class WorkersTest(SlurmTest):
    def test_an_array_renders_a_job_and_ends_when_it_is_idle(self):
        array = self.submit_workers("--array=1-3",
                                    arguments=["--log-level", "debug"],
                                    LUMIFOLD_IDLE_SECONDS="2")
        job = self.submit_job()
        self.check_picture(job)
        rendered = 0
        for task in range(1, 4):
            self.slurm.wait_for_state(f"{array}_{task}", "COMPLETED")
            log = self.log_of(f"{array}_{task}")
            self.assertIn(f"name=slurm-{array}_{task}@{self.slurm.host} ", log)
            self.assertIn("event=leaving reason=idle", log)
            rendered += log.count("event=unit_rendered")
        self.assertGreaterEqual(rendered, self.farm.status(job)["units_total"])
        for task in range(1, 4):  # tasks are recorded later than they end, each by itself
            self.wait_for_accounting(f"{array}_{task}", "COMPLETED")
            self.assertEqual(self.accounting(f"{array}_{task}", "State", "ExitCode", "AllocCPUS"),
                             [["COMPLETED", "0:0", "1"]])

    def test_workers_of_a_node_share_the_files_of_scenes(self):
        logs = []
        for _ in range(2):
            worker = self.submit_workers(arguments=["--log-level", "debug"], LUMIFOLD_IDLE_SECONDS="1")
            self.check_picture(self.submit_job())
            self.slurm.wait_for_state(worker, "COMPLETED")
            logs.append(self.log_of(worker))
        self.assertEqual([log.count("event=asset_found") for log in logs], [0, 1], logs)
        self.submit_workers(LUMIFOLD_IDLE_SECONDS="1",
                            LUMIFOLD_ASSET_CACHE="/")  # of somebody else: it works without
        self.check_picture(self.submit_job())
        self.assertEqual([asset.stat().st_size for asset in (self.folder / "assets").iterdir()],
                         [self.scene.stat().st_size])

    def test_a_worker_has_the_processors_that_slurm_gives_it(self):
        slurm_job = self.submit_workers("--cpus-per-task=3")
        line = farm.wait_until(lambda: self.farm.client("workers", "--json").stdout, "a worker")
        worker = json.loads(line)
        self.assertEqual((worker["name"], worker["slots"]), (f"slurm-{slurm_job}@{self.slurm.host}", 6),
                         worker)

    def test_sigterm_drains_a_worker_and_another_goes_on(self):
        job = self.submit_job()
        first = self.submit_workers()
        self.wait_for_units(job, 1)
        self.slurm.run("scancel", "--batch", "--signal=TERM", first)
        self.slurm.wait_for_state(first, "COMPLETED")
        self.assertEqual(self.slurm.field(first, "ExitCode"), "0:0")
        self.assertIn("event=leaving reason=signal", self.log_of(first))
        self.assertLess(self.farm.status(job)["units_done"], self.farm.status(job)["units_total"])
        self.submit_workers("--cpus-per-task=2")
        self.check_picture(job)
        for event in ("unit_failed", "lease_expired", "lease_dropped", "unit_in_quarantine"):
            self.assertNotIn(f"event={event}", self.farm.server.log_text())

    def test_requeueing_gives_the_worker_back(self):
        job = self.submit_job()
        slurm_job = self.submit_workers()
        self.wait_for_units(job, 1)
        self.slurm.run("scontrol", "requeue", slurm_job)
        self.check_picture(job)
        self.assertEqual(self.slurm.field(slurm_job, "Restarts"), "1")
        log = self.log_of(slurm_job)
        self.assertEqual((log.count("event=joined"), log.count("event=leaving reason=signal")), (2, 1), log)
        for event in ("unit_failed", "lease_expired", "lease_dropped", "unit_in_quarantine"):
            self.assertNotIn(f"event={event}", self.farm.server.log_text())

    def test_killed_workers_lose_nothing_that_was_committed(self):
        job = self.submit_job()
        array = self.submit_workers("--array=1-2")
        self.wait_for_units(job, 1)
        self.slurm.run("scancel", "--full", "--signal=KILL", f"{array}_1")
        self.check_picture(job)
        self.slurm.wait_for_state(f"{array}_1", "FAILED", "CANCELLED")

    def end_of(self, slurm_job):
        self.slurm.wait_for_state(slurm_job, "COMPLETED", "FAILED")
        return self.slurm.state(slurm_job), self.slurm.field(slurm_job, "ExitCode")

    def test_a_worker_that_reaches_no_coordinator_is_requeued(self):
        self.farm.server.stop()
        slurm_job = self.submit_workers(LUMIFOLD_IDLE_SECONDS="1")
        farm.wait_until(lambda: self.slurm.field(slurm_job, "Restarts") == "1",
                        "the job is requeued",
                        seconds=120)
        self.farm.restart_server()
        self.check_picture(self.submit_job())
        farm.wait_until(lambda: ["REQUEUED", "4:0"] in self.accounting(slurm_job, "State", "ExitCode"),
                        "its first run in sacct")

    def test_a_wrong_command_line_fails_the_job_for_good(self):
        self.assertEqual(self.end_of(self.submit_workers(arguments=["--no-such-option"])), ("FAILED", "2:0"))
        self.assertEqual(self.end_of(self.submit_workers("--ntasks=2")), ("FAILED", "2:0"))

    def test_a_missing_program_fails_the_job(self):
        self.assertEqual(self.end_of(self.submit_workers(LUMIFOLD_WORKER="/no/such/program")),
                         ("FAILED", "127:0"))


class PageTest(SlurmTest):
    """Runs the commands of docs/clusters.md as they stand there, with a folder, a port and small numbers put
    in."""

    def adapted(self, line):
        for words, put_in in {
                "/srv/lumifold": str(self.folder / "secured"), "0.0.0.0:7700": self.address,
                "farm.example.org:7700": self.address, "deploy/slurm": str(ROOT / "deploy/slurm"),
                "--cpus-per-task=16": "--cpus-per-task=1", "1-20": "1-2", "--spp 256": "--spp 2 --size 64x64",
                "scene.glb": str(self.scene), **self.printed
        }.items():
            line = line.replace(words, put_in)
        return line

    def run_line(self, line):
        done = subprocess.run(["bash", "-c", self.adapted(line)],
                              cwd=self.folder,
                              env=self.environment,
                              text=True,
                              capture_output=True,
                              timeout=farm.PATIENCE_SECONDS,
                              check=False)
        self.assertEqual(done.returncode, 0, f"{line}\n{done.stderr}")
        return done.stdout

    def test_slurm_in_ten_lines(self):
        page = (ROOT / "docs/clusters.md").read_text()
        lines = re.search(r"<!-- slurm: begin -->\n```sh\n(.*?)```", page, re.DOTALL)[1].splitlines()
        self.assertEqual(len(lines), 10)
        init, server, login, enroll, sbatch, submit, squeue, wait, download, scancel = lines
        self.address = f"127.0.0.1:{slurm.free_port()}"
        self.printed = {}
        self.environment = {**self.slurm.environment, "HOME": str(self.folder), "USER": "root",
                            "PATH": f"{farm.BIN}:{os.environ['PATH']}"}
        codes = re.findall(r"lumifold-[\w-]{40,}", self.run_line(init))
        self.printed = {"CODE-1": codes[0], "CODE-2": codes[1]}
        process = subprocess.Popen(["bash", "-c", f"exec {self.adapted(server)}"],
                                   env=self.environment,
                                   text=True,
                                   stdout=subprocess.PIPE,
                                   stderr=subprocess.DEVNULL)
        self.addCleanup(process.stdout.close)
        self.addCleanup(process.wait)
        self.addCleanup(process.terminate)
        self.assertIn("listening on", process.stdout.readline())
        self.run_line(login)
        self.run_line(enroll)
        array = self.run_line(sbatch).split()[-1]
        self.printed["JOB"] = self.run_line(submit).strip()
        self.assertIn(array, self.run_line(squeue))
        self.run_line(wait)
        self.run_line(download)
        self.assertGreater((self.folder / "picture.exr").stat().st_size, 1000)
        self.run_line(scancel)
        for task in (1, 2):
            self.slurm.wait_for_state(f"{array}_{task}", "COMPLETED")


if __name__ == "__main__":
    unittest.main()
