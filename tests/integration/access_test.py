"""Real processes over TLS: who gets in, who does not, and what a revocation and a renewal do to those who are
in."""

import json
import os
import pathlib
import re
import shutil
import ssl
import subprocess
import tempfile
import time
import unittest

from farm import BIN, PATIENCE_SECONDS, Farm, make_scene, run, wait_until

SETTINGS = ["--size", "64x48", "--spp", "96", "--seed", "5", "--save-film"]
CODE = re.compile(r"lumifold-[A-Za-z0-9_-]{64}")
EXIT_FAILED = 1
EXIT_UNREACHABLE = 3
EXIT_NOT_ADMITTED = 3  # of a worker


class SecureFarm(Farm):
    """A farm with access control and its first administrator. Profiles are in a folder of the farm's own."""

    def __init__(self, root, *server_arguments):
        self.root = pathlib.Path(root)
        os.environ["XDG_CONFIG_HOME"] = str(self.root / "config")
        self.profiles = self.root / "config" / "lumifold"
        self.printed = run("lumifold-server", "init", "--data", self.root / "data").stdout
        self.admin_code, self.worker_code = CODE.findall(self.printed)
        super().__init__(self.root / "data", *server_arguments)
        self.join("login", self.admin_code)

    def join(self, command, code, *options, profile="default", check=True, address=None):
        """lumifold login, or lumifold-worker enroll; the code goes over standard input."""
        program = {"login": "lumifold", "enroll": "lumifold-worker"}[command]
        return run(program,
                   command,
                   address or self.address,
                   "-",
                   "--profile",
                   profile,
                   *options,
                   input=code,
                   check=check)

    def invite(self, *arguments):
        return self.client("invite", *arguments).stdout.strip()

    def enroll(self, name, profile):
        self.join("enroll", self.invite("--worker", name), profile=profile)

    def token(self, profile="default"):
        return (self.profiles / profile / "token").read_text().strip()

    def handshake(self, *arguments):
        """openssl s_client against the coordinator; returns the finished process."""
        return subprocess.run(
            ["openssl", "s_client", "-connect", self.address, "-alpn", "h2", *map(str, arguments)],
            input="",
            capture_output=True,
            text=True,
            errors="replace",
            timeout=60)

    def server_certificate(self):
        return ssl.get_server_certificate(tuple(self.address.split(":")))


class AccessTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.scene = make_scene("cornell-box", cls.root)
        cls.farm = SecureFarm(cls.root / "farm")
        cls.farm.enroll("node-1", "node-1")

    @classmethod
    def tearDownClass(cls):
        cls.farm.__exit__()
        cls.folder.cleanup()

    def expect_failure(self, done, text, code=EXIT_FAILED):
        self.assertIn(text, done.stderr)
        self.assertEqual(done.returncode, code, done.stderr)

    def invite_person(self, name, *arguments):
        """Invites a person and logs in as that; returns the profile."""
        self.farm.join("login", self.farm.invite(name, *arguments), profile=name)
        return name

    def test_the_picture_is_that_of_plain_text(self):
        expected = self.root / "one-process.exr"
        run("lumifold", "render", self.scene, *SETTINGS, "--threads", "2", "-o", expected)
        worker = self.farm.start_worker("--profile", "node-1")
        job = self.farm.client("submit", self.scene, *SETTINGS).stdout.strip()
        self.farm.client("wait", job)
        result = self.root / "over-tls.exr"
        self.farm.client("download", job, "-o", result)
        self.assertEqual(result.read_bytes(), expected.read_bytes())
        self.assertIn("encrypted: yes", self.farm.client("server-status").stdout)
        self.assertEqual(worker.stop(), 0)

    def test_profiles_are_found_by_server_and_by_default(self):
        whoami = ["whoami", "--json"]
        self.assertEqual(json.loads(run("lumifold", *whoami).stdout)["name"], "admin")
        self.assertEqual(json.loads(self.farm.client(*whoami).stdout)["scopes"], ["read", "submit", "admin"])
        self.invite_person("ann", "--scope", "read")
        self.assertEqual(json.loads(run("lumifold", *whoami, "--profile", "ann").stdout)["name"], "ann")
        self.expect_failure(
            run("lumifold", *whoami, "--profile", "ann", "--server", "127.0.0.1:1", check=False),
            "is of " + self.farm.address)
        run("lumifold", "logout", "--profile", "ann")
        self.assertFalse((self.farm.profiles / "ann").exists())
        self.expect_failure(run("lumifold", "logout", "--profile", "ann", check=False),
                            "no profile 'ann'",
                            code=4)

    def test_the_doctor_reports_on_everything_it_looks_at(self):
        self.invite_person("cid")
        done = run("lumifold", "doctor", "--profile", "cid", "--json", check=False)
        subjects = [json.loads(line)["subject"] for line in done.stdout.splitlines()]
        for subject in ("this machine", "lumifold-server", "lumifold-worker", "configuration",
                        "profile default", "profile cid", "coordinator " + self.farm.address, "you",
                        "workers"):
            with self.subTest(subject=subject):
                self.assertIn(subject, subjects)

    def test_secrets_are_for_their_user_alone(self):
        for folder in (self.farm.profiles, self.farm.root / "data" / "access"):
            for path in [folder, *folder.rglob("*")]:
                self.assertEqual(path.stat().st_mode & 0o777, 0o700 if path.is_dir() else 0o600, path)
        token = self.farm.profiles / "default" / "token"
        token.chmod(0o640)
        self.expect_failure(self.farm.client("list", check=False), "other users have access")
        token.chmod(0o600)
        log = self.farm.server.log_text()
        for secret in (self.farm.token(), self.farm.admin_code[-22:], self.farm.worker_code[-22:]):
            self.assertNotIn(secret, log)
        self.assertIn("event=person_logged_in name=admin", log)

    def test_a_probe_needs_no_identity_but_the_authority(self):
        data = self.farm.root / "data"
        port = self.farm.address.rsplit(":", 1)[1]
        for server in (self.farm.address, f"localhost:{port}"):
            self.assertEqual(
                run("lumifold-server", "health", "--data", data, "--server", server).stdout, "ok\n")
        with tempfile.TemporaryDirectory() as other:
            run("lumifold-server", "init", "--data", other)
            for options in (("--data", other), ()):  # another authority, and none
                done = run("lumifold-server", "health", *options, "--server", self.farm.address, check=False)
                self.expect_failure(done, "does not answer")

    def test_a_coordinator_with_identities_does_not_give_them_up(self):
        self.expect_failure(run("lumifold-server", "--data", self.farm.data, "--insecure", check=False),
                            "--insecure does not go with " + str(self.farm.data / "access"))

    def test_a_block_holds_for_every_name_of_a_worker(self):
        self.farm.enroll("node-3", "node-3")
        self.farm.client("block", "node-3", "--reason", "test")
        worker = self.farm.start_worker("--profile", "node-3", "--name", "somebody-else")
        workers = lambda: [
            json.loads(line) for line in self.farm.client("workers", "--json").stdout.splitlines()
        ]
        wait_until(lambda: any(w["process"] == "somebody-else" for w in workers()), "the worker")
        self.assertEqual([(w["name"], w["state"]) for w in workers() if w["process"] == "somebody-else"],
                         [("node-3", "blocked")])
        self.assertIn("node-3/somebody-else", self.farm.client("workers").stdout)
        worker.stop()
        self.farm.client("readmit", "node-3")  # blocked workers are listed, and other tests count

    def test_init_happens_once(self):
        self.expect_failure(run("lumifold-server", "init", "--data", self.farm.data, check=False),
                            "set up before")

    def test_a_code_is_used_once(self):
        code = self.farm.invite("eve")
        self.farm.join("login", code, profile="eve")
        self.expect_failure(self.farm.join("login", code, profile="eve-2", check=False),
                            "the code is not valid")
        self.expect_failure(self.farm.join("enroll", self.farm.invite("eve"), check=False),
                            "the code is not valid")
        self.expect_failure(self.farm.join("login", "lumifold-guess", check=False),
                            "this is not a code",
                            code=2)

    def test_a_code_of_another_farm_is_not_even_sent(self):
        with tempfile.TemporaryDirectory() as other:
            printed = run("lumifold-server", "init", "--data", other).stdout
        self.expect_failure(self.farm.join("login", CODE.findall(printed)[0], profile="x", check=False),
                            "is not the one that the code is for")

    def test_no_token_no_answer(self):
        name = self.invite_person("mallory")
        (self.farm.profiles / name / "token").write_text("lumifold_" + "A" * 43)
        self.expect_failure(self.farm.client("list", "--profile", name, check=False),
                            "the token is not valid")
        with tempfile.TemporaryDirectory() as empty:
            done = run("lumifold", "list", "--server", self.farm.address, check=False,
                       env={**os.environ, "XDG_CONFIG_HOME": empty})
        self.expect_failure(done, "is encrypted, and there is no profile for it", code=EXIT_UNREACHABLE)

    def test_a_token_expires(self):
        name = self.invite_person("short", "--hours", "0.0005")
        wait_until(lambda: "has expired" in self.farm.client("whoami", "--profile", name, check=False).stderr,
                   "the end of a token of 1.8 s", seconds=30)

    def test_a_person_with_a_certificate(self):
        code = self.farm.invite("cora", "--scope", "submit")
        self.farm.join("login", code, "--certificate", profile="cora")
        self.assertFalse((self.farm.profiles / "cora" / "token").exists())
        whoami = json.loads(self.farm.client("whoami", "--json", "--profile", "cora").stdout)
        self.assertEqual((whoami["kind"], whoami["name"], whoami["scopes"]), ("person", "cora", ["submit"]))
        job = self.farm.client("submit", self.scene, *SETTINGS, "--paused", "--profile",
                               "cora").stdout.strip()
        self.assertEqual(
            json.loads(self.farm.client("status", job, "--json", "--profile", "cora").stdout)["user"], "cora")
        self.expect_failure(self.farm.client("identities", "--profile", "cora", check=False), "role submit")
        worker = self.farm.start_worker("--profile", "cora")
        self.assertEqual(worker.popen.wait(timeout=60), EXIT_NOT_ADMITTED)
        self.assertIn("may not make", worker.log_text())
        states = [json.loads(line) for line in self.farm.client("identities", "--json").stdout.splitlines()]
        self.assertEqual([(i["form"], i["kind"]) for i in states if i["name"] == "cora"],
                         [("certificate", "person")])
        self.farm.client("revoke", "cora")
        self.expect_failure(self.farm.client("list", "--profile", "cora", check=False),
                            "the certificate of cora was revoked")

    def test_a_token_that_is_revoked(self):
        name = self.invite_person("bob")
        self.farm.client("list", "--profile", name)
        self.assertIn("revoked: 1", self.farm.client("revoke", name).stderr)
        self.expect_failure(self.farm.client("list", "--profile", name, check=False), "was revoked")
        states = [
            json.loads(line)
            for line in self.farm.client("identities", "--all", "--json").stdout.splitlines()
        ]
        self.assertEqual([(i["form"], i["state"]) for i in states if i["name"] == name],
                         [("token", "revoked"), ("invite", "used")])

    def test_open_streams_end_with_a_revocation(self):
        name = self.invite_person("carol")
        job = self.farm.client("submit", self.scene, *SETTINGS, "--paused", "--profile", name).stdout.strip()
        watcher = subprocess.Popen(
            [BIN / "lumifold", "watch", job, "--json", "--server", self.farm.address, "--profile", name],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True)
        self.assertIn(job, watcher.stdout.readline())
        self.farm.enroll("node-2", "node-2")
        worker = self.farm.start_worker("--profile", "node-2")
        wait_until(lambda: self.farm.client("workers", "--json").stdout.strip(), "the worker")
        self.farm.client("revoke", name)
        self.farm.client("revoke", "node-2")
        _, errors = watcher.communicate(timeout=PATIENCE_SECONDS)
        self.assertEqual(watcher.returncode, EXIT_FAILED, errors)
        self.assertIn("was revoked", errors)
        wait_until(lambda: not self.farm.client("workers", "--json").stdout.strip(), "the worker's end")
        self.assertEqual(worker.popen.wait(timeout=PATIENCE_SECONDS), EXIT_NOT_ADMITTED)
        self.assertIn("the certificate of node-2 was revoked. The worker needs a new code", worker.log_text())
        audit = (self.farm.root / "data" / "access" / "audit.log").read_text()
        self.assertRegex(audit, r"address=ipv4:127\.0\.0\.1:\d+ rpc=\S+/Work .*outcome=UNAUTHENTICATED")

    def test_scopes_are_kept(self):
        name = self.invite_person("reader", "--scope", "read")
        self.farm.client("list", "--profile", name)
        for command in (["submit", self.scene], ["invite", "x"], ["identities"], ["revoke", "admin"]):
            self.assertEqual(
                self.farm.client(*command, "--profile", name, check=False).returncode, EXIT_FAILED, command)

    def test_a_worker_is_no_user(self):
        for command in (["list"], ["identities"], ["submit", self.scene], ["invite", "x"]):
            done = self.farm.client(*command, "--profile", "node-1", check=False)
            self.assertEqual(done.returncode, EXIT_FAILED, done.stderr)
        whoami = json.loads(self.farm.client("whoami", "--json", "--profile", "node-1").stdout)
        self.assertEqual((whoami["kind"], whoami["name"], whoami["scopes"]), ("worker", "node-1", []))

    def test_a_certificate_of_another_authority(self):
        with tempfile.TemporaryDirectory() as other:
            here = os.environ["XDG_CONFIG_HOME"]
            try:
                with SecureFarm(other) as farm:
                    farm.enroll("node-1", "node-1")
                    foreign = (farm.profiles / "node-1" / "worker.pem").read_text()
            finally:
                os.environ["XDG_CONFIG_HOME"] = here
        path = self.root / "foreign.pem"
        path.write_text(foreign)
        own = self.farm.profiles / "node-1" / "worker.pem"
        self.assertEqual(self.farm.handshake("-tls1_2", "-cert", own, "-key", own).returncode, 0)
        self.assertNotEqual(self.farm.handshake("-tls1_2", "-cert", path, "-key", path).returncode, 0)
        profile = self.farm.profiles / "foreign"
        shutil.copytree(self.farm.profiles / "node-1", profile)
        (profile / "worker.pem").write_text(foreign)
        self.assertEqual(
            self.farm.client("whoami", "--profile", "foreign", check=False).returncode, EXIT_UNREACHABLE)

    def test_a_workers_certificate_does_not_make_a_server(self):
        pem = self.farm.profiles / "node-1" / "worker.pem"
        done = subprocess.run([
            "openssl", "verify", "-purpose", "sslserver", "-CAfile", self.farm.profiles / "node-1" / "ca.pem",
            pem
        ],
                              capture_output=True,
                              text=True,
                              timeout=60)
        self.assertIn("unsuitable certificate purpose", done.stdout + done.stderr)

    def test_the_servers_name_is_checked(self):
        with tempfile.TemporaryDirectory() as data:
            code = CODE.findall(run("lumifold-server", "init", "--data", data).stdout)[0]
            with Farm(data, listen="127.0.0.2:0") as farm:
                done = self.farm.join("login", code, profile="zoe", check=False, address=farm.address)
        self.expect_failure(done, "may not have this name", code=EXIT_UNREACHABLE)

    def test_old_protocols_are_refused(self):
        for version in ("-tls1", "-tls1_1"):
            done = self.farm.handshake(version, "-cipher", "DEFAULT@SECLEVEL=0")
            self.assertNotEqual(done.returncode, 0, version)
            self.assertNotIn("Lumifold coordinator", done.stdout, version)  # no certificate was sent
        for version in ("-tls1_2", "-tls1_3"):
            self.assertIn("Lumifold coordinator", self.farm.handshake(version).stdout, version)

    def test_who_is_encrypted_and_who_is_not_is_said(self):
        done = run("lumifold", "list", "--server", self.farm.address, check=False,
                   env=os.environ | {"XDG_CONFIG_HOME": str(self.root / "empty")})
        self.assertEqual((done.returncode, "is encrypted, and there is no profile for it" in done.stderr),
                         (EXIT_UNREACHABLE, True), done.stderr)
        with Farm(self.root / "plain") as plain:
            profile = shutil.copytree(self.farm.profiles / "default", self.farm.profiles / "plain")
            self.addCleanup(shutil.rmtree, profile)
            text = (profile / "profile").read_text()
            (profile / "profile").write_text(text.replace(self.farm.address, plain.address))
            done = run("lumifold", "list", "--profile", "plain", check=False)
            self.assertEqual((done.returncode, "is not encrypted, but the profile" in done.stderr),
                             (EXIT_UNREACHABLE, True), done.stderr)

    def test_garbage_does_no_harm(self):
        host, port = self.farm.address.split(":")
        for garbage in (b"\0" * 4096, b"GET / HTTP/1.1\r\n\r\n", os.urandom(65536),
                        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"):
            subprocess.run(["bash", "-c", f"cat > /dev/tcp/{host}/{port}"],
                           input=garbage,
                           timeout=60,
                           check=False,
                           stderr=subprocess.DEVNULL)
        self.farm.client("list")


class PlainTextTest(unittest.TestCase):
    def test_plain_text_off_loopback_must_be_said(self):
        with tempfile.TemporaryDirectory() as data:
            done = run("lumifold-server", "--data", data, "--listen", "0.0.0.0:0", check=False)
            self.assertEqual(done.returncode, EXIT_FAILED)
            self.assertIn("'lumifold-server init'", done.stderr)
            for program in (["lumifold", "list"], ["lumifold-worker"]):
                done = run(*program, "--server", "192.0.2.1:7700", check=False)
                self.assertEqual(done.returncode, EXIT_FAILED)
                self.assertIn("--insecure", done.stderr)
            with Farm(data, "--insecure", listen="0.0.0.0:0") as farm:
                self.assertIn("event=insecure", farm.server.log_text())
                self.assertIn("encrypted: no", farm.client("server-status").stdout)
                self.assertEqual(json.loads(farm.client("whoami", "--json").stdout)["kind"], "local")


class RenewalTest(unittest.TestCase):
    """With certificates of 36 s: they are renewed after two thirds of that."""

    def test_nobody_restarts(self):
        with tempfile.TemporaryDirectory() as root, SecureFarm(root, "--certificate-hours", "0.01") as farm:
            scene = make_scene("cornell-box", root)
            farm.enroll("node-1", "node-1")
            farm.enroll("node-2", "node-2")  # nobody renews its certificate
            for name in ("ann", "idle"):
                farm.join("login", farm.invite(name), "--certificate", profile=name)
            person = farm.profiles / "ann" / "person.pem"
            first_person = person.read_text()
            pem = farm.profiles / "node-1" / "worker.pem"
            first_pem = pem.read_text()
            first_server = farm.server_certificate()
            worker = farm.start_worker("--profile", "node-1")
            started = time.monotonic()
            wait_until(lambda: farm.server_certificate() != first_server,
                       "a new server certificate",
                       seconds=120)
            wait_until(lambda: pem.read_text() != first_pem, "a new worker certificate", seconds=120)
            wait_until(lambda: farm.client("list", "--profile", "ann") and person.read_text() != first_person,
                       "a new certificate of a person", seconds=60)
            # Until the first certificates have expired for certain.
            wait_until(lambda: time.monotonic() - started > 45, "the end of the first certificates")
            job = farm.client("submit", scene, *SETTINGS).stdout.strip()
            farm.client("wait", job)
            self.assertEqual(farm.status(job)["state"], "done")
            self.assertTrue(worker.is_running())
            self.assertIn("event=certificate_renewed", worker.log_text())
            self.assertIn("event=server_certificate_renewed", farm.server.log_text())
            self.assertIn("event=worker_certificate_renewed name=node-1", farm.server.log_text())
            self.assertIn("event=person_certificate_renewed name=ann", farm.server.log_text())
            done = farm.client("list", "--profile", "idle", check=False)
            self.assertEqual((done.returncode, "the certificate of idle has expired" in done.stderr),
                             (EXIT_FAILED, True))
            expired = farm.start_worker("--profile", "node-2")
            self.assertEqual(expired.popen.wait(timeout=60), EXIT_NOT_ADMITTED)
            self.assertIn("the certificate of node-2 has expired", expired.log_text())
            # A coordinator that is away is waited for, longer than one that does not admit the worker.
            farm.server.kill()
            time.sleep(10)
            self.assertTrue(worker.is_running())


if __name__ == "__main__":
    unittest.main()
