"""Processes that are killed or stopped."""

import os
import signal
import time

from disk import ChangeWatcher
from fault import Fault, logged, logged_one_of
from world import LEASE_SECONDS, PATIENCE_SECONDS, Picture, Setup

KILLS = 20
# The longest time from an event to the SIGKILL: within a commit (two syncs) and within a filter process.
COMMIT_SECONDS = 0.01
FILTER_SECONDS = 0.15
START_SECONDS = 0.1
STOP_SECONDS = 2 * LEASE_SECONDS
SETTLE_SECONDS = 0.1


# ---- Workers ----

def kill_worker(world):
    number = world.rng.randrange(len(world.workers))
    world.workers[number].kill()
    return number


def replace_worker(world, number):
    world.workers[number] = world.start_worker(number)


def kill_all_workers(world):
    for worker in world.workers:
        worker.kill()
    world.workers = [world.start_worker(i) for i in range(len(world.workers))]


def stop_worker(world):
    worker = world.rng.choice(world.workers)
    worker.pause()
    return worker


def resume(world, process):
    process.resume()
    return process


# ---- The coordinator ----

def kill_coordinator(world):
    world.farm.server.kill()
    world.farm.restart_server()


def stop_coordinator(world):
    """Returns it, and the length of its log a moment later, when the last lines have been written."""
    world.farm.server.pause()
    time.sleep(SETTLE_SECONDS)
    return world.farm.server, len(world.log())


def resume_coordinator(world, state):
    """Whether it has logged nothing since."""
    server, length = state
    silent = len(world.log()) == length
    server.resume()
    return silent


def stood_still(world, silent):
    if not silent:
        raise AssertionError("the stopped coordinator wrote its log")
    return f"no line logged for {STOP_SECONDS:.0f} s"


def while_a_unit_is_written(world):
    """Between the write of a unit and its acknowledgement there are two syncs."""
    folders = world.wait_until(lambda: list((world.data / "film").iterdir()), "no film")
    with ChangeWatcher(folders[0]) as film:
        film.wait(PATIENCE_SECONDS)
    time.sleep(world.rng.uniform(0, COMMIT_SECONDS))
    return "commit"


def while_a_frame_is_filtered(world):
    world.wait_until(world.farm.server.children, "no filter process")
    time.sleep(world.rng.uniform(0, FILTER_SECONDS))
    return "filter" if world.farm.server.children() else "just after the filter"


def while_it_starts(world):
    world.farm.server.kill()
    world.farm.launch_server(*world.farm.server_arguments, listen=world.farm.address)
    time.sleep(world.rng.uniform(0, START_SECONDS))
    return "start"


def at_any_time(world):
    time.sleep(world.rng.uniform(0, 1))
    return "any time"


def kill_at_random_moments(world):
    """Kills the coordinator KILLS times; returns how many of them hit what."""
    moments = ([while_a_unit_is_written] * 8 + [while_a_frame_is_filtered] * 4 + [while_it_starts] * 4 +
               [at_any_time] * 4)
    world.rng.shuffle(moments)
    hits = {}
    for moment in moments[:KILLS]:
        world.expect_unfinished()
        hit = moment(world)
        hits[hit] = hits.get(hit, 0) + 1
        kill_coordinator(world)
    return hits


def hits_of_kills(world, hits):
    missed = [name for name in ("commit", "filter", "start", "any time") if name not in hits]
    if missed:
        raise AssertionError(f"no kill hit {missed}: {hits}")
    return ", ".join(f"{count} in {name}" for name, count in sorted(hits.items()))


def kill_filter(world):
    child = world.wait_until(world.farm.server.children, "no filter process")[0]
    os.kill(child, signal.SIGKILL)


FAULTS = [
    Fault("worker killed",
          "SIGKILL of a worker, for good",
          kill_worker,
          logged("worker_gone"),
          replace_worker,
          soak=True),
    Fault("all workers killed",
          "SIGKILL of all workers; others start",
          kill_all_workers,
          logged("worker_gone"),
          soak=True),
    Fault("coordinator killed",
          "SIGKILL of the coordinator; it starts at once",
          kill_coordinator,
          logged("job_restored"),
          soak=True),
    Fault("coordinator killed 20 times",
          "SIGKILL at 20 random moments of one job: in commits, filter processes, starts, and any "
          "time",
          kill_at_random_moments,
          hits_of_kills,
          setup=Setup(picture=Picture(samples=128, frames=16))),
    Fault("filter process killed",
          "SIGKILL of a frame's filter process",
          kill_filter,
          logged("frame_retried"),
          after_units=0),
    Fault("worker stopped",
          f"SIGSTOP of a worker for {STOP_SECONDS:.0f} s, twice its lease",
          stop_worker,
          logged_one_of("lease_expired", "leases_void"),
          resume,
          seconds=STOP_SECONDS,
          soak=True),
    Fault("coordinator stopped",
          f"SIGSTOP of the coordinator for {STOP_SECONDS:.0f} s",
          stop_coordinator,
          stood_still,
          resume_coordinator,
          seconds=STOP_SECONDS,
          soak=True),
]
