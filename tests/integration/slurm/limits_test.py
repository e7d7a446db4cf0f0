"""What takes minutes of Slurm's own time: time limits, preemption and lost nodes, and core-hours as Slurm and
the farm count them."""

import re
import subprocess
import time
import unittest

import farm
from slurm_farm import ROOT, SlurmTest

# Units of seconds, and more of them than a test lasts.
NO_END = ["--size", "256x256", "--spp", "1048576", "--plan", "full"]
BUSY_SECONDS = 100
FAILURES = ("unit_failed", "lease_expired", "lease_dropped", "unit_in_quarantine")


class LimitsTest(SlurmTest):
    def check_nothing_failed(self):
        for event in FAILURES:
            self.assertNotIn(f"event={event}", self.farm.server.log_text())

    def test_the_time_limit_drains_a_worker(self):
        job = self.submit_job(*NO_END)
        slurm_job = self.submit_workers("--time=1", "--signal=B:TERM@45", LUMIFOLD_DRAIN_SECONDS="5")
        self.wait_for_units(job, 1)
        self.assertEqual(self.wait_for_accounting(slurm_job, "COMPLETED", "TIMEOUT", "FAILED"), ["COMPLETED"])
        self.assertIn("event=leaving reason=signal", self.log_of(slurm_job))
        self.check_nothing_failed()

    def test_a_preempted_worker_hands_back_its_units_and_comes_back(self):
        job = self.submit_job()
        slurm_job = self.submit_workers("--exclusive", "--cpus-per-task=1")
        self.wait_for_units(job, 1)
        urgent = self.slurm.submit("--partition=urgent", "--exclusive", "--output=/dev/null",
                                   "--wrap=sleep 1")
        self.slurm.wait_for_state(urgent, "COMPLETED")
        self.check_picture(job)
        log = self.log_of(slurm_job)
        self.assertEqual((log.count("event=joined"), log.count("event=leaving reason=signal")), (2, 1), log)
        self.check_nothing_failed()

    def test_a_worker_of_a_lost_node_runs_again(self):
        job = self.submit_job()
        slurm_job = self.submit_workers()
        self.wait_for_units(job, 1)
        # The daemon of the node answers, so Slurm takes the node back by itself.
        self.slurm.run("scontrol", "update", f"nodename={self.slurm.host}", "state=down", "reason=test")
        farm.wait_until(lambda: self.slurm.field(slurm_job, "Restarts") == "1",
                        "the job is requeued",
                        seconds=120)
        self.check_picture(job)
        self.assertEqual(self.accounting(slurm_job, "State")[0], ["NODE_FAIL"])


class CoreHoursTest(SlurmTest):
    """Workers that are busy nearly all their life: what Slurm charges for them is what they spent for
    jobs."""

    def run_line(self, line):
        environment = {**self.slurm.environment, "LC_ALL": "C"}
        return subprocess.run(["bash", "-c", line],
                              cwd=self.folder,
                              env=environment,
                              text=True,
                              capture_output=True,
                              check=True).stdout

    def test_core_hours_agree_within_two_percent(self):
        # Of two users: those of one are served one after the other.
        jobs = [self.submit_job(*NO_END, "--user", user) for user in ("ann", "bob")]
        # Planned by another worker, so that those of Slurm have units from the first second on.
        planner = self.farm.start_worker("--drain-seconds", "0")
        for job in jobs:
            farm.wait_until(lambda job=job: self.farm.status(job)["state"] not in ("submitted", "planning"),
                            f"the plan of {job}")
        planner.stop()
        # One thread each: with several the first ones to finish wait for the last one when the worker leaves.
        array = self.submit_workers("--array=1-2", "--cpus-per-task=1")
        farm.wait_until(lambda: "RUNNING" in self.slurm.jobs().values(), "the workers run")
        time.sleep(BUSY_SECONDS)
        self.slurm.run("scancel", "--batch", "--signal=TERM", array)
        for task in (1, 2):
            self.assertEqual(self.wait_for_accounting(f"{array}_{task}", "COMPLETED"), ["COMPLETED"])
        page = (ROOT / "docs/clusters.md").read_text()
        theirs_line, ours_line = re.search(r"<!-- core-hours: begin -->\n```sh\n(.*?)```", page,
                                           re.DOTALL)[1].splitlines()
        theirs = float(self.run_line(theirs_line.replace("--name=lumifold-worker", f"--jobs={array}")))
        ours = {name: float(hours) for name, hours in map(str.split, self.run_line(ours_line).splitlines())}
        logs = "".join(self.log_of(f"{array}_{task}") for task in (1, 2))
        print(f"core-hours of {array}_[1-2]: Slurm {theirs:.5f}, ours {ours}", flush=True)
        self.assertEqual(set(ours), set(jobs))
        self.assertGreater(theirs, 2 * BUSY_SECONDS / 3600 * 0.98)
        self.assertAlmostEqual(sum(ours.values()) / theirs, 1, delta=0.02, msg=logs)


if __name__ == "__main__":
    unittest.main()
