"""Every cell of the table of docs/security.md, over TLS, against a real coordinator; and attacks by those who
have an identity."""

import json
import pathlib
import re
import subprocess
import tempfile
import unittest

from access_test import SecureFarm
from farm import Farm, command_of, make_scene

PAGE = pathlib.Path(__file__).parents[2] / "docs" / "security.md"
REFUSALS = ("PERMISSION_DENIED", "UNAUTHENTICATED")
EXIT_FAILED = 1


def table():
    """Of each call what each role may do, as the page says it."""
    text = PAGE.read_text().partition("<!-- calls and roles: begin -->\n")[2].partition(
        "<!-- calls and roles: end -->")[0]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    roles = rows[0][1:]
    paths = [row[0] if row[0].startswith("grpc.") else f"lumifold.v1.{row[0]}" for row in rows[2:]]
    return roles, {f"/{path}": dict(zip(roles, row[1:])) for path, row in zip(paths, rows[2:])}


class RolesTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.scene = make_scene("cornell-box", cls.root)
        cls.farm = SecureFarm(cls.root / "farm")
        cls.farm.enroll("node-1", "node-1")
        for name, scope in (("ann", "submit"), ("bob", "submit"), ("reader", "read"), ("root", "admin")):
            cls.farm.join("login", cls.farm.invite(name, "--scope", scope), profile=name)
            cls.farm.join("login",
                          cls.farm.invite(name, "--scope", scope),
                          "--certificate",
                          profile=f"{name}-by-certificate")
        cls.plain = Farm(cls.root / "plain")

    @classmethod
    def tearDownClass(cls):
        cls.plain.__exit__()
        cls.farm.__exit__()
        cls.folder.cleanup()

    def call(self, paths, farm, *credentials):
        """Makes calls with empty messages; of each the code."""
        done = subprocess.run(command_of("hostile-client", ("--server", farm.address, *credentials, "call")),
                              input="\n".join(paths),
                              capture_output=True,
                              text=True,
                              timeout=300)
        self.assertEqual(done.returncode, 0, done.stderr)
        return dict(line.split(" ", 1) for line in done.stdout.splitlines())

    def credentials(self, role, by_certificate=False):
        profiles = self.farm.profiles
        ca = ("--ca", profiles / "default" / "ca.pem")
        if role == "nobody":
            return self.farm, ca
        if role == "worker":
            return self.farm, (*ca, "--certificate", profiles / "node-1" / "worker.pem")
        if role == "local":
            return self.plain, ()
        profile = {"read": "reader", "submit": "ann", "admin": "root"}[role]
        if by_certificate:
            return self.farm, (*ca, "--certificate", profiles / f"{profile}-by-certificate" / "person.pem")
        return self.farm, (*ca, "--token", profiles / profile / "token")

    def test_each_cell(self):
        roles, rows = table()
        cells = 0
        for role, by_certificate in [
                *((role, False) for role in roles), *((role, True) for role in ("read", "submit", "admin"))
        ]:
            farm, credentials = self.credentials(role, by_certificate)
            codes = self.call(rows, farm, *credentials)
            for path, row in rows.items():
                with self.subTest(role=role, by_certificate=by_certificate, path=path):
                    # Codes that are not valid are refused too, but by the call itself.
                    if row["nobody"] == "yes" and path.startswith("/lumifold"):
                        self.assertIn(codes[path],
                                      ("UNAUTHENTICATED", "INVALID_ARGUMENT", "FAILED_PRECONDITION"))
                    else:
                        self.assertEqual(codes[path] in REFUSALS, row[role] == "-", codes[path])
                cells += 1
        self.assertEqual(cells, (len(roles) + 3) * len(rows))
        print(f"{cells} cells")

    def test_what_is_open_to_everyone(self):
        _, rows = table()
        self.assertEqual([path.rpartition(".")[2] for path, row in rows.items() if row["nobody"] != "-"],
                         ["Health/Check", "Health/Watch", "AccessService/Enroll", "AccessService/Login"])

    def test_a_call_without_a_row_is_nobodys(self):
        paths = ("/grpc.reflection.v1.ServerReflection/ServerReflectionInfo",
                 "/grpc.channelz.v1.Channelz/GetServers", "/lumifold.v1.FarmService/NoSuchCall",
                 "/no.Such/Service")
        for role, expected in (("nobody", "UNAUTHENTICATED"), ("read", "PERMISSION_DENIED"),
                               ("admin", "PERMISSION_DENIED"), ("worker", "PERMISSION_DENIED")):
            farm, credentials = self.credentials(role)
            self.assertEqual(self.call(paths, farm, *credentials), dict.fromkeys(paths, expected), role)

    def submit(self, profile, *arguments, check=True):
        return self.farm.client("submit",
                                self.scene,
                                "--size",
                                "32x24",
                                "--spp",
                                1,
                                "--profile",
                                profile,
                                *arguments,
                                check=check)

    def test_a_job_of_somebody_else_does_not_exist(self):
        job = self.submit("bob").stdout.strip()
        for command in (["status"], ["cancel"], ["pause"], ["delete"], ["explain"], ["logs", "--job"],
                        ["watch"], ["retry"], ["download", "--frame", "1", "-o", self.root / "x.exr"]):
            done = self.farm.client(*command, job, "--profile", "ann", check=False)
            self.assertNotEqual(done.returncode, 0, command)
        self.assertIn(f"no job {job}",
                      self.farm.client("status", job, "--profile", "ann", check=False).stderr)
        self.assertNotIn(job, self.farm.client("list", "--profile", "ann").stdout)
        self.assertIn(job, self.farm.client("list", "--profile", "bob").stdout)
        self.assertIn(job, self.farm.client("list", "--profile", "root").stdout)
        self.assertEqual(
            json.loads(self.farm.client("status", job, "--json", "--profile", "root").stdout)["user"], "bob")

    def test_a_submission_for_somebody_else_is_refused(self):
        done = self.submit("ann", "--user", "bob", check=False)
        self.assertEqual(done.returncode, EXIT_FAILED)
        self.assertIn("scheduling.user", done.stderr)

    def test_a_read_token_does_not_submit(self):
        done = self.submit("reader", check=False)
        self.assertEqual(done.returncode, EXIT_FAILED)
        self.assertIn("role read", done.stderr)

    def test_changes_and_refusals_are_in_the_audit_log(self):
        job = self.submit("ann").stdout.strip()
        self.farm.client("cancel", job, "--profile", "bob", check=False)
        self.farm.client("cancel", job, "--profile", "ann")
        audit = (self.root / "farm" / "data" / "access" / "audit.log")
        text = audit.read_text()
        self.assertEqual(audit.stat().st_mode & 0o777, 0o600)
        self.assertRegex(
            text,
            rf'identity="ann" role=submit id=\w+ address=ipv4:127\.0\.0\.1:\d+ rpc=\S+/SubmitJob subject="{job}" trace=\w{{32}} outcome=OK'
        )
        self.assertRegex(
            text, rf'identity="bob" role=submit .*CancelJob subject="{job}" trace=\w{{32}} outcome=NOT_FOUND')
        self.assertRegex(
            text, rf'identity="ann" role=submit .*CancelJob subject="{job}" trace=\w{{32}} outcome=OK')
        for secret in (self.farm.token("ann"), self.farm.token("bob"), self.farm.admin_code[-22:]):
            self.assertNotIn(secret, text)


if __name__ == "__main__":
    unittest.main()
