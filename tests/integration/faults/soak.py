"""Random faults against random small jobs, for a time: each job's picture must be equal bit by bit to the
undisturbed one.

    soak.py --seed S --seconds N

The seed determines the faults, their order, their targets and times, and the jobs; the machine decides how
far each gets. On failure the folder with all logs is kept.
"""

import argparse
import contextlib
import os
import pathlib
import random
import shutil
import signal
import sys
import tempfile
import threading
import time
import traceback
import typing

import network
import of_clients
import of_network
import of_processes
import of_storage
import of_workers
from world import Picture, References, Setup, World

PICTURES = (
    Picture(size="64x48", samples=64, frames=2),
    Picture(size="40x30", samples=256, frames=3, seed=7),
    Picture(size="96x64", samples=32, frames=1, seed=8),
)
CLIENTS = 2  # each has one job at a time
MOST_FAULTS = 2  # at a time
LONGEST_FAULT_SECONDS = 5
LONGEST_CALM_SECONDS = 1.5
# Behaviours of hostile workers that can fail no job by themselves: the soak leaves a hostile worker alone at
# times.
HOSTILE = ("twice", "late", "warnings", "foreign-failures", "second-hello", "other-version",
           "garbage-message")


class Disturbance(typing.NamedTuple):
    """As a Fault of the table; the picture alone is its proof. Both calls return soon, whatever else
    happens."""

    name: str
    begin: typing.Callable[[World], object]
    end: typing.Callable[[World, object], object] = lambda world, state: None


def start_hostile(world):
    return world.start_hostile(world.rng.choice(HOSTILE))


def end_hostile(world, worker):
    worker.kill()


def kill_filters(world):
    for child in world.farm.server.children():
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)


def corrupt_a_record(world):
    """A byte of any unit log changes, if there is one."""
    with contextlib.suppress(ValueError, FileNotFoundError):  # no frame is unfinished
        of_storage.corrupt_record(world)


def disturbances(world):
    table = [
        *of_processes.FAULTS, *of_network.FAULTS, *of_storage.FAULTS, *of_workers.FAULTS, *of_clients.FAULTS
    ]
    return [
        *(Disturbance(fault.name, fault.begin, fault.end) for fault in table
          if fault.soak and (world.network or not fault.setup.network)),
        Disturbance("hostile worker", start_hostile, end_hostile),
        Disturbance("filter processes killed", kill_filters),
        Disturbance("record damaged", corrupt_a_record),
    ]


class Active(typing.NamedTuple):
    fault: Disturbance
    state: object
    until: float


class Soak:
    def __init__(self, world, seconds, rng):
        self.world = world
        self.rng = rng
        self.deadline = time.monotonic() + seconds
        self.begin = time.monotonic()
        self.faults = disturbances(world)
        self.active = []
        self.counts = {}
        self.errors = []
        self.equal = 0

    def say(self, text):
        print(f"{time.monotonic() - self.begin:7.2f} s  {text}", flush=True)

    def run_client(self, rng):
        """A user's commands, one job after the other, through all faults."""
        try:
            while time.monotonic() < self.deadline and not self.errors:
                job = self.world.submit(rng.choice(PICTURES))
                self.world.expect_picture(job)
                self.equal += 1
        except Exception:  # of a thread: raised again by run()
            self.errors.append(traceback.format_exc())

    def step(self):
        now = time.monotonic()
        for one in [one for one in self.active if one.until <= now]:
            self.end(one)
        if len(self.active) < MOST_FAULTS:
            fault = self.rng.choice(self.faults)
            if fault not in [one.fault for one in self.active]:
                seconds = self.rng.uniform(0, LONGEST_FAULT_SECONDS)
                self.say(f"begin {fault.name} for {seconds:.1f} s")
                self.counts[fault.name] = self.counts.get(fault.name, 0) + 1
                self.active.append(Active(fault, fault.begin(self.world), now + seconds))
        time.sleep(self.rng.uniform(0, LONGEST_CALM_SECONDS))

    def end(self, one):
        self.say(f"end   {one.fault.name}; {self.equal} pictures equal")
        one.fault.end(self.world, one.state)
        self.active.remove(one)

    def run(self):
        clients = [
            threading.Thread(target=self.run_client, args=(random.Random(self.rng.random()),))
            for _ in range(CLIENTS)
        ]
        for client in clients:
            client.start()
        while time.monotonic() < self.deadline and not self.errors:
            self.step()
        while self.active:
            self.end(self.active[-1])
        for client in clients:
            client.join()
        if self.errors:
            raise AssertionError(self.errors[0])


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=None, help="default: a new one, which is printed")
    parser.add_argument("--seconds", type=float, default=60)
    return parser.parse_args()


def main():
    arguments = parse_arguments()
    seed = arguments.seed if arguments.seed is not None else random.SystemRandom().randrange(1 << 32)
    print(f"soak: seed {seed}, {arguments.seconds:.0f} s", flush=True)
    why = network.missing()
    if why:
        print(f"soak: SKIPPED the faults of the network: {why}")
    root = pathlib.Path(tempfile.mkdtemp(prefix="lumifold-soak-"))
    references = References(root / "references")
    for picture in PICTURES:
        references.of(picture)
    try:
        with World(root, Setup(workers=3, jobs=0, network=not why), references, random.Random(seed)) as world:
            soak = Soak(world, arguments.seconds, world.rng)
            soak.run()
            world.expect_clean_end()
    except Exception:
        traceback.print_exc()
        print(
            f"soak: FAILED. The logs are in {root}. Run it again: soak.py --seed {seed} --seconds {arguments.seconds:.0f}"
        )
        return 1
    shutil.rmtree(root)
    faults = ", ".join(f"{count} x {name}" for name, count in sorted(soak.counts.items()))
    print(f"soak: {soak.equal} jobs equal; {faults}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
