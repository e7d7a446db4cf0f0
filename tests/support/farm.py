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
PATIENCE_SECONDS = 900


def run(program, *arguments, timeout=PATIENCE_SECONDS, check=True, **options):
    """Runs one of our programs to its end; returns the finished process with text output."""
    command = [str(BIN / program), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=timeout, **options)
    if check and done.returncode != 0:
        raise AssertionError(f"{' '.join(command)}\nexit {done.returncode}\n{done.stdout}{done.stderr}")
    return done


def make_scene(name, folder):
    """Writes one of the generated scenes; returns its path."""
    run("lumifold-scenes", "--out", folder, name)
    return pathlib.Path(folder) / f"{name}.glb"


def wait_until(condition, what, seconds=PATIENCE_SECONDS):
    """Polls until the condition returns a true value, and returns it; fails after `seconds`."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if result := condition():
            return result
        time.sleep(0.02)
    raise AssertionError(f"{what}: not within {seconds} s")


class Process:
    """One of our daemons. Its log is kept for the messages of failing tests."""

    def __init__(self, program, *arguments, stderr=None):
        self.log = tempfile.NamedTemporaryFile("w+", suffix=f"-{program}.log")
        self.popen = subprocess.Popen(
            [str(BIN / program), *map(str, arguments)], stdout=subprocess.PIPE, stderr=stderr or self.log, text=True
        )

    def stop(self):
        """Sends SIGTERM and returns the exit code."""
        if self.popen.poll() is None:
            self.popen.send_signal(signal.SIGTERM)
        try:
            return self.popen.wait(timeout=PATIENCE_SECONDS)
        except subprocess.TimeoutExpired:
            self.kill()
            raise AssertionError(f"did not end within {PATIENCE_SECONDS} s of SIGTERM\n" + self.log_text()) from None
        finally:
            if not self.popen.stdout.closed:
                self.popen.stdout.close()

    def kill(self):
        """Sends SIGKILL."""
        self.popen.kill()
        self.popen.wait()
        self.popen.stdout.close()

    def log_text(self):
        return pathlib.Path(self.log.name).read_text()


class Farm(contextlib.AbstractContextManager):
    """A coordinator with a data folder, and its workers."""

    def __init__(self, data, *server_arguments, stderr=None):
        self.data = data
        self.workers = []
        self.start_server(*server_arguments, stderr=stderr)

    def start_server(self, *arguments, listen="127.0.0.1:0", stderr=None):
        self.server = Process("lumifold-server", "--data", self.data, "--listen", listen, *arguments, stderr=stderr)
        line = self.server.popen.stdout.readline()
        if not line.startswith("listening on "):
            self.server.popen.wait()
            raise AssertionError(f"no server: {line}{self.server.log_text()}")
        self.address = line.removeprefix("listening on ").strip()

    def start_worker(self, *arguments, threads=1, stderr=None):
        worker = Process("lumifold-worker", "--server", self.address, "--threads", threads, *arguments, stderr=stderr)
        self.workers.append(worker)
        return worker

    def client(self, command, *arguments, **options):
        """Runs a subcommand of `lumifold` against this farm."""
        return run("lumifold", command, "--server", self.address, *arguments, **options)

    def status(self, job):
        return json.loads(self.client("status", job, "--json").stdout)

    def __exit__(self, *_):
        for process in [*self.workers, self.server]:
            if process.popen.poll() is None:
                process.stop()
        return False
