"""Frames are finished by workers where the coordinator has no place: the files are the same, byte for byte, whoever
finishes them and whoever is killed meanwhile."""

import contextlib
import hashlib
import os
import pathlib
import re
import signal
import tempfile
import unittest

from farm import Farm, make_scene, wait_until

ONE_PLACE = ["--finish-processes", "1", "--filter-threads", "1"]  # so that the others wait
SHORT_LEASES = ["--lease-seconds", "3", "--heartbeat-seconds", "0.2"]


class FramesTest(unittest.TestCase):
    """Jobs of some frames, and their files as a coordinator that gets no help makes them."""

    FRAMES = 8
    SAMPLES = "8"

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.scene = make_scene("cornell-box", cls.root)
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            farm.start_worker("--finish", "never", threads=2)
            job = cls.submit(farm)
            farm.client("wait", job)
            cls.expected = cls.results(data, job)
            assert "frame_leased" not in farm.server.log_text()

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @classmethod
    def submit(cls, farm, *options):
        return farm.client("submit", cls.scene, "--size", "128x96", "--spp", cls.SAMPLES, "--frames",
                           f"0-{cls.FRAMES - 1}", *options).stdout.strip()

    @staticmethod
    def results(data, job):
        """The bytes of each frame, and what the coordinator keeps as their digests."""
        folder = pathlib.Path(data) / "results" / job
        return {path.name: path.read_bytes() for path in folder.glob("frame-*")}

    def expect_same(self, data, farm, job):
        farm.client("wait", job)
        self.assertEqual(farm.status(job)["state"], "done")
        found = self.results(data, job)
        self.assertEqual(sorted(found), sorted(self.expected))
        self.assertEqual(len(found), 2 * self.FRAMES)
        for name, content in found.items():
            self.assertEqual(content, self.expected[name], name)

    @staticmethod
    def leased_to(farm, worker):
        """Frames that were leased to the process, so far."""
        return re.findall(rf"event=frame_leased .* worker=w-\d+/\S+:{worker.popen.pid} .*", farm.server.log_text())

    def job_until(self, farm, happened, *options):
        """A job during which it happened. On a loaded machine the coordinator may keep up with what is rendered,
        so that workers get no frame; then another job is tried."""
        for _ in range(20):
            job = self.submit(farm, *options)
            wait_until(lambda job=job: happened() or re.search(f"event=job_ended job={job} ", farm.server.log_text()),
                       "what is wanted of the workers, or the job's end")
            if happened():
                return job
        return self.fail("it did not happen during 20 jobs")


class FinishTest(FramesTest):
    def test_workers_finish_what_the_coordinator_has_no_place_for(self):
        with tempfile.TemporaryDirectory() as data, Farm(data, *ONE_PLACE) as farm:
            workers = [farm.start_worker(threads=2) for _ in range(2)]

            def finished():
                return sum(worker.log_text().count("event=frame_finished") for worker in workers)

            self.expect_same(data, farm, self.job_until(farm, finished))
            log = farm.server.log_text()
            leased = log.count("event=frame_leased") - log.count("event=frame_came_back")
            wait_until(lambda: finished() >= leased, "the workers' last lines")
            self.assertEqual(finished(), leased)
            self.assertEqual(log.count("event=frame_finished"), self.FRAMES * log.count("event=job_submitted"))

    def test_workers_compare_the_results_of_an_audited_job(self):
        with tempfile.TemporaryDirectory() as data, Farm(data, *ONE_PLACE) as farm:
            for _ in range(2):
                farm.start_worker(threads=2)
            job = self.job_until(farm, lambda: "event=frame_compared" in farm.server.log_text(), "--audit-share", "0.5")
            self.expect_same(data, farm, job)
            self.assertNotIn("event=worker_faulty", farm.server.log_text())

    @contextlib.contextmanager
    def a_leased_frame(self, *options):
        """A farm whose first worker has a frame to finish; what happens then changes no file."""
        with tempfile.TemporaryDirectory() as data, Farm(data, *ONE_PLACE, *SHORT_LEASES) as farm:
            workers = [farm.start_worker(*options, threads=2) for _ in range(2)]
            job = self.job_until(farm, lambda: self.leased_to(farm, workers[0]))
            yield farm, workers[0]
            self.expect_same(data, farm, job)

    def test_a_killed_worker_costs_time_only(self):
        with self.a_leased_frame() as (_, worker):
            worker.kill()

    def test_a_worker_that_hangs_costs_time_only(self):
        with self.a_leased_frame() as (_, worker):
            worker.pause()

    def test_a_killed_coordinator_finishes_the_rest(self):
        with self.a_leased_frame() as (farm, _):
            farm.server.kill()
            farm.restart_server()

    def test_a_worker_that_leaves_hands_its_frames_back(self):
        with self.a_leased_frame("--drain-seconds", "0") as (_, worker):
            self.assertEqual(worker.stop(), 0)


