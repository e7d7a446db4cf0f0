"""The examples of docs/examples, against a real farm over TLS, with access control."""

import csv
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest

import gltf
import node_tools
from farm import BIN, make_scene, run

sys.path.insert(0, str(pathlib.Path(__file__).parents[1] / "integration"))
from access_test import SecureFarm  # noqa: E402

EXAMPLES = pathlib.Path(__file__).parents[2] / "docs/examples"
# Debian's modules belong to Debian's Python.
PYTHON = "/usr/bin/python3"


def has_modules():
    done = subprocess.run([PYTHON, "-c", "import grpc, google.protobuf, xxhash"], capture_output=True)
    return done.returncode == 0


@unittest.skipUnless(
    has_modules(),
    "python3-grpcio, python3-protobuf or python3-xxhash is not installed (deploy/setup.sh --tests)")
class ExamplesTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.root = pathlib.Path(folder.name)
        cls.farm = cls.enterClassContext(SecureFarm(cls.root / "farm"))
        cls.farm.enroll("node-1", "node-1")
        cls.farm.start_worker("--profile", "node-1")
        cls.scene = make_scene("cornell-box", cls.root)

    def run_example(self, name, *arguments):
        return subprocess.run([PYTHON, EXAMPLES / name, *arguments],
                              env={**os.environ, "PYTHONPATH": str(BIN.parent / "client/python")},
                              text=True,
                              capture_output=True)

    def render(self, *arguments):
        return self.run_example("farm.py", self.scene, *arguments)

    def test_python_renders_and_node_watches(self):
        done = self.render(self.root / "out.exr")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("done", done.stderr)
        job = done.stdout.strip()
        compared = json.loads(
            run("lumifold", "compare", self.root / "out.exr", self.root / "out.exr", "--json").stdout)
        self.assertEqual(compared["mse255"], 0, "it is a picture")
        self.assertEqual(json.loads(self.farm.client("status", job, "--json").stdout)["state"], "done")
        if not node_tools.is_available():
            self.skipTest("npm is not installed (deploy/setup.sh --tests)")
        node_tools.install()
        lines = node_tools.run("watch.mjs", job).splitlines()
        self.assertRegex(lines[-1], rf"^{job} JOB_STATE_DONE \d+/\d+$")

    def test_a_catalogue_of_models_is_rendered_and_continued(self):
        models, pictures = self.root / "models", self.root / "pictures"
        models.mkdir()
        scene, binary = gltf.unpack_glb(self.scene)
        for i in range(6):
            scene["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [i / 5, 0.5, 0.5, 1]
            (models / f"product-{i}.glb").write_bytes(gltf.pack_glb(scene, binary))
        (models / "broken.glb").write_bytes(b"no model")

        def run_it():
            done = self.run_example("catalogue.py", models, pictures, "--size", "32", "--samples", "2")
            with open(pictures / "report.csv", newline="") as file:
                return done, {row["model"]: row for row in csv.DictReader(file)}

        done, report = run_it()
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn("6 pictures, 1 failed", done.stderr)
        self.assertEqual(len({path.read_bytes() for path in pictures.glob("product-?.exr")}), 6)
        self.assertEqual({row["tries"] for name, row in report.items() if name != "broken.glb"}, {"1"})
        self.assertEqual(report["broken.glb"]["tries"], "3")
        self.assertIn("not a glTF file", report["broken.glb"]["error"])
        self.assertEqual(self.farm.client("list", "--json").stdout.count("product-"), 0, "jobs are deleted")
        (pictures / "product-3.exr").unlink()
        (models / "broken.glb").unlink()
        done, report = run_it()
        self.assertEqual((done.returncode, list(report)), (0, ["product-3.glb"]), done.stderr)

    def test_whoever_has_no_token_gets_in_nowhere(self):
        token = self.farm.profiles / "default" / "token"
        stranger = self.farm.profiles / "stranger"
        stranger.mkdir()
        for name in ("profile", "ca.pem"):
            (stranger / name).write_bytes((token.parent / name).read_bytes())
        (stranger / "token").write_text("no-such-token")
        done = self.render(self.root / "none.exr", "stranger")
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("AuthenticationError", done.stderr)
        self.assertFalse((self.root / "none.exr").exists())


if __name__ == "__main__":
    unittest.main()
