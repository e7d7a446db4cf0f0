"""A farm of real processes with a job, in which faults happen; and the pictures that it must deliver in spite
of them."""

import contextlib
import hashlib
import pathlib
import re
import threading
import time
import typing

import disk
import farm as farms
import network

PATIENCE_SECONDS = 900
LEASE_SECONDS = 2.0
HEARTBEAT_SECONDS = 0.2
RETRY_SECONDS = 0.2
NOT_REACHABLE = 3  # exit code of the client
FILM_SECONDS = 30  # it is deleted when nothing else is to do


class Picture(typing.NamedTuple):
    """What is rendered: some frames of one of the generated scenes."""

    scene: str = "cornell-box"
    size: str = "64x48"
    samples: int = 96
    frames: int = 3
    seed: int = 5

    def options(self):
        return ("--size", self.size, "--spp", self.samples, "--seed", self.seed, "--frames",
                self.frame_range(), "--save-film")

    def frame_range(self):
        return f"1-{self.frames}"


class References:
    """SHA-256 of the frames of undisturbed pictures, rendered by one process when they are first asked
    for."""

    def __init__(self, root):
        self.root = pathlib.Path(root)
        self.root.mkdir(exist_ok=True)
        self.lock = threading.Lock()
        self.known = {}
        self.scenes = {}

    def scene(self, name):
        """Path of a scene's file."""
        with self.lock:
            if name not in self.scenes:
                self.scenes[name] = farms.make_scene(name, self.root)
            return self.scenes[name]

    def of(self, picture):
        scene = self.scene(picture.scene)
        with self.lock:
            if picture not in self.known:
                folder = self.root / f"{len(self.known)}"
                folder.mkdir()
                farms.run("lumifold", "render", scene, *picture.options(), "-o", folder / "f.###.exr")
                self.known[picture] = digests(folder)
            return self.known[picture]


def digests(folder):
    return [hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.glob("*.exr"))]


class Setup(typing.NamedTuple):
    """What a fault needs around it."""

    workers: int = 2
    picture: Picture = Picture()
    jobs: int = 1
    # Hosts of a network of their own for the workers, and further ones.
    network: bool = False
    more_hosts: int = 0
    # Kind of a small disk for the data folder.
    disk: str = ""
    disk_megabytes: int = 48
    # Behaviours of hostile workers that are there before the job.
    hostile: tuple[str, ...] = ()
    hostile_options: tuple[str, ...] = ()
    # Whether the honest workers are there before the job as well.
    all_before_job: bool = False
    server: tuple[str, ...] = ()
    submit: tuple[str, ...] = ()

    def missing(self):
        """Why this machine cannot provide it; empty if it can."""
        return (self.network and network.missing()) or (self.disk and disk.missing(self.disk)) or ""


