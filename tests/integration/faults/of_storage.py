"""Disks that are full, read-only, frozen, or change what was written."""

import os
import sqlite3
import subprocess

from disk import set_immutable
from farm import run
from fault import Fault, logged
from world import Setup

FROZEN_SECONDS = 3
OUTAGE_SECONDS = 2
PAGE_BYTES = 4096
ANSWER_SECONDS = 60


# ---- Damage to files, done while the coordinator is away ----

def flip_byte(path, position):
    content = bytearray(path.read_bytes())
    content[position] ^= 0xFF
    path.write_bytes(content)


def unit_log(world):
    """A log with committed units. ValueError: there is none; a log is empty until its first unit."""
    sizes = {path: path.stat().st_size for path in (world.data / "film").glob("*/*.units")}
    return max((path for path, size in sizes.items() if size > 0), key=sizes.get)


def damage(change):
    """Begins a fault that changes the data folder between SIGKILL of the coordinator and its next start."""

    def begin(world):
        world.farm.server.kill()
        change(world)
        world.farm.restart_server()

    return begin


def corrupt_record(world):
    log = unit_log(world)
    flip_byte(log, log.stat().st_size // 2)


def cut_log(world):
    log = unit_log(world)
    with open(log, "r+b") as file:
        file.truncate(log.stat().st_size // 2)


def delete_log(world):
    unit_log(world).unlink()


def corrupt_record_now(world):
    """While the coordinator runs."""
    corrupt_record(world)


def corrupt_asset(world):
    """A damaged scene is found at its next use and healed by the next submission of it."""
    for asset in (world.data / "assets").iterdir():
        flip_byte(asset, asset.stat().st_size // 2)


def corrupt_asset_and_submit(world):
    world.expect_picture(next(iter(world.jobs)))
    world.farm.server.kill()
    corrupt_asset(world)
    world.farm.restart_server()
    world.submit(world.setup.picture._replace(seed=6))


# ---- The ledger ----

def checkpoint(ledger):
    """Writes what is in the ledger's log into its pages."""
    connection = sqlite3.connect(ledger)
    connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    connection.close()


def corrupt_page(world):
    ledger = world.data / "ledger.db"
    checkpoint(ledger)
    with open(ledger, "r+b") as file:
        file.seek(PAGE_BYTES)
        file.write(os.urandom(ledger.stat().st_size - PAGE_BYTES))


def delete_ledger(world):
    for path in world.data.glob("ledger.db*"):
        path.unlink()


def recover_from(change):
    """Begins a fault of the ledger: the next start must refuse it and name the command that helps."""

    def begin(world):
        world.farm.server.kill()
        change(world)
        try:
            world.farm.restart_server()
        except AssertionError as error:
            if "lumifold-server recover" not in str(error):
                raise
        else:
            raise AssertionError("the coordinator started without its ledger")
        return run("lumifold-server", "recover", "--data", world.data).stdout

    def restart(world):
        said = begin(world)
        world.farm.restart_server()
        return said

    return restart


def was_recovered(world, said):
    return f"the start was refused; {logged('job_restored')(world, None)} after `recover`"


# ---- Disks ----

def refusal(world):
    """What `submit` says."""
    done = world.farm.client("submit", world.references.scene("cornell-box"), "--size", "8x8", "--timeout", 1,
                              check=False)
    if done.returncode == 0:
        raise AssertionError("a job was accepted although the storage cannot be written")
    return done.stderr.strip().rsplit(": ", 1)[-1]


def fill_disk(world):
    world.disk.fill()
    world.wait_for("event=storage_unavailable")
    world.disk.fill()  # what the coordinator has given up since
    said = refusal(world)
    world.farm.status(next(iter(world.jobs)))
    return said


def start_on_full_disk(world):
    """Killed, the coordinator starts in the space that it keeps for its ledger."""
    world.farm.server.kill()
    world.disk.fill()
    world.farm.restart_server()
    world.wait_for("event=storage_unavailable")
    return refusal(world)


def free_disk(world, said):
    world.disk.free()
    return said


def lock_folder(world):
    """No file can be made beside the log of the frame that is being rendered."""
    folder = unit_log(world).parent
    set_immutable(folder, True)
    world.wait_for("event=storage_unavailable")
    return folder, refusal(world)


def unlock_folder(world, state):
    folder, said = state
    set_immutable(folder, False)
    return said


def abort_disk(world):
    world.disk.abort()
    world.wait_for("event=storage_unavailable")
    return refusal(world)


def mount_again(world, said):
    world.farm.server.kill()
    world.disk.unmount()
    world.disk.mount()
    world.farm.restart_server()
    return said


def refused_and_went_on(world, said):
    return f"{logged('storage_unavailable')(world, None)}, {logged('storage_available')(world, None)}; submit: {said}"


def refused_until_mounted(world, said):
    return f"{logged('storage_unavailable')(world, None)}, {logged('job_restored')(world, None)}; submit: {said}"


def freeze(world):
    """Returns the number of committed units, and whether the coordinator answers a client."""
    world.disk.freeze()
    try:
        world.farm.client("status", next(iter(world.jobs)), timeout=ANSWER_SECONDS)
        has_answered = True
    except subprocess.TimeoutExpired:
        has_answered = False
    return world.committed(), has_answered  # what was written just before is in the log by now


def thaw(world, state):
    before, answered = state
    during = world.committed() - before
    world.disk.thaw()
    return during, answered


def stood_still(world, outcome):
    during, answered = outcome
    if during:
        raise AssertionError(f"{during} units were committed on a frozen disk")
    if not answered:
        raise AssertionError(f"`status` got no answer within {ANSWER_SECONDS} s while the disk was frozen")
    return f"no commit for {FROZEN_SECONDS} s, status answered"


FAULTS = [
    Fault("record damaged",
          "a byte of a unit log changes while the coordinator is away",
          damage(corrupt_record),
          logged("units_lost"),
          after_units=8),
    Fault("record damaged at run time",
          "a byte of a unit log changes",
          corrupt_record_now,
          logged("units_lost"),
          after_units=8),
    Fault("log cut", "a unit log loses its second half", damage(cut_log), logged("units_lost"),
          after_units=8),
    Fault("log deleted", "a unit log is deleted", damage(delete_log), logged("units_lost"), after_units=8),
    Fault("asset damaged",
          "a byte of the scene changes on the coordinator's disk, then it is submitted again",
          corrupt_asset_and_submit, logged("asset_damaged")),
    Fault("ledger deleted",
          "the ledger is deleted while the coordinator is away",
          recover_from(delete_ledger),
          was_recovered,
          after_units=8),
    Fault("ledger damaged",
          "random bytes in all pages of the ledger but the first",
          recover_from(corrupt_page),
          was_recovered,
          after_units=8),
    Fault("disk full", f"no byte is free for {OUTAGE_SECONDS} s", fill_disk, refused_and_went_on, free_disk,
          OUTAGE_SECONDS, Setup(disk="tmpfs", disk_megabytes=96)),
    Fault("start on a full disk", "the coordinator is killed, and started when no byte is free",
          start_on_full_disk, refused_and_went_on, free_disk, OUTAGE_SECONDS,
          Setup(disk="tmpfs", disk_megabytes=96)),
    Fault("folder read-only", f"no file can be made in a job's folder for {OUTAGE_SECONDS} s", lock_folder,
          refused_and_went_on, unlock_folder, OUTAGE_SECONDS, Setup(disk="ext4", disk_megabytes=128)),
    Fault(
        "disk read-only",
        "the file system ends all writes, as after an error of the device; mounted again, the coordinator "
        "restarted", abort_disk, refused_until_mounted, mount_again, OUTAGE_SECONDS,
        Setup(disk="ext4", disk_megabytes=128)),
    Fault("disk frozen", f"writes to the data folder hang for {FROZEN_SECONDS} s", freeze, stood_still, thaw,
          FROZEN_SECONDS, Setup(disk="ext4", disk_megabytes=96)),
]
