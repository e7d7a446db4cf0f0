"""The status page of a real coordinator: what its interface shows and changes, and for whom. The browser's
side is in page_browser_test."""

import contextlib
import json
import pathlib
import random
import socket
import tempfile
import unittest

from access_test import SecureFarm
from farm import Farm, make_scene, run, wait_until
from page_link import PageLink

HOSTILE = "<script>alert(1)</script>\"'&\\"
SMALL = ("--size", "64x64", "--spp", 1)
LONG = ("--size", "640x480", "--spp", 4096)
FINISHED_UNITS = 2**53 - 1


class PageCase(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        cls.scene = make_scene("cornell-box", cls.root)

    def link(self, farm, *arguments, **options):
        return PageLink(farm.client("page", *arguments).stdout.strip(), **options)

    def submit(self, farm, *settings):
        return farm.client("submit", self.scene, *settings).stdout.strip()


class PageTest(PageCase):
    def setUp(self):
        self.farm = self.enterContext(Farm(self.enterContext(tempfile.TemporaryDirectory())))

    def test_a_job_is_seen_and_cancelled(self):
        self.farm.start_worker()
        job = self.submit(self.farm, *LONG)
        link = self.link(self.farm, job)
        self.assertEqual(link.fragment["job"], job)
        status, session = link.call("GetJob", job_id=job)
        self.assertEqual((status, session["job_id"]), (200, job))
        with contextlib.closing(link.events()) as events:
            seen = {}
            while "job" not in seen:
                name, value = next(events)
                seen[name] = value
            self.assertEqual(set(seen), {"server", "workers", "jobs", "job"})
            self.assertEqual(seen["jobs"], {"ids": [job], "more": False})
            self.assertEqual(link.call("CancelJob", job_id=job)[0], 200)
            for name, value in events:
                if name == "job" and value["state"] == "JOB_STATE_CANCELLED":
                    break
        self.assertEqual(self.farm.status(job)["state"], "cancelled")

    def test_the_picture_grows_until_it_is_the_result(self):
        self.farm.start_worker()
        job = self.submit(self.farm, "--size", "640x480", "--spp", 4)
        link = self.link(self.farm)
        units, looks = 0, []
        while units < FINISHED_UNITS:
            if (preview := link.preview(job, newer=units)) is None:
                continue
            about, planes = preview
            self.assertGreater(about["units"], units)
            self.assertEqual(len(planes), about["preview_width"] * about["preview_height"]
                             * sum({"half": 2, "float": 4}[kind] for kind in about["types"]))
            units = about["units"]
            looks.append(about)
        self.assertTrue(looks[-1]["finished"])
        for look in looks:
            self.assertEqual(look["channels"], ["R", "G", "B"], "the page takes them in this order")
        self.assertEqual((looks[-1]["width"], looks[-1]["height"], looks[-1]["reduction"]), (640, 480, 2))
        for layer in looks[-1]["layers"]:
            self.assertIsNotNone(link.preview(job, layer=layer), layer)
        about, _ = link.preview(job, region="600,0,640,9")
        self.assertEqual(
            [about[name] for name in ("x0", "y0", "preview_width", "preview_height", "reduction")],
            [600, 0, 40, 9, 1])
        for query, code in (("frame=1", 404), ("layer=colour", 400), ("frame=x", 400), ("newer=1e3", 400),
                            ("frame=-1", 404), ("region=0,0,641,9", 400), ("region=0,0,9", 400),
                            ("region=9,0,9,9", 400), ("region=0,0,9,481", 400)):
            self.assertEqual(link.request("GET", f"/api/preview?job={job}&{query}")[0], code, query)
        self.assertEqual(link.request("GET", "/api/preview?job=j-none&frame=0")[0], 404)

    def test_nothing_is_told_without_a_link_or_to_another_page(self):
        job = self.submit(self.farm, *SMALL)
        link = self.link(self.farm)
        for headers in ({"Authorization": None}, {"Authorization": "Bearer x.y"},
                        {"Authorization": link.session}, {"Authorization": f"Bearer {link.session[:-1]}"
                                                         }, {"Authorization": "Basic YTpi"}):
            for method, path in (("GET", "/api/session"), ("GET", "/api/events"),
                                 ("GET", f"/api/preview?job={job}"), ("POST", "/api/call/CancelJob")):
                body = json.dumps({"job_id": job}) if method == "POST" else None
                self.assertEqual(link.request(method, path, body, **headers)[0], 401, (path, headers))
        for headers in ({"Host": "evil.example"}, {"Host": f"evil.example:{link.port}"}, {"Host": ""},
                        {"Origin": "http://evil.example"}, {"Origin": "null"}):
            for path in ("/", "/api/session"):
                self.assertEqual(link.request("GET", path, **headers)[0], 403, headers)
        own = {"Host": f"localhost:{link.port}", "Origin": f"http://localhost:{link.port}"}
        status, headers, _ = link.request("GET", "/api/session", **own)
        self.assertEqual(status, 200)
        self.assertIn("default-src 'none'", headers["Content-Security-Policy"])
        self.assertNotIn("unsafe", headers["Content-Security-Policy"])
        self.assertEqual(headers["X-Content-Type-Options"], "nosniff")
        self.assertIsNone(headers["Access-Control-Allow-Origin"])
        self.assertEqual(self.farm.status(job)["state"], "submitted")

    def test_a_shared_link_shows_one_job_and_changes_nothing(self):
        job, other = self.submit(self.farm, *SMALL), self.submit(self.farm, *SMALL)
        link = self.link(self.farm, job, "--share", "--hours", 1)
        session = json.loads(link.request("GET", "/api/session")[2])
        self.assertEqual((session["job"], session["read_only"]), (job, True))
        self.assertEqual(link.call("GetJob", job_id=job)[0], 200)
        self.assertEqual(link.call("GetJob", job_id=other)[0], 403)
        self.assertEqual(link.call("ListJobs")[0], 403)
        for method in ("CancelJob", "PauseJob", "SetJobPriority", "RetryJob", "AddSamples"):
            self.assertEqual(link.call(method, job_id=job)[0], 403, method)
        self.assertEqual(link.request("GET", f"/api/preview?job={other}")[0], 403)
        events = link.events()
        self.assertEqual([next(events)[0] for _ in range(2)], ["jobs", "job"])

    def test_hostile_names_stay_texts(self):
        self.farm.start_worker("--name", HOSTILE)
        job = self.submit(self.farm, *LONG, "--user", HOSTILE)
        link = self.link(self.farm)
        with contextlib.closing(link.events()) as events:
            for name, value in events:
                if name == "workers" and value["workers"]:
                    break
            self.assertIn("script", json.dumps(value["workers"]))
        status, headers, body = link.request("POST", "/api/call/GetJob", json.dumps({"job_id": HOSTILE}))
        self.assertEqual((status, headers["Content-Type"]), (404, "application/json"))
        self.assertIn(HOSTILE[:8], json.loads(body)["error"]["message"])
        self.assertEqual(link.request("GET", "/<script>")[0], 404)
        self.farm.client("cancel", job)
        self.assertEqual(link.call("PauseJob", job_id=job)[0], 409, "it has ended")

    def test_garbage_is_refused_and_the_page_stays(self):
        link = self.link(self.farm)
        for body in ("", "{", "[]", "null", '{"job_id": 1.5}', "\x00", '{"unknown": 1}'):
            self.assertEqual(link.request("POST", "/api/call/GetJob", body)[0], 400, body)
        self.assertEqual(link.request("POST", "/api/call/GetJob", "{}", Content_Type="text/plain")[0], 400)
        self.assertEqual(
            link.request("POST", "/api/call/GetJob", json.dumps({"job_id": "x" * 2**20}))[0], 413)
        for method in ("WatchJob", "UploadAsset", "DownloadResult", "../GetJob", "GetJob/x"):
            self.assertEqual(link.request("POST", f"/api/call/{method}", "{}")[0], 404, method)
        for method in ("PUT", "DELETE", "OPTIONS", "TRACE", "BREW"):
            self.assertGreaterEqual(link.request(method, "/api/session")[0], 400, method)
        for path in ("/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "/web/index.html", "//",
                     "/" + "x" * 9000):
            self.assertGreaterEqual(link.request("GET", path)[0], 400, path[:40])
        source = random.Random(5)
        for _ in range(200):
            self.send_raw(link, source.randbytes(source.randrange(1, 400)))
        for start in (b"GET / HTTP/1.1\r\n",
                      b"POST /api/call/GetJob HTTP/1.1\r\nContent-Length: 999999999999\r\n\r\n", b"\r\n" * 50,
                      b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 10_000, b"GET /api/events HTTP/9.9\r\n\r\n"):
            self.send_raw(link, start)
        self.assertEqual(link.request("GET", "/api/session")[0], 200)
        self.assertTrue(self.farm.server.is_running())

    @staticmethod
    def send_raw(link, content):
        with contextlib.suppress(OSError), socket.create_connection((link.host, link.port),
                                                                    timeout=10) as connection:
            connection.sendall(content)
            connection.shutdown(socket.SHUT_WR)
            while connection.recv(4096):
                pass

    def test_a_connection_that_sends_too_slowly_is_closed(self):
        link = self.link(self.farm)
        with socket.create_connection((link.host, link.port), timeout=60) as connection:
            connection.settimeout(0.5)
            closed = []
            def drip():
                try:
                    connection.send(b"x")
                    if not connection.recv(1):
                        closed.append(True)
                except TimeoutError:
                    pass
                except OSError:
                    closed.append(True)
                return closed
            connection.send(b"GET /")
            wait_until(drip, "it is closed, though a byte comes now and then", seconds=60)

    def test_no_page_where_none_is_wanted(self):
        with tempfile.TemporaryDirectory() as folder, Farm(folder, "--page-address", "off") as farm:
            answer = farm.client("page", check=False)
            self.assertIn("shows no status page", answer.stderr)
        with tempfile.TemporaryDirectory() as folder:
            answer = run("lumifold-server",
                         "--data",
                         folder,
                         "--listen",
                         "127.0.0.1:0",
                         "--page-address",
                         "0.0.0.0:0",
                         check=False)
            self.assertNotEqual(answer.returncode, 0)
            self.assertIn("needs encryption", answer.stderr)


class SecurePageTest(PageCase):
    def setUp(self):
        self.farm = self.enterContext(
            SecureFarm(self.enterContext(tempfile.TemporaryDirectory()), "--page-address", "0.0.0.0:0",
                       "--advertise", "localhost:1"))
        self.ca = self.farm.data / "access" / "ca.pem"

    def person(self, name, *arguments):
        self.farm.join("login", self.farm.invite(name, *arguments), profile=name)
        return ("--profile", name)

    def test_a_link_has_the_rights_of_its_maker(self):
        ann, bob = self.person("ann"), self.person("bob")
        of_ann = self.submit(self.farm, *SMALL, *ann)
        of_bob = self.submit(self.farm, *SMALL, *bob)
        link = self.link(self.farm, *ann, ca=self.ca)
        self.assertTrue(link.tls)
        self.assertEqual([job["job_id"] for job in link.call("ListJobs")[1]["jobs"]], [of_ann])
        self.assertEqual(link.call("CancelJob", job_id=of_bob)[0], 404)
        self.assertEqual(link.call("BlockWorker", worker="w-1")[0], 403)
        self.assertEqual(json.loads(link.request("GET", "/api/session")[2])["user"], "ann")
        refused = self.farm.client("page", of_bob, "--share", *ann, check=False)
        self.assertIn(f"no job {of_bob}", refused.stderr)

        admin = self.link(self.farm, ca=self.ca)
        self.assertEqual(len(admin.call("ListJobs")[1]["jobs"]), 2)
        events = link.events()
        next(events)
        self.farm.client("revoke", "ann")
        for _ in events:  # the stream ends
            pass
        wait_until(lambda: link.call("ListJobs")[0] == 401, "the link of a revoked person ends")
        self.assertEqual(admin.call("ListJobs")[0], 200)


if __name__ == "__main__":
    unittest.main()
