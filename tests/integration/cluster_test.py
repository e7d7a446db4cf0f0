"""Several coordinators over one PostgreSQL database and one data folder: whatever happens to one of them, the picture is the
same bytes as those of one process, and nothing that was acknowledged is lost."""

import contextlib
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time
import unittest

from farm import PATIENCE_SECONDS, Process, make_scene, run, wait_until
from postgres_test import WithPostgres

SETTINGS = ["--size", "160x120", "--seed", "5", "--save-film"]
LONG = "--long" in sys.argv  # as many kills as the documents tell of
KILLS = 20 if LONG else 3


class Cluster(contextlib.AbstractContextManager):
    """Coordinators that share a data folder, and workers that know all of them."""

    def __init__(self, data, coordinators=3, workers=4, failover=2):
        self.data = data
        self.arguments = ["--failover-seconds", failover, "--heartbeat-seconds", 0.5, "--lease-seconds", 10]
        self.coordinators = []
        self.addresses = []
        for _ in range(coordinators):
            self.start_coordinator()
        self.workers = [self.start_worker() for _ in range(workers)]

    def start_coordinator(self, listen="127.0.0.1:0"):
        process = Process("lumifold-server", "--data", self.data, "--listen", listen, *self.arguments)
        line = process.popen.stdout.readline()
        if not line.startswith("listening on "):
            raise AssertionError(f"no server: {line}{process.log_text()}")
        process.address = line.removeprefix("listening on ").strip()
        self.coordinators.append(process)
        self.addresses.append(process.address)
        return process

    def restart(self, process):
        """Starts a coordinator that was killed again, at its address."""
        self.coordinators.remove(process)
        self.addresses.remove(process.address)
        return self.start_coordinator(process.address)

    def start_worker(self):
        return Process("lumifold-worker", "--server", ",".join(self.addresses), "--threads", 1)

    def client(self, command, *arguments, at=None, **options):
        return run("lumifold", command, "--server", (at or self.coordinators[0]).address, *arguments, **options)

    def submit(self, scene, *settings, at):
        return self.client("submit", scene, *SETTINGS, *settings, at=at).stdout.strip()

    def status(self, job, at=None):
        return json.loads(self.client("status", job, "--json", at=at).stdout)

    def owner(self, job, at):
        """The process that owns the job, as `at` says; None while nobody does."""
        answer = self.client("status", job, "--json", at=at, check=False)
        address = json.loads(answer.stdout)["coordinator"] if answer.returncode == 0 else ""
        return next((each for each in self.coordinators if each.address == address), None)

    def living(self):
        return [each for each in self.coordinators if each.is_running()]

    def __exit__(self, *_):
        for process in [*self.workers, *self.coordinators]:
            if process.is_running():
                process.resume()
                process.stop()
        return False


