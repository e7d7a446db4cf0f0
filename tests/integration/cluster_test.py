"""Several coordinators over one PostgreSQL database and one data folder: whatever happens to one of them, the
picture is the same bytes as those of one process, and nothing that was acknowledged is lost."""

import concurrent.futures
import json
import os
import pathlib
import re
import statistics
import sys
import time
import unittest

from cluster import SETTINGS, ClusterCase
from farm import Process, wait_until

LONG = "--long" in sys.argv  # as many kills as the documents tell of
KILLS = 20 if LONG else 3


class ClusterTest(ClusterCase):
    def tell_database(self, command):
        self.postgres.stdin.write(command + "\n")
        self.postgres.stdin.flush()
        self.assertEqual(self.postgres.stdout.readline(), "done\n")

    def test_any_coordinator_answers_for_all_jobs(self):
        cluster = self.cluster(coordinators=2, workers=2)
        first, second = cluster.coordinators
        job = cluster.submit(self.scene, "--spp", 4096, at=first)
        wait_until(lambda: cluster.status(job, at=second)["units_done"] > 0, "progress, at the other one")
        self.assertEqual(cluster.status(job, at=second)["coordinator"], first.address)
        self.assertIn(job, cluster.client("list", at=second).stdout)
        # What the autoscaler asks for, wherever it asks.
        def demand():
            members = json.loads(cluster.client("server-status", "--json", at=second).stdout)["coordinators"]
            return {each["address"]: each["demand"] > 0 for each in members}

        wait_until(lambda: demand() == {first.address: True, second.address: False},
                   "demand of the other one")
        cluster.client("pause", job, at=second)
        self.assertEqual(cluster.status(job, at=first)["state"].upper(), "PAUSED")
        cluster.client("resume", job, at=second)
        for at in (first, second):
            workers = [
                json.loads(line) for line in cluster.client("workers", "--json", at=at).stdout.splitlines()
            ]
            self.assertEqual(len(workers), 2, workers)
        cluster.client("cancel", job, at=second)
        wait_until(lambda: cluster.status(job, at=first)["state"].upper() == "CANCELLED",
                   "the end, at the first")
        other = cluster.submit(self.scene, "--spp", 64, at=second)
        followed = cluster.client("wait", other, at=first)
        self.assertNotIn("trying again", followed.stderr, "its statuses come from its owner")
        self.check(cluster, other, first, "--spp", 64)

    def test_a_forwarded_call_keeps_its_trace_and_logs_are_found_anywhere(self):
        def under(trace):
            return {**os.environ, "TRACEPARENT": f"00-{trace}-00f067aa0ba902b7-01"}

        cluster = self.cluster(coordinators=2, workers=0)
        first, second = cluster.coordinators
        of_job, of_cancel = "4bf92f3577b34da6a3ce929d0e0e4736", "0af7651916cd43dd8448eb211c80319c"
        job = cluster.client("submit", self.scene, *SETTINGS, "--spp", 4096, at=first,
                             env=under(of_job)).stdout.strip()
        worker = Process("lumifold-worker", "--server", first.address, "--threads", 1, "--name", "node")
        cluster.workers.append(worker)
        wait_until(lambda: cluster.status(job, at=second)["units_done"] > 0, "progress")
        self.assertEqual(cluster.status(job, at=second)["trace_id"], of_job)
        cluster.client("cancel", job, at=second, env=under(of_cancel))
        ended, = re.findall("event=job_ended .*", first.log_text())
        self.assertIn(f"trace={of_job}", ended)
        line = f"FarmService/CancelJob .* trace={of_cancel} "
        wait_until(
            lambda: any(
                re.search(line, log.read_text()) for log in pathlib.Path(cluster.data).glob("audit.*.log")),
            "the call in an audit log, which is written after it")
        for at in (first, second):
            self.assertIn("event=worker_connected", cluster.client("logs", "node", at=at).stdout)
            self.assertIn("event=job_ended", cluster.client("logs", job, at=at).stdout)

    def test_workers_go_where_the_jobs_are(self):
        cluster = self.cluster(coordinators=3, workers=4)
        last = cluster.coordinators[-1]
        job = cluster.submit(self.scene, "--spp", 4096, at=last)
        wait_until(lambda: cluster.status(job)["workers"] == 4, "all workers at the only job")
        cluster.client("cancel", job, at=last)

    def test_owners_are_killed_in_turn(self):
        cluster = self.cluster()
        times, jobs = [], []
        settings = ("--spp", 1024)
        while len(times) < KILLS:
            # A job that ends by itself, as on a fast machine, has no owner to kill: another takes its place.
            if not jobs or cluster.status(jobs[-1], at=cluster.living()[-1])["state"] == "done":
                jobs.append(cluster.submit(self.scene, *settings, at=cluster.living()[0]))
            at = cluster.living()[0]
            running = wait_until(lambda: self.owner_and_units(cluster, jobs[-1], at), "progress, or the end")
            if running == "done":
                continue
            owner, before = running
            witness = next(each for each in cluster.living() if each is not owner)
            owner.kill()
            start = time.monotonic()
            wait_until(lambda: self.goes_on(cluster, jobs[-1], owner, witness, before),
                       "another owner that goes on",
                       seconds=60)
            times.append(time.monotonic() - start)
            cluster.restart(owner)
        for job in jobs:
            self.check(cluster, job, cluster.living()[0], *settings)
        times.sort()
        print(
            f"failover over {KILLS} kills: median {statistics.median(times):.2f} s, worst {times[-1]:.2f} s",
            file=sys.stderr)

    def owner_and_units(self, cluster, job, at):
        """Who owns the job and how many of its units are done, once some are; "done" when all are; None
        before."""
        status = json.loads(cluster.client("status", job, "--json", at=at).stdout)
        if status["state"] == "done":
            return "done"
        owner = cluster.owner_of(status)
        return (owner, status["units_done"]) if owner and status["units_done"] else None

    def goes_on(self, cluster, job, lost, witness, before):
        answer = cluster.client("status", job, "--json", at=witness, check=False)
        if answer.returncode != 0:
            return False
        status = json.loads(answer.stdout)
        if status["units_done"] < before:  # nothing acknowledged is lost
            self.fail(
                f"{before} units were done, and then {status['units_done']}: {status}{cluster.last_logs()}")
        has_moved = status.get("coordinator", "") not in ("", lost.address) and status["units_done"] > before
        return has_moved or status["state"] == "done"

    def test_a_stopped_owner_that_wakes_is_refused(self):
        cluster = self.cluster()
        first, *others = cluster.coordinators
        job = cluster.submit(self.scene, "--spp", 1024, at=first)
        wait_until(lambda: cluster.status(job, at=others[0])["units_done"] > 0, "progress")
        first.pause()
        wait_until(lambda: cluster.owner(job, others[0]) in others, "another owner")

        def has_worker():
            status = cluster.status(job, at=others[0])
            return status["workers"] > 0 or status["state"] == "done"

        wait_until(has_worker, "a worker there")
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
            self.tell_database(command)
            time.sleep(3)  # longer than a lease, so that all stand still for one
        self.check(cluster, job, cluster.coordinators[0], "--spp", 1024)
        for each in cluster.coordinators:
            self.assertNotIn("event=coordinator_expelled", each.log_text())

    def test_clients_wait_while_the_database_is_away(self):
        cluster = self.cluster(coordinators=2, workers=0)
        first, second = cluster.coordinators
        job = cluster.submit(self.scene, "--spp", 64, at=first)
        calls = [("submit", self.scene, *SETTINGS, "--spp", 64), ("list",), ("status", job), ("pause", job),
                 ("explain", job), ("set-priority", job, 3)]
        self.tell_database("stop")
        for command, *arguments in calls:
            refused = cluster.client(command, *arguments, "--timeout", 1, at=second, check=False)
            self.assertEqual(refused.returncode, 3, refused.stderr)
            self.assertRegex(refused.stderr.splitlines()[-1],
                             "^lumifold: .*the storage of the farm is away.*: the database does not answer$")
            self.assertNotRegex(refused.stderr, "(?i)postgresql|socket|libpq|server closed")
        with concurrent.futures.ThreadPoolExecutor(len(calls)) as pool:
            waiting = [
                pool.submit(cluster.client, *call, at=second, check=False, timeout=60) for call in calls
            ]
            time.sleep(8)
            self.assertFalse(any(each.done() for each in waiting))
            self.tell_database("start")
            for each in waiting:
                self.assertEqual(each.result().returncode, 0, each.result().stderr)
        other = waiting[0].result().stdout.strip()
        self.assertIn(other, cluster.client("list", at=first).stdout)
        self.assertEqual(cluster.status(job)["state"].upper(), "PAUSED")

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
