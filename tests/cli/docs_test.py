"""Runs the commands of README.md as they stand there, with a temporary folder, a free port and fewer samples put in."""

import pathlib
import re
import shlex
import subprocess
import unittest

import harness

ROOT = pathlib.Path(__file__).parents[2]


def shell_blocks():
    """The lines of each ```sh block of README.md, comments dropped."""
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    return [[shlex.split(line, comments=True) for line in block.splitlines()] for block in blocks]


class ReadmeTest(harness.CliTest):
    def setUp(self):
        super().setUp()
        self.two_commands, self.one_machine, self.farm = shell_blocks()
        self.address = harness.free_address()
        subprocess.run([harness.BIN_DIR / "lumifold-scenes", "--out", self.folder, "cornell-box"], check=True, capture_output=True)
        (self.folder / "cornell-box.glb").rename(self.folder / "scene.glb")

    def adapted(self, words):
        """The command with what belongs to this test: programs of this build, its folder and port, small pictures."""
        replacements = {"/srv/lumifold": str(self.folder / "data"), "127.0.0.1:7700": self.address, "64": "2", "256": "2",
                        "1024x768": "256x192", "1920x1080": "240x135"}
        program, *arguments = words
        return [harness.BIN_DIR / program, *(replacements.get(word, word) for word in arguments)]

    def run_words(self, words):
        return subprocess.run(
            self.adapted(words), cwd=self.folder, text=True, capture_output=True, timeout=harness.TIMEOUT_SECONDS, check=True
        )

    def start_words(self, words):
        process = subprocess.Popen(self.adapted(words), cwd=self.folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)

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


class QuickstartTest(unittest.TestCase):
    def test_says_where_the_pictures_are_and_what_the_filter_gained(self):
        done = subprocess.run([ROOT / "deploy/quickstart.sh"], text=True, capture_output=True, timeout=1800, check=True)
        found = dict(re.findall(r"^  (filtered picture|as it was traced|all layers) +(\S+)$", done.stdout, re.MULTILINE))
        self.assertEqual(len(found), 3, done.stdout)
        for path in found.values():
            self.assertGreater(pathlib.Path(path).stat().st_size, 10_000, path)
        before, after = map(float, re.search(r"\(MSE255\) +(\S+) as traced, (\S+) filtered", done.stdout).groups())
        self.assertLess(after, before)


if __name__ == "__main__":
    unittest.main()
