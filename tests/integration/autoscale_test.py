"""lumifold-autoscale with a real coordinator: on a real Slurm, and on a fake of its commands."""

import json
import os
import pathlib
import tempfile
import time
import unittest
import unittest.mock

import slurm
from access_test import SecureFarm
from fake_slurm import FARM_NAME, FakeSlurm
from farm import BIN, Farm, Process, make_scene, run, wait_until

SCRIPT = pathlib.Path(__file__).parents[2] / "deploy" / "slurm" / "worker.sbatch"
# Units that take minutes: a queue that stays.
NO_END = ["--size", "128x128", "--spp", "1048576", "--plan", "full"]
# Some seconds for three workers on two processors.
SHORT = ["--size", "96x96", "--spp", "2048", "--seed", "3"]
MAXIMUM = 3
SLOTS = [f"lumifold-{FARM_NAME}-{slot}" for slot in range(MAXIMUM)]
EXIT_FAILED, EXIT_UNREACHABLE = 1, 3


class FarmCase(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory(prefix="lumifold-autoscale-")
        cls.addClassCleanup(folder.cleanup)
        cls.root = pathlib.Path(folder.name)
        cls.root.chmod(0o755)
        cls.scene = make_scene("cornell-box", cls.root)

    def setUp(self):
        data = tempfile.TemporaryDirectory()
        self.addCleanup(data.cleanup)
        self.folder = pathlib.Path(data.name)
        self.farm = Farm(self.folder / "data")
        self.addCleanup(self.farm.__exit__)

    def submit(self, *settings):
        return self.farm.client("submit", self.scene, *settings).stdout.strip()

    def arguments(self, *more, state="state"):
        maximum = () if "--max" in more else ("--max", MAXIMUM)
        return [
            "--server", self.farm.address, "--state", self.folder / state, *maximum, "--finish-seconds", "1",
            *self.engine_arguments(), *more
        ]

    def step(self, *more, code=0, state="state"):
        """One step; the decision, with the log in "log"."""
        done = run("lumifold-autoscale",
                   *self.arguments("--once", "--json", *more, state=state),
                   check=False,
                   timeout=120)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return {**(json.loads(done.stdout) if done.stdout else {}), "log": done.stderr}

    def start_autoscaler(self, *more, state="state"):
        """One that looks twice a second, until the end of the test."""
        process = Process("lumifold-autoscale",
                          *self.arguments("--interval-seconds", "0.5", *more, state=state))
        self.addCleanup(lambda: process.is_running() and process.stop())
        return process


class FakeSlurmTest(FarmCase):
    """What a real Slurm does only now and then. Needs no Slurm."""

    def setUp(self):
        super().setUp()
        self.slurm = FakeSlurm(self.folder)
        self.addCleanup(self.slurm.close)

    def engine_arguments(self):
        return self.slurm.engine_arguments()

    def test_asks_for_workers_once(self):
        self.submit(*NO_END)
        decision = self.step("--dry-run")
        self.assertEqual((decision["start"], self.slurm.jobs()), (MAXIMUM, []))
        self.assertEqual((self.step()["start"], self.slurm.jobs()), (MAXIMUM, SLOTS))
        decision = self.step()
        self.assertEqual((decision["start"], decision["pending"], self.slurm.jobs()), (0, MAXIMUM, SLOTS))

    def test_lets_the_idle_worker_go_and_no_busy_one(self):
        self.submit(*NO_END, "--max-leases", "1", "--tag", "wanted")
        for slot, tag in enumerate(("wanted", "other")):
            self.slurm.add_running(str(slot + 1), slot)
            self.farm.start_worker("--name", f"slurm-{slot + 1}@node", "--tags", tag, "--drain-seconds", "0")

        def states():
            workers = [json.loads(line) for line in self.farm.client("workers", "--json").stdout.splitlines()]
            return {worker["process"]: worker["state"] for worker in workers}

        wait_until(lambda: states() == {"slurm-1@node": "busy", "slurm-2@node": "idle"},
                   "one worker is busy, one idle")
        autoscaler = self.start_autoscaler("--idle-seconds", "1", "--tags", "wanted")
        wait_until(lambda: self.slurm.jobs() == SLOTS[:1], "the idle worker is released")
        self.assertEqual(autoscaler.stop(), 0, autoscaler.log_text())
        self.assertEqual(self.slurm.calls("scancel"), ["scancel --quiet 2"])

    def test_two_at_once_ask_for_no_more_than_one_would(self):
        self.submit(*NO_END)
        both = [self.start_autoscaler(state=f"state-{i}") for i in range(2)]
        wait_until(lambda: len(self.slurm.calls("squeue")) > 20, "some looks of both")
        for process in both:
            self.assertEqual(process.stop(), 0, process.log_text())
        # Both may have asked for the same slots; what was asked for twice is cancelled.
        asked = {
            word.removeprefix("--job-name=")
            for call in self.slurm.calls("sbatch")
            for word in call.split()
            if word.startswith("--job-name=")
        }
        self.assertEqual((sorted(asked), self.slurm.jobs()), (SLOTS, SLOTS))

    def test_errors_of_the_engine_start_nothing(self):
        self.submit(*NO_END)
        for answer, said in (("echo 'slurm_load_jobs error: Unable to contact slurm controller' >&2; exit 1",
                              "Unable to contact"),
                             ("echo 'slurm_load_jobs error: Invalid user id' >&2; exit 1",
                              "Invalid user id"), (f"echo '1|RUNNING|then|N/A|1|None|lumifold-{FARM_NAME}-0'",
                                                   "RUNNING|then"), ("kill -9 $$", "ended by signal 9")):
            self.slurm.answer("squeue", answer)
            self.assertIn(said, self.step(code=EXIT_FAILED)["log"])
        self.slurm.answer("squeue", "sleep 1000")
        self.assertIn("squeue took longer than 300ms",
                      self.step("--call-seconds", "0.3", code=EXIT_FAILED)["log"])
        self.slurm.remove("squeue")
        with unittest.mock.patch.dict(os.environ, PATH=str(self.slurm.bin)):
            self.assertIn("cannot run squeue", self.step(code=EXIT_FAILED)["log"])
        self.assertEqual(self.slurm.calls("sbatch"), [])
        self.slurm.install("squeue")
        self.assertEqual(self.step()["start"], MAXIMUM)

    def test_errors_while_it_runs_start_and_release_nothing(self):
        self.slurm.answer("squeue", "exit 1")
        self.submit(*NO_END)
        autoscaler = self.start_autoscaler()
        wait_until(lambda: autoscaler.log_text().count("event=step_failed") > 1, "two steps fail")
        self.assertEqual(self.slurm.calls("sbatch") + self.slurm.calls("scancel"), [])
        self.slurm.install("squeue")
        wait_until(lambda: self.slurm.jobs() == SLOTS, "it goes on")
        self.assertEqual(autoscaler.stop(), 0, autoscaler.log_text())

    def test_a_refused_start_waits_also_after_a_restart(self):
        self.submit(*NO_END)
        self.slurm.answer("sbatch", "echo 'sbatch: error: Job violates accounting/QOS policy' >&2; exit 1")
        self.assertIn("event=start_refused failures=1", self.step()["log"])
        self.slurm.install("sbatch")
        decision = self.step("--first-pause-seconds", "600")
        self.assertEqual((decision["start"], self.slurm.jobs()), (0, []))
        self.assertRegex(
            decision["reason"],
            r"the engine refused: sbatch ended .*QOS policy \(1 in a row\); next try in [\dms]+")

    def test_without_a_coordinator_nothing_is_done(self):
        self.farm.server.kill()
        self.step(code=EXIT_UNREACHABLE)
        self.assertEqual(self.slurm.calls(), [])


class AccessTest(unittest.TestCase):
    def test_scope_read_is_enough(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            fake = FakeSlurm(root)
            self.addCleanup(fake.close)
            with SecureFarm(root / "farm") as farm:
                farm.client("submit", make_scene("cornell-box", root), *NO_END)  # of another user
                farm.join("login", farm.invite("scaler", "--scope", "read"), profile="scaler")
                done = run("lumifold-autoscale", "--once", "--json", "--profile", "scaler", "--state",
                           root / "state", *fake.engine_arguments())
                self.assertEqual(json.loads(done.stdout)["start"], 1)
                self.assertEqual(fake.jobs(), SLOTS[:1])


@unittest.skipIf(slurm.missing(), slurm.missing())
class SlurmTest(FarmCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        (cls.root / "slurm").mkdir()
        cls.slurm = slurm.Slurm(cls.root / "slurm", cpus=8)
        cls.addClassCleanup(cls.slurm.__exit__)
        os.environ["SLURM_CONF"] = cls.slurm.environment["SLURM_CONF"]
        os.environ["LUMIFOLD_WORKER"] = str(BIN / "lumifold-worker")
        os.environ["LUMIFOLD_ASSET_CACHE"] = ""

    def setUp(self):
        super().setUp()
        os.environ["LUMIFOLD_SERVER"] = self.farm.address
        self.addCleanup(self.cancel_all)

    def cancel_all(self):
        self.slurm.run("scancel", "--quiet", "--user=root", check=False)
        wait_until(lambda: not self.slurm.run("squeue", "--noheader").stdout, "all jobs are gone")

    def engine_arguments(self):
        return [
            "--farm", f"{FARM_NAME}-{self.id().rsplit('.')[-1][:30]}", "--script", SCRIPT, "--sbatch",
            f"--output={self.folder}/%x-%j.log", "--sbatch", "--cpus-per-task=1", "--sbatch",
            f"--chdir={self.folder}"
        ]

    def jobs(self, *states):
        """Id and name of this test's jobs in these states."""
        name = self.engine_arguments()[1]
        lines = self.slurm.run("squeue", "--noheader", f"--states={','.join(states)}",
                               "--format=%i %j").stdout.splitlines()
        return dict(line.split() for line in lines if f"lumifold-{name}-" in line)

    def test_workers_come_and_go_with_a_job_whatever_autoscalers_do(self):
        both = [self.start_autoscaler("--idle-seconds", "2", state=f"state-{i}") for i in range(2)]
        job = self.submit(*SHORT)
        most = 0

        def looks(condition):
            nonlocal most
            most = max(most, len(self.jobs("RUNNING", "COMPLETING")))
            return condition()

        wait_until(lambda: looks(lambda: len(self.jobs("RUNNING")) == MAXIMUM), "all workers run")
        both[0].kill()  # and the other goes on; one that comes again takes its state
        both.append(self.start_autoscaler("--idle-seconds", "2", state="state-0"))
        wait_until(lambda: looks(lambda: self.farm.status(job)["state"] == "done"), "the job is done")
        wait_until(lambda: looks(lambda: not self.jobs("PENDING", "RUNNING", "COMPLETING")),
                   "the workers have gone", 60)
        self.assertEqual(most, MAXIMUM)
        started = [
            line for process in both for line in process.log_text().splitlines()
            if "event=start workers" in line
        ]
        self.assertGreaterEqual(len(started), 1)
        self.assertEqual(len({name for name in self.jobs("all").values()}), MAXIMUM,
                         "three slots and no others")
        for process in both[1:]:
            self.assertEqual(process.stop(), 0, process.log_text())

    def test_two_starts_at_a_time_of_a_slot_run_once(self):
        self.submit(*NO_END)
        # Both look before either starts: Slurm itself must keep the second one from running.
        slot = f"--job-name=lumifold-{self.engine_arguments()[1]}-0"
        for _ in range(2):
            self.slurm.submit(
                "--cpus-per-task=1",
                slot,
                "--dependency=singleton",
                f"--output={self.folder}/%j.log",
                SCRIPT,
                environment={name: os.environ[name] for name in ("LUMIFOLD_SERVER", "LUMIFOLD_WORKER")})
        wait_until(lambda: len(self.jobs("RUNNING")) == 1, "one runs")
        decision = self.step("--max", "1")
        self.assertEqual([one["why"] for one in decision["release"]], ["another request has its place"])
        wait_until(lambda: not self.jobs("PENDING"), "the duplicate is cancelled")
        self.assertEqual((len(self.jobs("RUNNING")), decision["start"]), (1, 0))

    def test_backs_off_when_slurm_refuses_and_remembers_it(self):
        self.submit(*NO_END)
        refusing = ["--sbatch", "--partition=none"]
        log = self.step(*refusing)["log"]
        self.assertRegex(log, "event=start_refused failures=1 .*(?i:invalid partition)")
        decision = self.step("--first-pause-seconds", "600")  # another process, with the same state file
        self.assertEqual(decision["start"], 0)
        self.assertRegex(decision["reason"],
                         r"the engine refused: sbatch .*\(1 in a row\); next try in [\dms]+")
        self.assertEqual(self.step("--dry-run", state="other")["start"], MAXIMUM)

    def test_backs_off_when_workers_die_at_their_start(self):
        self.submit(*NO_END)
        self.step("--worker=--no-such-option")
        wait_until(lambda: len(self.jobs("FAILED")) == MAXIMUM, "all have died")
        decision = self.step("--first-pause-seconds", "600")
        self.assertEqual(decision["start"], 0)
        self.assertRegex(decision["reason"],
                         r"workers die at their start: request \d+ ended .* NonZeroExitCode \(and 2 more\)")

    def test_a_spent_budget_ends_all(self):
        self.submit(*NO_END)
        self.step("--budget-core-hours", "1")
        wait_until(lambda: self.jobs("RUNNING"), "a worker runs")
        wait_until(
            lambda: "idle" in self.farm.client("workers").stdout or "busy" in self.farm.client("workers").
            stdout, "it joined")
        time.sleep(1)
        decision = self.step("--budget-core-hours", "1e-6")
        self.assertIn("the budget of 1e-06 core-hours is spent", decision["reason"])
        wait_until(lambda: not self.jobs("PENDING", "RUNNING", "COMPLETING"), "it is gone", 60)


if __name__ == "__main__":
    unittest.main()
