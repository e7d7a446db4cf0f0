"""Several coordinators whose network is cut, or whose disk is full: the picture is the same bytes as those of
one process."""

import tempfile
import time
import unittest

import disk
import network
from cluster import ClusterCase
from farm import wait_until
from with_postgres import SCRIPT

LONG_JOB = ("--spp", 1024)
DISK_MEGABYTES = 96


def commits(process):
    return process.log_text().count("event=unit_committed")


@unittest.skipIf(why := network.missing(), f"no network of our own: {why}")
class NetworkTest(ClusterCase):
    """Three coordinators and the database, each on a host of its own; workers and clients on the hub."""

    @classmethod
    def postgres_command(cls):
        cls.network = network.Network(4)
        cls.addClassCleanup(cls.network.__exit__)
        cls.database = cls.network.hosts[3]
        return (*cls.database.prefix, SCRIPT, cls.database.address)

    def start(self):
        """A cluster whose first coordinator has a job that is in progress; returns both."""
        cluster = self.cluster(network=self.network)
        job = cluster.submit(self.scene, *LONG_JOB, at=cluster.coordinators[0])
        wait_until(lambda: cluster.status(job)["units_done"] > 0, "progress")
        return cluster, job

    def test_the_owner_is_cut_off_from_the_database(self):
        cluster, job = self.start()
        first, second, _ = cluster.coordinators
        first.host.drop_of(self.database.address)
        start = time.monotonic()
        wait_until(lambda: cluster.owner(job, second) not in (None, first), "another owner", seconds=60)
        print(f"cut off from the database: another owner after {time.monotonic() - start:.1f} s")
        self.check(cluster, job, second, *LONG_JOB)
        self.assertGreater(first.host.lost_packets(), 0)
        first.host.heal()
        wait_until(lambda: first.log_text().count("event=farm_joined") == 2,
                   "the first one is back, as another")
        self.assertEqual(cluster.status(job, at=first)["state"], "done")

    def test_two_coordinators_are_cut_off_from_each_other(self):
        cluster, job = self.start()
        first, second, third = cluster.coordinators
        first.host.drop_of(second.host.address)
        # The second one cannot ask the owner. It says so in time, or answers; nobody loses a job.
        answer = cluster.client("status", job, at=second, check=False, timeout=60)
        if answer.returncode != 0:
            self.assertIn("coordinator", answer.stderr)
        self.assertIn(job, cluster.client("list", at=second).stdout)
        self.check(cluster, job, third, *LONG_JOB)
        self.assertGreater(first.host.lost_packets(), 0)
        first.host.heal()
        for each in cluster.coordinators:
            self.assertEqual(each.log_text().count("event=farm_joined"), 1)


@unittest.skipIf(why := disk.missing(), f"no disk of our own: {why}")
class SharedFolderTest(ClusterCase):
    def test_the_shared_folder_is_full(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        small = self.enterContext(disk.SmallDisk(folder.name, DISK_MEGABYTES))
        cluster = self.cluster(data=small.path / "data")
        first, second, third = cluster.coordinators
        job = cluster.submit(self.scene, *LONG_JOB, at=first)
        wait_until(lambda: cluster.status(job)["units_done"] > 0, "progress")
        small.fill()
        wait_until(lambda: "event=storage_unavailable" in first.log_text(), "the owner notices")
        self.assertIn("event=farm_joined", second.log_text())
        refused = cluster.client("submit", self.scene, "--size", "8x8", "--timeout", 1, at=third, check=False)
        self.assertIn("No space left on device", refused.stderr)
        small.free()
        self.check(cluster, job, second, *LONG_JOB)
        for each in cluster.coordinators:  # a full disk is no reason to take anybody's jobs
            self.assertEqual(each.log_text().count("event=farm_joined"), 1)


if __name__ == "__main__":
    unittest.main()
