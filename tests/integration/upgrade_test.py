"""A farm is upgraded in the middle of jobs: its ledger from that of the first version, its workers one after
the other."""

import json
import pathlib
import sqlite3
import tempfile
import unittest

from farm import BIN, Farm, Process, make_scene, run, wait_until

# Without a plan: the first version had none.
SETTINGS = ["--size", "96x72", "--spp", "256", "--seed", "5", "--save-film", "--plan", "full"]
# As server/ledger had them in its first version; it is not made by the current code.
SCHEMA_1 = """
CREATE TABLE jobs(number INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, request_id TEXT NOT NULL UNIQUE,
  spec BLOB NOT NULL, state INTEGER NOT NULL, error TEXT NOT NULL DEFAULT '', numeric_class TEXT NOT NULL DEFAULT '',
  submitted_ms INTEGER NOT NULL, started_ms INTEGER NOT NULL DEFAULT 0, units_done INTEGER NOT NULL DEFAULT 0,
  samples_done INTEGER NOT NULL DEFAULT 0, bad_samples INTEGER NOT NULL DEFAULT 0, render_seconds REAL NOT NULL DEFAULT 0,
  assemble_seconds REAL NOT NULL DEFAULT 0, filter_seconds REAL NOT NULL DEFAULT 0, write_seconds REAL NOT NULL DEFAULT 0);
CREATE TABLE units(job INTEGER NOT NULL REFERENCES jobs(number), frame INTEGER NOT NULL, tile INTEGER NOT NULL,
  kind INTEGER NOT NULL, pass INTEGER NOT NULL, file TEXT NOT NULL, offset INTEGER NOT NULL, length INTEGER NOT NULL,
  samples INTEGER NOT NULL, bad_samples INTEGER NOT NULL, PRIMARY KEY(job, frame, tile, kind, pass)) WITHOUT ROWID;
CREATE TABLE frames(job INTEGER NOT NULL REFERENCES jobs(number), frame INTEGER NOT NULL, PRIMARY KEY(job, frame)) WITHOUT ROWID;
CREATE TABLE warnings(number INTEGER PRIMARY KEY AUTOINCREMENT, job INTEGER NOT NULL REFERENCES jobs(number),
  line TEXT NOT NULL, UNIQUE(job, line));
PRAGMA user_version=1;
"""
# A job's scene was one message with its other files; messages that follow each other are one.
ROWS_OF_SCHEMA_1 = """
INSERT INTO jobs SELECT number, id, request_id, CAST(spec || files AS BLOB), state, error, numeric_class, submitted_ms, started_ms,
  units_done, samples_done, bad_samples, render_seconds, assemble_seconds, filter_seconds, write_seconds FROM now.jobs;
INSERT INTO units SELECT films.job, films.frame, tile, kind, pass, file, position, length, units.samples, units.bad_samples
  FROM now.units AS units JOIN now.films AS films ON films.number = units.film;
INSERT INTO frames SELECT job, frame FROM now.films WHERE finished = 1;
INSERT INTO warnings(job, line) SELECT job, line FROM now.warnings ORDER BY number;
"""
# Names in the program, and what a worker of another numeric class has there: an earlier version, another
# Embree.
OTHER_CLASSES = [({b"0.1.0\0": b"0.0.9\0"}, "lumifold-0.0.9/"),
                 ({b"\0embree3\0": b"\0embree4\0", b"\0embree4\0": b"\0embree3\0"}, "lumifold-0.1.0/embree")]


def take_ledger_back_to_schema_1(folder):
    """Writes the rows of a ledger as the first version had them. The coordinator must not run."""
    current, first = folder / "ledger.db", folder / "first.db"
    with sqlite3.connect(first) as db:
        db.executescript(SCHEMA_1)
        db.execute("ATTACH ? AS now", (str(current),))
        db.executescript(ROWS_OF_SCHEMA_1)
    db.close()
    for name in ("ledger.db-wal", "ledger.db-shm"):
        (folder / name).unlink(missing_ok=True)
    first.rename(current)


class UpgradeTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.root = pathlib.Path(cls.folder.name)
        cls.scene = make_scene("cornell-box", cls.root)
        cls.expected = cls.root / "one-process.exr"
        run("lumifold", "render", cls.scene, *SETTINGS, "--threads", "2", "-o", cls.expected)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def submit(self, farm):
        return farm.client("submit", self.scene, *SETTINGS).stdout.strip()

    def expect_same_pixels(self, farm, job):
        """The file itself names the renderer's version."""
        result = self.root / f"{job}.exr"
        farm.client("wait", job)
        farm.client("download", job, "-o", result)
        self.assertEqual(
            json.loads(run("lumifold", "compare", result, self.expected, "--json").stdout)["mse255"], 0)

    def test_a_ledger_of_the_first_version_goes_on(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            job = self.submit(farm)
            worker = farm.start_worker()
            wait_until(lambda: farm.status(job)["units_done"] > 3, "some units")
            worker.kill()
            farm.server.kill()
            take_ledger_back_to_schema_1(pathlib.Path(data))
            farm.restart_server()
            done = farm.status(job)["units_done"]
            self.assertGreater(done, 3)
            farm.start_worker()
            self.expect_same_pixels(farm, job)
            # Nothing that was committed before was rendered again.
            log = farm.server.log_text()
            self.assertNotIn("event=units_lost", log)
            self.assertEqual(farm.status(job)["units_done"], farm.status(job)["units_total"])
            with sqlite3.connect(pathlib.Path(data) / "ledger.db") as db:
                self.assertGreater(db.execute("PRAGMA user_version").fetchone()[0], 1)
            db.close()

    def other_worker(self, names):
        """A worker that says it is of another numeric class. It speaks the same protocol."""
        program = self.root / "other-worker"
        content = (BIN / "lumifold-worker").read_bytes()
        ours = [name for name in names if name in content]
        self.assertEqual(len(ours), 1)
        program.write_bytes(content.replace(ours[0], names[ours[0]]))
        program.chmod(0o755)
        return program

    def test_workers_of_two_classes_render_jobs_of_their_own_class(self):
        for names, class_start in OTHER_CLASSES:
            with self.subTest(class_start), tempfile.TemporaryDirectory() as data, Farm(data) as farm:
                self.expect_jobs_of_their_own_class(farm, self.other_worker(names), class_start)

    def expect_jobs_of_their_own_class(self, farm, other, class_start):
        def start_other():
            farm.workers.append(
                Process(str(other), "--server", farm.address, "--threads", 1, "--name", "other"))

        def class_of(job):
            return (pathlib.Path(farm.data) / "film" / job / "class").read_text()

        begun = self.submit(farm)
        start_other()
        wait_until(lambda: farm.status(begun)["units_done"] > 3, "some units of the other worker")
        farm.start_worker("--name", "ours")
        new = self.submit(farm)
        wait_until(lambda: farm.status(new)["units_done"] > 0, "a unit of our worker")
        # The other one is gone before the job it began is done: the job waits for its class and says so.
        farm.workers[0].kill()
        waits = f"needs workers of class {class_start}"
        explained = wait_until(lambda: waits in (t := farm.client("explain", begun).stdout) and t,
                               "a job that waits for its class")
        self.assertIn("no_worker", explained)
        self.expect_same_pixels(farm, new)
        start_other()
        self.expect_same_pixels(farm, begun)
        self.assertEqual(class_of(begun)[:len(class_start)], class_start)
        self.assertNotEqual(class_of(begun), class_of(new))


if __name__ == "__main__":
    unittest.main()
