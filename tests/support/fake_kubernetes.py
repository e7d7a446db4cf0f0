"""A fake of the part of the Kubernetes API that lumifold-autoscale uses, as a real HTTPS server: one Deployment with its scale
subresource, and its pods. No cluster can run in the tests; this answers as the API documents it: merge patches, resource versions
(409 for a patch of another version), tokens (401), pages of lists, and pods that are made and ended as a ReplicaSet does it."""

import http.server
import json
import ssl
import subprocess
import threading
import time
import urllib.parse

NAMESPACE = "farm"
DEPLOYMENT = "workers"
TOKEN = "the-token"
COST = "controller.kubernetes.io/pod-deletion-cost"
PAGE = 2  # pods, whatever limit asks for: so that every list has pages


def make_certificate(folder):
    """A certificate for 127.0.0.1 that vouches for itself; returns the paths of certificate and key."""
    certificate, key = folder / "api.pem", folder / "api.key"
    subprocess.run(["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=api",
                    "-addext", "subjectAltName=IP:127.0.0.1", "-keyout", key, "-out", certificate],
                   check=True, capture_output=True)
    return certificate, key


class FakeKubernetes:
    """`pods` maps names to pod objects. `start_pods` is whether pods that are made run at once. `fail` holds the codes of the next
    answers, with 0 for those that do not fail, `delay` seconds before each answer, and `calls` the method, path and body of each call."""

    def __init__(self, folder):
        certificate, self.key = make_certificate(folder)
        self.ca_file = certificate
        self.token_file = folder / "token"
        self.token_file.write_text(TOKEN + "\n")
        self.lock = threading.Lock()
        self.version, self.replicas, self.made = 1, 0, 0
        self.pods, self.conditions, self.fail, self.calls = {}, [], [], []
        self.delay, self.start_pods, self.before_patch = 0, True, None
        fake = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def answer(self):
                body = self.rfile.read(int(self.headers.get("Content-Length", 0))).decode()
                time.sleep(fake.delay)
                code, reply = fake.handle(self.command, self.path, self.headers, body)
                data = json.dumps(reply).encode()
                self.send_response(code)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

            do_GET = do_PATCH = do_PUT = do_POST = do_DELETE = answer

            def log_message(self, *_):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(certificate, self.key)
        self.server.socket = context.wrap_socket(self.server.socket, server_side=True)
        self.url = f"https://127.0.0.1:{self.server.server_address[1]}"
        self.thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self.thread.start()

    def close(self):
        self.server.shutdown()
        self.server.server_close()

    def patches(self, what):
        """Bodies of the patches of paths that end so."""
        return [json.loads(body) for method, path, body in self.calls if method == "PATCH" and path.endswith(what)]

    # The API.

    def handle(self, method, path, headers, body):
        with self.lock:
            self.calls.append((method, path, body))
            code = self.fail.pop(0) if self.fail else 0
            if code:
                return code, {"kind": "Status", "code": code, "message": f"made to fail with {code}"}
            if headers.get("Authorization") != f"Bearer {TOKEN}":
                return 401, {"kind": "Status", "code": 401, "message": "Unauthorized"}
            if method == "PATCH" and headers.get("Content-Type") != "application/merge-patch+json":
                return 415, {"kind": "Status", "code": 415, "message": "the body of the request was in an unknown format"}
            url = urllib.parse.urlsplit(path)
            return self.route(method, url.path, urllib.parse.parse_qs(url.query), body)

    def route(self, method, path, query, body):
        deployment = f"/apis/apps/v1/namespaces/{NAMESPACE}/deployments/{DEPLOYMENT}"
        pods = f"/api/v1/namespaces/{NAMESPACE}/pods"
        if path == deployment and method == "GET":
            return 200, {"kind": "Deployment", "spec": {"replicas": self.replicas}, "status": {"conditions": self.conditions}}
        if path == deployment + "/scale":
            return self.scale(method, body)
        if path == pods and method == "GET":
            return self.list_pods(query)
        name = path.removeprefix(pods + "/")
        if method == "PATCH" and name in self.pods:
            annotations = json.loads(body)["metadata"]["annotations"]
            self.pods[name]["metadata"].setdefault("annotations", {}).update(annotations)
            return 200, self.pods[name]
        return 404, {"kind": "Status", "code": 404, "message": f"{path} not found"}

    def scale(self, method, body):
        if method == "PATCH":
            if self.before_patch:
                self.before_patch()
            patch = json.loads(body)
            if patch["metadata"].get("resourceVersion", str(self.version)) != str(self.version):
                return 409, {"kind": "Status", "code": 409, "message": "the object has been modified"}
            self.set_replicas(patch["spec"]["replicas"])
        return 200, {"kind": "Scale", "metadata": {"name": DEPLOYMENT, "resourceVersion": str(self.version)},
                     "spec": {"replicas": self.replicas}, "status": {"selector": "app=worker,tier in (night)"}}

    def list_pods(self, query):
        if query.get("labelSelector") != ["app=worker,tier in (night)"]:
            return 400, {"kind": "Status", "code": 400, "message": "another selector"}
        first = int(query.get("continue", ["0"])[0])
        items = list(self.pods.values())
        more = {"continue": str(first + PAGE)} if first + PAGE < len(items) else {}
        return 200, {"kind": "PodList", "metadata": more, "items": items[first:first + PAGE]}

    # The cluster.

    def set_replicas(self, replicas):
        self.version += 1
        self.replicas = replicas
        while len(self.pods) < replicas:
            self.made += 1
            name = f"workers-{self.made}"
            self.pods[name] = {"metadata": {"name": name},
                               "spec": {"containers": [{"resources": {"requests": {"cpu": "500m"}}}]},
                               "status": {"phase": "Pending"}}
            if self.start_pods:
                self.run_pod(name)
        # As a ReplicaSet does: pending ones first, then by deletion cost.
        order = sorted(self.pods, key=lambda name: (
            self.pods[name]["status"]["phase"] == "Running",
            int(self.pods[name]["metadata"].get("annotations", {}).get(COST, 0))))
        for name in order[:max(0, len(self.pods) - replicas)]:
            del self.pods[name]

    def run_pod(self, name):
        self.pods[name]["status"] = {"phase": "Running",
                                     "startTime": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())}