class AdaptiveFinishTest(unittest.TestCase):
    """Frames with adaptive sampling: workers estimate rounds and finish frames while the coordinator's only place is held by a
    filter that is stopped. The files are the same."""

    SETTINGS = ["--size", "64x48", "--spp", "64", "--adaptive", "--frames", "0-3"]

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.scene = make_scene("cornell-box", cls.root)
        with cls.farm() as (farm, _):
            farm.start_worker("--finish", "never", threads=2)
            cls.expected = cls.results(farm, cls.submit(farm))
            assert "_leased" not in farm.server.log_text()

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    @classmethod
    @contextlib.contextmanager
    def farm(cls, *options):
        """A coordinator with one place, and a job that is done."""
        with tempfile.TemporaryDirectory() as data, Farm(data, *ONE_PLACE, *options) as farm:
            worker = farm.start_worker("--finish", "never", threads=2)
            job = farm.client("submit", cls.scene, "--size", "64x48", "--spp", "2").stdout.strip()
            farm.client("wait", job)
            worker.stop()
            yield farm, job

    @classmethod
    def submit(cls, farm):
        return farm.client("submit", cls.scene, *cls.SETTINGS).stdout.strip()

    @staticmethod
    def results(farm, job):
        """The SHA-256 of each frame, and what is told of the job's error."""
        farm.client("wait", job)
        folder = pathlib.Path(farm.data) / "results" / job
        assert not list(folder.glob("*.partial"))
        files = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.glob("frame-*")}
        return files, farm.status(job)["estimated_error"]

    @contextlib.contextmanager
    def held_place(self, farm, other):
        """The filter of another job is stopped meanwhile."""
        farm.client("retry", other, "--filter-only")
        filters = wait_until(farm.server.children, "the filter")
        try:
            for filter_process in filters:
                os.kill(filter_process, signal.SIGSTOP)
            yield
        finally:
            for filter_process in filters:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(filter_process, signal.SIGCONT)

    def estimated_meanwhile(self, meanwhile, *options):
        """Rounds go to workers; `meanwhile` happens while the first of them has one. Returns the coordinator's log."""
        with self.farm(*options) as (farm, other):
            with self.held_place(farm, other):
                worker = farm.start_worker(threads=2)
                job = self.submit(farm)
                wait_until(lambda: "event=estimate_leased" in farm.server.log_text(), "a round for a worker")
                meanwhile(farm, worker)
                farm.start_worker(threads=2)
            self.assertEqual(self.results(farm, job), self.expected)
            return farm.server.log_text()

    def test_workers_estimate_rounds(self):
        def finishes(_, worker):
            wait_until(lambda: re.search("event=frame_finished .*kind=estimate", worker.log_text()), "its estimate")

        self.estimated_meanwhile(finishes)

    def test_a_worker_killed_in_an_estimate_costs_time_only(self):
        self.estimated_meanwhile(lambda _, worker: worker.kill())

    def test_a_worker_that_hangs_in_an_estimate_costs_time_only(self):
        log = self.estimated_meanwhile(lambda _, worker: worker.pause(), *SHORT_LEASES)
        self.assertIn("event=frame_came_back", log)

    def test_a_killed_coordinator_estimates_again(self):
        def kills(farm, _):
            farm.server.kill()
            farm.restart_server()

        self.estimated_meanwhile(kills)

    def test_workers_finish_frames_whose_sampling_has_ended(self):
        with self.farm() as (farm, _):
            worker = farm.start_worker(threads=2)
            for _ in range(20):  # the coordinator may keep up with what is rendered
                self.assertEqual(self.results(farm, self.submit(farm)), self.expected)
                if re.search("event=frame_finished .*kind=result", worker.log_text()):
                    return
            self.fail("no frame went to a worker during 20 jobs")



