"""The Debian packages: what is in them, what Debian's own checks say, what systemd thinks of the units, and
the inventories."""

import gzip
import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import tempfile
import unittest

import node_tools
import packages
import programs

UNITS = programs.ROOT / "deploy/systemd"
DEFAULTS = programs.ROOT / "deploy/packages/default"
# What Debian's checker may say. The packages are not in Debian's archive, and those who build them put their
# own address into
# LUMIFOLD_PACKAGE_CONTACT.
EXPECTED_TAGS = {"bogus-mail-host", "bogus-mail-host-in-debian-changelog", "initial-upload-closes-no-bugs"}
MOST_EXPOSED = 2.0  # of 10, as systemd-analyze counts


class PackagesTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.files = packages.build(cls.folder.name)
        cls.root = pathlib.Path(cls.folder.name) / "root"
        for file in cls.files.values():
            subprocess.run(["dpkg-deb", "-x", file, cls.root], check=True)

    def test_fields(self):
        for name, file in self.files.items():
            self.assertEqual(packages.field(file, "Package"), name)
            self.assertEqual(packages.field(file, "Version"), f"{programs.version()}-1")
            needed = {re.match(r"[^ :(]+", word)[0] for word in packages.field(file, "Depends").split(", ")}
            if name == packages.PYTHON:
                self.assertEqual(packages.field(file, "Architecture"), "all")
                self.assertEqual(needed, {"python3", "python3-grpcio", "python3-protobuf", "python3-xxhash"})
                self.assertRegex(packages.field(file, "Description"), r"^Python package of the Lumifold render farm\n ")
                continue
            needed = {re.sub(r"^(libspdlog.*)-fmt\d+$", r"\1", one) for one in needed}  # a virtual package
            self.assertEqual(needed, set(programs.runtime_packages(name)), name)
            self.assertRegex(packages.field(file, "Description"),
                             r"^[a-z]+ of the Lumifold render farm\n [A-Z]")

    def test_files(self):
        for name, file in self.files.items():
            contents = packages.contents(file)
            self.assertEqual({owner for _, owner in contents.values()}, {"root/root"})
            programs_in = [path for path, (rights, _) in contents.items() if "x" in rights]
            if name == packages.PYTHON:
                self.assertEqual(programs_in, [])
                self.assertEqual(set(contents), self.files_of_python())
                continue
            self.assertEqual(programs_in, [f"/usr/bin/{name}"])
            expected = {
                f"/usr/bin/{name}",
                *(f"/usr/share/doc/{name}/{file}"
                  for file in ("copyright", "changelog.gz", "changelog.Debian.gz", f"{name}.cdx.json"))
            }
            if name == "lumifold":
                expected |= {f"/usr/share/lumifold/proto/{path.relative_to(programs.ROOT / 'proto').as_posix()}"
                             for path in (programs.ROOT / "proto").rglob("*.proto")}
                expected |= {f"/usr/share/lumifold/schemas/{path.name}"
                             for path in (programs.ROOT / "docs/schemas").iterdir()}
                expected |= {f"/usr/share/doc/lumifold/examples/{path.name}"
                             for path in (programs.ROOT / "docs/examples").iterdir() if path.is_file()}
                expected |= {f"/usr/share/lumifold/blender/{package}.zip"
                             for package in ("lumifold-blender", "lumifold-blender-extension")}
            if name in packages.SERVICES:
                expected |= {
                    f"/usr/lib/systemd/system/{name}.service", f"/etc/default/{name}",
                    f"/usr/share/man/man8/{name}.8.gz"
                }
            else:
                commands = re.findall(r"^  ([a-z][a-z-]+) +[A-Z]", programs.run(name, "--help").stdout, re.M)
                expected |= {
                    f"/usr/share/man/man1/lumifold{suffix}.1.gz"
                    for suffix in ["", *(f"-{one}" for one in commands)]
                }
                expected |= {
                    "/usr/share/bash-completion/completions/lumifold",
                    "/usr/share/zsh/vendor-completions/_lumifold",
                    "/usr/share/fish/vendor_completions.d/lumifold.fish"
                }
            self.assertEqual(set(contents), expected)

    @staticmethod
    def files_of_python():
        source = programs.ROOT / "client/python/lumifold"
        modules = {path.name for path in source.iterdir() if path.suffix == ".py" or path.name == "py.typed"}
        modules |= {f"v1/{name}_pb2.py" for name in ("access", "farm", "image", "job", "log", "scene")}
        modules |= {"v1/__init__.py"} | {f"v1/{name}_pb2_grpc.py" for name in
                                         ("access", "farm", "image", "job", "log", "scene")}
        documents = {f"/usr/share/doc/{packages.PYTHON}/{name}"
                     for name in ("copyright", "changelog.gz", "changelog.Debian.gz")}
        return documents | {f"/usr/lib/python3/dist-packages/lumifold/{module}" for module in modules}

    def test_the_python_package_is_found_and_knows_the_protocol(self):
        folder = self.root / "usr/lib/python3/dist-packages"
        done = subprocess.run(
            ["/usr/bin/python3", "-c", "import lumifold.v1.farm_pb2; print(lumifold.__file__)"],
            env={**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}, text=True,
            capture_output=True)
        if "No module named 'grpc'" in done.stderr:
            self.skipTest("python3-grpcio is not installed (deploy/setup.sh --tests)")
        self.assertEqual(done.stdout.strip(), str(folder / "lumifold/__init__.py"), done.stderr)

    def test_manual_pages_are_those_of_the_programs(self):
        page = gzip.decompress((self.root / "usr/share/man/man1/lumifold-submit.1.gz").read_bytes()).decode()
        self.assertEqual(page, programs.run("lumifold", "man", "submit").stdout)
        for name in packages.SERVICES:
            page = gzip.decompress(
                (self.root / f"usr/share/man/man8/{name}.8.gz").read_bytes()).decode().replace("\\", "")
            for flag in programs.flags_of(name):
                self.assertIn(flag, page)
            self.assertNotIn(os.uname().nodename + ":", page)

    def test_debians_checker(self):
        done = subprocess.run(["lintian", "--allow-root", *self.files.values()],
                              text=True,
                              capture_output=True)
        tags = {
            line.split(": ")[2].split()[0]: line
            for line in done.stdout.splitlines()
            if line[:2] in ("E:", "W:")
        }
        self.assertEqual([line for tag, line in tags.items() if tag not in EXPECTED_TAGS], [], done.stderr)

    def test_scripts_are_those_of_a_shell(self):
        for name in packages.SERVICES:
            control = pathlib.Path(self.folder.name) / f"control-{name}"
            subprocess.run(["dpkg-deb", "-e", self.files[name], control], check=True)
            self.assertEqual((control / "conffiles").read_text(), f"/etc/default/{name}\n")
            for script in ("postinst", "prerm", "postrm"):
                subprocess.run(["dash", "-n", control / script], check=True)

    @unittest.skipUnless(node_tools.is_available(), "npm is not installed (deploy/setup.sh --tests)")
    def test_inventories(self):
        node_tools.install()
        files = {name: self.root / f"usr/share/doc/{name}/{name}.cdx.json" for name in packages.PROGRAMS}
        results = node_tools.run("check_inventory.mjs", *files.values()).splitlines()
        self.assertEqual([json.loads(line) for line in results], [[]] * len(files))
        for name, file in files.items():
            inventory = json.loads(file.read_text())
            linked = {one["name"] for one in inventory["components"] if one["scope"] == "required"}
            self.assertLessEqual(set(programs.runtime_packages(name)) | {"libc6"}, linked)
            self.assertIn("nlohmann-json3-dev", {one["name"] for one in inventory["components"]})
        broken = pathlib.Path(self.folder.name) / "broken.json"
        broken.write_text(files["lumifold"].read_text().replace('"library"', '"no such type"'))
        self.assertNotEqual(json.loads(node_tools.run("check_inventory.mjs", broken)), [])


