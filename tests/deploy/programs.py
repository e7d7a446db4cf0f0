"""What manifests are compared with: the programs as they are, and the Dockerfile."""

import functools
import pathlib
import platform
import re
import shlex
import subprocess
import sys
import tempfile
import urllib.request

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests/support"))
from farm import BIN, Farm, run, wait_until  # noqa: E402



def suite():
    """The Debian of this machine, whose packages fit the programs that the tests run."""
    return platform.freedesktop_os_release()["VERSION_CODENAME"]


DOCKERFILE = ROOT / "deploy/container/Dockerfile"


@functools.cache
def flags_of(program, *subcommand):
    """The options of a program as `--help` tells them: whether each takes a value."""
    text = run(program, *subcommand, "--help").stdout
    options = text.split("Subcommands:")[0]
    listed = r"^  (?:-\w,)?(--[\w-]+)(?: (\S+))?(?: \(required\))?(?=  |$)"
    return {name: bool(value) for name, value in re.findall(listed, options, re.M)}


def flag_faults(program, words):
    """What is wrong with a command line: unknown options, missing or superfluous values, values out of
    range."""
    return faults_of_command(program, tuple(words))


@functools.cache
def faults_of_command(program, arguments):
    words = [*arguments]
    subcommand = [words.pop(0)] if words and not words[0].startswith("-") else []
    flags = flags_of(program, *subcommand)
    faults = []
    for word in words:
        name, equals, _ = word.partition("=")
        if name not in flags:
            faults.append(f"{program} has no {name}")
        elif flags[name] != bool(equals):
            faults.append(f"{program}: {word}: the option {'needs a' if flags[name] else 'takes no'} value")
    # The parser checks the values too. It gets as far as the last argument, which is no program's.
    done = run(program, *subcommand, *words, "--no-such-option", check=False)
    if not faults and "--no-such-option" not in done.stderr:
        faults.append(f"{program}: {done.stderr.strip()}")
    return faults


def value_of(words, name):
    """The value of `--name=value`; None where it is missing."""
    return next((word.partition("=")[2] for word in words if word.startswith(name + "=")), None)


@functools.cache
def metrics_texts():
    """What a real coordinator shows to Prometheus once a worker with 2 threads is connected, and what the
    worker shows."""
    with tempfile.TemporaryDirectory() as data, Farm(data, "--metrics-address", "0") as farm:
        worker = farm.start_worker("--metrics-address", "0", threads=2)

        def scrape(process):
            address = wait_until(lambda: re.search(r"event=metrics address=(\S+)", process.log_text()),
                                 "the endpoint")[1]
            with urllib.request.urlopen(f"http://{address}/metrics") as answer:
                return answer.read().decode()

        wait_until(lambda: slots_in(scrape(farm.server)), "the worker")
        return scrape(farm.server), scrape(worker)


def slots_in(text):
    return int(re.search(r"^lumifold_worker_slots (\d+)$", text, re.M)[1])


def metrics():
    """The names of the metrics of a real coordinator, and the slots that a thread of a worker adds."""
    text, _ = metrics_texts()
    return frozenset(re.findall(r"^# TYPE (\w+)", text, re.M)), slots_in(text) // 2


@functools.cache
def version():
    return re.search(r"project\(Lumifold VERSION (\S+)", (ROOT / "CMakeLists.txt").read_text())[1]


class Stage:
    """A stage of the Dockerfile."""

    def __init__(self, base, name):
        self.base, self.name, self.instructions = base, name, []

    def of(self, instruction):
        return [rest for word, rest in self.instructions if word == instruction]


def stages():
    """The stages of the Dockerfile, by name."""
    text = re.sub(r"^#.*\n", "", DOCKERFILE.read_text(), flags=re.M).replace("\\\n", " ")
    found = {}
    for line in filter(None, map(str.strip, text.splitlines())):
        word, rest = re.sub(r"\s+", " ", line).split(" ", 1)
        if word == "FROM":
            base, _, name = rest.split(" ")
            stage = found[name] = Stage(base, name)
        elif found:
            stage.instructions.append((word, rest))
    return found


@functools.cache
def images():
    """Program, user and ports of each image that the Dockerfile's head says how to build, by the image's
    name."""
    found = {}
    for target, name, tag in re.findall(r"^#   docker build .* --target (\w+) -t ([\w-]+):(\S+) \.$",
                                        DOCKERFILE.read_text(), re.M):
        stage = stages()[target]
        found[name] = {
            "program": shlex.split(stage.of("ENTRYPOINT")[0].strip("[]"))[0], "user": stage.of("USER")[0],
            "ports": {int(port) for ports in stage.of("EXPOSE") for port in ports.split()}, "tag": tag
        }
    return found


def runtime_packages(program):
    """Debian packages of the libraries that a program is linked with: what its image installs."""
    done = subprocess.run([ROOT / "deploy/container/runtime_packages.sh", BIN / program],
                          text=True,
                          capture_output=True,
                          check=True)
    return done.stdout.split()
