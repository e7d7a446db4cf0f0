"""Blender's compositor makes mattes from our Cryptomatte layers."""

import json
import pathlib
import struct
import subprocess
import tempfile
import unittest

import blender
import exr
import farm

HERE = pathlib.Path(__file__).parent
setUpModule = blender.require


class CryptomatteTest(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="lumifold-cryptomatte-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.path = self.folder / "picture.exr"
        scene = farm.make_scene("meeting-room", self.folder)
        farm.run("lumifold", "render", scene, "--size", "96x72", "--spp", "2", "--cryptomatte", "-o",
                 self.path)
        self.picture = exr.read(self.path)
        metadata = exr.metadata_of(self.path)
        self.manifests = {
            text: json.loads(metadata[name.replace("/name", "/manifest")])
            for name, text in metadata.items()
            if name.startswith("cryptomatte/") and name.endswith("/name")
        }

    def expected(self, layer, name):
        """The cover of each pixel by a name, by the specification."""
        number = struct.unpack(">f", bytes.fromhex(self.manifests[layer][name]))[0]
        covers = [0.0] * len(self.picture.channels["R"])
        for group in range(3):
            for of_id, of_cover in ("RG", "BA"):
                ids = self.picture.channels[f"{layer}{group:02}.{of_id}"]
                shares = self.picture.channels[f"{layer}{group:02}.{of_cover}"]
                covers = [
                    cover + (share if found == number else 0)
                    for cover, found, share in zip(covers, ids, shares)
                ]
        return covers

    def matte(self, layer, name):
        result = self.folder / "matte.exr"
        done = subprocess.run(blender.command(HERE / "compositor.py", self.path, layer, name, "96", "72",
                                              result),
                              text=True,
                              capture_output=True,
                              env=blender.ENVIRONMENT)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        return list(exr.read(result).channels["R"])

    def test_mattes_are_those_of_the_specification(self):
        for layer, name in (("CryptoObject", "table"), ("CryptoMaterial", "blue fabric")):
            with self.subTest(layer=layer):
                expected = self.expected(layer, name)
                self.assertGreater(sum(expected), 100)
                self.assertGreater(len([cover for cover in expected if 0 < cover < 1]), 50)
                for mine, blenders in zip(expected, self.matte(layer, name)):
                    self.assertAlmostEqual(mine, blenders, delta=1e-5)


if __name__ == "__main__":
    unittest.main()
