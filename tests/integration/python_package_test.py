"""The Python package against real farms, in plain text and over TLS. Runs under Debian's Python, whose modules it needs."""

import base64
import hashlib
import json
import os
import pathlib
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import zipfile

from access_test import SecureFarm
from farm import Farm, make_scene, wait_until

try:
    import lumifold
except ImportError:  # deploy/setup.sh --tests installs what it needs
    lumifold = None

SMALL = {"size": (48, 32), "samples": 2, "max_bounces": 2}
LONG = {"size": (640, 480), "samples": 4096}
MAKE_WHEEL = pathlib.Path(__file__).parents[2] / "client/python/make_wheel.py"


def split_scene(glb, folder):
    """The scene as a .gltf with its buffer in a file of its own, with a name that URIs encode."""
    content = glb.read_bytes()
    length, = struct.unpack("<I", content[12:16])
    document = json.loads(content[20:20 + length])
    folder.mkdir()
    (folder / "the buffer.bin").write_bytes(content[28 + length:])
    document["buffers"][0]["uri"] = "the%20buffer.bin"
    path = folder / "scene.gltf"
    path.write_text(json.dumps(document))
    return path


@unittest.skipIf(lumifold is None, "python3-grpcio, python3-protobuf or python3-xxhash is not installed")
class Case(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        os.environ["XDG_CONFIG_HOME"] = str(cls.root / "config")  # no profile of whoever runs the tests
        cls.scene = make_scene("cornell-box", cls.root)

    def folder(self):
        return pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))


class PlainTest(Case):
    def setUp(self):
        self.server = self.enterContext(Farm(self.folder()))
        self.farm = self.enterContext(lumifold.Farm(self.server.address))

    def test_a_scene_of_two_files_is_rendered_and_saved(self):
        scene = split_scene(self.scene, self.folder() / "scene")
        sent, seen = [], []
        job = self.farm.render(scene, **SMALL, frames=range(1, 3), frames_per_second=24, name="a box", user="ann",
                               uploaded=lambda done, total: sent.append((done, total)))
        self.assertEqual([reason.code for reason in job.explain()], ["no_worker"])
        with self.assertRaises(lumifold.NotReady):
            job.save(self.folder() / "early.exr")
        self.assertIsNone(job.preview())
        with self.assertRaises(lumifold.TimedOut):
            job.wait(timeout=0.2)
        size = scene.stat().st_size + (scene.parent / "the buffer.bin").stat().st_size
        self.assertEqual(sent[-1], (size, size))
        self.server.start_worker("--name", "node")
        status = job.wait(progress=seen.append)
        self.assertTrue(status.is_done)
        self.assertEqual((status.name, status.state, status.progress, status.frames()), ("a box", "done", 1.0, [1, 2]))
        self.assertEqual(seen[-1], status)
        folder = self.folder()
        saved = job.save_all(folder / "deep" / "box.####.exr")
        self.assertEqual([path.name for path in saved], ["box.0001.exr", "box.0002.exr"])
        self.assertEqual(sorted(path.name for path in (folder / "deep").iterdir()), [path.name for path in saved])
        for path in saved:
            self.assertEqual(path.read_bytes()[:4], b"\x76\x2f\x31\x01")
        self.assertEqual(job.save(folder / "first.exr").read_bytes(), saved[0].read_bytes())
        preview = job.preview(frame=2)
        self.assertTrue(preview.is_finished)
        self.assertEqual(set(preview.channels), set("RGB"))
        self.assertEqual(len(preview.channels["R"]), preview.width * preview.height)
        self.assertGreater(max(preview.channels["R"]), 0)
        self.assertIn("noisy", preview.layers)
        self.assertEqual([each.id for each in self.farm.jobs(user="ann", states=["done"])], [job.id])
        self.assertIn("node", self.farm.workers()[0].name)
        self.assertTrue(any("job_submitted" in event.text or job.id in event.text for event in job.log()))
        again = self.farm.render(scene, **SMALL, uploaded=lambda *_: self.fail("the farm has the files"))
        again.wait()
        job.delete()
        with self.assertRaises(lumifold.NotFound):
            self.farm.job(job.id)

    def test_errors_are_exceptions(self):
        self.server.start_worker()
        self.farm.render(self.scene, **SMALL).wait()  # a worker that has delivered nothing is not believed
        with self.assertRaisesRegex(lumifold.JobFailed, "no such camera") as failed:
            self.farm.render(self.scene, **SMALL, camera="no such camera").wait()
        self.assertEqual(failed.exception.status.state, "failed")
        job = self.farm.render(self.scene, **LONG)
        threading.Timer(0.5, job.cancel).start()
        with self.assertRaises(lumifold.JobCancelled):
            job.wait()
        with self.assertRaises(lumifold.NotReady):
            job.pause()
        with self.assertRaisesRegex(lumifold.InvalidRequest, "width"):
            self.farm.render(self.scene, size=(0, 32))
        with self.assertRaisesRegex(lumifold.NotReady, "--webhook-hosts"):
            self.farm.render(self.scene, **SMALL, webhook="https://hooks.example.org/")
        with self.assertRaises(lumifold.InvalidRequest):
            job.save("picture.png")
        for scene, text in (("none.glb", "No such file"), (__file__, "not a glTF")):
            with self.assertRaisesRegex(lumifold.SceneError, text):
                self.farm.render(self.root / scene)
        for uri in ("/etc/passwd", "../secret.bin", "https://example.org/a.bin", ""):
            scene = self.folder() / "scene.gltf"
            scene.write_text(json.dumps({"asset": {"version": "2.0"}, "buffers": [{"uri": uri, "byteLength": 1}]}))
            with self.assertRaisesRegex(lumifold.SceneError, "not the name of a file"):
                self.farm.render(scene)
        with self.assertRaises(lumifold.InvalidRequest):
            lumifold.Farm("farm.example:7700")
        with self.assertRaises(lumifold.Unreachable):
            lumifold.Farm("127.0.0.1:1", patience=0).server_status()

    def test_jobs_are_steered(self):
        job = self.farm.render(self.scene, **SMALL, paused=True, priority=3)
        self.assertEqual(job.status().state, "paused")
        self.assertNotEqual(job.resume().state, "paused")
        self.assertEqual(job.set_priority(7).message.scheduling.priority, 7)
        job.move_to_front()
        after = self.farm.render(self.scene, **SMALL, after=[job])
        self.assertEqual(after.explain()[0].code, "after")
        self.server.start_worker()
        after.wait()
        self.assertEqual(job.add_samples(4).message.samples_per_pixel, 4)
        job.wait()
        job.retry(frames=[0])
        self.assertTrue(job.wait().is_done)

    def test_a_coordinator_that_restarts_is_waited_for(self):
        job = self.farm.render(self.scene, **SMALL)
        seen, done = [], []
        waits = threading.Thread(target=lambda: done.append(job.wait(progress=seen.append)))
        waits.start()
        wait_until(lambda: seen, "its first status")
        self.server.server.kill()
        time.sleep(1)
        self.server.restart_server()
        self.server.start_worker()
        waits.join(timeout=300)
        self.assertTrue(done and done[0].is_done)