class ClusterTest(WithPostgres):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.scene = make_scene("cornell-box", cls.root)
        cls.expected = {}

    def expected_bytes(self, *settings):
        if settings not in self.expected:
            path = self.root / f"expected-{len(self.expected)}.exr"
            run("lumifold", "render", self.scene, *SETTINGS, *settings, "--threads", 2, "-o", path)
            type(self).expected[settings] = path.read_bytes()
        return self.expected[settings]

    def check(self, cluster, job, at, *settings):
        """Waits for the job and compares its picture."""
        cluster.client("wait", job, at=at)
        path = self.root / f"{job}.exr"
        cluster.client("download", job, "-o", path, at=at)
        self.assertEqual(path.read_bytes(), self.expected_bytes(*settings))

    def cluster(self, **options):
        data = self.enterContext(tempfile.TemporaryDirectory())
        return self.enterContext(Cluster(data, **options))

    def test_any_coordinator_answers_for_all_jobs(self):
        cluster = self.cluster(coordinators=2, workers=2)
        first, second = cluster.coordinators
        job = cluster.submit(self.scene, "--spp", 1024, at=first)
        wait_until(lambda: cluster.status(job, at=second)["units_done"] > 0, "progress, at the other one")
        self.assertEqual(cluster.status(job, at=second)["coordinator"], first.address)
        self.assertIn(job, cluster.client("list", at=second).stdout)
        self.assertIn("PAUSED", cluster.client("pause", job, at=second).stdout.upper())
        self.assertEqual(cluster.status(job, at=first)["state"].upper(), "PAUSED")
        cluster.client("resume", job, at=second)
        for at in (first, second):
            workers = json.loads(cluster.client("workers", "--json", at=at).stdout)["workers"]
            self.assertEqual(len(workers), 2, workers)
        cluster.client("cancel", job, at=second)
        wait_until(lambda: cluster.status(job, at=first)["state"].upper() == "CANCELLED", "the end, at the first")
        other = cluster.submit(self.scene, "--spp", 64, at=second)
        self.check(cluster, other, first, "--spp", 64)

    def test_workers_go_where_the_jobs_are(self):
        cluster = self.cluster(coordinators=3, workers=4)
        last = cluster.coordinators[-1]
        job = cluster.submit(self.scene, "--spp", 4096, at=last)
        wait_until(lambda: cluster.status(job)["workers"] == 4, "all workers at the only job")
        cluster.client("cancel", job, at=last)

    def test_owners_are_killed_in_turn(self):
        cluster = self.cluster()
        times = []
        settings = ("--spp", 2048)
        job = None
        for _ in range(KILLS):
            if job is None or cluster.status(job, at=cluster.living()[-1])["state"] == "done":
                if job is not None:
                    self.check(cluster, job, cluster.living()[0], *settings)
                job = cluster.submit(self.scene, *settings, at=cluster.living()[0])
            owner = wait_until(lambda: cluster.owner(job, cluster.living()[0]), "an owner")
            witness = next(each for each in cluster.living() if each is not owner)
            before = wait_until(lambda: cluster.status(job, at=witness)["units_done"], "progress")
            owner.kill()
            start = time.monotonic()
            wait_until(lambda: self.goes_on(cluster, job, owner, witness, before), "another owner that goes on", seconds=60)
            times.append(time.monotonic() - start)
            cluster.restart(owner)
        self.check(cluster, job, cluster.living()[0], *settings)
        times.sort()
        print(f"failover over {KILLS} kills: median {statistics.median(times):.2f} s, worst {times[-1]:.2f} s", file=sys.stderr)

    def goes_on(self, cluster, job, lost, witness, before):
        answer = cluster.client("status", job, "--json", at=witness, check=False)
        if answer.returncode != 0:
            return False
        status = json.loads(answer.stdout)
        self.assertGreaterEqual(status["units_done"], before)  # nothing acknowledged is lost
        has_moved = status["coordinator"] not in ("", lost.address) and status["units_done"] > before
        return has_moved or status["state"] == "done"

    def test_a_stopped_owner_that_wakes_is_refused(self):
        cluster = self.cluster()
        first, *others = cluster.coordinators
        job = cluster.submit(self.scene, "--spp", 1024, at=first)
        wait_until(lambda: cluster.status(job, at=others[0])["units_done"] > 0, "progress")
        first.pause()
        wait_until(lambda: cluster.owner(job, others[0]) in others, "another owner")
        wait_until(lambda: cluster.status(job, at=others[0])["workers"] > 0, "a worker there")
        first.resume()
        wait_until(lambda: "event=expelled" in first.log_text(), "a coordinator that knows it was expelled")
        wait_until(lambda: first.log_text().count("event=farm_joined") == 2, "a coordinator that starts anew")
        self.check(cluster, job, others[0], "--spp", 1024)
        self.assertEqual(cluster.status(job, at=first)["state"], "done")

    def test_the_database_is_restarted(self):
        cluster = self.cluster()
        job = cluster.submit(self.scene, "--spp", 1024, at=cluster.coordinators[1])
        wait_until(lambda: cluster.status(job)["units_done"] > 0, "progress")
        for command in ("stop", "start"):
            self.postgres.stdin.write(command + "\n")
            self.postgres.stdin.flush()
            self.assertEqual(self.postgres.stdout.readline(), "done\n")
            time.sleep(3)  # longer than a lease, so that all stand still for one
        self.check(cluster, job, cluster.coordinators[0], "--spp", 1024)
        for each in cluster.coordinators:
            self.assertNotIn("event=coordinator_expelled", each.log_text())

    def test_a_coordinator_that_ends_hands_its_jobs_over(self):
        cluster = self.cluster(coordinators=2, workers=2)
        first, second = cluster.coordinators
        job = cluster.submit(self.scene, "--spp", 1024, at=first)
        wait_until(lambda: cluster.status(job, at=second)["units_done"] > 0, "progress")
        self.assertEqual(first.stop(), 0)
        self.check(cluster, job, second, "--spp", 1024)
        self.assertIn("event=farm_left", first.log_text())


if __name__ == "__main__":
    sys.argv = [argument for argument in sys.argv if argument != "--long"]
    sys.exit(unittest.main())
