"""The Dockerfile and the Compose file fit the programs, the packages that these need, and each other; broken
ones do not."""

import copy
import re
import unittest

import compose_rules
import node_tools
import programs

ROOT = programs.ROOT
COMPOSE = ROOT / "deploy/compose.yaml"


class DockerfileTest(unittest.TestCase):
    def setUp(self):
        self.stages = programs.stages()

    def test_each_image_installs_what_its_program_is_linked_with(self):
        # That the list of the script is right is a test of the packages.
        for name, image in programs.images().items():
            program = image["program"]
            stage = next(s for s in self.stages.values() if s.of("ENTRYPOINT") == [f'["{program}"]'])
            self.assertIn(f"--from=build /src/build/release/{program}.packages /usr/local/share/",
                          stage.of("COPY"), name)
            self.assertIn(f"install -y --no-install-recommends </usr/local/share/{program}.packages ",
                          stage.of("RUN")[0], name)
            self.assertIn(
                f" {program} ",
                re.search(r"for program in .*? ?;", self.stages["build"].of("RUN")[2])[0].replace(";", " "))

    def test_images_are_of_the_three_programs(self):
        self.assertEqual({image["program"] for image in programs.images().values()},
                         {"lumifold-server", "lumifold-worker", "lumifold"})

    def test_what_is_copied_exists(self):
        targets = dict(re.findall(r"lumifold_program\((\w+) (\S+)\s+SOURCES main\.cc",
                                  "".join((ROOT / folder / "CMakeLists.txt").read_text()
                                          for folder in ("server", "worker", "client"))))
        built = re.search(r"--target ([\w ]+?) &&", self.stages["build"].of("RUN")[1])[1].split()
        self.assertEqual(sorted(built), sorted(targets))
        copied = []
        for stage in self.stages.values():
            for words in map(str.split, stage.of("COPY")):
                if words[0].startswith("--from="):
                    self.assertEqual(words[0], "--from=build")
                    if not words[1].endswith(".packages"):
                        copied.append(words[1].removeprefix("/src/build/release/bin/"))
                else:
                    self.assertTrue((ROOT / words[0]).exists(), words)
        self.assertEqual(sorted(copied), sorted(targets.values()))

    def test_nothing_runs_as_root_or_from_another_base(self):
        for stage in self.stages.values():
            self.assertIn(stage.base, {"${DEBIAN}", *self.stages})
            if stage.of("ENTRYPOINT"):
                self.assertEqual(stage.of("USER"), ["10001:10001"])
        user = self.stages["runtime"].of("RUN")[0]
        self.assertIn("--uid 10001 ", user)
        default = re.search(r"^ARG DEBIAN=\S+:(\d+)-slim$", programs.DOCKERFILE.read_text(), re.M)[1]
        self.assertIn(
            default,
            re.search(r"Debian (\d+(?: or \d+)*)", (ROOT / "deploy/setup.sh").read_text())[1].split(" or "))


BROKEN = [
    ("an unknown option", lambda s: s["worker"]["command"].append("--no-such"), "has no --no-such"),
    ("another port", lambda s: s["coordinator"].update(ports=["7700:7701"]), "is not published"),
    ("a health check of another port",
     lambda s: s["coordinator"]["healthcheck"]["test"].__setitem__(4, "--server=localhost:1"),
     "asks another coordinator"),
    ("data that are lost with the container", lambda s: s["coordinator"].update(volumes=[]),
     "is on no volume"),
    ("root", lambda s: s["worker"].pop("user"), "runs as None"),
    ("a writable root", lambda s: s["worker"].pop("read_only"), "read_only is None"),
    ("capabilities", lambda s: s["worker"].update(cap_drop=[]), "cap_drop is []"),
    ("no limit of memory", lambda s: s["worker"].pop("mem_limit"), "has no mem_limit"),
    ("the other program's image", lambda s: s["worker"]["build"].update(target="server"),
     "is not what the target server builds"),
    ("another version", lambda s: s["worker"].update(image="lumifold-worker:0.0.9"),
     "is not what the target worker builds"),
    ("too short a time to drain", lambda s: s["worker"].update(stop_grace_period="10s"), "is killed before"),
    ("a volume that there is not", lambda s: s["worker"]["volumes"].append("x:/x"), "no volume x:/x"),
]


@unittest.skipUnless(node_tools.is_available(), "npm is not installed (deploy/setup.sh --tests)")
class ComposeTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        node_tools.install()
        cls.compose, cls.schema_faults = node_tools.read_compose(COMPOSE.read_text())

    def test_it_fits_the_schema_and_the_programs(self):
        self.assertEqual(self.schema_faults, [])
        self.assertEqual(compose_rules.faults(self.compose), [])

    def test_what_is_broken_is_found(self):
        for what, change, fault in BROKEN:
            with self.subTest(what):
                compose = copy.deepcopy(self.compose)
                change(compose["services"])
                self.assertIn(fault, "\n".join(compose_rules.faults(compose)))
        _, found = node_tools.read_compose(COMPOSE.read_text().replace("mem_limit", "memory_limit"))
        self.assertIn("memory_limit", "\n".join(found))


if __name__ == "__main__":
    unittest.main()
