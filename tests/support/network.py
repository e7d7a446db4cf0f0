"""Hosts of a network of their own on this machine, whose connections a test can break: Linux network
namespaces on a bridge, with faults by nftables. Needs root, `ip` and `nft`."""

import contextlib
import itertools
import json
import os
import shutil
import subprocess

NUMBERS = itertools.count()


def missing():
    """Why there can be no network here; empty if there can."""
    if os.geteuid() != 0:
        return "not root"
    absent = [program for program in ("ip", "nft") if shutil.which(program) is None]
    if absent:
        return f"no {' and no '.join(absent)}"
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(Network(1))
        except subprocess.CalledProcessError as error:
            return f"{' '.join(error.cmd)}: {error.stderr.strip()}"
    return ""


def execute(*command, text=None):
    return subprocess.run(command, input=text, check=True, capture_output=True, text=True).stdout


class Host:
    """A machine of the network. A fault is of all its packets, in both directions, until heal()."""

    def __init__(self, name, address):
        self.name = name
        self.address = address
        self.prefix = ("ip", "netns", "exec", name)

    def fault(self, rule):
        chains = "".join(
            f" chain {hook} {{\n  type filter hook {hook} priority 0\n  {device} != \"lo\" {rule}\n }}\n"
            for hook, device in (("input", "iifname"), ("output", "oifname")))
        self.heal()
        execute(*self.prefix, "nft", "-f", "-", text=f"table inet fault {{\n{chains}}}\n")

    def cut(self):
        """Every connection is reset, and no new one is made."""
        self.fault("meta l4proto tcp counter reject with tcp reset")

    def drop(self):
        """Packets get lost; neither side is told."""
        self.fault("counter drop")

    def drop_of(self, address):
        """Packets from and to one other host get lost."""
        self.fault(f"ip saddr {address} counter drop\n  ip daddr {address} counter drop")

    def lose(self, percent):
        """A random share of the packets gets lost."""
        self.fault(f"numgen random mod 100 < {percent} counter drop")

    def heal(self):
        execute(*self.prefix, "nft", "flush", "ruleset")

    def lost_packets(self):
        """Number of packets that the present fault has stopped."""
        rules = json.loads(execute(*self.prefix, "nft", "-j", "list", "ruleset"))["nftables"]
        return sum(part["counter"]["packets"] for entry in rules if "rule" in entry
                   for part in entry["rule"]["expr"] if "counter" in part)


class Network(contextlib.AbstractContextManager):
    """A hub, where the coordinator runs, and `count` hosts that reach it. Nothing of it is seen outside."""

    def __init__(self, count):
        prefix = f"lf{os.getpid()}-{next(NUMBERS)}"
        self.hub = Host(f"{prefix}-hub", "10.77.0.1")
        self.hosts = [Host(f"{prefix}-{i}", f"10.77.0.{i + 2}") for i in range(count)]
        try:
            self.build()
        except subprocess.CalledProcessError:
            self.__exit__()
            raise

    def build(self):
        hub = self.hub.name
        execute("ip", "netns", "add", hub)
        execute("ip", "-n", hub, "link", "add", "bridge", "type", "bridge")
        execute("ip", "-n", hub, "addr", "add", f"{self.hub.address}/24", "dev", "bridge")
        for device in ("lo", "bridge"):
            execute("ip", "-n", hub, "link", "set", device, "up")
        for i, host in enumerate(self.hosts):
            execute("ip", "netns", "add", host.name)
            execute("ip", "-n", hub, "link", "add", f"host{i}", "type", "veth", "peer", "name", "eth0",
                    "netns", host.name)
            execute("ip", "-n", hub, "link", "set", f"host{i}", "master", "bridge", "up")
            execute("ip", "-n", host.name, "addr", "add", f"{host.address}/24", "dev", "eth0")
            for device in ("lo", "eth0"):
                execute("ip", "-n", host.name, "link", "set", device, "up")

    def __exit__(self, *_):
        for host in (*self.hosts, self.hub):
            subprocess.run(("ip", "netns", "del", host.name), capture_output=True, check=False)
        return False