class SecureTest(Case):
    def test_profiles_tokens_and_scopes(self):
        server = self.enterContext(SecureFarm(self.folder()))
        with lumifold.Farm(server.address) as farm:  # by the profile of this address
            job = farm.render(self.scene, **SMALL)
            self.assertEqual(farm.job(job.id).id, job.id)
        with lumifold.Farm() as farm:
            farm.server_status()
        token, ca = server.token(), server.profiles / "default" / "ca.pem"
        with lumifold.Farm(server.address, token=token, ca=ca) as farm:
            self.assertEqual(farm.job(job.id).id, job.id)
        with lumifold.Farm(server.address, token="x" + token[1:], ca=ca) as farm:
            with self.assertRaises(lumifold.AuthenticationError):
                farm.job(job.id)
        server.join("login", server.invite("eve", "--scope", "read"), profile="eve")
        with lumifold.Farm(server.address, profile="eve") as farm:
            with self.assertRaises(lumifold.NotAllowed):
                farm.render(self.scene, **SMALL)
            with self.assertRaises(lumifold.NotFound):
                farm.job(job.id)
        server.join("login", server.invite("cora"), "--certificate", profile="cora")
        with lumifold.Farm(server.address, profile="cora") as farm:
            self.assertEqual(list(farm.jobs()), [])
            own = farm.render(self.scene, **SMALL)
            self.assertEqual([each.id for each in farm.jobs(user="cora")], [own.id])
        with self.assertRaises(lumifold.InvalidRequest):
            lumifold.Farm(server.address, profile="nobody")


@unittest.skipIf(lumifold is None, "python3-grpcio, python3-protobuf or python3-xxhash is not installed")
class WheelTest(unittest.TestCase):
    def test_it_is_complete_and_the_same_each_time(self):
        package = pathlib.Path(lumifold.__file__).parent
        with tempfile.TemporaryDirectory() as folder:
            wheels = [pathlib.Path(folder) / name / "lumifold-1.2.3-py3-none-any.whl" for name in "ab"]
            for wheel in wheels:
                wheel.parent.mkdir()
                subprocess.run([sys.executable, MAKE_WHEEL, package, "1.2.3", wheel], check=True)
            self.assertEqual(wheels[0].read_bytes(), wheels[1].read_bytes())
            with zipfile.ZipFile(wheels[0]) as wheel:
                lines = wheel.read("lumifold-1.2.3.dist-info/RECORD").decode().splitlines()
                self.assertEqual({line.split(",")[0] for line in lines}, set(wheel.namelist()))
                for name, digest, size in (line.split(",") for line in lines[:-1]):
                    content = wheel.read(name)
                    expected = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
                    self.assertEqual((digest, int(size)), (f"sha256={expected}", len(content)), name)
                self.assertIn("lumifold/py.typed", wheel.namelist())
            done = subprocess.run([sys.executable, "-c", "import lumifold; print(lumifold.__file__)"],
                                  env={**os.environ, "PYTHONPATH": str(wheels[0])}, text=True, capture_output=True)
            self.assertIn(".whl", done.stdout, done.stderr)


if __name__ == "__main__":
    unittest.main()
