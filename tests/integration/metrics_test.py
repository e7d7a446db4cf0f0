"""The metrics endpoints of a real coordinator and of real workers: Prometheus' own check of the format,
figures that add up with those of the status and with each other, and callers that send garbage, much or
nothing."""

import concurrent.futures
import contextlib
import json
import pathlib
import random
import re
import shutil
import socket
import subprocess
import tempfile
import time
import unittest

from farm import Farm, make_scene, run, wait_until
from metrics import GET, address_of, ask, figures_of, samples, scrape
from page_link import PageLink

SETTINGS = ["--size", "64x64", "--spp", "64", "--seed", "5", "--plan", "full"]
MAX_CONNECTIONS = 32  # proto/monitoring/endpoint.h
MAX_REQUEST_BYTES = 16384  # proto/http/server.h
REQUEST_SECONDS = 10


class Conventions:
    """Tests of what a program shows at `address`. `table` is the part of the manual that lists its metrics,
    `total` one of its counters."""

    def test_prometheus_finds_nothing_to_object_to(self):
        if shutil.which("promtool") is None:
            self.skipTest("promtool is not installed (deploy/setup.sh --tests)")
        text = scrape(self.address)
        self.assertIn(f"# TYPE {self.total} counter", text)
        check = ["promtool", "check", "metrics"]
        done = subprocess.run(check, input=text, text=True, capture_output=True)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))
        wrong = text.replace(self.total, self.total.removesuffix("_total"))
        self.assertNotEqual(subprocess.run(check, input=wrong, text=True, capture_output=True).returncode, 0)

    def test_the_manual_names_each_metric(self):
        page = (pathlib.Path(__file__).parents[2] / "docs/operations.md").read_text()
        table = page.split(f"<!-- {self.table}: begin -->")[1].split(f"<!-- {self.table}: end -->")[0]
        self.assert_table_is_complete(table, scrape(self.address))
        label = re.search(r"`\w+(\{\w+\})` \| \w+ \|[^|]*: (\w+)", table)
        for wrong in (table.replace(label[2], "asleep"), table.replace("| gauge |", "| counter |"),
                      table.replace(label[1], "{size}"), table.replace(self.total, "lumifold_other_total")):
            with self.assertRaises(AssertionError):
                self.assert_table_is_complete(wrong, scrape(self.address))

    def assert_table_is_complete(self, table, text):
        """The table has each metric of the text, in its order, with its kind, its label and all values of
        that."""
        rows = re.findall(r"^\| `(\w+)(?:\{(\w+)\})?` \| (\w+) \|(?:[^|]*: ([\w, ]+) \|)?", table, re.M)
        self.assertEqual([(name, kind) for name, _, kind, _ in rows],
                         re.findall(r"^# TYPE (\w+) (\w+)$", text, re.M))
        for name, label, kind, values in rows:
            suffix = "_count" if kind == "histogram" else ""
            shown = re.findall(rf'^{name}{suffix}{{(\w+)="(\w+)"}}', text, re.M)
            self.assertEqual(sorted(shown),
                             sorted((label, value) for value in values.split(", ")) if label else [])


