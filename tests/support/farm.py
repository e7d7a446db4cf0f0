"""Starts real coordinators and workers for tests, on free ports of this machine, and stops them again."""

import contextlib
import json
import os
import pathlib
import signal
import subprocess
import tempfile
import time

BIN = pathlib.Path(os.environ["LUMIFOLD_BIN"])
# Tests compare files of equal jobs.
os.environ.setdefault("LUMIFOLD_CONFIG", str(pathlib.Path(__file__).with_name("lumifold.yaml")))
PATIENCE_SECONDS = 900


def command_of(program, arguments, host=None):
    """The command line of one of our programs."""
    return [*(host.prefix if host else ()), str(BIN / program), *map(str, arguments)]


def run(program, *arguments, timeout=PATIENCE_SECONDS, check=True, host=None, **options):
    """Runs one of our programs to its end, on `host` (see network.py); returns the finished process with text
    output."""
    command = command_of(program, arguments, host)
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, **options)
    if check and done.returncode != 0:
        raise AssertionError(f"{' '.join(command)}\nexit {done.returncode}\n{done.stdout}{done.stderr}")
    return done


def make_scene(name, folder):
    """Writes one of the generated scenes; returns its path."""
    run("lumifold-scenes", "--out", folder, name)
    return pathlib.Path(folder) / f"{name}.glb"


class TooLate(AssertionError):
    """What wait_until waited for did not come."""


def wait_until(condition, what, seconds=PATIENCE_SECONDS):
    """Polls until the condition returns a true value, and returns it; fails after `seconds`.

    Polling takes at most a third of the time: a condition that starts a program would take a processor from
    the farm.
    """
    deadline = time.monotonic() + seconds
    while (start := time.monotonic()) < deadline:
        if result := condition():
            return result
        time.sleep(min(0.5, max(0.02, 2 * (time.monotonic() - start))))
    raise TooLate(f"{what}: not within {seconds} s")


class Process:
    """One of our daemons. Its log is kept for the messages of failing tests: in a file that goes with it, or
    in `log`, to which it is appended. It runs on `host` (see network.py), or without one on this machine."""

    def __init__(self, program, *arguments, stderr=None, log=None, host=None):
        self.host = host
        self.log = open(log, "a+") if log else tempfile.NamedTemporaryFile(
            "w+", suffix=f"-{pathlib.Path(program).name}.log")
        self.popen = subprocess.Popen(
            command_of(program, arguments, host), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=stderr or self.log, text=True
        )

    def stop(self):
        """Sends SIGTERM and returns the exit code."""
        if self.popen.poll() is None:
            self.popen.send_signal(signal.SIGTERM)
        try:
            return self.popen.wait(timeout=PATIENCE_SECONDS)
        except subprocess.TimeoutExpired:
            self.kill()
            raise AssertionError(f"did not end within {PATIENCE_SECONDS} s of SIGTERM\n" +
                                 self.log_text()) from None
        finally:
            if not self.popen.stdout.closed:
                self.popen.stdout.close()

    def kill(self):
        """Sends SIGKILL."""
        self.popen.kill()
        self.popen.wait()
        self.popen.stdout.close()

    def pause(self):
        """Sends SIGSTOP."""
        self.popen.send_signal(signal.SIGSTOP)

    def resume(self):
        """Sends SIGCONT."""
        self.popen.send_signal(signal.SIGCONT)

    def is_running(self):
        return self.popen.poll() is None

    def cpu_seconds(self):
        """Processor seconds so far: its own, and those of its children that have ended."""
        fields = pathlib.Path(f"/proc/{self.popen.pid}/stat").read_text().rpartition(")")[2].split()
        ticks = os.sysconf("SC_CLK_TCK")
        return sum(map(int, fields[11:13])) / ticks, sum(map(int, fields[13:15])) / ticks

    def children(self):
        """Process ids of its children."""
        pids = []
        for task in pathlib.Path(f"/proc/{self.popen.pid}/task").glob("*/children"):
            with contextlib.suppress(OSError):  # the thread or process has ended
                pids += map(int, task.read_text().split())
        return pids

    def log_text(self):
        return pathlib.Path(self.log.name).read_text()


class Farm(contextlib.AbstractContextManager):
    """A coordinator with a data folder, and its workers. With a folder `logs`, all logs are kept there; with
    a `host` (see network.py) the coordinator and its clients run there."""

    def __init__(self, data, *server_arguments, stderr=None, listen="127.0.0.1:0", logs=None, host=None):
        self.data = data
        self.workers = []
        self.logs = logs and pathlib.Path(logs)
        self.host = host
        self.server_arguments = server_arguments
        self.start_server(*server_arguments, stderr=stderr, listen=listen)

    def log_of(self, name):
        return self.logs and self.logs / f"{name}.log"

    def start_server(self, *arguments, listen="127.0.0.1:0", stderr=None):
        self.launch_server(*arguments, listen=listen, stderr=stderr)
        line = self.server.popen.stdout.readline()
        if not line.startswith("listening on "):
            self.server.popen.wait()
            raise AssertionError(f"no server: {line}{self.server.log_text()}")
        self.address = line.removeprefix("listening on ").strip()
        on_loopback = self.address.startswith("127.")
        # Off loopback these tests use plain text; access_test.py does not.
        self.consent = () if on_loopback else ("--insecure",)

    def launch_server(self, *arguments, listen, stderr=None):
        """Starts the coordinator and does not wait until it listens."""
        self.server = Process("lumifold-server",
                              "--data",
                              self.data,
                              "--listen",
                              listen,
                              *arguments,
                              stderr=stderr,
                              log=self.log_of("server"),
                              host=self.host)

    def restart_server(self):
        """Starts the coordinator again after its end, at the same address and with the same arguments."""
        self.start_server(*self.server_arguments, listen=self.address)

    def start_worker(self, *arguments, threads=1, stderr=None, host=None, program="lumifold-worker"):
        if program == "lumifold-worker":
            arguments = ("--threads", threads, *self.consent, *arguments)
        worker = Process(program, "--server", self.address, *arguments, stderr=stderr,
                         log=self.log_of(f"worker-{len(self.workers)}"), host=host)
        self.workers.append(worker)
        return worker

    def client(self, command, *arguments, **options):
        """Runs a subcommand of `lumifold` against this farm."""
        return run("lumifold", command, "--server", self.address, *self.consent, *arguments,
                   **{"host": self.host, **options})

    def start_client(self, command, *arguments):
        """Starts a subcommand of `lumifold` against this farm; its output is dropped."""
        return subprocess.Popen(
            [str(BIN / "lumifold"), command, "--server", self.address, *self.consent, *map(str, arguments)],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )

    def status(self, job):
        return json.loads(self.client("status", job, "--json").stdout)

    def __exit__(self, *_):
        for process in [*self.workers, self.server]:
            if process.is_running():
                process.resume()  # a stopped process would not see SIGTERM
                process.stop()
        return False