class UnitsTest(unittest.TestCase):
    def test_the_manual_names_what_there_is(self):
        text = (programs.ROOT / "docs/packages.md").read_text()
        self.assertEqual(re.findall(r"^\| `(\S+)` \|", text, re.M), list(packages.PACKAGES))
        for name in re.findall(r"/etc/default/(\S+?)`", text):
            self.assertIn(name, packages.SERVICES)
        for words in (
                line.split() for line in re.findall(r"(lumifold-worker enroll .*|^lumifold .*)", text, re.M)):
            flags = programs.flags_of(*words[:2])
            self.assertEqual([word for word in words if word.startswith("--") and word not in flags], [],
                             words)

    def test_command_lines(self):
        for name in packages.SERVICES:
            (command,) = packages.unit_options(UNITS / f"{name}.service", "ExecStart")
            program, *words = shlex.split(command)
            self.assertEqual(program, f"/usr/bin/{name}")
            variable = words.pop()
            self.assertRegex(variable, r"^\$LUMIFOLD_[A-Z]+_OPTIONS$")
            self.assertEqual(packages.unit_options(UNITS / f"{name}.service", "EnvironmentFile"),
                             [f"-/etc/default/{name}"])
            flags = programs.flags_of(name)
            self.assertEqual([word for word in words if word.startswith("--") and word not in flags], [])
            # The examples of the options are command lines too.
            (example,) = re.findall(rf'^#{variable[1:]}="(.*)"$', (DEFAULTS / name).read_text(), re.M)
            self.assertEqual(
                [word for word in example.split() if word.startswith("--") and word not in flags], [])
            self.assertEqual(re.findall(rf'^{variable[1:]}="(.*)"$', (DEFAULTS / name).read_text(), re.M),
                             [""])

    @unittest.skipUnless(shutil.which("systemd-analyze"),
                         "systemd is not installed (deploy/setup.sh --tests)")
    def test_systemd_understands_them_and_finds_them_closed(self):
        with tempfile.TemporaryDirectory() as folder:
            for name in packages.SERVICES:
                unit = pathlib.Path(folder) / f"{name}.service"
                unit.write_text((UNITS / unit.name).read_text().replace("/usr/bin/", f"{programs.BIN}/"))
                done = subprocess.run(
                    ["systemd-analyze", "verify", "--man=no", "--recursive-errors=no", unit],
                    text=True,
                    capture_output=True)
                self.assertEqual((done.returncode, done.stderr), (0, ""))
                done = subprocess.run([
                    "systemd-analyze", "security", "--offline=true", f"--threshold={MOST_EXPOSED * 10:.0f}",
                    unit
                ],
                                      text=True,
                                      capture_output=True)
                self.assertEqual(done.returncode, 0, done.stdout + done.stderr)


if __name__ == "__main__":
    unittest.main()
