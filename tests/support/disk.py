"""A small disk for a test, which can be filled, stopped and broken. Needs root."""

import contextlib
import ctypes
import errno
import os
import pathlib
import select
import subprocess
import time


def missing(kind="tmpfs"):
    """Why there can be no such disk here; empty if there can."""
    if os.geteuid() != 0:
        return "not root"
    import tempfile
    with tempfile.TemporaryDirectory() as folder:
        try:
            with SmallDisk(folder, 16, kind):
                return ""
        except (OSError, subprocess.CalledProcessError) as error:
            return f"no {kind} of our own: {getattr(error, 'stderr', error)}".strip()


def execute(*command):
    subprocess.run(list(map(str, command)), check=True, capture_output=True, text=True)


class SmallDisk(contextlib.AbstractContextManager):
    """A file system of `megabytes`, mounted at `path`: kind "tmpfs", or "ext4" in a file of `folder`."""

    FILL_STEP = 1 << 16

    def __init__(self, folder, megabytes, kind="tmpfs"):
        self.folder = pathlib.Path(folder)
        self.path = self.folder / "disk"
        self.path.mkdir()
        self.kind = kind
        self.image = self.folder / "disk.img"
        self.options = f"size={megabytes}m"
        if kind == "ext4":
            with open(self.image, "wb") as image:
                image.truncate(megabytes << 20)
            execute("mkfs.ext4", "-q", self.image)
        self.mount()

    def mount(self):
        if self.kind == "tmpfs":
            execute("mount", "-t", "tmpfs", "-o", self.options, "none", self.path)
        else:
            execute("mount", "-o", "loop", self.image, self.path)

    def unmount(self):
        """Waits for processes that are ending."""
        for _ in range(100):
            done = subprocess.run(("umount", str(self.path)), capture_output=True, text=True, check=False)
            if done.returncode == 0:
                return
            time.sleep(0.05)
        raise AssertionError(done.stderr)

    def fill(self):
        """Leaves no byte free. Call it again to take what has been freed since."""
        with open(self.path / "filler", "ab", buffering=0) as file:
            step = self.FILL_STEP
            while step > 0:
                try:
                    file.write(b"\xff" * step)
                except OSError as error:
                    if error.errno != errno.ENOSPC:
                        raise
                    step //= 2

    def free(self):
        (self.path / "filler").unlink(missing_ok=True)

    def freeze(self):
        """Whoever writes waits until thaw(). ext4 only."""
        execute("fsfreeze", "-f", self.path)

    def thaw(self):
        execute("fsfreeze", "-u", self.path)

    def abort(self):
        """Becomes read-only under the feet of whoever writes, as after an error of the device, until it is
        mounted again. ext4 only."""
        execute("mount", "-o", "remount,abort", self.path)

    def __exit__(self, *_):
        self.unmount()
        return False


def set_immutable(folder, on):
    """Whether files of a folder can be made, renamed and deleted; root may not either."""
    execute("chattr", "+i" if on else "-i", folder)


class ChangeWatcher(contextlib.AbstractContextManager):
    """Waits for writes to the files of a folder (inotify)."""

    IN_MODIFY = 0x2

    def __init__(self, folder):
        libc = ctypes.CDLL(None, use_errno=True)
        self.descriptor = libc.inotify_init1(os.O_CLOEXEC | os.O_NONBLOCK)
        if libc.inotify_add_watch(self.descriptor, os.fsencode(folder), self.IN_MODIFY) < 0:
            raise OSError(ctypes.get_errno(), f"inotify: {folder}")

    def wait(self, seconds):
        """Whether a file was written within `seconds`, or since the last call."""
        ready, _, _ = select.select([self.descriptor], [], [], seconds)
        if ready:
            os.read(self.descriptor, 1 << 16)
        return bool(ready)

    def __exit__(self, *_):
        os.close(self.descriptor)
        return False