class MetricsTest(Conventions, unittest.TestCase):
    table = "metrics"
    total = "lumifold_units_committed_total"

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.farm = Farm(pathlib.Path(cls.folder.name) / "data", "--metrics-address", "0")
        cls.address = address_of(cls.farm.server)

    @classmethod
    def tearDownClass(cls):
        cls.farm.__exit__()
        cls.folder.cleanup()

    def figures(self, **wanted):
        """The samples, once these have these values."""
        return figures_of(self.address,
                          lambda found: all(found[name] == value for name, value in wanted.items()),
                          str(wanted))

    def test_figures_are_those_of_the_farm(self):
        farm = self.farm
        scene = make_scene("cornell-box", self.folder.name)
        self.figures(lumifold_units_queued=0, lumifold_units_leased=0)
        job = farm.client("submit", scene, *SETTINGS).stdout.strip()
        total = farm.status(job)["units_total"]
        self.assertGreater(total, 4)
        waiting = self.figures(lumifold_units_queued=total)
        self.assertEqual(waiting['lumifold_jobs{state="planned"}'], 1)
        self.assertEqual(waiting["lumifold_worker_slots"], 0)
        farm.client("pause", job)
        self.assertEqual(self.figures(lumifold_units_queued=0)['lumifold_jobs{state="paused"}'], 1)
        farm.client("resume", job)
        self.figures(lumifold_units_queued=total)
        worker = farm.start_worker()
        farm.client("wait", job)
        done = self.figures(lumifold_units_committed_total=total,
                            lumifold_units_queued=0,
                            lumifold_units_leased=0)
        self.assertEqual(done['lumifold_workers{state="idle"}'], 1)
        self.assertGreater(done["lumifold_worker_slots"], 0)
        self.assertEqual(sum(value for name, value in done.items() if name.startswith("lumifold_jobs{")), 0)
        worker.stop()
        self.figures(lumifold_worker_slots=0)

    def test_browsers_that_watch_are_counted(self):
        self.figures(lumifold_page_viewers=0)
        link = PageLink(self.farm.client("page").stdout.strip())
        with contextlib.closing(link.events()) as events:
            next(events)
            self.figures(lumifold_page_viewers=1)
        self.figures(lumifold_page_viewers=0)

    def test_requests_that_are_not_for_metrics(self):
        for request, status in ((b"GET / HTTP/1.1\r\n\r\n",
                                 404), (b"GET /metrics/../etc/passwd HTTP/1.1\r\n\r\n", 404),
                                (b"POST /metrics HTTP/1.1\r\nContent-Length: 9\r\n\r\n123456789",
                                 405), (b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", 400),
                                (b"\x16\x03\x01\x02\r\n\r\n", 400), (b"GET  /metrics HTTP/1.1\r\n\r\n", 400),
                                (b"get /metrics HTTP/1.1\r\n\r\n", 400), (b"GET /metrics\r\n\r\n",
                                                                          400), (b"\r\n\r\n", 400),
                                (b"GET /metrics HTTP/1.1\r\nX: " + b"a" * 2 * MAX_REQUEST_BYTES, 431)):
            with self.subTest(request=request[:40]):
                self.assertRegex(ask(self.address, request), rb"^HTTP/1\.1 %d " % status)
        head = ask(self.address, b"HEAD /metrics?x=1 HTTP/1.0\r\n\r\n")
        self.assertRegex(head, rb"(?s)^HTTP/1\.1 200 OK\r\n.*Content-Length: [1-9]\d*\r\n.*\r\n\r\n$")
        self.assertEqual(ask(self.address, b""), b"")
        self.assertEqual(ask(self.address, b"GET /metrics"), b"")

    def test_garbage_ends_nothing(self):
        seed = random.SystemRandom().randrange(1 << 32)
        chance = random.Random(seed)
        memory = self.memory_kib()

        def mutated(_):
            data = bytearray(GET + b"x" * chance.randrange(4))
            for _ in range(chance.randrange(12)):
                at = chance.randrange(len(data))
                piece = chance.randbytes(chance.choice((1, 1, 3, 40, 3 * MAX_REQUEST_BYTES)))
                data[at:at + chance.randrange(8)] = piece
            answer = ask(self.address, bytes(data), finish=chance.random() < 0.8)
            return answer == b"" or re.match(rb"HTTP/1\.1 (200|400|404|405|411|413|431) ", answer)

        with concurrent.futures.ThreadPoolExecutor(16) as pool:
            # Limits of time end those that stay open without an end of the request.
            answers = list(pool.map(mutated, range(200)))
        self.assertTrue(all(answers), f"seed {seed}")
        self.assertTrue(self.farm.server.is_running(), f"seed {seed}")
        self.assertIn("lumifold_units_queued", scrape(self.address))
        self.assertLess(self.memory_kib() - memory, 50 * 1024, f"seed {seed}")

    def test_slow_callers_hold_it_for_a_bounded_time(self):
        starts = [b"", b"GET /met", GET[:-2] + b"Content-Length: 1000000\r\n\r\n",
                  b"GET /metrics HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n"]
        with contextlib.ExitStack() as stack:
            slow = [
                stack.enter_context(socket.create_connection(self.address))
                for _ in range(2 * MAX_CONNECTIONS)
            ]
            for number, connection in enumerate(slow):
                connection.sendall(starts[number % len(starts)])
            wait_until(self.open_connections, "the first connection that is accepted")
            self.assertLessEqual(len(self.open_connections()), MAX_CONNECTIONS)
            # Each keeps sending a byte at a time: that must not make it stay.
            deadline = time.monotonic() + 10 * REQUEST_SECONDS
            while slow and time.monotonic() < deadline:
                for connection in list(slow):
                    try:
                        connection.sendall(b"a")
                    except OSError:
                        slow.remove(connection)
                time.sleep(0.1)
            self.assertEqual(slow, [])
            self.assertIn("lumifold_units_queued", scrape(self.address))

    def open_connections(self):
        """Connections that the coordinator has taken."""
        table = pathlib.Path(f"/proc/{self.farm.server.popen.pid}/net/tcp").read_text().splitlines()[1:]
        port = f":{self.address[1]:04X}"
        inodes = {row.split()[9] for row in table if row.split()[1].endswith(port) and row.split()[3] != "0A"}
        found = []
        for link in pathlib.Path(f"/proc/{self.farm.server.popen.pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                target = str(link.readlink())
                if target.removeprefix("socket:[").rstrip("]") in inodes:
                    found.append(target)
        return found

    def memory_kib(self):
        status = pathlib.Path(f"/proc/{self.farm.server.popen.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", status)[1])


class CountersTest(unittest.TestCase):
    """What is counted as it happens, of a farm whose workers are lost."""

    def setUp(self):
        self.folder = self.enterContext(tempfile.TemporaryDirectory())
        self.farm = self.enterContext(
            Farm(
                pathlib.Path(self.folder) / "data", "--metrics-address", "0", "--lease-seconds", "3",
                "--heartbeat-seconds", "0.5"))
        self.address = address_of(self.farm.server)

    def figures(self, condition):
        """The samples, once they meet the condition."""
        return figures_of(self.address, condition, "the figures")

    def test_leases_that_end_without_their_unit(self):
        scene = make_scene("cornell-box", self.folder)
        self.farm.client("submit", scene, *SETTINGS[:3], "65536", "--plan", "full")
        before = samples(scrape(self.address))
        self.assertEqual(before["lumifold_lease_expiries_total"], 0)
        self.assertEqual([value for name, value in before.items() if "_retries_" in name], [0.0] * 10)
        silent = self.farm.start_worker()
        self.figures(lambda found: found["lumifold_units_leased"] > 0)
        silent.pause()
        expired = self.figures(lambda found: found["lumifold_lease_expiries_total"] > 0)
        self.assertEqual(expired['lumifold_unit_retries_total{reason="expired"}'],
                         expired["lumifold_lease_expiries_total"])
        silent.kill()
        lost = self.farm.start_worker()
        self.figures(lambda found: found["lumifold_units_leased"] > 0)
        lost.kill()
        self.figures(lambda found: found['lumifold_unit_retries_total{reason="worker_lost"}'] > 0)
        leaving = self.farm.start_worker("--drain-seconds", "0")
        self.figures(lambda found: found["lumifold_units_leased"] > 0)
        self.assertEqual(leaving.stop(), 0)
        done = self.figures(lambda found: found['lumifold_unit_retries_total{reason="handed_back"}'] > 0)
        self.assertEqual(done['lumifold_unit_retries_total{reason="failed"}'], 0)

    def test_bytes_samples_and_times_of_a_job(self):
        farm = self.farm
        scene = make_scene("cornell-box", self.folder)
        job = farm.client("submit", scene, *SETTINGS).stdout.strip()
        farm.start_worker()
        farm.client("wait", job)
        result = pathlib.Path(self.folder) / "out.exr"
        farm.client("download", job, "-o", result)
        done = self.figures(lambda found: found['lumifold_sent_bytes_total{kind="results"}'] > 0)
        self.assertEqual(done['lumifold_sent_bytes_total{kind="results"}'], result.stat().st_size)
        self.assertEqual(done['lumifold_received_bytes_total{kind="assets"}'], scene.stat().st_size)
        self.assertEqual(done['lumifold_sent_bytes_total{kind="assets"}'], scene.stat().st_size)
        stored = sum(file.stat().st_size
                     for file in pathlib.Path(self.folder, "data/film").rglob("*")
                     if file.is_file())
        self.assertGreater(done['lumifold_received_bytes_total{kind="units"}'], 0)
        self.assertLessEqual(done['lumifold_received_bytes_total{kind="units"}'], stored)
        self.assertGreaterEqual(done["lumifold_samples_committed_total"], 64 * 64 * 64)
        self.assertGreater(done["lumifold_ledger_commit_seconds_count"], 0)
        for stage in ("assemble", "filter", "write"):
            self.assertEqual(done[f'lumifold_frame_stage_seconds_count{{stage="{stage}"}}'], 1)
            self.assertGreater(done[f'lumifold_frame_stage_seconds_sum{{stage="{stage}"}}'], 0)
        self.assertEqual(done["lumifold_storage_writable"], 1)
        self.assertGreaterEqual(done["lumifold_disk_free_bytes"], done["lumifold_disk_room_bytes"])


class WorkerMetricsTest(Conventions, unittest.TestCase):
    """What workers count."""
    table = "worker metrics"
    total = "lumifold_worker_units_rendered_total"

    def setUp(self):
        self.folder = self.enterContext(tempfile.TemporaryDirectory())
        self.farm = self.enterContext(Farm(pathlib.Path(self.folder) / "data", "--metrics-address", "0"))
        self.worker = self.start_worker()
        self.address = address_of(self.worker)

    def start_worker(self, *arguments):
        return self.farm.start_worker("--metrics-address", "0", *arguments, threads=2)

    def submit(self, scene, *settings):
        return self.farm.client("submit", scene, *(settings or SETTINGS)).stdout.strip()

    def figures(self, condition, worker=None):
        return figures_of(address_of(worker or self.worker), condition, "the figures of the worker")

    def test_a_job_is_counted_as_the_coordinator_counts_it(self):
        scene = make_scene("cornell-box", self.folder)
        job = self.submit(scene)
        self.farm.client("wait", job)
        units = self.farm.status(job)["units_total"]
        done = self.figures(lambda found: found["lumifold_worker_units_rendered_total"] == units
                            and found["lumifold_worker_sent_bytes_total"] > 0
                            and found['lumifold_worker_leases{state="delivered"}'] == 0)
        farm = figures_of(address_of(self.farm.server),
                          lambda found: found["lumifold_units_committed_total"] == units,
                          "the figures of the farm")
        self.assertEqual(done["lumifold_worker_samples_total"], farm["lumifold_samples_committed_total"])
        self.assertGreaterEqual(done["lumifold_worker_rays_total"], done["lumifold_worker_samples_total"])
        received = farm['lumifold_received_bytes_total{kind="units"}']
        self.assertAlmostEqual(done["lumifold_worker_sent_bytes_total"] / received, 1, delta=0.01)
        self.assertEqual(done["lumifold_worker_received_bytes_total"], scene.stat().st_size)
        self.assertEqual(done["lumifold_worker_asset_cache_bytes"], scene.stat().st_size)
        self.assertEqual(done['lumifold_worker_assets_total{source="coordinator"}'], 1)
        self.assertEqual(done['lumifold_worker_assets_total{source="memory"}'], 0)
        self.assertEqual(done["lumifold_worker_scenes_loaded_total"], 1)
        self.assertEqual(sum(value for name, value in done.items() if "_failures_" in name), 0)
        seconds = {activity: done[f'lumifold_worker_thread_seconds_total{{activity="{activity}"}}']
                   for activity in ("waiting", "rendering", "sending")}
        self.assertTrue(all(seconds.values()), seconds)
        self.assertLess(done["lumifold_worker_scene_load_seconds_total"], seconds["rendering"])
        for process in (done, farm):
            self.assertGreater(process["process_cpu_seconds_total"], 0)
            self.assertGreater(process["process_resident_memory_bytes"], 1 << 20)
        self.farm.client("wait", self.submit(scene, "--size", "32x32", "--spp", "4"))
        again = self.figures(lambda found: found['lumifold_worker_assets_total{source="memory"}'] == 1)
        self.assertEqual(again["lumifold_worker_received_bytes_total"], scene.stat().st_size)

    def test_assets_in_the_folder_of_the_machine(self):
        self.worker.stop()
        cache = pathlib.Path(self.folder) / "cache"
        scene = make_scene("cornell-box", self.folder)
        for source in ("coordinator", "folder"):
            worker = self.start_worker("--user", "root", "--asset-cache", cache)
            self.farm.client("wait", self.submit(scene))
            found = self.figures(lambda found: found["lumifold_worker_scenes_loaded_total"] > 0, worker)
            self.assertEqual({name for name, value in found.items() if "_assets_total" in name and value},
                             {f'lumifold_worker_assets_total{{source="{source}"}}'})
            worker.stop()

    def test_a_scene_that_cannot_be_rendered(self):
        scene = pathlib.Path(self.folder) / "damaged.gltf"
        scene.write_text(
            json.dumps({
                "asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
                "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
                "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3,
                               "type": "VEC3"}], "bufferViews": [{"buffer": 0, "byteLength": 36}],
                "buffers": [{"byteLength": 36, "uri": "data:application/octet-stream;base64,AAAA"}]
            }))  # 3 bytes of 36
        self.submit(scene, *SETTINGS, "--unchecked")
        found = self.figures(
            lambda found: any("_failures_" in name and value for name, value in found.items()))
        self.assertGreater(found['lumifold_worker_unit_failures_total{reason="permanent"}'], 0)
        self.assertEqual(found["lumifold_worker_units_rendered_total"], 0)

    def test_a_connection_that_is_lost(self):
        self.submit(make_scene("cornell-box", self.folder), *SETTINGS[:3], "65536", "--plan", "full")
        held = self.figures(lambda found: found['lumifold_worker_leases{state="rendering"}'] == 2)
        self.assertEqual(held["lumifold_worker_connected"], 1)
        self.farm.server.kill()
        self.figures(lambda found: found["lumifold_worker_connected"] == 0
                     and sum(value for name, value in found.items() if "_leases{" in name) == 0)
        self.farm.restart_server()
        back = self.figures(lambda found: found["lumifold_worker_connected"] == 1
                            and found['lumifold_worker_leases{state="rendering"}'] == 2)
        self.assertEqual(back["lumifold_worker_connections_total"], 2)

    def test_the_sandbox_is_up(self):
        self.assertRegex(self.worker.log_text(), r'event=sandbox up="[^"]*system calls')
        self.assertRegex(ask(self.address, b"GET / HTTP/1.1\r\n\r\n"), rb"^HTTP/1\.1 404 ")


