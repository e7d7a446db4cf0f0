"""Connections that break."""

import subprocess
import time

from farm import command_of
from fault import Fault
from world import PATIENCE_SECONDS, Setup

CUT_SECONDS = 2
# The longest pause of 5 s, and time for a busy machine.
LATEST_RETURN_SECONDS = 20
LOSS_PERCENT = 5
ON_HOSTS = Setup(network=True)


def heal(world, hosts):
    """Returns how many packets were stopped."""
    packets = sum(host.lost_packets() for host in hosts)
    for host in hosts:
        host.heal()
    return packets


def lost(world, packets):
    if packets == 0:
        raise AssertionError("no packet was stopped")
    return f"{packets} packets stopped"


def random_host(world):
    return world.rng.choice(world.network.hosts[:len(world.workers)])


def cut_worker(world):
    host = random_host(world)
    host.cut()
    return [host]


def silence_worker(world):
    host = random_host(world)
    host.drop()
    return [host]


def lose_packets(world):
    hosts = world.network.hosts[:len(world.workers)]
    for host in hosts:
        host.lose(LOSS_PERCENT)
    return hosts


def cut_coordinator(world):
    world.network.hub.cut()
    return [world.network.hub]


def cut_client(world):
    """A client that waits for the job is cut off; returns its process and host."""
    host = world.network.hosts[-1]
    job = next(iter(world.jobs))
    client = subprocess.Popen(command_of("lumifold",
                                         ("wait", job, "--server", world.farm.address, *world.farm.consent),
                                         host),
                              stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE,
                              text=True)
    world.wait_until(lambda: connections_of(world, host), "no connection of the client")
    host.cut()
    return host, client


def connections_of(world, host):
    """Established TCP connections of a host; its namespace has no other processes."""
    table = subprocess.run((*host.prefix, "cat", "/proc/net/tcp", "/proc/net/tcp6"),
                           capture_output=True,
                           text=True,
                           check=True)
    return [line for line in table.stdout.splitlines() if line.split()[3] == "01"]


def heal_client(world, state):
    host, client = state
    packets = heal(world, [host])
    world.wait_for("event=job_ended")
    begin = time.monotonic()
    out, err = client.communicate(timeout=PATIENCE_SECONDS)
    return packets, client.returncode, out, err, time.monotonic() - begin


def client_came_back(world, outcome):
    packets, code, out, err, seconds = outcome
    if (code, out) != (0, "done\n"):
        raise AssertionError(f"lumifold wait: exit {code} {out}{err}")
    if seconds > LATEST_RETURN_SECONDS:
        raise AssertionError(f"lumifold wait: came back after {seconds:.1f} s")
    return f"{lost(world, packets)}; `wait` came back {seconds:.1f} s after the end of the job"


FAULTS = [
    Fault("worker cut off",
          f"connections of a worker reset for {CUT_SECONDS} s",
          cut_worker,
          lost,
          heal,
          CUT_SECONDS,
          ON_HOSTS,
          soak=True),
    Fault("coordinator cut off", f"all connections reset for {CUT_SECONDS} s", cut_coordinator, lost, heal,
          CUT_SECONDS, ON_HOSTS),
    Fault("worker half-open",
          "all packets of a worker vanish, until the job is done",
          silence_worker,
          lost,
          heal,
          setup=ON_HOSTS,
          soak=True),
    Fault("packets lost",
          f"{LOSS_PERCENT} % of the packets of all workers vanish, in both directions",
          lose_packets,
          lost,
          heal,
          setup=ON_HOSTS,
          soak=True),
    Fault("client cut off", f"connections of a client that waits are reset for {CUT_SECONDS} s", cut_client,
          client_came_back, heal_client, CUT_SECONDS, ON_HOSTS._replace(more_hosts=1)),
]
