"""Attacks of those who can reach the port and have nothing else."""

import collections
import contextlib
import functools
import random
import socket
import ssl
import struct
import threading
import time

import raw_http2
from fault import Fault, expect_count
from world import Setup

# All of this machine's loopback network is ours: the attacker has an address of its own.
ATTACKER = "127.0.0.66"
REFUSED = f"event=connection_refused address={ATTACKER} reason="
STREAMS = 10_000
MAX_STREAMS = 256  # limits.h: of an address, without access control
CONNECTIONS = 3000
ALLOWED_CONNECTIONS = 200


def connect(world, seconds=60):
    host, port = world.farm.address.rsplit(":", 1)
    return socket.create_connection((host, int(port)), timeout=seconds, source_address=(ATTACKER, 0))


def is_closed(connection):
    """Waits until the server closes the connection."""
    try:
        while connection.recv(1 << 16):
            pass
    except ConnectionResetError:
        pass
    except TimeoutError:
        return False
    return True


def scan(world):
    """What a port scanner sends: each on a connection of its own, which the coordinator must close."""
    rng = random.Random(1)
    probes = {
        "HTTP/1 GET": b"GET / HTTP/1.1\r\nHost: farm\r\n\r\n",
        "HTTP/1 upgrade": b"GET / HTTP/1.1\r\nHost: farm\r\nConnection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\n\r\n",
        "SSH": b"SSH-2.0-scanner\r\n",
        "RDP": b"\x03\x00\x00\x13\x0e\xe0\x00\x00\x00\x00\x00\x01\x00\x08\x00\x03\x00\x00\x00",
        "SOCKS": b"\x05\x01\x00",
        "zeros": bytes(4096),
        "newlines": b"\r\n" * 100,
    }
    for i in range(50):
        probes[f"random {i}"] = bytes([rng.choice([b for b in range(256) if b not in (0x50, 0x16)])
                                      ]) + rng.randbytes(rng.randrange(2000))
    left_open = []
    for name, probe in probes.items():
        with connect(world) as connection:
            with contextlib.suppress(OSError):  # it may be closed while we send
                connection.sendall(probe)
            if not is_closed(connection):
                left_open.append(name)
    if left_open:
        raise AssertionError(f"not closed: {', '.join(left_open)}")
    return len(probes)


def scans_were_closed(world, probes):
    lines = expect_count(world.count(REFUSED + '"not HTTP/2'), "lines")
    return f"{probes} probes closed, {lines}"


def garbage_after_preface(world):
    """Begins as HTTP/2 and goes on with anything."""
    rng = random.Random(2)
    closed = 0
    for _ in range(100):
        with connect(world) as connection:
            with contextlib.suppress(OSError):
                connection.sendall(raw_http2.PREFACE + rng.randbytes(rng.randrange(1, 5000)))
                connection.shutdown(socket.SHUT_WR)
            closed += is_closed(connection)
    return closed


def garbage_was_closed(_, closed):
    if closed != 100:
        raise AssertionError(f"{closed} of 100 connections were closed")
    return f"{closed} connections closed"


def speak_tls(world):
    """A client of TLS at a port in plain text."""
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    refused = 0
    for _ in range(10):
        with connect(world) as connection:
            try:
                context.wrap_socket(connection)
            except OSError:
                refused += 1
    return refused


def tls_was_refused(world, refused):
    if refused != 10:
        raise AssertionError(f"{refused} of 10 handshakes were refused")
    return expect_count(world.count(REFUSED + '"TLS, but this port is in plain text'), "lines")


def dribble(world):
    """Slow-loris: connections that say nothing, or a byte now and then, and never a whole call."""
    opened = time.monotonic()
    silent = [connect(world) for _ in range(50)]
    slow = [connect(world) for _ in range(50)]
    sender = threading.Thread(target=send_slowly, args=(slow,), daemon=True)
    sender.start()
    return opened, silent, slow


def send_slowly(connections):
    preface = raw_http2.PREFACE
    for byte in preface + raw_http2.frame(raw_http2.SETTINGS, 0, 0):
        for connection in connections:
            with contextlib.suppress(OSError):
                connection.sendall(bytes([byte]))
        time.sleep(1)


def end_dribble(_, state):
    opened, silent, slow = state
    closed = sum(is_closed(connection) for connection in silent), sum(
        is_closed(connection) for connection in slow)
    seconds = time.monotonic() - opened
    for connection in (*silent, *slow):
        connection.close()
    return closed, seconds


def dribblers_were_closed(world, outcome):
    closed, seconds = outcome
    if closed != (50, 50):
        raise AssertionError(f"{closed[0]} of 50 silent and {closed[1]} of 50 slow connections were closed")
    lines = expect_count(world.count(REFUSED + '"silent for'), "lines")
    return f"50 silent and 50 slow connections closed within {seconds:.0f} s, {lines}"


def open_streams(world, polite=True):
    """One connection that opens thousands of calls at once, whatever the server allows."""
    job = next(iter(world.jobs))
    watch = b"\x0a" + bytes([len(job)]) + job.encode()  # WatchJobRequest
    connection = raw_http2.RawConnection(world.farm.address, ATTACKER, polite=polite)
    answers = collections.Counter()
    reader = threading.Thread(target=count_answers, args=(connection, answers), daemon=True)
    reader.start()
    opened = 0
    with contextlib.suppress(OSError):  # the coordinator may close the connection
        for _ in range(STREAMS):
            connection.open_stream("/lumifold.v1.FarmService/WatchJob", watch)
            opened += 1
    return connection, reader, answers, opened


