"""lumifold-autoscale with a real coordinator: on a real Slurm, and on a fake of the Kubernetes API over TLS."""

import contextlib
import json
import os
import pathlib
import tempfile
import time
import unittest

import slurm
from access_test import SecureFarm
from fake_kubernetes import COST, DEPLOYMENT, NAMESPACE, FakeKubernetes
from farm import BIN, Farm, Process, make_scene, run, wait_until

SCRIPT = pathlib.Path(__file__).parents[2] / "deploy" / "slurm" / "worker.sbatch"
# Units that take minutes: a queue that stays.
NO_END = ["--size", "128x128", "--spp", "1048576", "--plan", "full"]
# Some seconds for three workers on two processors.
SHORT = ["--size", "96x96", "--spp", "2048", "--seed", "3"]
FARM_NAME = "test"
MAXIMUM = 3
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
        return ["--server", self.farm.address, "--state", self.folder / state, *maximum, "--finish-seconds", "1",
                *self.engine_arguments(), *more]

    def step(self, *more, code=0, state="state"):
        """One step; the decision, with the log in "log"."""
        done = run("lumifold-autoscale", *self.arguments("--once", "--json", *more, state=state), check=False, timeout=120)
        self.assertEqual(done.returncode, code, done.stdout + done.stderr)
        return {**(json.loads(done.stdout) if done.stdout else {}), "log": done.stderr}

    def start_autoscaler(self, *more, state="state"):
        """One that looks twice a second, until the end of the test."""
        process = Process("lumifold-autoscale", *self.arguments("--interval-seconds", "0.5", *more, state=state))
        self.addCleanup(lambda: process.is_running() and process.stop())
        return process


class KubernetesTest(FarmCase):
    def setUp(self):
        super().setUp()
        self.cluster = FakeKubernetes(self.folder)
        self.addCleanup(self.cluster.close)

    def engine_arguments(self):
        return ["--engine", "kubernetes", "--api", self.cluster.url, "--namespace", NAMESPACE, "--deployment", DEPLOYMENT,
                "--token-file", self.cluster.token_file, "--ca-file", self.cluster.ca_file]

    def test_asks_for_workers_once(self):
        self.cluster.start_pods = False
        self.submit(*NO_END)
        decision = self.step("--dry-run")
        self.assertEqual((decision["start"], self.cluster.replicas), (MAXIMUM, 0))
        self.assertEqual((self.step()["start"], self.cluster.replicas), (MAXIMUM, MAXIMUM))
        decision = self.step()
        self.assertEqual((decision["start"], decision["pending"], self.cluster.replicas), (0, MAXIMUM, MAXIMUM))

    def test_lets_the_idle_pod_go_and_no_busy_one(self):
        self.cluster.set_replicas(2)
        self.submit(*NO_END, "--max-leases", "1")
        for pod in self.cluster.pods:
            self.farm.start_worker("--name", pod, "--drain-seconds", "0")

        def states():
            workers = [json.loads(line) for line in self.farm.client("workers", "--json").stdout.splitlines()]
            # The job is planned: the unit that is leased now takes minutes.
            return {worker["process"]: worker["state"] for worker in workers if worker["job_ids"] or worker["state"] == "idle"}

        wait_until(lambda: sorted(states().values()) == ["busy", "idle"], "one worker is busy, one idle")
        idle = next(pod for pod, state in states().items() if state == "idle")
        autoscaler = self.start_autoscaler("--idle-seconds", "1")
        wait_until(lambda: self.cluster.replicas == 1, "the Deployment is scaled down")
        self.assertEqual(self.cluster.patches(f"/pods/{idle}"), [{"metadata": {"annotations": {COST: "-1000"}}}])
        self.assertNotIn(idle, self.cluster.pods)
        self.assertEqual(autoscaler.stop(), 0, autoscaler.log_text())
        self.assertEqual(self.cluster.replicas, 1)

    def test_a_change_of_another_program_is_seen(self):
        self.submit(*NO_END)

        def change():
            self.cluster.before_patch = None
            self.cluster.set_replicas(1)

        self.cluster.before_patch = change
        self.assertIn("event=start_again", self.step()["log"])
        self.assertEqual(self.cluster.replicas, 1)
        self.assertEqual(self.step()["start"], MAXIMUM - 1)

    def test_two_at_once_ask_for_no_more_than_one_would(self):
        self.cluster.start_pods = False
        self.submit(*NO_END)
        both = [self.start_autoscaler(state=f"state-{i}") for i in range(2)]
        wait_until(lambda: len(self.cluster.calls) > 60, "some looks of both")
        for process in both:
            self.assertEqual(process.stop(), 0, process.log_text())
        self.assertEqual({patch["spec"]["replicas"] for patch in self.cluster.patches("/scale")}, {MAXIMUM})
        self.assertEqual((self.cluster.replicas, self.cluster.made), (MAXIMUM, MAXIMUM))

    def test_errors_of_the_api_start_nothing(self):
        self.submit(*NO_END)
        for code in (500, 503, 429, 404):
            self.cluster.fail = [code]
            self.assertIn(f"answers {code}", self.step(code=EXIT_FAILED)["log"])
        self.cluster.token_file.write_text("another")
        self.assertIn("answers 401", self.step(code=EXIT_FAILED)["log"])
        self.cluster.token_file.write_text("the-token")
        self.cluster.delay = 2
        self.assertRegex(self.step("--call-seconds", "0.3", code=EXIT_FAILED)["log"], "(?i)time")
        self.cluster.delay = 0
        own, self.cluster.ca_file = self.cluster.ca_file, "/etc/ssl/certs/ca-certificates.crt"
        self.assertIn("certificate", self.step(code=EXIT_FAILED)["log"])
        self.cluster.ca_file = own
        self.assertEqual(self.cluster.replicas, 0)
        self.assertEqual(self.step()["start"], MAXIMUM)

    def test_a_refused_start_waits_also_after_a_restart(self):
        self.submit(*NO_END)
        self.cluster.fail = [0, 0, 0, 403]  # scale, Deployment, pods; the patch
        self.assertIn("event=start_refused failures=1", self.step()["log"])
        decision = self.step("--first-pause-seconds", "600")
        self.assertEqual((decision["start"], self.cluster.replicas), (0, 0))
        self.assertRegex(decision["reason"], r"the engine refused: .* answers 403 .*\(1 in a row\); next try in [\dms]+")

    def test_without_a_coordinator_nothing_is_done(self):
        self.farm.server.kill()
        self.step(code=EXIT_UNREACHABLE)
        self.assertEqual(self.cluster.calls, [])