class AddressTest(unittest.TestCase):
    def test_it_is_off_unless_asked_for(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            worker = farm.start_worker()
            wait_until(lambda: "event=joined" in worker.log_text(), "the worker")
            for process in (farm.server, worker):
                self.assertNotIn("event=metrics", process.log_text())

    def test_a_port_alone_is_on_loopback(self):
        for value, host in (("0", "127.0.0.1"), (":0", "127.0.0.1"), ("0.0.0.0:0", "0.0.0.0"), ("[::1]:0",
                                                                                                "[::1]")):
            with tempfile.TemporaryDirectory() as data, Farm(data, "--metrics-address", value) as farm:
                self.assertEqual(address_of(farm.server)[0], host)

    def test_an_address_that_is_taken_or_malformed_is_named(self):
        with tempfile.TemporaryDirectory() as data, socket.socket() as taken:
            taken.bind(("127.0.0.1", 0))
            taken.listen()
            for value in (str(taken.getsockname()[1]), "host", "127.0.0.1:99999", "::1:80"):
                for command in (("lumifold-server", "--data", data, "--listen", "127.0.0.1:0"),
                                ("lumifold-worker",)):
                    done = run(*command, "--metrics-address", value, check=False)
                    self.assertEqual(done.returncode, 1)
                    self.assertIn(value, done.stderr)


if __name__ == "__main__":
    unittest.main()
