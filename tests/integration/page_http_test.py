"""The calls over HTTP that docs/http.md describes, with a real coordinator: all of them are as docs/schemas/http.json
says."""

import base64
import hashlib
import http.client
import io
import json
import pathlib
import tempfile
import unittest
import urllib.parse
import zipfile

from access_test import SecureFarm
from farm import Farm, make_scene, wait_until
from page_test import PageCase

try:
    import jsonschema
except ImportError:  # deploy/setup.sh --tests installs it
    jsonschema = None

DOCUMENT = json.loads((pathlib.Path(__file__).parents[2] / "docs/schemas/http.json").read_text())
PART = 700


def conforms(value, schema):
    if jsonschema is not None:
        jsonschema.Draft202012Validator({**schema, "components": DOCUMENT["components"]}).validate(value)


def operation(name):
    """Method, path and description of an operation of the document."""
    return next((method.upper(), path, each) for path, item in DOCUMENT["paths"].items()
                for method, each in item.items() if each["operationId"] == name)


class Api:
    """Calls by the names of the document. What is sent and answered must be as it says."""

    def __init__(self, link, token=None):
        self.link = link
        self.token = token or link.session

    def ask(self, name, body=None, expect=200, token=True, headers=None, **parameters):
        method, path, about = operation(name)
        known = {each["name"] for each in about.get("parameters", [])}
        assert parameters.keys() <= known, parameters
        sent = {"Authorization": f"Bearer {self.token}" if token else None, **(headers or {})}
        if isinstance(body, dict):
            conforms(body, about["requestBody"]["content"]["application/json"]["schema"])
            body = json.dumps(body)
        url = f"{path}?{urllib.parse.urlencode(parameters)}" if parameters else path
        status, got, content = self.link.request(method, url, body, **sent)
        assert status == expect, (name, status, content[:300])
        described = about["responses"][str(status)]
        if "$ref" in described:
            described = DOCUMENT["components"]["responses"][described["$ref"].rpartition("/")[2]]
        (kind, media), = described["content"].items()
        assert got["Content-Type"] == kind, (name, got["Content-Type"])
        if kind != "application/json":
            return got, content
        answer = json.loads(content)
        conforms(answer, media["schema"])
        return answer

    def upload(self, content, sha256):
        """In parts; returns how many it took."""
        parts, offset, complete = 0, 0, False
        while not complete:
            answer = self.ask("uploadPart", content[offset:offset + PART], sha256=sha256, size=len(content),
                              offset=offset, headers={"Content_Type": "application/octet-stream"})
            offset, complete, parts = answer["received_bytes"], answer["complete"], parts + 1
        return parts