class World(contextlib.AbstractContextManager):
    """One farm in one folder."""

    def __init__(self, root, setup, references, rng):
        self.root = pathlib.Path(root)
        self.setup = setup
        self.references = references
        self.rng = rng
        self.jobs = {}  # of each job its picture
        self.stack = contextlib.ExitStack()
        with contextlib.ExitStack() as undo:  # if a part cannot be started
            undo.callback(self.stack.close)
            self.start()
            undo.pop_all()

    def start(self):
        setup = self.setup
        self.disk = self.stack.enter_context(disk.SmallDisk(self.root, setup.disk_megabytes,
                                                            setup.disk)) if setup.disk else None
        hosts = setup.workers + setup.more_hosts
        self.network = self.stack.enter_context(network.Network(hosts)) if setup.network else None
        self.data = (self.disk.path if self.disk else self.root) / "data"
        listen, off_loopback = "127.0.0.1:0", ()
        if self.network:
            listen, off_loopback = f"{self.network.hub.address}:0", ("--insecure",)
        self.farm = self.stack.enter_context(
            farms.Farm(self.data,
                       "--lease-seconds",
                       LEASE_SECONDS,
                       "--heartbeat-seconds",
                       HEARTBEAT_SECONDS,
                       "--log-level",
                       "debug",
                       "--keep-film-gb",
                       0,
                       *off_loopback,
                       *setup.server,
                       listen=listen,
                       logs=self.root,
                       host=self.network and self.network.hub))
        for behaviour in setup.hostile:
            self.start_hostile(behaviour, *setup.hostile_options)
        if setup.hostile:  # they are to get leases
            self.wait_for("event=worker_connected|event=worker_refused", 0, 5, required=False)
        self.workers = [self.start_worker(i) for i in range(setup.workers)]
        if setup.all_before_job:
            self.wait_until(lambda: all("event=joined" in worker.log_text() for worker in self.workers),
                            "the workers join")
        for _ in range(setup.jobs):
            self.submit(setup.picture)

    def __exit__(self, *exception):
        return self.stack.__exit__(*exception)

    # ---- Processes ----

    def host_of(self, number):
        return self.network.hosts[number] if self.network else None

    def start_worker(self, number):
        return self.farm.start_worker(host=self.host_of(number))

    def start_hostile(self, behaviour, *options):
        return self.farm.start_worker("--behaviour", behaviour, *options, program="hostile-worker",
                                      host=self.network and self.network.hub)

    # ---- Jobs ----

    def client(self, command, *arguments, **options):
        """Runs a subcommand, again where no coordinator was there to begin with, as a user would."""
        deadline = time.monotonic() + PATIENCE_SECONDS
        while True:
            done = self.farm.client(command, *arguments, check=False, **options)
            if done.returncode != NOT_REACHABLE or time.monotonic() > deadline:
                return done
            time.sleep(RETRY_SECONDS)

    def submit(self, picture):
        self.references.of(picture)
        scene = self.references.scene(picture.scene)
        done = self.client("submit", scene, *picture.options(), *self.setup.submit)
        if done.returncode != 0:
            raise AssertionError(f"submit: exit {done.returncode} {done.stderr}")
        job = done.stdout.strip()
        self.jobs[job] = picture
        return job

    def expect_picture(self, job):
        """Waits for the job and compares all its frames with the reference."""
        picture = self.jobs[job]
        done = self.client("wait", job, timeout=PATIENCE_SECONDS)
        if done.stdout != "done\n":
            status = self.farm.client("status", job, "--json", check=False).stdout
            raise AssertionError(f"job {job}: {done.stdout}{done.stderr}{status}")
        folder = self.root / job
        folder.mkdir()
        done = self.client("download", job, "--frames", picture.frame_range(), "-o", folder / "f.###.exr")
        if done.returncode != 0:
            raise AssertionError(f"download of {job}: exit {done.returncode} {done.stderr}")
        expected = self.references.of(picture)
        got = digests(folder)
        wrong = [i + 1 for i, (a, b) in enumerate(zip(got, expected)) if a != b]
        if wrong or len(got) != len(expected):
            raise AssertionError(
                f"job {job}: frames {wrong or 'missing'} differ from the undisturbed picture")

    def expect_clean_end(self):
        """What holds after any fault: the coordinator keeps no film of jobs that have ended, and stops when
        it is told to."""
        if not self.wait_until(
                lambda: not any((self.data / "film").iterdir()), "", FILM_SECONDS, required=False):
            left = [path.relative_to(self.data) for path in sorted((self.data / "film").rglob("*"))]
            jobs = [path.name for path in (self.data / "film").iterdir()]
            lines = [
                line for line in self.log().splitlines()
                if "not_deleted" in line or any(job in line for job in jobs)
            ]
            raise AssertionError("\n".join(
                [f"film of finished jobs is left: {[str(path) for path in left]}", *lines[-40:]]))
        code = self.farm.server.stop()
        if code != 0:
            raise AssertionError(f"the coordinator ended with code {code}")

    # ---- What the coordinator says ----

    def log(self):
        """The log of the coordinator, of all its runs."""
        return (self.root / "server.log").read_text(errors="replace")

    def worker_logs(self):
        return "".join(path.read_text(errors="replace") for path in self.root.glob("worker-*.log"))

    def count(self, pattern):
        return len(re.findall(pattern, self.log()))

    def wait_for(self, pattern, more_than=0, seconds=PATIENCE_SECONDS, required=True):
        """Waits until the coordinator's log has more lines of a pattern; whether it has."""
        return self.wait_until(lambda: self.count(pattern) > more_than,
                               f"{more_than} x {pattern} and no more", seconds, required)

    def wait_until(self, condition, what, seconds=PATIENCE_SECONDS, required=True):
        try:
            return farms.wait_until(condition, what, seconds)
        except farms.TooLate:
            if required:
                raise
            return False

    def committed(self):
        return self.count("event=unit_committed")

    def expect_unfinished(self):
        """A fault that begins when its job has ended shows nothing."""
        if self.count("event=job_ended") == len(self.jobs):
            raise AssertionError("the job had ended before the fault began")

    def resident_bytes(self):
        """Memory of the coordinator."""
        fields = pathlib.Path(f"/proc/{self.farm.server.popen.pid}/status").read_text()
        return 1024 * int(re.search(r"VmRSS:\s+(\d+)", fields).group(1))
