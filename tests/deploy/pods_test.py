"""The pods of deploy/kubernetes/overlays/small render a picture, in containers as restricted as their
manifests say: the steps of docs/clusters.md, with crun for the part of Kubernetes that starts containers."""

import contextlib
import os
import pathlib
import re
import subprocess
import tempfile
import unittest

import node_tools
import pods
import programs
from farm import BIN, make_scene, run, wait_until
from kubernetes_rules import of_kind

GROUP = 10001
SETTINGS = ["--size", "64x64", "--spp", "16", "--seed", "5"]


@unittest.skipUnless(pods.are_available() and node_tools.is_available(),
                     "not root, or no crun, mmdebstrap or npm")
class PodsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        node_tools.install()
        cls.stack = contextlib.ExitStack()
        cls.root = pathlib.Path(cls.stack.enter_context(tempfile.TemporaryDirectory()))
        cls.root.chmod(0o755)
        cls.network = f"lumifold-{os.getpid()}"
        subprocess.run(["ip", "netns", "add", cls.network], check=True)
        cls.stack.callback(subprocess.run, ["ip", "netns", "del", cls.network], check=True)
        subprocess.run(["ip", "-n", cls.network, "link", "set", "lo", "up"], check=True)
        cls.images = {
            name: pods.make_image(name, cls.root) for name in ("lumifold-server", "lumifold-worker")
        }
        manifests = node_tools.render(programs.ROOT / "deploy/kubernetes/overlays/small")
        cls.coordinator, cls.worker = of_kind(manifests, "StatefulSet")[0], of_kind(manifests,
                                                                                    "Deployment")[0]
        os.environ["XDG_CONFIG_HOME"] = str(cls.root / "config")
        cls.start_coordinator()

    @classmethod
    def tearDownClass(cls):
        cls.stack.close()

    @classmethod
    def start(cls, workload, name, volumes, **options):
        pod = pods.Pod(workload,
                       name,
                       images=cls.images,
                       folder=cls.root,
                       volumes=volumes,
                       network=cls.network,
                       **options)
        pod.start()
        cls.stack.callback(pod.kill)
        return pod

    @classmethod
    def command(cls, program, *arguments, **options):
        """Runs a program of ours on the host, in the pods' network."""
        done = subprocess.run(["ip", "netns", "exec", cls.network, BIN / program, *map(str, arguments)],
                              text=True,
                              capture_output=True,
                              **options)
        if done.returncode != 0:
            raise AssertionError(f"{program} {arguments}: {done.stdout}{done.stderr}")
        return done.stdout.strip()

    @classmethod
    def start_coordinator(cls):
        run("lumifold-server", "init", "--data", cls.root / "farm")
        access = cls.root / "farm/access"
        volumes = {
            "authority": pods.make_secret(cls.root, "authority", [access / "ca.key", access / "ca.pem"],
                                          GROUP)
        }
        for name in ("data", "access"):
            volumes[name] = cls.root / name
            volumes[name].mkdir()
            pods.give(volumes[name], GROUP, 0o2775)
        (volumes["data"] / "access").mkdir()  # the place of the other volume
        pod = cls.pod = cls.start(cls.coordinator, "lumifold-0", volumes)
        cls.await_coordinator()
        code = re.search(r"lumifold-\S+",
                         pod.execute("lumifold-server", "invite-admin", "--data=/var/lib/lumifold").stdout)[0]
        cls.command("lumifold", "login", "localhost:7700", "-", input=code)
        code = cls.command("lumifold", "invite", "--worker", "kubernetes")
        cls.command("lumifold-worker", "enroll", "localhost:7700", "-", "--profile", "kubernetes", input=code)
        profile = cls.root / "config/lumifold/kubernetes"
        cls.profile = pods.make_secret(cls.root, "profile", [*profile.iterdir()], GROUP)

    @classmethod
    def await_coordinator(cls):
        process = cls.pod.process
        wait_until(lambda: process.poll() is not None or cls.pod.probe("startupProbe").returncode == 0,
                   "the coordinator", 300)
        if process.poll() is not None:
            raise AssertionError(cls.pod.log.read_text())

    def start_worker(self, name, **options):
        pod = self.start(self.worker, name, {"profile": self.profile}, **options)
        wait_until(lambda: pod.process.poll() is not None or "event=joined" in pod.log.read_text(),
                   "the worker joins", 300)
        self.assertIsNone(pod.process.poll(), pod.log.read_text())
        return pod

    def test_the_picture_is_that_of_one_process(self):
        worker = self.start_worker("lumifold-worker-1")
        self.assertRegex(worker.log.read_text(),
                         r'event=sandbox up="[^"]*no new privileges[^"]*system calls"')
        scene = make_scene("cornell-box", self.root)
        job = self.command("lumifold", "submit", scene, *SETTINGS, "--server", "localhost:7700")
        self.assertEqual(self.pod.stop(), 0)  # a pod that is replaced has its volumes again
        self.pod.start()
        self.await_coordinator()
        self.command("lumifold", "wait", job)
        self.command("lumifold", "download", job, "-o", self.root / "farm.exr")
        run("lumifold", "render", scene, *SETTINGS, "-o", self.root / "one.exr")
        self.assertEqual((self.root / "farm.exr").read_bytes(), (self.root / "one.exr").read_bytes())
        self.assertEqual(worker.stop(), 0)
        self.assertIn("event=stop ", worker.log.read_text())

    def test_probes_answer(self):
        for kind in ("startupProbe", "livenessProbe", "readinessProbe"):
            self.assertEqual(self.pod.probe(kind).stdout, "ok\n")
        self.assertNotEqual(
            self.pod.execute("lumifold-server", "health", "--server=localhost:7701").returncode, 0)

    def test_containers_have_no_more_than_they_need(self):
        status = self.pod.execute("cat", "/proc/1/status").stdout
        for line in (r"Uid:\s+10001\s", r"CapEff:\s+0{16}$", r"CapBnd:\s+0{16}$", r"NoNewPrivs:\s+1$",
                     r"Seccomp:\s+2$"):
            self.assertRegex(status, re.compile("^" + line, re.M))
        self.assertIn("Read-only file system", self.pod.execute("touch", "/etc/x").stderr)

    def test_a_profile_without_landlock_costs_a_warning(self):
        refused = pods.runtime_default(
            ("landlock_create_ruleset", "landlock_add_rule", "landlock_restrict_self"))
        worker = self.start_worker("lumifold-worker-2", seccomp=refused)
        self.assertRegex(worker.log.read_text(), r'event=sandbox_lacks what="landlock')
        self.assertEqual(worker.stop(), 0)


if __name__ == "__main__":
    unittest.main()