class HttpTest(PageCase):
    def setUp(self):
        self.farm = self.enterContext(Farm(self.enterContext(tempfile.TemporaryDirectory())))
        self.api = Api(self.link(self.farm))

    def spec(self, content, **more):
        return {
            "scene": {"file": {"sha256": hashlib.sha256(content).hexdigest(), "size": len(content)},
                      "display_name": "box.glb"},
            "width": 48, "height": 32, "frame_count": 1, "samples_per_pixel": 2, "max_bounces": 2, **more
        }

    def test_a_scene_is_submitted_in_parts_and_its_pictures_are_fetched(self):
        content = self.scene.read_bytes()
        sha256 = hashlib.sha256(content).hexdigest()
        asset = {"sha256": sha256, "size": len(content)}
        self.assertEqual(self.api.ask("findMissingAssets", {"assets": [asset]}), {"missing_sha256": [sha256]})
        self.assertEqual(self.api.upload(content, sha256), -(-len(content) // PART))
        self.assertEqual(self.api.ask("findMissingAssets", {"assets": [asset]}), {"missing_sha256": []})
        request = {"spec": self.spec(content, first_frame=1, frame_count=2, frames_per_second=24),
                   "request_id": "0123456789abcdef0123", "scheduling": {"user": "ann", "name": "a box"}}
        job = self.api.ask("submitJob", request)["job_id"]
        self.assertEqual(self.api.ask("submitJob", request)["job_id"], job, "a repeated request is the same job")
        self.assertEqual(self.api.ask("explainJob", {"job_id": job})["reasons"][0]["code"], "no_worker")
        self.api.ask("downloadFrame", job=job, frame=1, expect=409)
        self.api.ask("downloadAllFrames", job=job, expect=409)
        self.farm.start_worker()
        wait_until(lambda: self.api.ask("getJob", {"job_id": job})["state"] == "JOB_STATE_DONE", "done")
        self.expect_results(job)
        explained = self.api.ask("explainJob", {"job_id": job})
        settings = explained["status"]["settings"]
        self.assertEqual((settings["max_bounces"], settings["filter"]["method"]), (2, "default"))
        self.assertEqual([each["job_id"] for each in self.api.ask("listJobs", {"user": "ann"})["jobs"]], [job])
        self.api.ask("deleteJob", {"job_id": job})
        self.api.ask("getJob", {"job_id": job}, expect=404)

    def expect_results(self, job):
        files = []
        for frame in (1, 2):
            headers, whole = self.api.ask("downloadFrame", job=job, frame=frame)
            digest = base64.b64encode(hashlib.sha256(whole).digest()).decode()
            self.assertEqual(headers["Repr-Digest"], f"sha-256=:{digest}:")
            self.assertEqual(whole[:4], b"\x76\x2f\x31\x01")
            files.append(whole)
        self.assertNotEqual(*files)
        self.assertEqual(int(headers["Content-Length"]), len(whole))
        self.assertIn("a_box.0002.exr", headers["Content-Disposition"])
        headers, rest = self.api.ask("downloadFrame", job=job, frame=2, expect=206, headers={"Range": "bytes=1000-"})
        self.assertEqual(rest, whole[1000:])
        self.assertEqual(headers["Content-Range"], f"bytes 1000-{len(whole) - 1}/{len(whole)}")
        self.api.ask("downloadFrame", job=job, frame=3, expect=404)
        ticket = self.api.ask("ticket", job=job)["ticket"]
        self.assertEqual(self.api.ask("downloadFrame", job=job, ticket=ticket, token=False)[1], files[0])
        _, archive = self.api.ask("downloadAllFrames", job=job, ticket=ticket, token=False)
        with zipfile.ZipFile(io.BytesIO(archive)) as frames:
            self.assertIsNone(frames.testzip())
            self.assertEqual({name: frames.read(name) for name in frames.namelist()},
                             {"a_box.0001.exr": files[0], "a_box.0002.exr": files[1]})

    def test_what_is_wrong_is_refused_and_keeps_nothing(self):
        content = self.scene.read_bytes()
        sha256 = hashlib.sha256(content).hexdigest()
        refused = self.api.ask("submitJob", {"spec": self.spec(content), "request_id": "0123456789abcdef"}, expect=409)
        self.assertIn(sha256, refused["error"]["message"])
        for parameters, status in (({"size": "x"}, 400), ({"offset": 7}, 409), ({"sha256": "z" * 64}, 400),
                                   ({"size": 0}, 400)):
            given = {"sha256": sha256, "size": len(content), "offset": 0, **parameters}
            self.assertEqual(self.put(given, content[:PART])[0], status, parameters)
        self.assertEqual(self.put({"sha256": "0" * 64, "size": 3, "offset": 0}, b"abc")[0], 500, "another content")
        self.assertEqual(self.put({"sha256": sha256, "size": 3_000_000, "offset": 0}, b"x" * (2**20 + 1))[0], 413)
        job = self.submit(self.farm, "--size", "64x64", "--spp", 1)
        other = self.submit(self.farm, "--size", "64x64", "--spp", 1)
        ticket = self.api.ask("ticket", job=job)["ticket"]
        self.api.ask("downloadFrame", job=other, ticket=ticket, token=False, expect=403)
        self.api.ask("downloadFrame", job=job, token=False, expect=401)
        for path in ("/api/session", f"/api/preview?job={job}"):
            status, _, _ = self.api.link.request("GET", f"{path}{'&' if '?' in path else '?'}ticket={ticket}",
                                                 Authorization=None)
            self.assertEqual(status, 401, "tickets are for downloads")
        shared = Api(self.link(self.farm, job, "--share"))
        shared.ask("uploadPart", b"abc", sha256=sha256, size=9, expect=403)
        shared.ask("submitJob", {"spec": self.spec(content), "request_id": "0123456789abcdef"}, expect=403)
        shared.ask("deleteJob", {"job_id": job}, expect=403)
        shared.ask("createPageLink", {"job_id": job}, expect=403)

    def put(self, parameters, body):
        return self.api.link.request("PUT", f"/api/asset?{urllib.parse.urlencode(parameters)}", body)

    def test_all_that_the_document_describes_is_there(self):
        link = self.api.link
        for path, item in DOCUMENT["paths"].items():
            for method, about in item.items():
                if path == "/api/events":
                    continue  # it does not end
                status, _, body = link.request(method.upper(), path, "{}" if "requestBody" in about else None)
                self.assertNotIn(b"does not have this", body, path)
                self.assertNotIn(b"makes no call", body, path)
                self.assertIn(str(status), about["responses"], path)
                for other in {"GET", "PUT", "POST", "DELETE"} - {each.upper() for each in item}:
                    self.assertEqual(link.request(other, path, "{}")[0], 404, (other, path))

    def test_a_broken_download_does_not_look_complete(self):
        self.farm.start_worker()
        job = self.submit(self.farm, "--size", "1024x512", "--spp", 1, "--method", "none")
        wait_until(lambda: self.api.ask("getJob", {"job_id": job})["state"] == "JOB_STATE_DONE", "done")
        connection = self.api.link.connect()
        connection.request("GET", f"/api/result?job={job}", headers={"Authorization": f"Bearer {self.api.token}"})
        answer = connection.getresponse()
        answer.read(1000)
        self.farm.server.kill()
        with self.assertRaises((http.client.IncompleteRead, ConnectionError)):
            answer.read()


class TokenTest(PageCase):
    def test_a_token_of_the_farm_is_enough(self):
        farm = self.enterContext(
            SecureFarm(self.enterContext(tempfile.TemporaryDirectory()), "--page-address", "127.0.0.1:0"))
        farm.join("login", farm.invite("ann"), profile="ann")
        farm.join("login", farm.invite("bob"), profile="bob")
        link = self.link(farm)
        ann, bob = (Api(link, farm.token(name)) for name in ("ann", "bob"))
        self.assertEqual(ann.ask("session")["user"], "ann")
        job = self.submit(farm, "--size", "64x64", "--spp", 1, "--profile", "ann")
        self.assertEqual(ann.ask("getJob", {"job_id": job})["state"], "JOB_STATE_SUBMITTED")
        bob.ask("cancelJob", {"job_id": job}, expect=404)
        bob.ask("blockWorker", {"worker": "w-1"}, expect=403)
        Api(link, farm.token("ann")[:-1] + "x").ask("session", expect=401)
        farm.client("revoke", "ann")
        wait_until(lambda: link.request("GET", "/api/session", Authorization=f"Bearer {ann.token}")[0] == 401,
                   "a token that is revoked")
        self.assertEqual(ann.ask("cancelJob", {"job_id": job}, expect=401)["error"]["code"], "UNAUTHENTICATED")


if __name__ == "__main__":
    unittest.main()
