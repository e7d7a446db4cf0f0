"""Options from files and the environment: job files, the configuration and its profiles; and what follows a
job."""

import json
import os
import pathlib
import pty
import subprocess
import unittest

import harness

DOCS = pathlib.Path(__file__).parents[2] / "docs"


class JobFile(harness.CliTest):
    def setUp(self):
        super().setUp()
        (self.folder / "shots").mkdir()
        self.scene = harness.write_scene(self.folder / "shots")

    def write(self, name, text):
        path = self.folder / name
        path.write_text(text)
        return path

    def decisions(self, *arguments):
        return {d["name"]: d["value"] for d in self.succeed_json("plan", *arguments)["decisions"]}

    def test_a_job_file_has_options_and_paths_relative_to_itself(self):
        self.write("shots/job.yaml", "scene: room.gltf\nsize: 16x12\nspp: 4\nforce: [tile-size=16]\n")
        self.assertEqual(self.decisions("--job", "shots/job.yaml")["tile-size"], "16")
        self.assertEqual(
            self.decisions("--job=shots/job.yaml", "--force", "tile-size=8")["tile-size"], "8",
            "the command line counts more")
        self.write(
            "job.json",
            json.dumps({"scene": "shots/room.gltf", "size": "16x12", "output": "a.png", "priority": 3}))
        self.decisions("--job", "job.json")
        self.succeed("render", "--job", "job.json", "--spp", "2")
        self.assertTrue((self.folder / "a.png").exists())

    def test_errors_name_the_line(self):
        for name, text in (("job_unknown", "spp: 4\nszie: 16x12\n"), ("job_value", "spp: 4\nsize: huge\n"),
                           ("job_flag", "adaptive: perhaps\n"), ("job_map", "- spp\n"), ("job_yaml",
                                                                                         "spp: [4\n")):
            with self.subTest(name=name):
                self.write("job.yaml", text)
                self.check_golden(name, "plan", "shots/room.gltf", "--job", "job.yaml")
        self.check_golden("job_missing", "plan", "shots/room.gltf", "--job", "none.yaml")

    def test_the_configuration_is_for_all_commands(self):
        config = self.write(
            "config.yaml",
            "plan: full\npriority: 3\nprofiles:\n  quick:\n    plan: auto\n    force: [tile-size=8]\n")
        self.environment["LUMIFOLD_CONFIG"] = str(config)
        arguments = ("shots/room.gltf", "--size", "16x12")
        self.assertEqual(self.succeed_json("plan", *arguments)["decisions"][0]["by"], "full")
        self.assertEqual(
            self.succeed_json("plan", *arguments, "--plan", "auto")["decisions"][0]["by"], "scene")
        self.environment["LUMIFOLD_PROFILE"] = "quick"
        self.assertEqual(self.decisions(*arguments)["tile-size"], "8")
        config.write_text("szie: 3\n")
        replace = [(str(config), "config.yaml")]
        self.check_golden("config_unknown", "plan", *arguments, replace=replace)
        self.assertIn("config.yaml:1: unknown option szie", self.run_lumifold("doctor")[1])

    def test_the_schema_in_the_docs_is_the_programs(self):
        schema = self.succeed("schema")
        path = DOCS / "schemas/job.json"
        if harness.APPROVE:
            path.write_text(schema)
        self.assertEqual(path.read_text(), schema)
        try:
            import jsonschema
        except ImportError:
            self.skipTest("python3-jsonschema is not installed (deploy/setup.sh --tests)")
        good = {
            "scene": "room.glb", "spp": 64, "frames": "1-48,60", "tag": ["gpu"], "adaptive": True,
            "target-error": 0.5
        }
        jsonschema.validate(good, json.loads(schema))
        for bad in ({"szie": 3}, {"spp": "many"}, {"adaptive": "yes"}, {"job": "other.yaml"}):
            with self.assertRaises(jsonschema.ValidationError):
                jsonschema.validate(bad, json.loads(schema))


class AfterAJob(harness.CliTest):
    def setUp(self):
        super().setUp()
        harness.write_scene(self.folder)

    def render(self, *arguments):
        return self.run_lumifold("render", "room.gltf", "--size", "24x16", "--spp", "2", *arguments)

    def test_a_hook_learns_of_the_picture(self):
        (self.folder / "shots").mkdir()
        code, out, err = self.render("-o", "shots/{name}/{user}x.##.png", "--frames", "3-4", "--name",
                                     "a b/c", "--hook",
                                     'echo "$LUMIFOLD_STATE $LUMIFOLD_OUTPUT" > said; echo to the user')
        self.assertEqual((code, out), (0, ""), err)
        self.assertEqual((self.folder / "said").read_text(), "done shots/a b_c/anonymousx.03.png\n")
        self.assertIn("to the user", err)
        self.assertTrue((self.folder / "shots/a b_c/anonymousx.04.png").exists())
        code, _, err = self.render("-o", "b.png", "--hook", "exit 7")
        self.assertEqual((code, err.splitlines()[-1]), (1, "lumifold: --hook: ended with code 7"))

    def test_a_preview_of_a_local_render(self):
        code, _, err = self.render("-o", "out.exr", "--preview", "seen.jpg")
        self.assertEqual(code, 0, err)
        self.assertEqual(
            sorted(path.name for path in self.folder.iterdir() if path.suffix in (".jpg", ".part")),
            [path.name for path in self.folder.glob("seen.jpg")])

    def test_json_has_a_version(self):
        self.environment.pop("LUMIFOLD_CONFIG")
        self.environment["XDG_CONFIG_HOME"] = str(self.folder)
        code, out, err = self.render("-o", "out.exr", "--json")
        self.assertEqual(code, 0, err)
        self.check_schema("render", json.loads(out))
        for line in self.run_lumifold("doctor", "--json")[1].splitlines():
            self.check_schema("doctor", json.loads(line))
        for arguments in (("convert", "out.exr", "-o", "out.png"), ("compare", "out.exr", "out.exr"),
                          ("filter", "out.exr", "-o", "again.png"), ("plan", "room.gltf")):
            self.succeed_json(*arguments)

    def test_only_a_terminal_is_coloured(self):
        def error(**environment):
            master, slave = pty.openpty()
            subprocess.run([harness.BIN_DIR / "lumifold", "convert", "none.exr", "-o", "a.png"],
                           stderr=slave,
                           cwd=self.folder,
                           env={**self.environment, "TERM": "xterm", **environment},
                           check=False)
            os.close(slave)
            try:
                return os.read(master, 10_000)
            finally:
                os.close(master)

        self.assertIn(b"\x1b[31m", error())
        self.assertNotIn(b"\x1b", error(NO_COLOR="1"))
        self.assertNotIn(b"\x1b", error(TERM="dumb"))
        self.assertNotIn("\x1b", self.run_lumifold("convert", "none.exr", "-o", "a.png")[2])


if __name__ == "__main__":
    unittest.main()