def count_answers(connection, answers):
    for kind, flags, _, _ in connection.frames():
        if kind == raw_http2.RST_STREAM:
            answers["refused"] += 1
        elif kind == raw_http2.GOAWAY:
            answers["goaway"] += 1
        elif kind == raw_http2.HEADERS and not flags & raw_http2.END_STREAM:
            answers["served"] += 1
        elif kind == raw_http2.HEADERS:
            answers["ended"] += 1
    answers["closed"] += 1


def close_streams(_, state):
    connection, reader, answers, opened = state
    deadline = time.monotonic() + 60
    while not answers["closed"] + answers["goaway"] + answers["refused"] + answers[
            "ended"] and time.monotonic() < deadline:
        time.sleep(0.01)  # a busy coordinator has not looked at them yet
    answers = collections.Counter(answers)
    with contextlib.suppress(OSError):
        connection.socket.shutdown(socket.SHUT_RDWR)
    reader.join(30)
    connection.close()
    return answers, opened


def streams_were_bounded(_, outcome):
    answers, opened = outcome
    refused = answers["refused"] + answers["ended"]
    if not refused and not answers["goaway"] and not answers["closed"]:
        raise AssertionError(f"none of {opened} streams was refused: {dict(answers)}")
    if answers["served"] > MAX_STREAMS:
        raise AssertionError(f"{answers['served']} streams were served")
    closed = "the connection was closed" if answers["goaway"] or answers["closed"] else "the connection stayed"
    return f"{opened} streams opened, {answers['served']} served, {refused} refused, {closed}"


def open_connections(world):
    """Thousands of connections that behave, and stay."""
    connections = []
    closed = 0
    for _ in range(CONNECTIONS):
        try:
            connection = connect(world, seconds=3)
            connection.sendall(raw_http2.PREFACE + raw_http2.frame(raw_http2.SETTINGS, 0, 0))
            connections.append(connection)
        except TimeoutError:
            break  # we are shut out
        except OSError:
            closed += 1
    return connections, closed


def close_connections(_, state):
    connections, closed = state
    kept = 0
    for connection in connections:
        connection.settimeout(0.001)
        try:
            more = connection.recv(1 << 16)
            kept += len(more) > 0
        except TimeoutError:
            kept += 1
        except OSError:
            closed += 1
        connection.close()
    return kept


def connections_were_bounded(world, kept):
    if kept > ALLOWED_CONNECTIONS:
        raise AssertionError(
            f"{kept} connections of one address were kept, allowed are {ALLOWED_CONNECTIONS}")
    lines = world.count(REFUSED + '"too many connections') + world.count("event=connections_refused")
    return f"{kept} connections kept, {expect_count(lines, 'lines')}"


def huge_frames(world):
    """Messages that claim to have 4 GiB, and a frame of more than HTTP/2 allows."""
    refused = 0
    for payload in (b"\0\xff\xff\xff\xff", b"\1\0\0\0\x01x", b"\xff" * 100):
        connection = raw_http2.RawConnection(world.farm.address, ATTACKER)
        connection.socket.sendall(
            raw_http2.frame(raw_http2.HEADERS, raw_http2.END_HEADERS, 1,
                            raw_http2.headers_of("/lumifold.v1.FarmService/SubmitJob")) +
            raw_http2.frame(raw_http2.DATA, raw_http2.END_STREAM, 1, payload))
        connection.socket.settimeout(30)
        for kind, flags, _, _ in connection.frames():
            if kind in (raw_http2.RST_STREAM, raw_http2.GOAWAY) or (kind == raw_http2.HEADERS and
                                                                    flags & raw_http2.END_STREAM):
                refused += 1
                break
        connection.close()
    with connect(world) as connection:
        with contextlib.suppress(OSError):
            connection.sendall(raw_http2.PREFACE + b"\xff\xff\xff" +
                               struct.pack(">BBI", raw_http2.DATA, 0, 1) + bytes(1 << 20))
        refused += is_closed(connection)
    return refused


def all_were_refused(_, refused):
    if refused != 4:
        raise AssertionError(f"{refused} of 4 were refused")
    return f"{refused} calls refused"


ATTACKS = [
    Fault("port scanner", "HTTP/1, SSH, RDP, SOCKS and random bytes, each on a new connection", scan,
          scans_were_closed),
    Fault("garbage after the preface", "100 connections begin as HTTP/2 and go on with random bytes",
          garbage_after_preface, garbage_was_closed),
    Fault("TLS to a plain port", "10 clients of TLS", speak_tls, tls_was_refused),
    Fault("slow-loris", "50 connections say nothing, 50 send a byte a second", dribble, dribblers_were_closed,
          end_dribble),
    Fault("10,000 streams", "one connection opens 10,000 watches at once", open_streams, streams_were_bounded,
          close_streams),
    Fault("10,000 streams, rudely", "the same by a client that never acknowledges the server's limits",
          functools.partial(open_streams, polite=False), streams_were_bounded, close_streams),
    Fault("3000 connections",
          f"one address opens 3000 connections; {ALLOWED_CONNECTIONS} are allowed",
          open_connections,
          connections_were_bounded,
          close_connections,
          setup=Setup(server=("--max-connections-per-address", ALLOWED_CONNECTIONS))),
    Fault("huge messages", "messages of 4 GiB, compressed ones, and frames that are too large", huge_frames,
          all_were_refused),
]
