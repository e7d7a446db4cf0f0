"""Builds the Debian packages of the programs that the tests run, and of the Python package, and reads them."""

import pathlib
import re
import subprocess

import programs

PROGRAMS = ("lumifold", "lumifold-server", "lumifold-worker", "lumifold-autoscale")
SERVICES = PROGRAMS[1:]
PYTHON = "python3-lumifold"
PACKAGES = (*PROGRAMS, PYTHON)
BUILD = programs.BIN.parent


def build(folder, version=None):
    """The packages' files, by name. With another `version` they are newer or older packages of the same
    programs."""
    options = ["-D", "CPACK_DEBIAN_COMPRESSION_TYPE=gzip"]  # as its default, xz, in less time
    if version:
        options += ["-D", f"CPACK_PACKAGE_VERSION={version}"]
    done = subprocess.run(["cpack", "--config", BUILD / "CPackConfig.cmake", "-B", folder, *options],
                          text=True,
                          capture_output=True)
    if done.returncode != 0:
        raise ValueError(done.stdout + done.stderr)
    files = {file.name.split("_")[0]: file for file in pathlib.Path(folder).glob("*.deb")}
    if set(files) != set(PACKAGES):
        raise ValueError(f"packages made: {sorted(files)}")
    return files


def field(file, name):
    return subprocess.run(["dpkg-deb", "-f", file, name], text=True, capture_output=True,
                          check=True).stdout.strip()


def contents(file):
    """Path of each file in a package, and its rights as ls shows them."""
    lines = subprocess.run(["dpkg-deb", "-c", file], text=True, capture_output=True,
                           check=True).stdout.splitlines()
    split = (re.match(r"(\S+) (\S+) +\d+ \S+ \S+ \.(/.*)$", line).groups() for line in lines)
    return {path: (rights, owner) for rights, owner, path in split if not path.endswith("/")}


def unit_options(unit, name):
    """The values of a setting of a unit."""
    return re.findall(rf"^{name}=(.*)$", unit.read_text(), re.M)
