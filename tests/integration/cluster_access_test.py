"""Several coordinators with access control: each decides alike, also on calls that another one forwards."""

import contextlib
import json
import os
import pathlib
import re
import shlex
import socket
import tempfile
import unittest

from cluster import ClusterCase
from farm import Process, run, wait_until
from with_postgres import WithPostgres

PAGE = pathlib.Path(__file__).parents[2] / "docs" / "clusters.md"
CODE = re.compile(r"lumifold-[A-Za-z0-9_-]{64}")
JOB = ("--spp", 1024)


def free_ports(count):
    """Ports that nobody listens on now."""
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(count)]
        return [each.getsockname()[1] for each in sockets]


class ClusterAccessTest(ClusterCase):
    def setUp(self):
        data = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        os.environ["XDG_CONFIG_HOME"] = str(data / "config")
        self.addCleanup(os.environ.pop, "XDG_CONFIG_HOME")
        admin, worker = CODE.findall(run("lumifold-server", "init", "--data", data / "farm").stdout)
        self.farm = self.cluster(data=data / "farm", coordinators=2, workers=0)
        self.first, self.second = self.farm.coordinators
        self.join("lumifold", "login", admin, "admin")
        self.join("lumifold-worker", "enroll", worker, "node")

    def join(self, program, command, code, profile, *options):
        run(program, command, ",".join(self.farm.addresses), "-", "--profile", profile, *options, input=code)

    def invite(self, name, *options):
        """Lets a person in; returns the profile."""
        code = self.client("admin", "invite", name, at=self.first).stdout.strip()
        self.join("lumifold", "login", code, name, *options)
        return name

    def client(self, profile, command, *arguments, **options):
        return self.farm.client(command, *arguments, "--profile", profile, **options)

    def test_forwarded_calls_are_those_of_their_callers(self):
        ann, cora, bob = self.invite("ann"), self.invite("cora", "--certificate"), self.invite("bob")
        for owner in (ann, cora):  # one with a token, one with a certificate
            with self.subTest(owner=owner):
                job = self.client(owner, "submit", self.scene, *JOB, "--paused", at=self.first).stdout.strip()
                status = json.loads(self.client(owner, "status", job, "--json", at=self.second).stdout)
                self.assertEqual((status["user"], status["coordinator"]), (owner, self.first.address))
                for command in ("resume", "cancel", "retry"):
                    for at in (self.first, self.second):
                        done = self.client(bob, command, job, at=at, check=False)
                        self.assertEqual((done.returncode, f"no job {job}" in done.stderr), (4, True),
                                         done.stderr)
                self.client(owner, "set-priority", job, "7", at=self.second)
                status = json.loads(self.client(owner, "status", job, "--json", at=self.first).stdout)
                self.assertEqual((status["state"], status["priority"]), ("paused", 7))
                self.client(owner, "cancel", job, at=self.second)

    def test_a_revocation_holds_everywhere(self):
        bob = self.invite("bob")
        job = self.client(bob, "submit", self.scene, *JOB, "--paused", at=self.first).stdout.strip()
        self.client("admin", "revoke", "bob", at=self.second)
        wait_until(lambda: self.client(bob, "list", at=self.first, check=False).returncode != 0,
                   "the end of bob",
                   seconds=60)
        self.assertNotEqual(self.client(bob, "resume", job, at=self.second, check=False).returncode, 0)

    def test_the_picture_is_the_same_over_a_killed_owner(self):
        self.farm.workers = [self.farm.start_worker("--profile", "node") for _ in range(2)]
        job = self.farm.submit(self.scene, *JOB, at=self.first)
        wait_until(lambda: self.farm.status(job, at=self.second)["units_done"] > 0, "progress")
        self.first.kill()
        self.check(self.farm, job, self.second, *JOB)


class ManualTest(WithPostgres):
    """The commands of docs/clusters.md for several coordinators, as they stand there, with addresses and
    folders of this machine."""

    def commands(self, data):
        block = re.search(r"<!-- several: begin -->\n```sh\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]
        addresses = dict(
            zip(("a.example.org:7700", "b.example.org:7700"), map("127.0.0.1:{}".format, free_ports(2))))
        for line in block.splitlines():
            advertised = next(
                (address for name, address in addresses.items() if f"--advertise {name}" in line), "")
            for name, address in addresses.items():
                line = line.replace(name, address)
            line = line.replace("0.0.0.0:7700",
                                advertised).replace("/mnt/farm",
                                                    str(data)).replace(".example.org --name", " --name")
            yield shlex.split(line, comments=True)

    def test_the_commands_make_a_farm(self):
        root = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.addCleanup(os.environ.pop, "XDG_CONFIG_HOME")
        codes = {}
        for program, *arguments in self.commands(root / "farm"):
            os.environ["XDG_CONFIG_HOME"] = str(root / program)  # a user, and workers elsewhere
            if program == "export":
                self.assertTrue(arguments[0].startswith("LUMIFOLD_STORE=postgresql://"))
            elif arguments and arguments[0] in ("init", "login", "enroll", "server-status"):
                done = run(program, *(codes.get(word, word) for word in arguments))
                codes |= dict(zip(("CODE-1", "CODE-2"), CODE.findall(done.stdout)))
            else:
                process = Process(program, *arguments)
                self.addCleanup(process.stop)
                if program == "lumifold-server":
                    self.assertIn("listening on", process.popen.stdout.readline())
        self.assertEqual(done.stdout.count("coordinator: "), 2)
        os.environ["XDG_CONFIG_HOME"] = str(root / "lumifold")
        wait_until(lambda: run("lumifold", "workers", "--json").stdout, "the worker", seconds=60)


if __name__ == "__main__":
    unittest.main()
