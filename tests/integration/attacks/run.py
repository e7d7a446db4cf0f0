"""Runs the table of attacks as that of the faults: each on a farm of real processes with a small job, whose
picture must be equal bit by bit. Options as those of ../faults/run.py.

    run.py --measure [NAME ...]   the time of a job that is attacked again and again, against that of an
                                  undisturbed one

The attacker of --measure has a processor core of its own, as one on another machine has: only what the farm
does about the attack takes time from the job.
"""

import contextlib
import dataclasses
import os
import pathlib
import random
import sys
import tempfile
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "faults"))

import of_callers  # noqa: E402
import of_strangers  # noqa: E402
import run  # noqa: E402
from world import Picture, References, World  # noqa: E402

# Two frames: what an attack does to the first shows on the second.
SMALL_PICTURE = Picture(frames=2)
ATTACKS = [
    dataclasses.replace(attack, setup=attack.setup._replace(picture=SMALL_PICTURE))
    for attack in (*of_strangers.ATTACKS, *of_callers.ATTACKS)
]
LONG_PICTURE = Picture(size="128x96", samples=192)
PAIRS = 3
ATTACKER_CORE = set()  # of --measure


def cores():
    """Those of the farm, and that of the attacker."""
    *farm, attacker = sorted(os.sched_getaffinity(0))
    if not farm:
        sys.exit("--measure needs two processor cores, one of them for the attacker")
    return set(farm), {attacker}


def attack_until(done, attack, world, outcomes):
    """The same attack again and again, on the attacker's core."""
    os.sched_setaffinity(0, ATTACKER_CORE)  # of this thread, and of all that it starts
    while not done.is_set():
        with contextlib.suppress(TimeoutError):  # it is shut out, and tries again
            outcomes.append(attack.end(world, attack.begin(world)))


def seconds_of(folder, attack, references, disturbed):
    """From the first committed units to the end of the job, and how often it was attacked."""
    folder.mkdir(parents=True)
    setup = attack.setup._replace(picture=LONG_PICTURE)
    with World(folder, setup, references, random.Random(1)) as world:
        world.wait_for("event=unit_committed", attack.after_units - 1)
        done, outcomes = threading.Event(), []
        attacker = threading.Thread(target=attack_until, args=(done, attack, world, outcomes))
        begin = time.monotonic()
        if disturbed:
            attacker.start()
        world.wait_for(f"event=job_ended job={next(iter(world.jobs))}")
        seconds = time.monotonic() - begin
        done.set()
        if disturbed:
            attacker.join()
        world.expect_picture(next(iter(world.jobs)))
    return seconds, len(outcomes)


def measure(names):
    """Prints the ratio of each attack, or of those with these names: the median of pairs, undisturbed and
    disturbed in turns."""
    farm, attacker = cores()
    ATTACKER_CORE.update(attacker)
    os.sched_setaffinity(0, farm)  # of this thread and of all processes that it starts
    root = pathlib.Path(tempfile.mkdtemp(prefix="lumifold-attacks-"))
    references = References(root / "references")
    slow = []
    for attack in (attack for attack in ATTACKS if not names or attack.name in names):
        ratios = []
        for pair in range(PAIRS):
            folder = root / f"{attack.name.replace(' ', '-')}-{pair}"
            calm, _ = seconds_of(folder / "calm", attack, references, disturbed=False)
            under, times = seconds_of(folder / "attacked", attack, references, disturbed=True)
            ratios.append(under / calm)
        ratio = sorted(ratios)[PAIRS // 2]
        print(
            f"{attack.name:30} {ratio:.2f} times the {calm:.1f} s of an undisturbed job, attacked {times} times",
            flush=True)
        if ratio > 1.2:
            slow.append(attack.name)
    print(f"more than 1.2 times: {', '.join(slow) or 'none'}")
    return 1 if slow else 0


if __name__ == "__main__":
    sys.exit(measure(sys.argv[2:]) if sys.argv[1:2] == ["--measure"] else run.main(ATTACKS))
