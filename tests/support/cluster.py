"""Several coordinators that share a PostgreSQL database (LUMIFOLD_STORE) and a data folder, and their
workers."""

import contextlib
import json
import tempfile

from farm import Process, make_scene, run
from with_postgres import WithPostgres

SETTINGS = ["--size", "96x72", "--seed", "5", "--save-film"]


class Cluster(contextlib.AbstractContextManager):
    """Coordinators that share a data folder, and workers that know all of them. Coordinators run on `hosts`
    of a network (see network.py), workers and clients on its hub; without a network all are on this
    machine."""

    def __init__(self, data, coordinators=3, workers=4, failover=2, network=None):
        self.data = data
        self.arguments = ["--failover-seconds", failover, "--heartbeat-seconds", 0.5, "--lease-seconds", 10]
        self.network = network
        self.hub = network.hub if network else None
        self.consent = ("--insecure",) if network else ()
        self.coordinators = []
        self.killed = []
        self.addresses = []
        for i in range(coordinators):
            self.start_coordinator(host=network.hosts[i] if network else None)
        self.workers = [self.start_worker() for _ in range(workers)]

    def start_coordinator(self, listen="", host=None):
        listen = listen or f"{host.address if host else '127.0.0.1'}:0"
        process = Process("lumifold-server",
                          "--data",
                          self.data,
                          "--listen",
                          listen,
                          *self.consent,
                          *self.arguments,
                          host=host)
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
        self.killed.append(process)
        self.addresses.remove(process.address)
        return self.start_coordinator(process.address, process.host)

    def start_worker(self, *arguments):
        return Process("lumifold-worker",
                       "--server",
                       ",".join(self.addresses),
                       *self.consent,
                       "--threads",
                       1,
                       *arguments,
                       host=self.hub)

    def client(self, command, *arguments, at=None, **options):
        return run("lumifold",
                   command,
                   "--server", (at or self.coordinators[0]).address,
                   *self.consent,
                   *arguments,
                   host=self.hub,
                   **options)

    def submit(self, scene, *settings, at):
        return self.client("submit", scene, *SETTINGS, *settings, at=at).stdout.strip()

    def status(self, job, at=None):
        return json.loads(self.client("status", job, "--json", at=at).stdout)

    def owner(self, job, at):
        """The process that owns the job, as `at` says; None while nobody does."""
        answer = self.client("status", job, "--json", at=at, check=False)
        return self.owner_of(json.loads(answer.stdout)) if answer.returncode == 0 else None

    def owner_of(self, status):
        """The process that owns the job of a status; None while nobody does."""
        address = status.get("coordinator", "")
        return next((each for each in self.coordinators if each.address == address), None)

    def last_logs(self, most_lines=200):
        """What each coordinator logged last, for the message of a failing test."""
        return "\n".join(f"\n{each.address}, process {each.popen.pid}:\n" +
                         "\n".join(each.log_text().splitlines()[-most_lines:])
                         for each in [*self.killed, *self.coordinators])

    def living(self):
        return [each for each in self.coordinators if each.is_running()]

    def __exit__(self, *_):
        for process in [*self.workers, *self.coordinators]:
            if process.is_running():
                process.resume()
                process.stop()
        return False


class ClusterCase(WithPostgres):
    """A PostgreSQL server, a scene, and the pictures that one process makes of it."""

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
        data = options.pop("data", None) or self.enterContext(tempfile.TemporaryDirectory())
        return self.enterContext(Cluster(data, **options))
