"""What a program that displays a file would see of it."""

import time

PAUSE_SECONDS = 0.02


def versions_of(path, goes_on):
    """The content of the file after each change, the last one included, while `goes_on()` is true."""
    last = None
    while True:
        may_change = goes_on()
        content = path.read_bytes() if path.exists() else None
        if content is not None and content != last:
            last = content
            yield content
        if not may_change:
            return
        time.sleep(PAUSE_SECONDS)