class AccessTest(unittest.TestCase):
    def test_scope_read_is_enough(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            cluster = FakeKubernetes(root)
            self.addCleanup(cluster.close)
            with SecureFarm(root / "farm") as farm:
                farm.client("submit", make_scene("cornell-box", root), *NO_END)  # of another user
                farm.join("login", farm.invite("scaler", "--scope", "read"), profile="scaler")
                done = run("lumifold-autoscale", "--once", "--json", "--profile", "scaler", "--state", root / "state", "--engine",
                           "kubernetes", "--api", cluster.url, "--namespace", NAMESPACE, "--deployment", DEPLOYMENT,
                           "--token-file", cluster.token_file, "--ca-file", cluster.ca_file)
                self.assertEqual(json.loads(done.stdout)["start"], 1)


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
        return ["--engine", "slurm", "--farm", f"{FARM_NAME}-{self.id().rsplit('.')[-1][:30]}", "--script", SCRIPT, "--sbatch",
                f"--output={self.folder}/%x-%j.log", "--sbatch", "--cpus-per-task=1", "--sbatch", f"--chdir={self.folder}"]

    def jobs(self, *states):
        """Id and name of this test's jobs in these states."""
        name = self.engine_arguments()[3]
        lines = self.slurm.run("squeue", "--noheader", f"--states={','.join(states)}", "--format=%i %j").stdout.splitlines()
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
        wait_until(lambda: looks(lambda: not self.jobs("PENDING", "RUNNING", "COMPLETING")), "the workers have gone", 60)
        self.assertEqual(most, MAXIMUM)
        started = [line for process in both for line in process.log_text().splitlines() if "event=start workers" in line]
        self.assertGreaterEqual(len(started), 1)
        self.assertEqual(len({name for name in self.jobs("all").values()}), MAXIMUM, "three slots and no others")
        for process in both[1:]:
            self.assertEqual(process.stop(), 0, process.log_text())

    def test_two_starts_at_a_time_of_a_slot_run_once(self):
        self.submit(*NO_END)
        # Both look before either starts: Slurm itself must keep the second one from running.
        slot = f"--job-name=lumifold-{self.engine_arguments()[3]}-0"
        for _ in range(2):
            self.slurm.submit("--cpus-per-task=1", slot, "--dependency=singleton",
                              f"--output={self.folder}/%j.log", SCRIPT,
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
        self.assertRegex(decision["reason"], r"the engine refused: sbatch .*\(1 in a row\); next try in [\dms]+")
        self.assertEqual(self.step("--dry-run", state="other")["start"], MAXIMUM)

    def test_backs_off_when_workers_die_at_their_start(self):
        self.submit(*NO_END)
        self.step("--worker=--no-such-option")
        wait_until(lambda: len(self.jobs("FAILED")) == MAXIMUM, "all have died")
        decision = self.step("--first-pause-seconds", "600")
        self.assertEqual(decision["start"], 0)
        self.assertRegex(decision["reason"], r"workers die at their start: request \d+ ended .* NonZeroExitCode \(and 2 more\)")

    def test_a_spent_budget_ends_all(self):
        self.submit(*NO_END)
        self.step("--budget-core-hours", "1")
        wait_until(lambda: self.jobs("RUNNING"), "a worker runs")
        wait_until(lambda: "idle" in self.farm.client("workers").stdout or "busy" in self.farm.client("workers").stdout, "it joined")
        time.sleep(1)
        decision = self.step("--budget-core-hours", "1e-6")
        self.assertIn("the budget of 1e-06 core-hours is spent", decision["reason"])
        wait_until(lambda: not self.jobs("PENDING", "RUNNING", "COMPLETING"), "it is gone", 60)


if __name__ == "__main__":
    unittest.main()
