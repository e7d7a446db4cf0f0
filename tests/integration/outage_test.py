"""Workers and clients come back soon after an outage of the coordinator, and lose nothing that was done
before."""

import os
import pathlib
import subprocess
import tempfile
import time
import unittest

from farm import BIN, PATIENCE_SECONDS, Farm, make_scene, wait_until
from slow_proxy import SlowProxy

OUTAGE_SECONDS = 30
# The longest pause of 5 s, gRPC's jitter of 20 % and time for a busy machine; 13 with the pauses of gRPC
# itself.
LATEST_RETURN_SECONDS = 12


class OutageTest(unittest.TestCase):
    def test_workers_come_back_within_seconds(self):
        with tempfile.TemporaryDirectory() as data, Farm(data) as farm:
            workers = [farm.start_worker() for _ in range(3)]

            def joined():
                return all("event=joined" in worker.log_text() for worker in workers)

            wait_until(joined, "the workers join")
            farm.server.kill()
            time.sleep(OUTAGE_SECONDS)
            farm.start_server(listen=farm.address)
            begin = time.monotonic()
            wait_until(lambda: all(worker.log_text().count("event=joined") == 2 for worker in workers),
                       "the workers join again")
            self.assertLess(time.monotonic() - begin, LATEST_RETURN_SECONDS)


class UploadTest(unittest.TestCase):
    ASSET_BYTES = 48 << 20
    UPLOAD_BYTES_PER_SECOND = 12e6

    def test_an_upload_goes_on_with_a_restarted_coordinator(self):
        with tempfile.TemporaryDirectory() as folder, Farm(pathlib.Path(folder) / "data") as farm:
            scene = make_scene("cornell-box", folder)
            content = scene.read_bytes()
            noise = os.urandom(self.ASSET_BYTES)
            length = len(content) + 8 + len(noise)  # a chunk of an unknown kind, which readers skip
            scene.write_bytes(content[:8] + length.to_bytes(4, "little") + content[12:]
                              + len(noise).to_bytes(4, "little") + b"NOIS" + noise)
            proxy = SlowProxy(farm.address, upload_bytes_per_second=self.UPLOAD_BYTES_PER_SECOND)
            self.addCleanup(proxy.close)
            client = subprocess.Popen(
                [BIN / "lumifold", "submit", scene, "--server", proxy.address, "--size", "8x8"],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True)
            wait_until(lambda: proxy.sent_bytes > self.ASSET_BYTES * 0.6, "most of the file is sent")
            farm.server.kill()
            farm.start_server(listen=farm.address)
            out, err = client.communicate(timeout=PATIENCE_SECONDS)
            self.assertEqual(client.returncode, 0, err)
            self.assertRegex(out, r"\A\S+\n\Z")
            self.assertIn("trying again", err)
            # Buffers between client and coordinator are lost with the connection, but not what had arrived.
            self.assertLess(proxy.sent_bytes, 1.4 * self.ASSET_BYTES)


class FullPipeTest(unittest.TestCase):
    def full_pipe(self):
        """The ends of a pipe that takes no more bytes."""
        reader, writer = os.pipe()
        self.addCleanup(os.close, reader)
        self.addCleanup(os.close, writer)
        os.set_blocking(writer, False)
        try:
            while True:
                os.write(writer, b"x" * 4096)
        except BlockingIOError:
            os.set_blocking(writer, True)
        return reader, writer

    def test_a_log_that_nobody_reads_stops_nothing(self):
        reader, writer = self.full_pipe()
        debug = ("--log-level", "debug")
        with tempfile.TemporaryDirectory() as data, Farm(data, *debug, stderr=writer) as farm:
            farm.start_worker(*debug, stderr=writer)
            scene = make_scene("cornell-box", data)
            job = farm.client("submit", scene, "--size", "64x48", "--spp", "8", timeout=300).stdout.strip()
            farm.client("wait", job, timeout=300)
            self.assertEqual(farm.status(job)["state"], "done")
            # With a reader, the log goes on.
            text = b""
            while b"event=frame_finished" not in text:
                text += os.read(reader, 1 << 16)


if __name__ == "__main__":
    unittest.main()
