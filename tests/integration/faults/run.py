"""Runs the table of faults: each on a farm of real processes with a small job, whose picture must be equal
bit by bit to the undisturbed one. See docs/testing.md.

    run.py                        the faults of the gate
    run.py --all                  the long ones too
    run.py --only NAME --seed S   one fault, as it was run before
    run.py --list
    run.py --write FILE           also writes the table as Markdown
"""

import argparse
import concurrent.futures
import os
import pathlib
import platform
import random
import shutil
import sys
import tempfile
import time
import traceback
import typing

import of_clients
import of_network
import of_processes
import of_storage
import of_workers
from world import References, World

FAULTS = [
    *of_processes.FAULTS, *of_network.FAULTS, *of_storage.FAULTS, *of_workers.FAULTS, *of_clients.FAULTS
]


class Row(typing.NamedTuple):
    """What a fault gave."""

    fault: str
    what: str
    result: str  # "equal", "skipped: ..." or "FAILED: ..."
    shown_by: str
    seconds: float


def disturb(world, fault):
    """From the start of the jobs to their end; returns the proof."""
    if fault.after_units:
        world.wait_for("event=unit_committed", fault.after_units - 1)
        world.expect_unfinished()
    state = fault.begin(world)
    if fault.seconds is not None:
        time.sleep(fault.seconds)
        outcome = fault.end(world, state)
    for job in [*world.jobs]:
        if not (world.root / job).exists():  # otherwise it was compared before
            world.expect_picture(job)
    if fault.seconds is None:
        outcome = fault.end(world, state)
    return fault.proof(world, outcome)


def run_fault(fault, root, references, seed):
    begin = time.monotonic()
    folder = root / fault.name.replace(" ", "-").replace(":", "")
    if why := fault.setup.missing():
        return Row(fault.name, fault.what, f"skipped: {why}", "", 0)
    folder.mkdir()
    try:
        with World(folder, fault.setup, references, random.Random(f"{seed} {fault.name}")) as world:
            shown_by = disturb(world, fault)
            world.expect_clean_end()
        result = "equal"
    except Exception as error:  # reported in the table
        (folder / "error.txt").write_text(traceback.format_exc())
        result, shown_by = f"FAILED: {error}", ""
    return Row(fault.name, fault.what, result, shown_by, time.monotonic() - begin)


def print_row(row):
    print(f"{row.seconds:6.1f} s  {row.fault:30} {row.result}  {row.shown_by}", flush=True)


def markdown(rows, seed):
    lines = [
        "# Faults",
        "",
        "Each row is a farm of real processes with one small job of three frames. While units are in flight, the fault happens. The",
        "picture is then compared bit by bit with that of an undisturbed render in one process.",
        "",
        f"`tests/integration/faults/run.py --all --seed {seed}` on {platform.machine()}; [testing.md](../testing.md) says how to run",
        "one of them again. \"Shown by\" counts the coordinator's log lines that prove that the fault happened.",
        "",
        "| fault | what happens | picture | shown by | s |",
        "|---|---|---|---|---|",
    ]
    for row in rows:
        shown_by = row.shown_by.replace("|", "\\|")
        lines.append(f"| {row.fault} | {row.what} | {row.result} | {shown_by} | {row.seconds:.0f} |")
    return "\n".join(lines) + "\n"


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--all", action="store_true", help="the long ones too")
    parser.add_argument("--only", action="append", metavar="NAME", help="these faults only")
    parser.add_argument("--list", action="store_true", help="print the table without running it")
    parser.add_argument("--seed", type=int, default=1, help="of the random moments and choices")
    parser.add_argument("--jobs", type=int, default=4, help="farms at a time")
    parser.add_argument("--write", type=pathlib.Path, metavar="FILE", help="write the table as Markdown")
    parser.add_argument("--keep",
                        action="store_true",
                        help="keep the folders of farms whose picture was equal too")
    return parser.parse_args()


def chosen(table, arguments):
    if not arguments.only:
        return [fault for fault in table if fault.gate or arguments.all]
    names = {fault.name: fault for fault in table}
    if unknown := [name for name in arguments.only if name not in names]:
        sys.exit(f"run.py: no fault is called {', '.join(unknown)}; --list prints them")
    return [names[name] for name in arguments.only]


def main(table):
    arguments = parse_arguments()
    faults = chosen(table, arguments)
    if arguments.list:
        for fault in faults:
            print(f"{fault.name:30} {fault.what}")
        return 0
    root = pathlib.Path(tempfile.mkdtemp(prefix="lumifold-faults-"))
    references = References(root / "references")
    rows = []
    with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
        runs = [pool.submit(run_fault, fault, root, references, arguments.seed) for fault in faults]
        for run in concurrent.futures.as_completed(runs):
            print_row(run.result())
        rows = [run.result() for run in runs]
    failed = [row for row in rows if row.result.startswith("FAILED")]
    skipped = [row for row in rows if row.result.startswith("skipped")]
    print(f"{len(rows) - len(failed) - len(skipped)} equal, {len(failed)} failed, {len(skipped)} skipped")
    if arguments.write:
        arguments.write.write_text(markdown(rows, arguments.seed))
    if failed:
        program = " ".join([
            *(f"{name}={os.environ[name]}" for name in ("LUMIFOLD_BIN", "PYTHONPATH")), "python3", sys.argv[0]
        ])
        print(
            f"The logs are in {root}. To run one again: {program} --only \"{failed[0].fault}\" --seed {arguments.seed}"
        )
    elif not arguments.keep:
        shutil.rmtree(root)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(FAULTS))
