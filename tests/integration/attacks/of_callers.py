"""Attacks by calls: whoever may talk to a coordinator without access control."""

import pathlib
import re
import time

from fault import Fault
from of_clients import end_client, start_client
from world import Setup


def files_outside(world):
    """The files around the data folder, which nobody may write to."""
    return {path for path in world.root.rglob("*") if world.data not in (path, *path.parents)}


def names_inside(world):
    return {path.relative_to(world.data).as_posix() for path in world.data.rglob("*")}


def send_tricks(world):
    """Every call of the protocol, with paths and other tricks in each of its texts."""
    outside = files_outside(world)
    done = end_client(start_client(world, "strings"))
    return outside, done


def tricks_did_nothing(world, outcome):
    outside, said = outcome
    new = {
        path for path in files_outside(world) - outside
        if not path.is_relative_to(world.root / next(iter(world.jobs)))
    }
    if new := {path for path in new if path.suffix != ".log"}:
        raise AssertionError(f"new files outside the data folder: {new}")
    if odd := [
            name for name in names_inside(world)
            if not re.fullmatch(r"[A-Za-z0-9._/-]+", name) or ".." in name
    ]:
        raise AssertionError(f"odd names in the data folder: {odd}")
    calls, codes = re.search(r"(\d+) calls: (.*)", said).groups()
    allowed = {
        "INVALID_ARGUMENT", "NOT_FOUND", "PERMISSION_DENIED", "FAILED_PRECONDITION", "OK",
        "RESOURCE_EXHAUSTED", "OUT_OF_RANGE", "DATA_LOSS"
    }
    seen = dict(re.findall(r"(\w+)=(\d+)", codes))
    # Text that is not UTF-8 does not parse, which gRPC calls INTERNAL.
    if wrong := set(seen) - allowed - {"INTERNAL", "UNIMPLEMENTED"}:
        raise AssertionError(f"answers {wrong}: {said}")
    if pathlib.Path("/tmp/lumifold-canary").exists():
        raise AssertionError("a call wrote to /tmp")
    return f"{calls} calls: {codes}"


def announce(world):
    return end_client(start_client(world, "--count", 20, "announce"))


def announcements_were_refused(world, said):
    if "20 of 20 refused" not in said or "1099511627776" not in said:
        raise AssertionError(said)
    return "20 of 20 refused"


def submit_too_many(world):
    """Submissions past the limit of a user's jobs, of which one may be there. It is paused, but ends with the
    units that workers have: it is active before the submissions and after them, only before, or never."""
    running = next(iter(world.jobs))
    world.farm.client("pause", running, check=False)

    def is_active():
        return world.farm.status(running)["state"] == "paused"

    before = is_active()
    scene = world.references.scene(world.setup.picture.scene)
    accepted, refused = [], 0
    for seed in range(100, 108):
        done = world.farm.client("submit",
                                 scene,
                                 "--size",
                                 "8x8",
                                 "--spp",
                                 1,
                                 "--seed",
                                 seed,
                                 "--paused",
                                 check=False)
        if done.returncode == 0:
            accepted.append(done.stdout.strip())
        elif "active jobs; the limit is 4" in done.stderr:
            refused += 1
    after = is_active()
    for job in accepted:
        world.farm.client("cancel", job)
    world.farm.client("resume", running, check=False)
    return len(accepted), refused, int(before), int(after)


def jobs_were_bounded(_, outcome):
    accepted, refused, before, after = outcome
    said = f"{accepted} of 8 jobs accepted, {refused} refused, {before} there before, {after} after"
    if not 4 - before <= accepted <= 4 - after or accepted + refused != 8:
        raise AssertionError(said)
    return said


def request_too_often(world):
    said = end_client(start_client(world, "--count", 2000, "status"))
    time.sleep(1)  # the client that waits for the picture comes from the same address
    return said


def requests_were_refused(_, said):
    ok, refused = map(int, re.search(r"(\d+) answered, (\d+) refused", said).groups())
    if refused == 0 or ok == 0:
        raise AssertionError(said)
    return said.strip()


ATTACKS = [
    Fault("tricks in texts",
          "'..', absolute paths, NUL, overlong, odd UTF-8 and backslashes in each text of each call",
          send_tricks, tricks_did_nothing),
    Fault("20 uploads of 1 TiB", "20 uploads are announced at 1 TiB each, and left open", announce,
          announcements_were_refused),
    Fault("8 jobs past a limit of 4",
          "a user submits jobs until it is refused",
          submit_too_many,
          jobs_were_bounded,
          setup=Setup(server=("--max-user-jobs", 4))),
    # Workers are the same caller as everyone else here, so the limit leaves room for them and for the test's
    # own client.
    Fault("2000 requests at once",
          "one address makes 2000 calls at once; 40 a second and 200 at once are allowed",
          request_too_often,
          requests_were_refused,
          setup=Setup(server=("--max-requests-per-second", 40))),
]
