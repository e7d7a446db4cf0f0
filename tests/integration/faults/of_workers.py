"""Workers that break the protocol (tests/support/hostile_worker.cc)."""

import os
import socket

from fault import Fault, both, logged, logged_one_of, refused, said_by_workers
from world import LEASE_SECONDS, Picture, Setup

# What the hostile worker says for each unit, and for each connection that was ended.
DELIVERED = ("event=hostile .*unit=", "units")
FOREIGN_TOKEN = ("token of another job", "units")
GARBAGE_CONNECTIONS = 20
ANSWER_SECONDS = 60
MAX_WARNINGS = 101  # with the line that counts the others
LONG = Picture(samples=512)
# What a worker does to units that are then refused, in turn.
INVALID = {
    "nan": "a value is NaN",
    "infinity": "a value is infinite",
    "negative-count": "a sample count is negative",
    "too-many-samples": "a sample count is above that of the pass",
    "wrong-size": "one pixel narrower than their tile",
    "missing-channel": "without their last channel",
    "garbage": "random bytes for pixels, with a checksum that fits",
    "flipped-bit": "one bit differs from the checksum",
    "short": "half of the bytes",
}
# Workers that never get on, each a process of its own.
WRONG_HELLOS = ("second-hello", "other-version", "garbage-message")


def hostile(behaviour,
            what,
            *proofs,
            name="",
            said=DELIVERED,
            jobs=1,
            options=(),
            picture=Picture(),
            workers=1,
            submit=(),
            all_before_job=False,
            **fault):
    """A worker with this behaviour beside honest ones."""
    setup = Setup(workers=workers,
                  hostile=(behaviour,),
                  jobs=jobs,
                  hostile_options=options,
                  picture=picture,
                  submit=submit,
                  all_before_job=all_before_job)
    return Fault(f"worker: {name or behaviour}",
                 what,
                 lambda world: None,
                 both(said_by_workers(*said), *proofs),
                 setup=setup,
                 after_units=0,
                 **fault)


def texts_are_bounded(world, _):
    """A proof: status and list, which carry the texts of workers, can be read."""
    world.farm.client("list")
    warnings = world.farm.status(next(iter(world.jobs)))["warnings"]
    if not MAX_WARNINGS // 2 < len(warnings) <= MAX_WARNINGS:
        raise AssertionError(f"the status has {len(warnings)} warnings")
    return f"{len(warnings)} warnings in the status"


def send_garbage(world):
    """Random bytes on the coordinator's port."""
    host, port = world.farm.address.rsplit(":", 1)
    connections = [
        socket.create_connection((host, int(port)), timeout=ANSWER_SECONDS)
        for _ in range(GARBAGE_CONNECTIONS)
    ]
    for connection in connections:
        connection.sendall(os.urandom(1000))
    return connections


def is_refused(connection):
    """Whether the coordinator has closed the connection."""
    with connection:
        try:
            while connection.recv(1 << 16):
                pass
        except TimeoutError:
            return False
        except ConnectionError:
            pass
    return True


def count_refused(world, connections):
    return sum(is_refused(connection) for connection in connections)


def all_refused(world, refused):
    if refused != GARBAGE_CONNECTIONS:
        raise AssertionError(f"{refused} of {GARBAGE_CONNECTIONS} connections with random bytes were closed")
    return f"{refused} connections closed"


FAULTS = [
    hostile(",".join(INVALID),
            f"units that are not valid, in turn: {', '.join(INVALID.values())}",
            *(said_by_workers(f"event=hostile behaviour={way} unit=", way) for way in INVALID),
            refused,
            name="invalid units"),
    hostile("wrong-tile", "units under the number of another tile", logged("unit_not_wanted",
                                                                           "lease_dropped")),
    hostile("other-job",
            "units with the token of another job, and wrong pixels",
            logged("unit_not_wanted", "lease_dropped"),
            jobs=2,
            said=FOREIGN_TOKEN),
    hostile("warnings", "3 MB of new warnings with each unit", texts_are_bounded),
    hostile("twice", "each unit twice, with wrong pixels the second time", logged("unit_not_wanted")),
    hostile("late",
            "silence past the lease, then wrong pixels",
            logged("lease_expired", "unit_not_wanted"),
            options=("--late-seconds", str(1.5 * LEASE_SECONDS), "--slots", "1"),
            picture=LONG),
    hostile("wrong-pixels",
            "plausible but wrong pixels, in a job whose units are all audited",
            logged("worker_faulty", "units_discarded"),
            workers=2,
            submit=("--audit-share", "1")),
    hostile("vanish",
            "an incomplete unit, then its connection breaks, again and again",
            logged("worker_gone"),
            picture=LONG),
    # A worker that is alone is believed.
    hostile("long-error",
            "calls each unit impossible to render, in 3 MB of text",
            logged("unit_failed"),
            all_before_job=True),
    hostile("foreign-failures", "failures of units that others have leased"),
    hostile("hoard", "reports progress for ever and delivers nothing",
            logged_one_of("unit_overdue", "leases_void")),
    Fault("workers: wrong introductions",
          "three workers: one introduces itself twice, one speaks another version of the protocol, one sends "
          "random bytes for its first message",
          lambda world: None,
          both(*(said_by_workers(f"event=hostile behaviour={way} ended code=", way) for way in WRONG_HELLOS),
               logged("worker_refused")),
          setup=Setup(workers=1, hostile=WRONG_HELLOS),
          after_units=0),
    Fault("garbage on the port", f"{GARBAGE_CONNECTIONS} connections with random bytes", send_garbage,
          all_refused, count_refused),
]
