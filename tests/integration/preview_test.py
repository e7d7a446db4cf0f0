"""The picture of a job as it grows: `watch --preview` keeps a file up to date that is always whole."""

import pathlib
import struct
import tempfile
import time
import unittest
import zlib

from farm import Farm, make_scene
from file_watch import versions_of

SIZE = (640, 480)
SETTINGS = ("--size", "x".join(map(str, SIZE)), "--spp", 64)
SMALL = ("--size", "64x48", "--spp", 1)


def size_of_png(content):
    """The size of a complete PNG; fails for one that is damaged or cut off."""
    assert content.startswith(b"\x89PNG\r\n\x1a\n"), "no PNG"
    at, size, pixels, kind = 8, None, b"", b""
    while kind != b"IEND":
        length, kind = struct.unpack(">I4s", content[at:at + 8])
        data = content[at + 8:at + 8 + length]
        checksum, = struct.unpack(">I", content[at + 8 + length:at + 12 + length])
        assert zlib.crc32(kind + data) == checksum, f"the checksum of {kind} is wrong"
        if kind == b"IHDR":
            size = struct.unpack(">II", data[:8])
        if kind == b"IDAT":
            pixels += data
        at += 12 + length
    assert len(zlib.decompress(pixels)) >= size[0] * size[1] * 3, "pixels are missing"
    return size


class PreviewTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = cls.enterClassContext(tempfile.TemporaryDirectory())
        cls.root = pathlib.Path(folder)
        cls.scene = make_scene("cornell-box", cls.root)

    def farm(self, workers=2):
        farm = self.enterContext(Farm(self.enterContext(tempfile.TemporaryDirectory())))
        for _ in range(workers):
            farm.start_worker()
        return farm

    def submit(self, farm, settings):
        return farm.client("submit", self.scene, *settings).stdout.strip()

    def test_a_file_shows_the_picture_as_it_grows(self):
        farm = self.farm()
        start = time.monotonic()
        job = self.submit(farm, SETTINGS)
        path = self.root / "growing.png"
        watch = farm.start_client("watch", job, "--preview", path)
        sizes = []
        for content in versions_of(path, lambda: watch.poll() is None):
            if not sizes:
                print(f"first preview after {time.monotonic() - start:.2f} s")
            sizes.append(size_of_png(content))
        self.assertEqual(watch.wait(), 0)
        self.assertGreater(len(sizes), 2, "it grows")
        self.assertEqual(set(sizes[:-1]), {(320, 240)})  # half of the frame fits into 512 pixels
        final = self.root / "final.png"
        farm.client("download", job, "-o", final)
        self.assertEqual(path.read_bytes(), final.read_bytes())
        self.assertEqual(list(self.root.glob("*.part")), [])

    def test_a_job_that_has_ended_gets_its_result(self):
        farm = self.farm()
        job = self.submit(farm, SMALL)
        farm.client("wait", job)
        path = self.root / "ended.exr"
        farm.client("watch", job, "--preview", path)
        final = self.root / "ended-result.exr"
        farm.client("download", job, "-o", final)
        self.assertEqual(path.read_bytes(), final.read_bytes())

    def test_what_cannot_be_shown_is_said(self):
        farm = self.farm(workers=1)
        job = self.submit(farm, SMALL)
        for name, why in ((self.root / "picture.gif",
                           "--preview: expected a name that ends in .exr, .png or .jpg"),
                          (self.root / "none" / "picture.png", "does not exist")):
            answer = farm.client("watch", job, "--preview", name, check=False)
            self.assertNotEqual(answer.returncode, 0)
            self.assertIn(why, answer.stderr)
        answer = farm.client("watch", job, "--preview", self.root / "other.png", "--frame", 7, check=False)
        self.assertIn("has no frame 7", answer.stderr)


if __name__ == "__main__":
    unittest.main()
