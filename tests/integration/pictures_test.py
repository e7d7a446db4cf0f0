"""Result files as artists use them: regions, pixel filters, Cryptomatte, compressions and parts, read back by
OpenImageIO."""

import json
import os
import pathlib
import re
import shutil
import statistics
import struct
import subprocess
import tempfile
import unittest
import zlib

import exr
from farm import Farm, make_scene, run

SETTINGS = ["--size", "96x64", "--spp", "16", "--seed", "3"]


def info(path):
    """What oiiotool says of a file."""
    if shutil.which("oiiotool") is None:
        raise unittest.SkipTest("oiiotool is not installed (deploy/setup.sh --tests)")
    return subprocess.run(["oiiotool", "--info", "-v", "-a", path],
                          check=True,
                          capture_output=True,
                          text=True).stdout


def png(width, height, depth, byte_at):
    """A PNG of RGB whose codes are a byte, or the same byte twice."""
    rows = b"".join(b"\0" + b"".join(bytes([byte_at(x, y, c)] * (depth // 8)) for x in range(width) for c in range(3))
                    for y in range(height))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, depth, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


class PicturesTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.root = pathlib.Path(folder.name)
        cls.scene = make_scene("cornell-box", cls.root)
        cls.farm = cls.enterClassContext(Farm(cls.root / "data"))
        cls.farm.start_worker(threads=2)
        cls.whole = cls.render("whole.exr")

    @classmethod
    def render(cls, name, *options):
        """Submits a job, waits for it and downloads its picture."""
        path = cls.root / name
        cls.farm.client("submit", cls.scene, *SETTINGS, *options, "--download", path)
        return path

    def test_a_region_is_a_part_of_the_frame(self):
        path = self.render("part.exr", "--region", "30,20,62,44")
        part, whole = exr.read(path), exr.read(self.whole)
        self.assertEqual((part.width, part.height), (32, 24))
        for channel in ("noisy.R", "noisy.B", "N.X", "Z", "id.Y"):
            of_whole = [whole.channels[channel][96 * y + x] for y in range(20, 44) for x in range(30, 62)]
            self.assertEqual(list(part.channels[channel]), of_whole, channel)
        text = info(path)
        self.assertRegex(text, r"96 x +64")
        self.assertIn("pixel data origin: x=30, y=20", text)

    def test_a_region_must_be_within_the_frame(self):
        done = self.farm.client("submit", self.scene, *SETTINGS, "--region", "80,0,97,64", check=False)
        self.assertEqual((done.returncode, "not within the frame of 96x64" in done.stderr), (2, True),
                         done.stderr)

    def test_wider_pixel_filters_blur_and_keep_the_light(self):
        def spread(picture):
            """Mean square of the differences of neighbours: large where edges are sharp."""
            red = picture.channels["albedo.R"]
            return statistics.fmean((red[i] - red[i + 1]) ** 2 for i in range(len(red) - 1) if (i + 1) % 96)

        box = exr.read(self.whole)
        pictures = {
            name: exr.read(self.render(f"{name}.exr", "--pixel-filter", name, "--pixel-filter-width", "3"))
            for name in ("box", "gaussian", "blackman-harris")
        }
        for name, picture in pictures.items():
            self.assertLess(spread(picture), 0.8 * spread(box), name)
            self.assertAlmostEqual(statistics.fmean(picture.channels["albedo.G"]) /
                                   statistics.fmean(box.channels["albedo.G"]),
                                   1,
                                   delta=0.01)
        self.assertEqual(
            exr.read(self.render("one.exr", "--pixel-filter-width", "1")).channels["R"], box.channels["R"])
        self.assertIn("gaussian 2", info(self.render("g.exr", "--pixel-filter", "gaussian")))

    def test_cryptomatte_covers_the_picture(self):
        path = self.render("crypto.exr", "--cryptomatte")
        picture, text = exr.read(path), info(path)
        manifest = json.loads(
            re.search(r'cryptomatte/3ae39a5/manifest: "(.*)"', text).group(1).replace('\\"', '"'))
        self.assertIn("floor", manifest)
        ranks = [(f"CryptoObject{i:02}.{id_}", f"CryptoObject{i:02}.{cover}")
                 for i in range(3)
                 for id_, cover in ("RG", "BA")]
        for i in range(96 * 64):
            covers = [picture.channels[cover][i] for _, cover in ranks]
            self.assertEqual(covers, sorted(covers, reverse=True))
            self.assertAlmostEqual(sum(covers), picture.channels["A"][i], delta=1e-6)
        mixed = [c for c in picture.channels["CryptoObject00.G"] if 0 < c < 1]
        self.assertGreater(len(mixed), 100, "edges are shared")
        self.assertEqual(picture.channels["R"], exr.read(self.whole).channels["R"], "the picture is the same")
        self.assertNotIn("cryptomatte", info(self.whole))

    def test_a_transparent_background_and_the_shadow_on_it(self):
        clear, shadow = (exr.read(self.render(f"{options[1]}.exr", *options))
                         for options in (("--background", "transparent"), ("--ground", "shadow")))
        self.assertEqual(clear.channels["R"], shadow.channels["R"], "the ground changes no colour")
        below = [x >= y - 1e-6 for x, y in zip(shadow.channels["A"], clear.channels["A"])]
        self.assertEqual(set(below), {True})
        path = self.root / "clear.png"
        self.farm.client("submit", self.scene, *SETTINGS, "--background", "transparent", "--download", path)
        self.assertEqual(path.read_bytes()[25], 6, "red, green, blue and alpha")
        self.assertIn("transparent", info(self.root / "transparent.exr"))
        film = self.render("film.exr", "--background", "transparent", "--save-film")
        run("lumifold", "convert", film, "-o", self.root / "converted.png")
        run("lumifold", "filter", film, "-o", self.root / "filtered.png")
        self.assertEqual((self.root / "filtered.png").read_bytes(), (self.root / "converted.png").read_bytes())

    def test_attributes(self):
        self.farm.client("submit",
                         self.scene,
                         *SETTINGS,
                         "--name",
                         "shot 7",
                         "--user",
                         "ann",
                         "--download",
                         self.root / "{user}-{name}.exr",
                         env=self.environment_without_configuration())
        text = info(self.root / "ann-shot 7.exr")
        for pattern in (r'software: "lumifold \d', r'DateTime: "20\d\d:', r'Copyright: "ann"|owner: "ann"',
                        "worldToCamera: ", "worldToNDC: ", r"chromaticities: 0.64", "ExposureTime: 0|expTime",
                        r"renderTime: \d", r"framesPerSecond: 24"):
            self.assertRegex(text, pattern)
        self.assertEqual(
            json.loads(self.farm.client("list", "--user", "ann", "--json").stdout.splitlines()[0])["name"],
            "shot 7")

    def environment_without_configuration(self):
        return {name: value for name, value in os.environ.items() if name != "LUMIFOLD_CONFIG"
               } | {"XDG_CONFIG_HOME": str(self.root)}

    def test_compressions_and_parts(self):
        job = self.farm.client("submit", self.scene, *SETTINGS, "--cryptomatte", "--wait").stdout.strip()
        sizes = {}
        for compression in ("none", "zips", "zip", "piz", "dwaa"):
            path = self.root / f"{compression}.exr"
            self.farm.client("download", job, "-o", path, "--compression", compression)
            sizes[compression] = path.stat().st_size
            error = json.loads(run("lumifold", "compare", path, self.root / "none.exr",
                                   "--json").stdout)["mse255"]
            self.assertEqual(error == 0, compression != "dwaa", compression)
            self.assertLess(error, 0.5)
        self.assertEqual(max(sizes, key=sizes.get), "none", sizes)
        layers = self.root / "layers.exr"
        self.farm.client("download", job, "-o", layers, "--parts", "layers")
        self.assertRegex(info(layers), r"name: \"noisy\"")
        self.assertEqual(
            json.loads(run("lumifold", "compare", layers, self.root / "none.exr", "--json").stdout)["mse255"],
            0)

    def test_pictures_for_a_display(self):
        sizes = {}
        for name, options in (("a.png", []), ("b.jpg", ["--view", "filmic", "--exposure",
                                                        "auto"]), ("c.jpg", ["--quality", "10"])):
            run("lumifold", "convert", self.whole, "-o", self.root / name, *options)
            sizes[name] = (self.root / name).stat().st_size
            self.assertRegex(info(self.root / name), r"96 x +64, 3 channel, uint8")
        self.assertLess(sizes["c.jpg"], sizes["b.jpg"])

    def test_pictures_of_16_bits_a_channel_are_filtered_like_those_of_8(self):
        filtered = []
        for depth in (8, 16):
            path = self.root / f"photo-{depth}.png"
            path.write_bytes(png(40, 30, depth, lambda x, y, c: (7 * x + 5 * y + 60 * c) % 256))
            run("lumifold", "filter", path, "-o", path.with_suffix(".exr"))
            filtered.append(exr.read(path.with_suffix(".exr")).channels)
        for channel in "RGB":
            self.assertEqual(filtered[0][channel], filtered[1][channel], channel)


if __name__ == "__main__":
    unittest.main()