class KeptFramesTest(FramesTest):
    """Frames of a job whose film is larger than what the coordinator keeps of films: each worker keeps the units of
    its frames and finishes them."""

    FRAMES = 16
    SAMPLES = "2"  # so that the filter takes longer
    SERVER = ["--keep-film-gb", "0", *ONE_PLACE, *SHORT_LEASES]

    @staticmethod
    def kept_by(farm, worker):
        """Frames whose units the process has kept, as far as they are due."""
        return [line for line in FramesTest.leased_to(farm, worker) if " kept=true" in line]

    def test_the_file_alone_travels(self):
        with tempfile.TemporaryDirectory() as data, Farm(data, *self.SERVER) as farm:
            workers = [farm.start_worker(threads=2) for _ in range(2)]
            job = self.job_until(farm, lambda: any(self.kept_by(farm, worker) for worker in workers))
            self.expect_same(data, farm, job)
            status = farm.status(job)
            self.assertEqual(status["units_done"], status["units_total"])
            self.assertNotIn("event=frame_kept_no_more", farm.server.log_text())

    def test_a_job_whose_film_stays_sends_it(self):
        with tempfile.TemporaryDirectory() as data, Farm(data, *ONE_PLACE, *SHORT_LEASES) as farm:
            workers = [farm.start_worker(threads=2) for _ in range(2)]
            job = self.job_until(farm, lambda: any(self.leased_to(farm, worker) for worker in workers))
            self.expect_same(data, farm, job)
            self.assertNotIn(" kept=true", farm.server.log_text())

    @contextlib.contextmanager
    def a_keeper(self):
        """A farm of two workers, the first of which keeps a frame; what happens then changes no file."""
        with tempfile.TemporaryDirectory() as data, Farm(data, *self.SERVER) as farm:
            workers = [farm.start_worker("--drain-seconds", "0", threads=2) for _ in range(2)]
            job = self.job_until(farm, lambda: self.kept_by(farm, workers[0]))
            yield farm, workers[0]
            self.expect_same(data, farm, job)

    def test_a_killed_keeper_costs_its_frames(self):
        with self.a_keeper() as (_, worker):
            worker.kill()

    def test_a_keeper_that_hangs_costs_its_frames(self):
        with self.a_keeper() as (_, worker):
            worker.pause()

    def test_a_keeper_that_leaves_costs_its_frames(self):
        with self.a_keeper() as (_, worker):
            self.assertEqual(worker.stop(), 0)

    def test_a_killed_coordinator_renders_them_again(self):
        with self.a_keeper() as (farm, _):
            farm.server.kill()
            farm.restart_server()


class BlocksTest(unittest.TestCase):
    """A still of several blocks, which workers filter side by side."""

    WIDE = ["--size", "4200x48", "--spp", "4"]  # four blocks: a side is longer than one may be

    def render(self, worker_options, server_options=(), submit_options=(), meanwhile=lambda farm, workers: None):
        """The file of the frame, and the coordinator's log."""
        with tempfile.TemporaryDirectory() as root, tempfile.TemporaryDirectory() as data, \
                Farm(data, *server_options) as farm:
            scene = make_scene("cornell-box", root)
            workers = [farm.start_worker(*options, threads=1) for options in worker_options]
            wait_until(lambda: farm.server.log_text().count("event=worker_connected") == len(workers), "all workers")
            job = farm.client("submit", scene, *self.WIDE, *submit_options).stdout.strip()
            meanwhile(farm, workers)
            farm.client("wait", job)
            folder = pathlib.Path(data) / "results" / job
            self.assertEqual(list(folder.glob("*.partial")), [])
            file, = folder.glob("frame-*.exr")
            return file.read_bytes(), farm.server.log_text()

    def test_workers_filter_blocks_and_the_file_is_the_same(self):
        expected, log = self.render([("--finish", "never")])
        self.assertNotIn("event=block_leased", log)
        found, log = self.render([("--finish", "never"), ("--finish", "only"), ("--finish", "only")], ONE_PLACE)
        # The coordinator has one, or more where it is faster than they are.
        self.assertIn(log.count("event=block_leased"), (1, 2, 3))
        self.assertEqual(found, expected)
        # All blocks are made by two who agree, one of them a worker.
        found, log = self.render([("--finish", "never"), ("--finish", "only"), ("--finish", "only")], ONE_PLACE,
                                 ("--audit-share", "1"))
        self.assertIn("event=frame_compared", log)
        self.assertNotIn("event=worker_faulty", log)
        self.assertEqual(found, expected)

        def kill_one(farm, workers):
            wait_until(lambda: "event=block_leased" in farm.server.log_text(), "a block for a worker")
            workers[1].kill()

        found, log = self.render([("--finish", "never"), ("--finish", "only")], meanwhile=kill_one)
        self.assertEqual(found, expected)


if __name__ == "__main__":
    unittest.main()
