"""A worker inside its sandbox renders what one without a sandbox renders, and the kernel says that the
sandbox is up."""

import os
import pathlib
import tempfile
import unittest

from farm import Farm, make_scene, run

SETTINGS = ["--size", "96x72", "--spp", "16", "--seed", "5", "--save-film"]


def status_of(process):
    """What the kernel tells of a process: names and values of /proc/PID/status."""
    lines = pathlib.Path(f"/proc/{process.popen.pid}/status").read_text().splitlines()
    return dict(line.split(":\t", 1) for line in lines if ":\t" in line)


class SandboxTest(unittest.TestCase):
    def render(self, farm, scene, name):
        job = farm.client("submit", scene, *SETTINGS).stdout.strip()
        farm.client("wait", job)
        result = scene.parent / f"{name}.exr"
        farm.client("download", job, "-o", result)
        return result.read_bytes()

    def test_the_same_bits_with_and_without_a_sandbox(self):
        with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as data, Farm(
                data) as farm:
            scene = make_scene("cornell-box", pathlib.Path(folder))
            sandboxed = farm.start_worker(threads=2)
            inside = self.render(farm, scene, "inside")
            status = status_of(sandboxed)
            self.assertIn("event=sandbox up=", sandboxed.log_text())
            self.assertEqual(status["NoNewPrivs"], "1")
            self.assertEqual(status["Seccomp"], "2")
            self.assertEqual(int(status["CapEff"], 16), 0)
            if os.geteuid() == 0:
                self.assertNotIn("0", status["Uid"].split())
                self.assertEqual(status["Groups"].strip(), "")
            self.assertEqual(sandboxed.stop(), 0)

            free = farm.start_worker("--no-sandbox", threads=2)
            outside = self.render(farm, scene, "outside")
            self.assertIn("[warning] event=no_sandbox", free.log_text())
            self.assertEqual(status_of(free)["NoNewPrivs"], "0")
            self.assertEqual(inside, outside)

            one_process = scene.parent / "one-process.exr"
            run("lumifold", "render", scene, *SETTINGS, "-o", one_process)
            self.assertEqual(inside, one_process.read_bytes())

    def test_a_sandboxed_worker_finds_its_coordinator_by_name_and_again_after_a_restart(self):
        with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as data, Farm(
                data) as farm:
            scene = make_scene("cornell-box", pathlib.Path(folder))
            address = farm.address
            farm.address = address.replace("127.0.0.1", "localhost")
            farm.start_worker()
            farm.address = address
            first = self.render(farm, scene, "first")
            farm.server.kill()
            farm.restart_server()
            self.assertEqual(self.render(farm, scene, "again"), first)

    def test_data_are_private(self):
        with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as parent:
            data = pathlib.Path(parent) / "data"
            data.mkdir(mode=0o755)
            with Farm(data) as farm:
                farm.start_worker(threads=2)
                self.render(farm, make_scene("cornell-box", pathlib.Path(folder)), "any")
            paths = [data, *data.rglob("*")]
            self.assertGreater(len(paths), 10)
            for path in paths:
                self.assertEqual(path.stat().st_mode & 0o077, 0, path)

    def test_an_unknown_user_is_an_error(self):
        if os.geteuid() != 0:
            self.skipTest("only root can become another user")
        done = run("lumifold-worker", "--user", "no-such-user", check=False)
        self.assertEqual((done.returncode, done.stderr),
                         (1, "lumifold-worker: sandbox: no user 'no-such-user'\n"))


if __name__ == "__main__":
    unittest.main()
