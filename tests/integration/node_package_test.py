"""The Node package against real farms: by a link of the page, and by a token over TLS."""

import io
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import unittest
import zipfile

from access_test import SecureFarm
from farm import Farm, make_scene

ROOT = pathlib.Path(__file__).parents[2]
PACKAGE = ROOT / "client/node"
SCRIPT = pathlib.Path(__file__).with_name("node_package.mjs")


@unittest.skipUnless(shutil.which("node"), "node is not installed (deploy/setup.sh --tests)")
class NodePackageTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        cls.scene = make_scene("cornell-box", cls.root)

    def run_script(self, farm, *arguments):
        # A worker that has delivered nothing is not believed that a scene cannot be rendered.
        farm.client("wait", farm.client("submit", self.scene, "--size", "48x32", "--spp", 1).stdout.strip())
        folder = pathlib.Path(self.enterContext(tempfile.TemporaryDirectory()))
        address, *rest = arguments
        done = subprocess.run(["node", SCRIPT, address, self.own_scene(), folder, *rest],
                              env={**os.environ, "LUMIFOLD_NODE": str(PACKAGE / "index.js")},
                              text=True,
                              capture_output=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        return json.loads(done.stdout), folder

    def own_scene(self):
        """One that the farm does not have yet."""
        content = bytearray(self.scene.read_bytes())
        path = self.root / "own.glb"
        length = int.from_bytes(content[12:16], "little")
        document = json.loads(content[20:20 + length])
        document["asset"]["generator"] = "a test"
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        rest = content[20 + length:]
        size = 20 + len(text) + len(rest)
        path.write_bytes(content[:8] + size.to_bytes(4, "little") + len(text).to_bytes(4, "little") +
                         content[16:20] + text + rest)
        return path

    def expect_right(self, seen, folder):
        self.assertEqual(seen["early"], [True, "FAILED_PRECONDITION"])
        size = (self.root / "own.glb").stat().st_size
        self.assertEqual(seen["uploads"][-1], [size, size])
        self.assertEqual((seen["status"]["name"], seen["status"]["state"]), ("a box", "done"))
        self.assertEqual(seen["states"][-1], ["done", 1])
        self.assertEqual(seen["failure"][::2], [True, "failed"])
        self.assertIn("no such camera", seen["failure"][1])
        self.assertEqual((seen["cancelled"], seen["gone"]), ("cancelled", "NOT_FOUND"))
        self.assertIn(seen["job"], seen["listed"])
        self.assertIn("not a glTF file", seen["noScene"])
        self.assertEqual({path.name for path in folder.rglob("*") if path.is_file()}, {"second.exr", "all.zip"})
        with zipfile.ZipFile(io.BytesIO((folder / "all.zip").read_bytes())) as frames:
            self.assertEqual(frames.namelist(), ["a_box.0001.exr", "a_box.0002.exr"])
            self.assertEqual(frames.read("a_box.0002.exr"), (folder / "deep/second.exr").read_bytes())

    def test_by_a_link(self):
        farm = self.enterContext(Farm(self.enterContext(tempfile.TemporaryDirectory())))
        farm.start_worker()
        self.expect_right(*self.run_script(farm, farm.client("page").stdout.strip()))

    def test_by_a_token_over_tls(self):
        farm = self.enterContext(SecureFarm(self.enterContext(tempfile.TemporaryDirectory()), "--page-address",
                                            "0.0.0.0:0", "--advertise", "localhost:1"))
        farm.enroll("node-1", "node-1")
        farm.start_worker("--profile", "node-1")
        address = farm.client("page").stdout.strip().partition("/#")[0]
        farm.join("login", farm.invite("ann"), profile="ann")
        self.expect_right(*self.run_script(farm, address, farm.token("ann"), farm.profiles / "ann" / "ca.pem"))


if __name__ == "__main__":
    unittest.main()
