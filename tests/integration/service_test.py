"""Programs tell a service manager that they are ready, alive and stopping: systemd's protocol, by a socket of
the test."""

import os
import pathlib
import signal
import socket
import tempfile
import unittest

from farm import Farm, wait_until

LIMIT_SECONDS = 2


class ServiceTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = pathlib.Path(folder.name)
        self.manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.addCleanup(self.manager.close)
        self.manager.bind("\0lumifold-test-" + str(os.getpid()))  # in no folder, as systemd's may be
        self.manager.settimeout(900)
        os.environ["NOTIFY_SOCKET"] = "@lumifold-test-" + str(os.getpid())
        os.environ["WATCHDOG_USEC"] = str(LIMIT_SECONDS * 1_000_000)
        for name in ("NOTIFY_SOCKET", "WATCHDOG_USEC"):
            self.addCleanup(os.environ.pop, name, None)

    def next(self, word):
        """The next message with the word; others are passed over."""
        while word not in (text := self.manager.recv(4096).decode()):
            pass
        return text

    def expect_silence(self):
        """No sign of life: what is on its way is taken first."""
        self.manager.settimeout(LIMIT_SECONDS)
        with self.assertRaises(TimeoutError):
            while True:
                self.manager.recv(4096)
        self.manager.settimeout(900)

    def test_a_coordinator(self):
        with Farm(self.root / "data") as farm:
            self.assertIn(f"STATUS=listening on {farm.address}", self.next("READY=1"))
            farm.client("list")  # it really serves
            for _ in range(3):
                self.next("WATCHDOG=1")
            farm.server.pause()
            self.expect_silence()
            farm.server.resume()
            self.next("WATCHDOG=1")
            farm.server.popen.send_signal(signal.SIGTERM)
            self.next("STOPPING=1")

    def test_a_worker_with_and_without_a_coordinator(self):
        with Farm(self.root / "data") as farm:
            self.next("READY=1")
            worker = farm.start_worker()
            self.next("STATUS=worker of")
            wait_until(lambda: "w-1" in farm.client("workers").stdout, "the worker")
            farm.server.kill()
            for _ in range(3):
                self.next("WATCHDOG=1")
            worker.pause()
            self.expect_silence()
            worker.resume()
            self.next("WATCHDOG=1")
            worker.popen.send_signal(signal.SIGTERM)
            self.next("STOPPING=1")
            worker.popen.wait(timeout=900)


if __name__ == "__main__":
    unittest.main()
