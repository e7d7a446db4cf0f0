"""What the program says without any farm: help, and each way to ask for something that cannot be."""

import json
import struct
import unittest

import harness


class Help(harness.CliTest):
    def test_program(self):
        self.check_golden("help", "--help")
        self.check_golden("no_arguments")
        self.check_golden("version", "--version", replace=[(r"\d+\.\d+\.\d+", "VERSION")])

    def test_each_command(self):
        for command in harness.commands_of(self.succeed("--help")):
            with self.subTest(command=command):
                self.check_golden(f"help_{command.replace('-', '_')}", command, "--help")


class Autoscale(harness.CliTest):
    program = "lumifold-autoscale"

    def test_help(self):
        # Versions of CLI11 write defaults in two ways, and break lines elsewhere.
        self.check_golden("autoscale_help",
                          "--help",
                          replace=[(r"((?:TEXT|INT|FLOAT)(?::\S+(?: in \[.*?\])?)?)=(\S+)", r"\1 [\2]"),
                                   (r" *\n {20,}", "  "), (r"(?<=\S) {2,}", "  "), (r"\] (?=[A-Z])", "]  ")])

    def test_what_is_missing_or_wrong_is_named(self):
        needed = ("--state", "state")
        self.check_golden("autoscale_no_script", *needed)
        self.check_golden("autoscale_lost_script", *needed, "--script", "lost.sbatch")
        script = ("--script", __file__)
        self.check_golden("autoscale_bad_farm", *needed, *script, "--farm", "a b")
        self.check_golden("autoscale_bad_limits", *needed, *script, "--min", "9")


class WrongCommandLine(harness.CliTest):
    def test_unknown_words_get_a_suggestion(self):
        self.check_golden("unknown_command", "rendr", "room.gltf")
        self.check_golden("unknown_command_far", "frobnicate")
        self.check_golden("unknown_option_before_command", "--verison")
        self.check_golden("unknown_option", "render", "room.gltf", "--szie", "512x384", "-o", "out.exr")
        self.check_golden("unexpected_argument", "render", "room.gltf", "hall.gltf", "-o", "out.exr")

    def test_values_say_what_is_expected(self):
        for name, option, value in (
            ("bad_size", "--size", "512x"),
            ("zero_size", "--size", "0x384"),
            ("absurd_size", "--size", "99999999x99999999"),
            ("zero_samples", "--spp", "0"),
            ("negative_seed", "--seed", "-1"),
            ("bad_exposure", "--exposure", "bright"),
        ):
            with self.subTest(name=name):
                self.check_golden(name, "render", "room.gltf", option, value, "-o", "out.exr")

    def test_what_is_missing_is_named(self):
        self.check_golden("no_scene", "render", "-o", "out.exr")
        self.check_golden("no_output", "render", "room.gltf")
        self.check_golden("no_value", "render", "room.gltf", "-o", "out.exr", "--spp")
        self.check_golden("no_job", "status")

    def test_outputs_are_looked_at_first(self):
        self.check_golden("unknown_format", "render", "room.gltf", "-o", "out.gif")
        self.check_golden("no_folder", "render", "room.gltf", "-o", "none/out.exr")
        self.check_golden("noisy_no_png", "render", "room.gltf", "-o", "out.exr", "--noisy", "noisy.exr")


class Filter(harness.CliTest):
    def test_what_cannot_be_filtered_is_named(self):
        (self.folder / "text.exr").write_text("This is no picture.\n")
        self.check_golden("filter_missing", "filter", "none.exr", "-o", "out.exr")
        self.check_golden("filter_no_picture", "filter", "text.exr", "-o", "out.exr")
        self.check_golden("filter_unknown_layout", "filter", "text.exr", "--layout", "brand-x", "-o",
                          "out.exr")
        (self.folder / "bad.layout").write_text("combined = C\nbeauty = C\n")
        self.check_golden("filter_bad_layout", "filter", "text.exr", "--layout", "bad.layout", "-o",
                          "out.exr")


class BadScene(harness.CliTest):
    def test_missing(self):
        self.check_golden("missing_scene", "render", "room.gltf", "-o", "out.exr")

    def test_folder(self):
        self.check_golden("folder_scene", "render", ".", "-o", "out.exr")

    def test_not_gltf(self):
        (self.folder / "room.gltf").write_text("This is no scene.\n")
        self.check_golden("not_gltf", "render", "room.gltf", "-o", "out.exr")

    def test_cut_short(self):
        (self.folder / "room.glb").write_bytes(b"glTF" + struct.pack("<III", 2, 1000, 900) + b"JSON{}")
        self.check_golden("cut_short_glb", "render", "room.glb", "-o", "out.exr")

    def test_missing_file_of_the_scene(self):
        harness.write_scene(self.folder)
        (self.folder / "mesh.bin").unlink()
        self.check_golden("missing_buffer", "submit", "room.gltf")

    def test_file_outside_the_folder_of_the_scene(self):
        for name, uri in (("outside", "..%2f..%2fetc/passwd"), ("absolute",
                                                                "/etc/passwd"), ("url", "file:///etc/passwd"),
                          ("device", "zero"), ("drive", "C:/a.png"), ("control", "a%0ab.png")):
            (self.folder / "room.gltf").write_text(
                json.dumps({"asset": {"version": "2.0"}, "images": [{"uri": uri}]}))
            (self.folder / "zero").unlink(missing_ok=True)
            (self.folder / "zero").symlink_to("/dev/zero")
            self.check_golden(f"file_{name}", "submit", "room.gltf")

    def test_device_in_an_allowed_folder(self):
        (self.folder / "room.gltf").write_text('{"asset": {"version": "2.0"}, "images": [{"uri": "zero"}]}')
        (self.folder / "zero").symlink_to("/dev/zero")
        self.check_golden("file_allowed_device", "render", "room.gltf", "--allow-dir", "/dev", "-o",
                          "out.exr")

    def test_file_over_the_limit(self):
        (self.folder / "room.gltf").write_text('{"asset": {"version": "2.0"}, "images": [{"uri": "a.png"}]}')
        with open(self.folder / "a.png", "wb") as file:
            file.truncate(5 << 20)
        self.check_golden("file_too_large", "submit", "room.gltf", "--max-file-mb", "4")


class NoServer(harness.CliTest):
    def test_each_command_names_it(self):
        harness.write_scene(self.folder)
        address = harness.free_address()
        for command in (
            ("submit", "room.gltf"),
            ("status", "j1"),
            ("wait", "j1"),
            ("watch", "j1"),
            ("list",),
            ("cancel", "j1"),
            ("explain", "j1"),
            ("logs", "j1"),
            ("pause", "j1"),
            ("resume", "j1"),
            ("set-priority", "j1", "-5"),
            ("add-samples", "j1", "8"),
            ("retry", "j1"),
            ("delete", "j1"),
            ("workers",),
            ("drain", "w-1"),
            ("block", "w-1"),
            ("readmit", "w-1"),
            ("server-status",),
            ("usage",),
            ("whoami",),
            ("invite", "ann"),
            ("identities",),
            ("revoke", "ann"),
            ("download", "j1", "-o", "out.exr"),
        ):
            with self.subTest(command=command[0]):
                self.check_golden("no_server", *command, "--server", address, replace=[(address, "ADDRESS")])

    def test_address_from_the_environment(self):
        address = harness.free_address()
        self.environment["LUMIFOLD_SERVER"] = address
        self.check_golden("no_server", "list", replace=[(address, "ADDRESS")])

    def test_no_address(self):
        self.check_golden("bad_address", "list", "--server", "render.example.org")


if __name__ == "__main__":
    unittest.main()
