"""Runs the commands of README.md and of the tutorial as they stand there, with a temporary folder, a free
port and fewer samples put in."""

import os
import pathlib
import re
import shlex
import shutil
import subprocess
import time
import unittest

import harness

ROOT = pathlib.Path(__file__).parents[2]


def shell_blocks(page="README.md"):
    """The lines of each ```sh block of a page, comments dropped."""
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / page).read_text(), re.DOTALL)
    return [[shlex.split(line, comments=True) for line in block.splitlines()] for block in blocks]


class ReadmeTest(harness.CliTest):
    def setUp(self):
        super().setUp()
        self.two_commands, self.one_machine, self.farm = shell_blocks()
        self.address = harness.free_address()
        subprocess.run([harness.BIN_DIR / "lumifold-scenes", "--out", self.folder, "cornell-box"],
                       check=True,
                       capture_output=True)
        (self.folder / "cornell-box.glb").rename(self.folder / "scene.glb")

    def adapted(self, words):
        """The command with what belongs to this test: programs of this build, its folder and port, small
        pictures."""
        replacements = {
            "/srv/lumifold": str(self.folder / "data"), "127.0.0.1:7700": self.address, "64": "2", "256": "2",
            "1024x768": "256x192", "1920x1080": "240x135"
        }
        program, *arguments = words
        return [harness.BIN_DIR / program, *(replacements.get(word, word) for word in arguments)]

    def run_words(self, words):
        return subprocess.run(self.adapted(words),
                              cwd=self.folder,
                              text=True,
                              capture_output=True,
                              timeout=harness.TIMEOUT_SECONDS,
                              check=True)

    def start_words(self, words):
        process = subprocess.Popen(self.adapted(words),
                                   cwd=self.folder,
                                   text=True,
                                   stdout=subprocess.PIPE,
                                   stderr=subprocess.DEVNULL)

        def stop():
            process.terminate()
            process.wait(timeout=harness.TIMEOUT_SECONDS)
            process.stdout.close()

        self.addCleanup(stop)
        return process

    def test_both_first_commands_exist(self):
        self.assertEqual(self.two_commands, [["./deploy/quickstart.sh"], ["./tests/run.sh"]])
        for (path,) in self.two_commands:
            self.assertTrue((ROOT / path).stat().st_mode & 0o100, path)

    def test_one_machine(self):
        for words in self.one_machine:
            self.run_words(words)
        for name in ("picture.exr", "picture.png", "unfiltered.png"):
            self.assertGreater((self.folder / name).stat().st_size, 1000, name)

    def test_farm(self):
        server, worker, submit = self.farm
        self.assertIn("listening on", self.start_words(server).stdout.readline())
        self.start_words(worker)
        job = self.run_words(submit).stdout.strip()
        self.run_words(["lumifold", "wait", job, "--server", self.address])
        self.run_words(["lumifold", "download", job, "-o", "farm.exr", "--server", self.address])
        self.assertGreater((self.folder / "farm.exr").stat().st_size, 1000)


class TutorialTest(harness.CliTest):
    """The commands of docs/tutorial.md, in their order, as a shell runs them."""

    def setUp(self):
        super().setUp()
        self.address = harness.free_address()
        scripts = self.folder / "scripts/addons"
        scripts.mkdir(parents=True)
        (scripts / "lumifold").symlink_to(ROOT / "deploy/blender/lumifold")  # what the user installs by hand
        # Blender's Python takes its library from beside the first python3 on the path, which must be the
        # system's.
        self.environment |= {
            "PATH": f"{harness.BIN_DIR}:{os.defpath}", "BLENDER_USER_SCRIPTS": str(self.folder / "scripts"),
            "XDG_CONFIG_HOME": str(self.folder / "config")
        }
        for name in ("deploy", "docs"):
            (self.folder / name).symlink_to(ROOT / name)

    def adapted(self, line):
        return (line.replace("127.0.0.1:7700", self.address).replace("--spp 64", "--spp 2").replace(
            "spp: 64",
            "spp: 2").replace("640x480",
                              "64x48").replace("--threads 8",
                                               "--threads 2").replace("package.sh", "package.sh ."))

    def run_block(self, lines):
        script = "set -e\n" + "\n".join(map(self.adapted, lines))
        done = subprocess.run(["bash", "-c", script],
                              cwd=self.folder,
                              env=self.environment,
                              text=True,
                              capture_output=True,
                              timeout=harness.TIMEOUT_SECONDS)
        self.assertEqual(done.returncode, 0, f"{script}\n{done.stdout}{done.stderr}")
        return done.stdout

    def start_line(self, line):
        process = subprocess.Popen(shlex.split(self.adapted(line)),
                                   cwd=self.folder,
                                   env=self.environment,
                                   text=True,
                                   stdout=subprocess.PIPE,
                                   stderr=subprocess.DEVNULL)

        def stop():
            process.terminate()
            process.wait(timeout=harness.TIMEOUT_SECONDS)
            process.stdout.close()

        self.addCleanup(stop)
        return process

    def test_each_command(self):
        blocks = re.findall(r"```sh\n(.*?)```", (ROOT / "docs/tutorial.md").read_text(), re.DOTALL)
        build, scene, blender, alone, daemons, farm, job_file = [
            block.strip().splitlines() for block in blocks
        ]
        self.assertEqual(build[0], "./deploy/quickstart.sh")  # QuickstartTest runs it
        self.run_block(build[2:])
        if shutil.which("blender") is None:
            print("SKIPPED: there is no blender on this machine (deploy/setup.sh --tests)")
            subprocess.run([harness.BIN_DIR / "lumifold-scenes", "--out", self.folder, "cornell-box"],
                           check=True,
                           capture_output=True)
            (self.folder / "cornell-box.glb").rename(self.folder / "room.glb")
        else:
            self.run_block(scene)
            self.run_block([
                blender[0].replace(
                    "-f 1",
                    "--python-expr \"import bpy; bpy.context.scene.render.resolution_percentage = 10; "
                    "bpy.context.scene.lumifold.samples = 2\" -f 1")
            ])
            self.assertGreater((self.folder / "from-blender-0001.png").stat().st_size, 500)
        self.run_block(alone)
        self.assertGreater((self.folder / "room.jpg").stat().st_size, 500)
        server, worker = daemons
        self.assertIn("listening on", self.start_line(server).stdout.readline())
        self.start_line(worker)
        self.environment["LUMIFOLD_SERVER"] = self.address
        while "w-1" not in self.succeed("workers"):
            time.sleep(0.1)
        out = self.run_block(farm)
        self.assertIn("first room", out)
        self.assertIn("http://", out)
        self.run_block(job_file)
        for name in ("farm.exr", "shot.png"):
            self.assertGreater((self.folder / name).stat().st_size, 500, name)


class QuickstartTest(unittest.TestCase):
    def test_says_where_the_pictures_are_and_what_the_filter_gained(self):
        done = subprocess.run([ROOT / "deploy/quickstart.sh"],
                              text=True,
                              capture_output=True,
                              timeout=1800,
                              check=True)
        found = dict(
            re.findall(r"^  (filtered picture|as it was traced|all layers) +(\S+)$", done.stdout,
                       re.MULTILINE))
        self.assertEqual(len(found), 3, done.stdout)
        for path in found.values():
            self.assertGreater(pathlib.Path(path).stat().st_size, 10_000, path)
        before, after = map(float,
                            re.search(r"\(MSE255\) +(\S+) as traced, (\S+) filtered", done.stdout).groups())
        self.assertLess(after, before)


if __name__ == "__main__":
    unittest.main()
