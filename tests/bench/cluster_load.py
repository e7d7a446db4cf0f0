#!/usr/bin/env python3
"""Units per second of several coordinators over one PostgreSQL of its own, and what the database spends on
them. Prints a table.

    LUMIFOLD_BIN=build/release/bin PYTHONPATH=tests/support python3 tests/bench/cluster_load.py [--seconds 10]
    [--repeat 3]
"""

import argparse
import contextlib
import os
import pathlib
import statistics
import subprocess
import urllib.parse

from farm import BIN
from with_postgres import SCRIPT

TICKS = os.sysconf("SC_CLK_TCK")
WORKERS, SLOTS = 24, 4


def cpu_seconds(postmaster):
    """Of a PostgreSQL server: its processes, and those that have ended."""
    total = 0
    for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # it has ended
            fields = stat.read_text().rpartition(")")[2].split()
            if stat.parent.name == postmaster or fields[1] == postmaster:
                total += sum(map(int, fields[11:15]))
    return total / TICKS


def measure(coordinators, seconds):
    """Runs one farm over a new database; returns units per second, and seconds of coordinators and database
    for 1000 units."""
    postgres = subprocess.Popen([SCRIPT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    uri = postgres.stdout.readline().strip()
    folder = pathlib.Path(urllib.parse.parse_qs(urllib.parse.urlparse(uri).query)["host"][0])
    postmaster = (folder / "data" / "postmaster.pid").read_text().split()[0]
    before = cpu_seconds(postmaster)
    done = subprocess.run([
        BIN / "farm-load", "--coordinators",
        str(coordinators), "--workers",
        str(WORKERS), "--slots",
        str(SLOTS), "--seconds",
        str(seconds), "--tile", "8", "--size", "256"
    ],
                          env={**os.environ, "LUMIFOLD_STORE": uri},
                          capture_output=True,
                          text=True,
                          check=True)
    spent = cpu_seconds(postmaster) - before
    postgres.communicate()
    values = {line.split()[0]: float(line.split()[1]) for line in done.stdout.splitlines()}
    units = values["committed_units"]
    return values["units_per_second"], values["server_cpu_seconds_per_1000_units"], 1000 * spent / units


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--repeat", type=int, default=3)
    options = parser.parse_args()
    print("| coordinators | units/s | coordinators, ms a unit | database, ms a unit |")
    print("|---|---|---|---|")
    # In turn, so that a change of the machine's speed is in all of them.
    runs = {count: [] for count in (1, 2, 3)}
    for _ in range(options.repeat):
        for count, results in runs.items():
            results.append(measure(count, options.seconds))
    for count, results in runs.items():
        units, servers, database = (statistics.median(column) for column in zip(*results))
        print(f"| {count} | {units:.0f} | {servers:.3f} | {database:.3f} |")


if __name__ == "__main__":
    main()
