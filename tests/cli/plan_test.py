"""lumifold plan: what it decides about a scene, and how to say otherwise."""

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
        for line in first.splitlines()[1:-1]:
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

    def test_the_page_explains_every_decision(self):
        page = (ROOT / "docs" / "plan.md").read_text()
        section = page.split("\n## Decisions\n")[1].split("\n## ")[0]
        rows = re.findall(r"^\| `([a-z-]+)`", section, re.MULTILINE)
        self.assertEqual(rows, list(self.decisions()))


if __name__ == "__main__":
    unittest.main()
