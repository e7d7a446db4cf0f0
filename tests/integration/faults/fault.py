"""A fault of the table: what it does to a running farm, when it ends, and how one knows that it happened."""

import dataclasses
import re
import typing

from world import Setup, World


@dataclasses.dataclass(frozen=True)
class Fault:
    """`begin` makes the fault while units are in flight and returns what `end` needs. `end` puts right what
    does not heal by itself, `seconds` later; without seconds when the jobs have ended. It returns what
    `proof` needs, which says in a few words what the fault did, and fails if it did nothing. The picture is
    compared in any case."""

    name: str
    what: str
    begin: typing.Callable[[World], object]
    proof: typing.Callable[[World, object], str]
    end: typing.Callable[[World, object], object] = lambda world, state: state
    seconds: float | None = None
    setup: Setup = Setup()
    # Committed units after which it begins.
    after_units: int = 3
    # In the gate; others are for `--all`.
    gate: bool = True
    # In the soak: it and its end return soon, and it may meet others.
    soak: bool = False


def logged(*names):
    """A proof: the coordinator has logged each of these events."""

    def proof(world, _):
        return ", ".join(expect_count(world.count(f"event={name}(?= |$)"), name) for name in names)

    return proof


def logged_one_of(*names):
    """A proof: the coordinator has logged one of these events."""

    def proof(world, _):
        counts = {name: world.count(f"event={name}(?= |$)") for name in names}
        seen = [name for name in names if counts[name]]
        return expect_count(counts[seen[0]], seen[0]) if seen else expect_count(0, " or ".join(names))

    return proof


def refused(world, _):
    """A proof: the coordinator has refused units."""
    return expect_count(world.count("event=unit_failed .*which is not valid"), "refused")


def said_by_workers(pattern, what):
    """A proof: a worker's log has it."""
    return lambda world, _: expect_count(len(re.findall(pattern, world.worker_logs())), what)


def both(*proofs):
    return lambda world, outcome: ", ".join(proof(world, outcome) for proof in proofs)


def expect_count(count, what):
    if count == 0:
        raise AssertionError(f"nothing shows that the fault happened: no {what}")
    return f"{count} {what}"
