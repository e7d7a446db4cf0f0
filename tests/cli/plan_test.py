"""lumifold plan: what it decides about a scene, and how to say otherwise."""

import json
import re
import unittest

import harness

ROOT = harness.pathlib.Path(__file__).parents[2]


class Plan(harness.CliTest):
    def setUp(self):
        super().setUp()
        self.scene = harness.write_scene(self.folder)

    def decisions(self, *options):
        """The decisions by name."""
        plan = self.succeed_json("plan", self.scene, "--size", "64x48", *options)
        return {decision["name"]: decision for decision in plan["decisions"]}

    def test_reads_the_scene(self):
        plan = self.decisions()
        self.assertEqual((plan["levels"]["value"], plan["levels"]["by"]), ("0", "scene"))
        self.assertEqual(plan["emission"]["value"], "on")
        self.assertEqual(plan["glossy"]["value"], "on")  # glTF's default material
        self.assertEqual(self.files(), ["mesh.bin", "room.gltf"])

    def test_is_the_same_every_time(self):
        first = self.succeed("plan", self.scene)
        self.assertEqual(self.succeed("plan", self.scene), first)
        for line in first.splitlines()[1:-2]:
            self.assertRegex(line, r"^[a-z-]+ +(on|off|\d+) +(scene|probe) +\S")

    def test_full_and_forced(self):
        full = self.decisions("--plan", "full", "--force", "glossy=off", "--force", "levels=2")
        self.assertEqual({name: d["value"] for name, d in full.items() if d["by"] == "forced"},
                         {"glossy": "off", "levels": "2"})
        self.assertEqual({d["by"] for d in full.values()}, {"full", "forced"})
        self.assertEqual(full["bounces"]["value"], "8")

    def test_what_cannot_be_asked_for(self):
        self.check_golden("plan_bad_force", "plan", "room.gltf", "--force", "levels=9")
        self.check_golden("plan_unknown_decision", "plan", "room.gltf", "--force", "speed=9")
        self.check_golden("plan_bad_plan", "plan", "room.gltf", "--plan", "half")
        self.check_golden("plan_no_camera", "plan", "room.gltf", "--camera", "none")
        (self.folder / "mesh.bin").unlink()
        self.check_golden("plan_missing_buffer", "plan", "room.gltf")

    def write_radiance_sky(self):
        """A Radiance picture whose pixels are all (0.5, 0.25, 0.125)."""
        pixel = bytes((128, 64, 32, 128))
        (self.folder / "sky.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" +
                                              8 * pixel)

    def change_scene(self, name, **members):
        scene = json.loads(self.scene.read_text())
        scene.update(members)
        (self.folder / name).write_text(json.dumps(scene))

    def test_a_frame_of_darkness_or_of_sky_alone(self):
        """Planned and adaptive it has the pixels that it has when everything is modelled, and every metric is
        a number."""
        self.write_radiance_sky()
        self.change_scene("dark.gltf", materials=[{}, {}])
        self.change_scene("sky.gltf", nodes=[{"mesh": 0}, {"mesh": 1}, {"camera": 0, "translation": [0, 1, 5],
                                                                         "rotation": [0, 1, 0, 0]}])
        for scene, options, method in (("dark", ("--env", "none"), "default"), ("sky", ("--env", "sky.hdr"), "default"),
                                       ("sky", ("--env", "sky.hdr"), "none")):
            with self.subTest(scene=scene, method=method):
                common = (f"{scene}.gltf", "--size", "64x48", "--method", method, *options)
                self.succeed("render", *common, "--spp", "256", "--adaptive", "--target-error", "0.5", "-o",
                             "auto.exr")
                self.succeed("render", *common, "--spp", "4", "--plan", "full", "-o", "full.exr")
                found = self.succeed_json("compare", "auto.exr", "full.exr", "--metric", "mse255,ssim,flip")
                self.assertLess(found["mse255"], 1e-6)
                self.assertGreater(found["ssim"], 0.999)
                self.assertLess(found["flip"], 1e-3)

    def test_adaptive_sampling_needs_a_filter_that_tells_its_error(self):
        code, _, err = self.run_lumifold("render", str(self.scene), "--adaptive", "--method", "bilateral",
                                         "-o", "no.exr")
        self.assertEqual(code, 2)
        self.assertIn('method "bilateral" does not tell its error', err)

    def test_the_page_explains_every_decision(self):
        page = (ROOT / "docs" / "plan.md").read_text()
        section = page.split("\n## Decisions\n")[1].split("\n## ")[0]
        rows = re.findall(r"^\| `([a-z-]+)`", section, re.MULTILINE)
        self.assertEqual(rows, list(self.decisions()))


if __name__ == "__main__":
    unittest.main()
