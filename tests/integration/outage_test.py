"""Workers come back soon after an outage of the coordinator."""

import tempfile
import time
import unittest

from farm import Farm, wait_until

OUTAGE_SECONDS = 30
# The longest pause of 5 s, gRPC's jitter of 20 % and time for a busy machine. With gRPC's own pauses of up to two minutes
# a worker comes back 13 s after an outage of 30 s.
LATEST_RETURN_SECONDS = 9


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


if __name__ == "__main__":
    unittest.main()
