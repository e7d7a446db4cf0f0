"""`lumifold filter` and the coordinator need no more memory for a taller picture, even if its film exceeds
the limit."""

import os
import pathlib
import subprocess
import tempfile
import unittest

from farm import BIN, Farm, make_scene, run

WIDTH = 1472
ROWS = 352
TIMES = (8, 16)  # 4 and 8 Mpx, in blocks of one size
LIMIT_BYTES = 2 * 2**30  # of address space: the taller film alone needs as much, without the filter
FINISH_LIMIT_MIB = 1536  # less than the taller film, 56 floats per pixel: 1772 MiB


class LargePictureTest(unittest.TestCase):
    def peak_bytes(self, picture, output):
        """Filters a picture in a limited address space; returns the maximum memory."""
        command = [
            "sh", "-c", f'ulimit -v {LIMIT_BYTES // 1024} && exec "$@"', "sh",
            str(BIN / "lumifold"), "filter",
            str(picture), "--method", "paper", "--threads", "2", "-o",
            str(output)
        ]
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        with process.stderr as stderr:
            words = stderr.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        self.assertEqual(process.returncode, 0, words)
        return 1024 * usage.ru_maxrss

    def test_memory_does_not_grow_with_the_height(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            scene = make_scene("cornell-box", root)
            run("lumifold", "render", scene, "--size", f"512x{ROWS}", "--spp", 4, "--method", "none",
                "--save-film", "-o", root / "film.exr")
            peaks = []
            for times in TIMES:
                run("repeat-film", root / "film.exr", WIDTH, times * ROWS, root / "tall.exr", timeout=600)
                peaks.append(self.peak_bytes(root / "tall.exr", root / "out.exr"))
                print(f"{WIDTH}x{times * ROWS}: {peaks[-1] / 2**20:.0f} MiB")
            self.assertLess(peaks[1], 1.1 * peaks[0])

    def test_a_coordinator_finishes_a_frame_whose_film_does_not_fit(self):
        height = TIMES[-1] * ROWS
        self.assertGreater(4 * 56 * WIDTH * height, FINISH_LIMIT_MIB * 2**20)
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            scene = make_scene("cornell-box", root)
            with Farm(root / "data", "--filter-memory-mb", FINISH_LIMIT_MIB, "--filter-threads", "2") as farm:
                farm.start_worker(threads=2)
                job = farm.client("submit", scene, "--size", f"{WIDTH}x{height}", "--spp", 1, "--method",
                                  "paper").stdout.strip()
                farm.client("wait", job, timeout=1500)
                self.assertEqual(farm.status(job)["state"], "done")
                farm.client("download", job, "-o", root / "out.exr")
                self.assertGreater((root / "out.exr").stat().st_size, 2**20)


if __name__ == "__main__":
    unittest.main()
