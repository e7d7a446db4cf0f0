"""The Debian packages in a clean root: installed, upgraded while jobs and options are kept, removed and
purged. There is no systemd in it: what the packages' scripts tell it is seen in the links that they make, and
the services are started by hand, as the units say."""

import contextlib
import hashlib
import os
import pathlib
import re
import shlex
import shutil
import signal
import subprocess
import tempfile
import unittest

import packages
import programs
from farm import make_scene, wait_until

OLDER = "0.0.9"
# Mounts of its own, which end with the command, and then the root.
ENTER = [
    "unshare", "--mount", "sh", "-euc",
    'root=$1; shift; mount -t proc proc "$root/proc"; mount --rbind /dev "$root/dev"; '
    'exec chroot "$root" "$@"', "sh"
]
SETTINGS = ["--size", "48x32", "--spp", "16", "--seed", "5"]
ADDRESS = "127.0.0.1:17700"
DATA = "var/lib/lumifold-server"
LINK = "etc/systemd/system/multi-user.target.wants/{}.service"


@unittest.skipUnless(os.geteuid() == 0 and shutil.which("mmdebstrap"), "not root, or no mmdebstrap")
class InstallTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.stack = contextlib.ExitStack()
        cls.folder = pathlib.Path(cls.stack.enter_context(tempfile.TemporaryDirectory()))
        cls.addClassCleanup(cls.stack.close)
        os.environ["SOURCE_DATE_EPOCH"] = "1700000000"
        cls.new = packages.build(cls.folder / "new")
        cls.old = packages.build(cls.folder / "old", OLDER)
        cls.root = cls.folder / "root"
        needed = {
            word.split()[0]
            for file in cls.new.values()
            for word in packages.field(file, "Depends").split(", ")
        }
        subprocess.run([
            "mmdebstrap", "--quiet", "--variant=minbase", f"--include={','.join(sorted(needed))}",
            programs.suite(), cls.root
        ],
                       check=True)

    def enter(self, *command, check=True):
        """What a command in the root prints, messages first."""
        done = subprocess.run([*ENTER, self.root, *map(str, command)],
                              text=True,
                              capture_output=True,
                              env={
                                  "PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root",
                                  "DEBIAN_FRONTEND": "noninteractive"
                              })
        if check and done.returncode != 0:
            raise AssertionError(f"{command}: exit {done.returncode}\n{done.stdout}{done.stderr}")
        return done.stderr + done.stdout

    def dpkg(self, *arguments):
        return self.enter("dpkg", *arguments)

    def install(self, files):
        for file in files.values():
            shutil.copy(file, self.root / "tmp")
        text = self.dpkg("--install", *(f"/tmp/{file.name}" for file in files.values()))
        self.assertEqual([line for line in text.splitlines() if "warning" in line], [])
        return text

    @contextlib.contextmanager
    def service(self, name):
        """A service's process in the root, started as its unit and options say; ended by SIGTERM."""
        (command,) = packages.unit_options(self.root / f"usr/lib/systemd/system/{name}.service", "ExecStart")
        options = (self.root / "etc/default" / name).read_text()
        variable = command.split()[-1]
        words = shlex.split(re.search(rf'^{variable[1:]}="(.*)"$', options, re.M)[1])
        for setting in ("StateDirectory", "CacheDirectory"):
            for folder in packages.unit_options(self.root / f"usr/lib/systemd/system/{name}.service",
                                                setting):
                (self.root / {"StateDirectory": "var/lib", "CacheDirectory": "var/cache"}[setting] /
                 folder).mkdir(exist_ok=True)
        log = open(self.folder / f"{name}.log", "a")
        process = subprocess.Popen([*ENTER, self.root, *command.split()[:-1], *words],
                                   text=True,
                                   stdout=subprocess.PIPE,
                                   stderr=log)
        try:
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(timeout=900)
            process.stdout.close()
            log.close()

    @contextlib.contextmanager
    def coordinator(self):
        with self.service("lumifold-server") as process:
            self.assertRegex(process.stdout.readline(), r"^listening on 127.0.0.1:")
            yield process

    def await_end(self, job):
        self.assertEqual(self.enter("lumifold", "wait", job, "--server", ADDRESS).split()[-1], "done")

    def picture_of(self, job):
        self.enter("lumifold", "download", job, "--server", ADDRESS, "--reproducible", "-o",
                   "/tmp/picture.exr")
        return hashlib.sha256((self.root / "tmp/picture.exr").read_bytes()).hexdigest()

    def set_options(self, name, text):
        file = self.root / "etc/default" / name
        file.write_text(re.sub(r'^(LUMIFOLD_\w+_OPTIONS)=""$', rf'\1="{text}"', file.read_text(), flags=re.M))

    def is_enabled(self, name):
        return (self.root / LINK.format(name)).is_symlink()

    def test_the_same_build_makes_the_same_files(self):
        again = packages.build(self.folder / "again")
        self.assertEqual([file.read_bytes() for file in again.values()],
                         [self.new[name].read_bytes() for name in again])

    def test_from_installation_to_purge(self):
        options = f"--listen {ADDRESS}"
        # Installed: programs, manual and completion are there; only the coordinator is enabled.
        self.install(self.old)
        for name in packages.PROGRAMS:
            self.assertIn(f"{name} {programs.version()}", self.enter(name, "--version"))
        self.assertEqual([name for name in packages.SERVICES if self.is_enabled(name)], ["lumifold-server"])
        self.set_options("lumifold-server", options)
        self.set_options("lumifold-worker", f"--server {ADDRESS} --threads 1 --user root")
        shutil.copy(make_scene("cornell-box", self.folder), self.root / "tmp/scene.glb")
        with self.coordinator(), self.service("lumifold-worker"):
            job = self.enter("lumifold", "submit", "/tmp/scene.glb", "--server", ADDRESS,
                             *SETTINGS).split()[-1]
            self.await_end(job)
            before = self.picture_of(job)

        # Upgraded: options, jobs and pictures are kept, and the farm goes on rendering.
        self.install(self.new)
        self.assertIn(options, (self.root / "etc/default/lumifold-server").read_text())
        self.assertTrue(self.is_enabled("lumifold-server"))
        with self.coordinator(), self.service("lumifold-worker"):
            self.assertEqual(self.picture_of(job), before)
            again = self.enter("lumifold", "submit", "/tmp/scene.glb", "--server", ADDRESS,
                               *SETTINGS).split()[-1]
            self.await_end(again)
            self.assertEqual(self.picture_of(again), before)

        # Removed: options and data stay. Purged: options, caches and keys go, jobs and pictures stay.
        self.dpkg("--remove", *packages.PROGRAMS)
        self.assertFalse((self.root / "usr/bin/lumifold-server").exists())
        self.assertIn(options, (self.root / "etc/default/lumifold-server").read_text())
        self.assertTrue(any((self.root / "var/cache/lumifold-worker").iterdir()))
        text = self.dpkg("--purge", *packages.PROGRAMS)
        self.assertIn(f"jobs and pictures are kept: /{DATA}", text)
        self.assertTrue((self.root / DATA / "ledger.db").exists())
        left = [path.relative_to(self.root) for folder in ("etc", "usr", "var/lib", "var/cache")
                for path in sorted((self.root / folder).rglob("*lumifold*"))]
        left = [str(path) for path in left if not str(path).startswith(DATA)]
        self.assertEqual(left, [])

        # Installed again over the data: the jobs are there.
        self.install(self.new)
        self.set_options("lumifold-server", options)
        with self.coordinator():
            self.assertEqual(self.picture_of(job), before)


if __name__ == "__main__":
    unittest.main()
