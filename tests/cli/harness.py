"""Runs the program `lumifold` and compares its output with the files in golden/."""

import json
import os
import pathlib
import re
import signal
import socket
import struct
import subprocess
import tempfile
import unittest
import zlib

try:
    import jsonschema
except ImportError:  # deploy/setup.sh --tests installs it
    jsonschema = None

OUTPUT_SCHEMA = json.loads((pathlib.Path(__file__).parents[2] / "docs/schemas/output.json").read_text())
# What commands print whose object has another name in the schema.
SCHEMA_OF = {
    **dict.fromkeys(("render", "status", "wait", "watch", "list", "cancel", "pause", "resume", "move-to-front", "set-priority", "add-samples", "retry"), "job"),
    **dict.fromkeys(("workers", "drain", "block", "readmit"), "worker")
}

BIN_DIR = pathlib.Path(os.environ["LUMIFOLD_BIN_DIR"])
GOLDEN_DIR = pathlib.Path(__file__).parent / "golden"
REPRODUCIBLE = pathlib.Path(__file__).parents[1] / "support/lumifold.yaml"
APPROVE = os.environ.get("LUMIFOLD_APPROVE") == "1"
TIMEOUT_SECONDS = 900


def commands_of(help_text):
    """The names of all commands, by the help of the program."""
    return re.findall(r"^  (\S+) +\S", help_text.split("Commands:\n")[1].split("\n\n")[0], flags=re.MULTILINE)


class CliTest(unittest.TestCase):
    """A test with an empty folder in which the program runs."""

    maxDiff = None
    program = "lumifold"

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="lumifold-cli-")
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.environment = {key: value for key, value in os.environ.items() if key != "LUMIFOLD_SERVER"}
        self.environment["LUMIFOLD_CONFIG"] = str(REPRODUCIBLE)

    def start(self, *arguments):
        return subprocess.Popen(
            [BIN_DIR / self.program, *map(str, arguments)],
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run_lumifold(self, *arguments):
        """Exit code, standard output, standard error."""
        process = self.start(*arguments)
        out, err = process.communicate(timeout=TIMEOUT_SECONDS)
        return process.returncode, out, err

    def succeed(self, *arguments):
        """Standard output of a call that must succeed."""
        code, out, err = self.run_lumifold(*arguments)
        self.assertEqual(code, 0, f"lumifold {arguments}: {err}")
        return out

    def succeed_json(self, *arguments):
        """The object on the one line that a call with --json prints, as docs/schemas/output.json describes
        it."""
        out = self.succeed(*arguments, "--json")
        self.assertEqual(out.count("\n"), 1, out)
        result = json.loads(out)
        self.check_schema(arguments[0], result)
        return result

    def check_schema(self, command, result):
        self.assertEqual(result["schema_version"], 1)
        if jsonschema is not None:
            schema = {**OUTPUT_SCHEMA, "$ref": f"#/$defs/{SCHEMA_OF.get(command, command)}"}
            jsonschema.Draft202012Validator(schema).validate(result)

    def check_golden(self, name, *arguments, replace=()):
        """Compares a call with golden/NAME.txt; `replace` has (pattern, replacement) for text that differs
        between runs."""
        before = self.files()
        code, out, err = self.run_lumifold(*arguments)
        text = f"exit code: {code}\n--- standard output\n{out}--- standard error\n{err}"
        for pattern, replacement in replace:
            text = re.sub(pattern, replacement, text)
        path = GOLDEN_DIR / f"{name}.txt"
        if APPROVE:
            path.write_text(text)
        self.assertEqual(path.read_text() if path.exists() else None, text, f"lumifold {arguments}")
        self.assertEqual(self.files(), before, "something was left behind")

    def files(self):
        return sorted(str(path.relative_to(self.folder)) for path in self.folder.rglob("*"))

    def interrupt(self, process):
        """Ctrl-C. Exit code, standard output, standard error."""
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=TIMEOUT_SECONDS)
        return process.returncode, out, err


def free_address():
    """HOST:PORT where no program listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


def write_scene(folder, name="room.gltf"):
    """A triangle that glows, above another that it shines on, with their vertices in a file beside the
    scene."""
    positions = [(-1, 0, -1), (0, 0, 1), (1, 0, -1), (-1, 2, -1), (1, 2, -1), (0, 2, 1)]
    (folder / "mesh.bin").write_bytes(b"".join(struct.pack("<3f", *position) for position in positions))

    def mesh(accessor):
        return {"primitives": [{"attributes": {"POSITION": accessor}, "material": accessor}]}

    def accessor(first, low, high):
        return {"bufferView": 0, "byteOffset": 12 * first, "componentType": 5126, "count": 3, "type": "VEC3",
                "min": low, "max": high}

    scene = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [{"mesh": 0}, {"mesh": 1}, {"camera": 0, "translation": [0, 1, 5]}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.01}}],
        "materials": [{}, {"emissiveFactor": [1, 1, 1]}],
        "meshes": [mesh(0), mesh(1)],
        "buffers": [{"uri": "mesh.bin", "byteLength": 12 * len(positions)}],
        "bufferViews": [{"buffer": 0, "byteLength": 12 * len(positions)}],
        "accessors": [accessor(0, [-1, 0, -1], [1, 0, 1]), accessor(3, [-1, 2, -1], [1, 2, 1])],
    }
    path = folder / name
    path.write_text(json.dumps(scene))
    return path


def write_png(path, width, height, rgb):
    """An 8-bit picture; `rgb` gives the colour at x, y."""
    rows = b"".join(b"\0" + b"".join(bytes(rgb(x, y)) for x in range(width)) for y in range(height))

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows))
                     + chunk(b"IEND", b""))


def write_textured_scene(folder, mesh_name, texture_name, encode):
    """The scene of write_scene() with a texture on its lamp. `encode` makes the URI of a file name."""
    path = write_scene(folder)
    scene = json.loads(path.read_text())
    vertices = (folder / "mesh.bin").read_bytes() + struct.pack("<6f", 0, 0, 1, 0, 0.5, 1)
    (folder / "mesh.bin").unlink()
    (folder / mesh_name).write_bytes(vertices)
    write_png(folder / texture_name, 4, 4, lambda x, y: (60 * x, 60 * y, 200))
    scene["buffers"] = [{"uri": encode(mesh_name), "byteLength": len(vertices)}]
    scene["bufferViews"].append({"buffer": 0, "byteOffset": len(vertices) - 24, "byteLength": 24})
    scene["accessors"].append({"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"})
    scene["meshes"][1]["primitives"][0]["attributes"]["TEXCOORD_0"] = 2
    scene["images"] = [{"uri": encode(texture_name)}]
    scene["textures"] = [{"source": 0}]
    scene["materials"][1]["emissiveTexture"] = {"index": 0}
    path.write_text(json.dumps(scene))
    return path
