"""Webhooks of a real coordinator and a real receiver, that of docs/examples: a receiver that fails, a
coordinator that is killed, another one over the same data, and URLs that are not allowed."""

import contextlib
import importlib.util
import json
import os
import pathlib
import shutil
import ssl
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from http.server import ThreadingHTTPServer

from cluster import ClusterCase, SETTINGS as CLUSTER_SETTINGS
from farm import Farm, make_scene, run, wait_until
from metrics import address_of, samples, scrape
from page_http_test import DOCUMENT, conforms

EXAMPLE = pathlib.Path(__file__).parents[2] / "docs/examples/webhook_receiver.py"
NODE_PACKAGE = pathlib.Path(__file__).parents[2] / "client/node/index.js"
NODE_JOB = """
const {Farm} = await import(process.env.LUMIFOLD_NODE);
const [address, scene, webhook] = process.argv.slice(1);
const farm = new Farm(address);
const small = {size: [32, 32], samples: 2};
const job = await farm.render(scene, {...small, webhook});
await job.wait();
const refused = await farm.render(scene, {...small, webhook: "https://hooks.example.org/"}).catch((error) => error);
console.log(JSON.stringify({job: job.id, refused: [refused.code, refused.message.includes("--webhook-hosts")]}));
"""
SETTINGS = ["--size", "32x32", "--spp", "4", "--seed", "5", "--plan", "full"]


def example():
    """The receiver of the manual, as a module."""
    spec = importlib.util.spec_from_file_location("webhook_receiver", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Hook(contextlib.AbstractContextManager):
    """The example's receiver on a port of its own, where nothing listens before `open`. It answers the first
    calls with `failures`, and keeps the headers, the body and the answer of each."""

    def __init__(self, failures=(), certificate=None):
        self.calls = []
        failures, calls = list(failures), self.calls

        class Recorded(example().Receiver):
            seen = set()

            def take(self, body):
                status = failures.pop(0) if failures else super().take(body)
                calls.append((dict(self.headers), body, status))
                return status

            def ended(self, message):
                pass

        self.receiver = Recorded
        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Recorded, bind_and_activate=False)
        self.server.daemon_threads = True
        if certificate is not None:
            context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            context.load_cert_chain(certificate)
            self.server.socket = context.wrap_socket(self.server.socket, server_side=True)
        self.server.server_bind()
        self.port = self.server.server_port
        self.thread = None

    def open(self, secret_file):
        self.receiver.secret = pathlib.Path(secret_file).read_bytes().strip()
        self.server.server_activate()
        self.thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self.thread.start()

    def messages(self):
        """What was accepted."""
        return [json.loads(body) for _, body, status in list(self.calls) if status == 204]

    def await_message(self):
        return wait_until(self.messages, "a call of the webhook")[0]

    def __exit__(self, *_):
        if self.thread is not None:
            self.server.shutdown()
        self.server.server_close()
        return False


class WebhookTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.root = pathlib.Path(folder.name)
        cls.scene = make_scene("cornell-box", cls.root)

    def farm(self, *arguments):
        data = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory())) / "data"
        return self.enterContext(Farm(data, *arguments))

    def submit(self, farm, url, *arguments):
        return farm.client("submit", self.scene, *SETTINGS, "--webhook", url, *arguments).stdout.strip()

    def certificate(self):
        path = self.root / "receiver.pem"
        key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", path]
        name = ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost", "-days", "2"]
        subprocess.run(["openssl", "req", "-x509", *key, *name, "-out", self.root / "ca.pem"],
                       check=True, capture_output=True)
        path.write_text(path.read_text() + (self.root / "ca.pem").read_text())
        return path

    def test_a_receiver_over_tls_that_fails_twice_gets_the_same_message_again(self):
        hook = self.enterContext(Hook(failures=[503, 500], certificate=self.certificate()))
        farm = self.farm("--webhook-hosts", f"localhost:{hook.port}", "--webhook-ca", self.root / "ca.pem",
                         "--metrics-address", "0")
        hook.open(farm.data / "webhook.secret")
        farm.start_worker()
        before = time.time() * 1000
        url = f"https://localhost:{hook.port}/jobs?token=1"
        job = self.submit(farm, url, "--name", "chair \"17\"", "--wait")
        message = hook.await_message()
        conforms(message, DOCUMENT["components"]["schemas"]["WebhookMessage"])
        self.assertEqual([status for *_, status in hook.calls], [503, 500, 204])
        self.assertEqual(len({body for _, body, _ in hook.calls}), 1)
        deliveries = {headers["X-Lumifold-Delivery"] for headers, *_ in hook.calls}
        self.assertEqual(deliveries, {message["delivery_id"]})
        self.assertEqual((message["job_id"], message["name"], message["state"], message["error"]),
                         (job, "chair \"17\"", "JOB_STATE_DONE", ""))
        self.assertLessEqual(before, int(message["submitted_unix_ms"]))
        self.assertLessEqual(int(message["submitted_unix_ms"]), int(message["ended_unix_ms"]))
        self.assertGreater(message["times"]["render_seconds"], 0)
        self.assertEqual((message["frames_done"], message["frames_total"]), (1, 1))
        self.assertEqual(message["links"], {"result": f"/api/result?job={job}&frame=0",
                                            "results": f"/api/results?job={job}"})
        status = wait_until(lambda: (found := farm.status(job))["webhook"]["state"] == "delivered" and found,
                            "the delivery in the job's status")
        self.assertEqual((status["webhook"]["url"], status["webhook"]["tries"]), (url, 3))
        self.assertIn("500", status["webhook"]["error"])
        self.assertIn("delivered, tries 3", farm.client("status", job).stdout)
        counts = json.loads(farm.client("server-status", "--json").stdout)["webhooks"]
        self.assertEqual(counts, {"waiting": 0, "delivered": 1, "failed": 2, "given_up": 0})
        shown = samples(scrape(address_of(farm.server)))
        self.assertEqual(shown['lumifold_webhook_calls_total{outcome="failed"}'], 2)
        log = farm.server.log_text()
        self.assertIn("event=webhook_delivered", log)
        self.assertNotIn("token=1", log)

    def test_a_call_that_nobody_signed_is_refused(self):
        is_genuine = example().is_genuine
        secret, now, body = b"0123456789abcdef0123456789abcdef", 1_700_000_000, b'{"job_id":"j-1"}'
        signed = {"X-Lumifold-Timestamp": str(now), "X-Lumifold-Signature":
                  "sha256=21f2eacf9ceaa3c304ed14f9953fd7b9b3ebb15bc2c8ccaae99d7d06c4b32f56"}
        self.assertTrue(is_genuine(secret, signed, body, now))
        self.assertFalse(is_genuine(secret, signed, body, now + 3600))
        self.assertFalse(is_genuine(secret, signed, body + b" ", now))
        self.assertFalse(is_genuine(secret, signed | {"X-Lumifold-Timestamp": str(now + 1)}, body, now))
        self.assertFalse(is_genuine(secret, {}, body, now))

    def test_the_end_of_each_job_is_told(self):
        hook = self.enterContext(Hook())
        farm = self.farm("--webhook-hosts", f"127.0.0.1:{hook.port}")
        hook.open(farm.data / "webhook.secret")
        url = f"http://127.0.0.1:{hook.port}/"
        cancelled = self.submit(farm, url, "--paused")
        failed = self.submit(farm, url, "--after", cancelled)
        farm.client("cancel", cancelled)
        wait_until(lambda: len(hook.messages()) == 2, "both messages")
        messages = {each["job_id"]: each for each in hook.messages()}
        self.assertEqual(messages[cancelled]["state"], "JOB_STATE_CANCELLED")
        self.assertEqual((messages[failed]["state"], messages[failed]["links"]), ("JOB_STATE_FAILED", {}))
        self.assertIn(cancelled, messages[failed]["error"])
        self.assertEqual(messages[failed]["error"], farm.status(failed)["error"])

    def test_a_killed_coordinator_calls_after_its_start(self):
        hook = self.enterContext(Hook())  # nothing listens there yet
        farm = self.farm("--webhook-hosts", f"127.0.0.1:{hook.port}")
        farm.start_worker()
        job = self.submit(farm, f"http://127.0.0.1:{hook.port}/", "--wait")
        wait_until(lambda: farm.status(job)["webhook"]["tries"] > 0, "a try")
        self.assertEqual(farm.status(job)["webhook"]["state"], "waiting")
        farm.server.kill()
        hook.open(farm.data / "webhook.secret")
        farm.restart_server()
        self.assertEqual(hook.await_message()["job_id"], job)
        wait_until(lambda: farm.status(job)["webhook"]["state"] == "delivered", "the delivery in the status")
        self.assertEqual(len(hook.messages()), 1)

    def test_urls_that_are_not_allowed_are_refused_in_one_line(self):
        none = self.farm()
        farm = self.farm("--webhook-hosts", "hooks.example.org")
        for where, url, words in (
            (none, "https://hooks.example.org/", "--webhook-hosts"),
            (farm, "https://other.example.org/secret", "does not allow https://other.example.org:443"),
            (farm, "https://hooks.example.org:8443/", "does not allow https://hooks.example.org:8443"),
            (farm, "https://me:word@hooks.example.org/", "a URL with a user is not allowed"),
            (farm, "ftp://hooks.example.org/", "webhook is no URL"),
        ):
            with self.subTest(url):
                done = where.client("submit", self.scene, *SETTINGS, "--webhook", url, check=False)
                self.assertNotEqual(done.returncode, 0)
                self.assertIn(words, done.stderr)
                self.assertEqual(done.stderr.count("lumifold: "), 1, done.stderr)
                self.assertNotIn("secret", done.stderr)
        self.assertEqual(none.client("list").stdout.count("\n"), farm.client("list").stdout.count("\n"))
        self.assertFalse((none.data / "webhook.secret").exists())
        wrong = run("lumifold-server", "--data", self.root / "wrong", "--webhook-hosts", "https://a.example/",
                    check=False)
        self.assertEqual(wrong.returncode, 1)
        self.assertIn("--webhook-hosts", wrong.stderr)

    @unittest.skipUnless(shutil.which("node"), "node is not installed (deploy/setup.sh --tests)")
    def test_a_job_of_the_node_package_calls_too(self):
        hook = self.enterContext(Hook())
        farm = self.farm("--webhook-hosts", f"localhost:{hook.port}")
        hook.open(farm.data / "webhook.secret")
        farm.start_worker()
        done = subprocess.run(
            ["node", "--input-type=module", "-e", NODE_JOB, farm.client("page").stdout.strip(), self.scene,
             f"http://localhost:{hook.port}/node"],
            env={**os.environ, "LUMIFOLD_NODE": str(NODE_PACKAGE)}, text=True, capture_output=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        seen = json.loads(done.stdout)
        message = hook.await_message()
        self.assertEqual((message["job_id"], message["state"]), (seen["job"], "JOB_STATE_DONE"))
        self.assertEqual(seen["refused"], ["PERMISSION_DENIED", True])

    def test_the_receiver_of_the_manual_prints_what_has_ended(self):
        secret = self.root / "secret"
        secret.write_text("0123456789abcdef0123456789abcdef\n")
        secret.chmod(0o600)
        command = [sys.executable, EXAMPLE, secret, "0"]
        receiver = self.enterContext(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        self.addCleanup(receiver.terminate)
        port = receiver.stdout.readline().split()[-1]
        farm = self.farm("--webhook-hosts", f"127.0.0.1:{port}", "--webhook-secret", secret)
        job = self.submit(farm, f"http://127.0.0.1:{port}/", "--paused", "--name", "chair")
        farm.client("cancel", job)
        self.assertEqual(receiver.stdout.readline(), f"{job} JOB_STATE_CANCELLED chair \n")
        self.assertFalse((farm.data / "webhook.secret").exists())


class ClusterWebhookTest(ClusterCase):
    def test_another_coordinator_calls_for_one_that_was_killed(self):
        hook = self.enterContext(Hook())
        cluster = self.cluster(coordinators=0, workers=0)
        cluster.arguments += ["--webhook-hosts", f"127.0.0.1:{hook.port}"]
        first, second = cluster.start_coordinator(), cluster.start_coordinator()
        cluster.workers.append(cluster.start_worker())
        settings = ["--spp", 4, "--webhook", f"http://127.0.0.1:{hook.port}/"]
        job = cluster.client("submit", self.scene, *CLUSTER_SETTINGS, *settings, "--wait", at=first)
        job = job.stdout.split()[0]
        wait_until(lambda: cluster.status(job, at=second)["webhook"]["tries"] > 0, "a try")
        first.kill()
        hook.open(pathlib.Path(cluster.data) / "webhook.secret")
        self.assertEqual(hook.await_message()["job_id"], job)
        wait_until(lambda: cluster.status(job, at=second)["webhook"]["state"] == "delivered",
                   "the delivery, at the other coordinator")


if __name__ == "__main__":
    unittest.main()
