#pragma once

// The tables of ledgers that earlier versions of Lumifold wrote, and rows in them. They do not change any
// more.

namespace lumifold::ledger {

/// Schema 2. Schema 1 is the same without the column warnings_left_out.
inline constexpr char kSchema2[] = R"(
CREATE TABLE jobs(
  number INTEGER PRIMARY KEY AUTOINCREMENT,
  id TEXT NOT NULL UNIQUE,
  request_id TEXT NOT NULL UNIQUE,
  spec BLOB NOT NULL,
  state INTEGER NOT NULL,
  error TEXT NOT NULL DEFAULT '',
  numeric_class TEXT NOT NULL DEFAULT '',
  submitted_ms INTEGER NOT NULL,
  started_ms INTEGER NOT NULL DEFAULT 0,
  units_done INTEGER NOT NULL DEFAULT 0,
  samples_done INTEGER NOT NULL DEFAULT 0,
  bad_samples INTEGER NOT NULL DEFAULT 0,
  render_seconds REAL NOT NULL DEFAULT 0,
  assemble_seconds REAL NOT NULL DEFAULT 0,
  filter_seconds REAL NOT NULL DEFAULT 0,
  write_seconds REAL NOT NULL DEFAULT 0,
  warnings_left_out INTEGER NOT NULL DEFAULT 0);
CREATE TABLE units(
  job INTEGER NOT NULL REFERENCES jobs(number),
  frame INTEGER NOT NULL,
  tile INTEGER NOT NULL,
  kind INTEGER NOT NULL,
  pass INTEGER NOT NULL,
  file TEXT NOT NULL,
  offset INTEGER NOT NULL,
  length INTEGER NOT NULL,
  samples INTEGER NOT NULL,
  bad_samples INTEGER NOT NULL,
  PRIMARY KEY(job, frame, tile, kind, pass)) WITHOUT ROWID;
CREATE TABLE frames(
  job INTEGER NOT NULL REFERENCES jobs(number),
  frame INTEGER NOT NULL,
  PRIMARY KEY(job, frame)) WITHOUT ROWID;
CREATE TABLE warnings(
  number INTEGER PRIMARY KEY AUTOINCREMENT,
  job INTEGER NOT NULL REFERENCES jobs(number),
  line TEXT NOT NULL,
  UNIQUE(job, line));
PRAGMA user_version=2;
)";

/// An active job with a recorded and an unrecorded frame, a job that has ended, and one whose spec is
/// damaged. The spec has width 640 and a scene "room.glb" with the dependency "wood.png".
inline constexpr char kRowsOfSchema2[] = R"(
INSERT INTO jobs(number, id, request_id, spec, state, numeric_class, submitted_ms, started_ms, units_done,
                 samples_done, bad_samples, filter_seconds) VALUES
  (3, 'j-a', 'r-1', x'0a16120a0a08776f6f642e706e671a08726f6f6d2e676c62188005', 1, 'avx2', 1700000000123,
   1700000000200, 3, 300, 3, 2.5);
INSERT INTO jobs(number, id, request_id, spec, state, error, submitted_ms, units_done) VALUES
  (4, 'j-ended', 'r-2', x'188005', 5, 'broken', 1700000000124, 1),
  (7, 'j-damaged', 'r-3', x'ffffff', 1, '', 1700000000125, 0);
INSERT INTO units VALUES
  (3, 0, 0, 1, 0, 'film/j-a/0', 0, 77, 100, 1),
  (3, 1, 0, 1, 0, 'film/j-a/1', 0, 77, 100, 1),
  (3, 1, 0, 2, 0, 'film/j-a/1', 77, 78, 100, 1),
  (4, 0, 0, 1, 0, 'film/j-ended/0', 0, 77, 100, 1);
INSERT INTO frames VALUES(3, 0);
INSERT INTO warnings(job, line) VALUES(3, 'no light'), (3, 'no camera');
)";

/// What the later schemas have added, taken away again.
inline constexpr char kFromSchema7To6[] = "DROP TABLE deliveries";
inline constexpr char kFromSchema6To5[] = "ALTER TABLE jobs DROP COLUMN counted; DROP TABLE usage";
inline constexpr char kFromSchema5To4[] = "DROP TABLE coordinators; DROP INDEX jobs_by_epoch";
inline constexpr char kFromSchema4To3[] = "ALTER TABLE jobs DROP COLUMN estimated_error";

}  // namespace lumifold::ledger
