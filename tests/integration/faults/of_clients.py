"""Clients that ask too much or read too slowly (tests/support/hostile_client.cc)."""

import contextlib
import json
import subprocess

from farm import command_of
from fault import Fault
from slow_proxy import SlowProxy
from world import Setup

SUBMISSIONS = 1000
UPLOADS = 20
UPLOADS_OF_ONE = 16  # limits.h: of one caller
READERS = 10
SLOW_BYTES_PER_SECOND = 1000
# What slow readers may cost the coordinator: chunks of 1 MiB and the buffers of gRPC for each.
READER_BYTES = 8 << 20


def start_client(world, *arguments):
    return subprocess.Popen(command_of("hostile-client", ("--server", world.farm.address, *arguments),
                                       world.farm.host),
                            stdin=subprocess.PIPE,
                            stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE,
                            text=True)


def end_client(client):
    out, err = client.communicate("\n", timeout=120)
    if client.returncode != 0:
        raise AssertionError(f"hostile-client: exit {client.returncode} {err}")
    return out


def submit_many(world):
    """All at once; returns the process, the jobs' ids, and those that `list` shows."""
    client = start_client(world, "--count", SUBMISSIONS, "submit", "--scene",
                          world.references.scene("cornell-box"))
    jobs = [client.stdout.readline().strip() for _ in range(SUBMISSIONS)]
    listed = world.farm.client("list", "--limit", SUBMISSIONS, "--json").stdout
    return client, jobs, {json.loads(line)["job_id"] for line in listed.splitlines()}


def cancel_many(world, state):
    client, jobs, listed = state
    end_client(client)
    return jobs, listed


def all_are_listed(world, outcome):
    jobs, listed = outcome
    if len(set(jobs)) != SUBMISSIONS or "" in jobs:
        raise AssertionError(f"{len(set(jobs))} distinct ids for {SUBMISSIONS} submissions")
    if missing := set(jobs) - listed:
        raise AssertionError(f"{len(missing)} of {SUBMISSIONS} jobs are not listed")
    return f"{SUBMISSIONS} distinct ids, all listed, all cancelled"


def open_uploads(world):
    client = start_client(world, "--count", UPLOADS, "upload")
    said = client.stdout.readline()
    if said != f"{UPLOADS} uploads are open\n":
        raise AssertionError(f"hostile-client: {said}{client.communicate()[1]}")
    return client


def close_uploads(world, client):
    """Returns how many were there until then."""
    count = len(list((world.data / "incoming").iterdir()))
    end_client(client)
    return count


def uploads_were_open(world, count):
    if count != UPLOADS_OF_ONE:
        raise AssertionError(
            f"{count} of {UPLOADS} uploads are there, not the {UPLOADS_OF_ONE} that one caller may have")
    return f"{count} uploads half done until the end of the job"


def read_slowly(world):
    """Clients that read a download, and others that watch the running job, behind slow links."""
    done = world.submit(world.setup.picture._replace(seed=1))
    world.expect_picture(done)
    running = world.submit(world.setup.picture._replace(seed=2, samples=4 * world.setup.picture.samples))
    world.expect_picture(next(iter(world.jobs)))  # nothing but the last job runs
    before = world.resident_bytes()
    readers = []
    for i in range(READERS):
        proxy = SlowProxy(world.farm.address, download_bytes_per_second=SLOW_BYTES_PER_SECOND)
        command = ("download", done, "--frame", 1, "-o",
                   world.root / f"slow-{i}.exr") if i % 2 else ("watch", running, "--json")
        client = subprocess.Popen(command_of("lumifold", (*command, "--server", proxy.address)),
                                  stdout=subprocess.DEVNULL,
                                  stderr=subprocess.DEVNULL)
        readers.append((proxy, client))
    world.wait_until(lambda: all(proxy.received_bytes for proxy, _ in readers), "the readers get nothing")
    return readers, before


def end_readers(world, state):
    readers, before = state
    grown_bytes = world.resident_bytes() - before
    for proxy, client in readers:
        with contextlib.suppress(ProcessLookupError):
            client.kill()
        client.wait()
        proxy.close()
    return sum(proxy.received_bytes for proxy, _ in readers), grown_bytes


def readers_cost_little(world, outcome):
    received, grown_bytes = outcome
    if grown_bytes > READERS * READER_BYTES:
        raise AssertionError(f"the coordinator grew by {grown_bytes} bytes for {READERS} slow readers")
    return f"{received} bytes read by {READERS} readers, memory +{grown_bytes / 2**20:.0f} MiB"


FAULTS = [
    Fault(
        "1000 submissions",
        f"{SUBMISSIONS} jobs submitted at once, and cancelled at once",
        submit_many,
        all_are_listed,
        # More calls than one person may make: it is about the jobs.
        cancel_many,
        setup=Setup(server=("--max-requests-per-second", SUBMISSIONS))),
    Fault("half-open uploads", f"{UPLOADS} uploads that stop in the middle", open_uploads, uploads_were_open,
          close_uploads),
    Fault("slow readers", f"{READERS} clients read a download or a watch at {SLOW_BYTES_PER_SECOND} bytes/s",
          read_slowly, readers_cost_little, end_readers),
]
