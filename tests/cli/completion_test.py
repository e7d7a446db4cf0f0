"""Completion and manual pages: made from what the commands say of themselves, and taken by the shells and by
man."""

import json
import os
import re
import shutil
import subprocess
import unittest

import harness


class Completion(harness.CliTest):
    def setUp(self):
        super().setUp()
        self.commands = harness.commands_of(self.succeed("--help"))
        (self.folder / "room.glb").touch()
        (self.folder / "a b.glb").touch()

    def complete(self, *words):
        """What bash offers for the last word of a command line."""
        (self.folder / ".script").write_text(self.succeed("completion", "bash"))
        script = 'source .script; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _lumifold; printf "%s\\n" "${COMPREPLY[@]}"'
        done = subprocess.run(["bash", "-euc", script, "bash", "lumifold", *words],
                              cwd=self.folder,
                              env=self.environment | {"PATH": f"{harness.BIN_DIR}:{os.environ['PATH']}"},
                              text=True,
                              capture_output=True)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return set(done.stdout.split("\n")) - {"", ".script"}

    def test_bash_offers_commands_options_and_files(self):
        self.assertEqual(self.complete(""), {*self.commands, "--help", "--version"})
        self.assertEqual(self.complete("re"), {name for name in self.commands if name.startswith("re")})
        self.assertEqual(self.complete("watch", "j-1", "--pre"), {"--preview"})
        self.assertIn("--json", self.complete("watch", "-"))
        self.assertEqual(self.complete("render", ""), {"room.glb", "a b.glb"})
        self.assertEqual(self.complete("render", "room.glb", "-o", "a"), {"a b.glb"})
        self.assertEqual(self.complete("render", "room.glb", "--size", ""), set(), "a size is no file")

    def test_bash_offers_what_options_may_be(self):
        self.assertEqual(self.complete("render", "room.glb", "--view", "a"), {"agx"})
        self.assertLess({"default", "none"}, self.complete("render", "room.glb", "--method", ""))
        self.assertEqual(self.complete("submit", "room.glb", "--pixel-filter", "g"), {"gaussian"})
        self.assertEqual(self.complete("render", "room.glb", "--camera", ""), set(), "it is no scene")
        harness.write_scene(self.folder)
        self.assertEqual(self.complete("render", "room.gltf", "--camera", ""), {"camera0"})
        self.assertEqual(self.complete("watch", ""), {"last"}, "without a farm")

    def test_each_shell_offers_what_is_in_a_scene(self):
        scene = json.loads(harness.write_scene(self.folder).read_text())
        bad = "$(touch bad) `touch bad`"
        scene["cameras"][0]["name"] = bad
        for node in scene["nodes"]:
            node["name"] = bad
        (self.folder / "room.gltf").write_text(json.dumps(scene))
        self.assertEqual(self.complete("render", "room.gltf", "--camera", ""), {bad})
        environment = self.environment | {"PATH": f"{harness.BIN_DIR}:{os.environ['PATH']}"}
        for shell, script in (
            ("zsh", "_describe() { }; compadd() { shift; print -rl -- $@ }; CURRENT=2; words=(lumifold render room.gltf)"
             "; source .script; _lumifold_of_scene cameras"),
            ("fish", "source .script; complete -C 'lumifold render room.gltf --camera '")):
            with self.subTest(shell=shell):
                if shutil.which(shell) is None:
                    self.skipTest(f"{shell} is not installed (deploy/setup.sh --tests)")
                (self.folder / ".script").write_text(self.succeed("completion", shell))
                self.assertIn("_lumifold_of_scene cameras", (self.folder / ".script").read_text())
                quiet = "-f" if shell == "zsh" else "--no-config"
                done = subprocess.run([shell, quiet, "-c", script], cwd=self.folder, env=environment, text=True,
                                      capture_output=True)
                offered = done.stdout.split("\t")[0].strip()  # fish adds the option's help
                self.assertEqual((offered, done.stderr), (bad, ""))
        self.assertFalse((self.folder / "bad").exists(), "names of others are no commands")

    def test_each_shell_reads_its_script(self):
        for shell in ("bash", "zsh", "fish"):
            with self.subTest(shell=shell):
                script = self.succeed("completion", shell)
                for command in self.commands:
                    self.assertIn(command, script)
                if shutil.which(shell) is None:
                    self.skipTest(f"{shell} is not installed (deploy/setup.sh --tests)")
                done = subprocess.run([shell, "-n"], input=script, text=True, capture_output=True)
                self.assertEqual((done.returncode, done.stderr), (0, ""))
                broken = subprocess.run([shell, "-n"],
                                        input=script + "\nif then (",
                                        text=True,
                                        capture_output=True)
                self.assertNotEqual(broken.returncode, 0)

    def test_zsh_and_fish_offer_options(self):
        if shutil.which("fish") is None:
            self.skipTest("fish is not installed (deploy/setup.sh --tests)")
        (self.folder / "completion.fish").write_text(self.succeed("completion", "fish"))
        (self.folder / "sun.exr").touch()

        def offered(line):
            done = subprocess.run(
                ["fish", "--no-config", "-c", f"source completion.fish; complete -C '{line}'"],
                cwd=self.folder,
                env=self.environment | {"PATH": f"{harness.BIN_DIR}:{os.environ['PATH']}"},
                text=True,
                capture_output=True)
            self.assertEqual(done.stderr, "")
            return [entry.split("\t")[0] for entry in done.stdout.splitlines()]

        # fish 4 adds some that have the letters elsewhere
        options = [option for option in offered("lumifold watch --pre") if option.startswith("--pre")]
        self.assertEqual(options, ["--preview"])
        self.assertLessEqual({"studio", "sun.exr"}, set(offered("lumifold render room.glb --env s")),
                             "words and files")

    def test_another_shell_is_refused(self):
        self.check_golden("completion_shell", "completion", "csh")


@unittest.skipIf(shutil.which("groff") is None, "groff is not installed (deploy/setup.sh --tests)")
class ManualPages(harness.CliTest):
    def read(self, page):
        done = subprocess.run(["groff", "-man", "-ww", "-Tascii", "-P-cbou"],
                              input=page,
                              text=True,
                              capture_output=True)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return done.stdout

    def test_each_page_has_each_option(self):
        commands = harness.commands_of(self.succeed("--help"))
        for command in commands:
            with self.subTest(command=command):
                page = " ".join(self.read(self.succeed("man", command)).split())
                for option in re.findall(r"^  [^ ].*?(--[a-z][a-z-]*)",
                                         self.succeed(command, "--help"),
                                         flags=re.MULTILINE):
                    self.assertIn(option, page)
        page = self.read(self.succeed("man"))
        for command in commands:
            self.assertIn(f"lumifold-{command}(1)", page)

    def test_an_unknown_command_is_named(self):
        self.check_golden("man_unknown", "man", "rendr")


if __name__ == "__main__":
    unittest.main()
