"""The program with processes of the coordinator and a worker over loopback, and alone."""

import json
import queue
import struct
import subprocess
import threading
import unittest
import urllib.parse

import harness

NO_END = ("--size", "2048x2048", "--spp", "65536")  # hours of work: still running when it is cancelled


class FarmTest(harness.CliTest):
    """Each test has its own coordinator, and workers if it starts them."""

    def setUp(self):
        super().setUp()
        self.scene = harness.write_scene(self.folder)
        lines = self.start_daemon("lumifold-server", "--data", self.folder / "data", "--listen",
                                  "127.0.0.1:0")
        self.address = self.wait_for_address(lines)
        self.environment["LUMIFOLD_SERVER"] = self.address

    def start_daemon(self, program, *arguments):
        """Starts a program that runs until the test ends. Returns a queue of the lines that it prints."""
        process = subprocess.Popen(
            [harness.BIN_DIR / program, *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        lines = queue.Queue()

        def read():
            for line in process.stdout:
                lines.put(line)

        reader = threading.Thread(target=read, daemon=True)
        reader.start()

        def stop():
            process.terminate()
            process.wait(timeout=harness.TIMEOUT_SECONDS)
            reader.join()
            process.stdout.close()

        self.addCleanup(stop)
        return lines

    def wait_for_address(self, lines):
        while True:
            words = lines.get(timeout=harness.TIMEOUT_SECONDS).split()
            if "listening" in words:
                return words[words.index("on", words.index("listening")) + 1]

    def start_worker(self):
        self.start_daemon("lumifold-worker", "--server", self.address, "--threads", "1")

    def submit(self, *options):
        out = self.succeed("submit", self.scene, *(options or ("--size", "40x30", "--spp", "4")))
        self.assertRegex(out, r"\A[A-Za-z0-9_-]+\n\Z")  # the id alone
        return out.strip()


class Jobs(FarmTest):
    def test_from_submit_to_download(self):
        self.start_worker()
        job = self.submit()
        self.assertEqual(self.run_lumifold("wait", job)[:2], (0, "done\n"))

        status = self.succeed_json("status", job)
        self.assertEqual((status["job_id"], status["state"], status["name"]), (job, "done", "room.gltf"))
        self.assertEqual((status["frames_done"], status["frames_total"]), (1, 1))
        self.assertEqual(status["samples_done"], 40 * 30 * 4)
        self.assertEqual(status["units_done"], status["units_total"])
        self.assertEqual(self.succeed_json("list")["job_id"], job)
        self.assertIn(job, self.succeed("list"))
        self.assertEqual(json.loads(self.succeed("watch", job, "--json").splitlines()[-1])["state"], "done")

        self.assertEqual(self.succeed_json("download", job, "-o", "out.exr")["output"], "out.exr")
        self.succeed("download", job, "-o", "out.png", "--noisy", "noisy.png")
        self.assertTrue((self.folder / "out.exr").read_bytes().startswith(b"\x76\x2f\x31\x01"))
        for name in ("out.png", "noisy.png"):
            self.assertTrue((self.folder / name).read_bytes().startswith(b"\x89PNG"))
        self.assertEqual([name for name in self.files() if name.endswith(".part")], [])

    def test_download_is_resumed(self):
        self.start_worker()
        job = self.submit()
        self.succeed("wait", job)
        self.succeed("download", job, "-o", "whole.exr")
        whole = (self.folder / "whole.exr").read_bytes()
        (self.folder / f"again.exr.{job}-0.part").write_bytes(whole[: len(whole) // 3])
        self.succeed("download", job, "-o", "again.exr")
        self.assertEqual((self.folder / "again.exr").read_bytes(), whole)

    def test_garbage_in_a_part_is_healed(self):
        self.start_worker()
        job = self.submit()
        self.succeed("wait", job)
        self.succeed("download", job, "-o", "whole.exr")
        whole = (self.folder / "whole.exr").read_bytes()
        for garbage in (b"?" * 1000, b"?" * len(whole), b"?" * (len(whole) + 5),
                        whole[:99] + b"?" + whole[100:]):
            (self.folder / f"again.exr.{job}-0.part").write_bytes(garbage)
            self.succeed("download", job, "-o", "again.exr")
            self.assertEqual((self.folder / "again.exr").read_bytes(), whole)

    def test_a_result_that_changed_is_refused(self):
        self.start_worker()
        job = self.submit()
        self.succeed("wait", job)
        result = self.folder / "data" / "results" / job / "frame-0000.exr"
        whole = result.read_bytes()
        result.write_bytes(whole[:-100] + bytes([whole[-100] ^ 1]) + whole[-99:])
        code, out, err = self.run_lumifold("download", job, "-o", "out.exr")
        self.assertEqual((code, out), (1, ""))
        self.assertRegex(
            err.splitlines()[-1],
            rf"\Alumifold: frame 0 of job {job}: its SHA-256 is \w+, the coordinator states \w+\Z")
        self.assertNotIn("out.exr", "".join(self.files()))

    def test_jobs_have_several_names(self):
        settings = ("--size", "40x30", "--spp", "4", "--max-bounces", "3")
        job = self.submit(*settings, "--name", "shot 7")
        other = self.submit(*settings, "--name", "shot 8")
        for name in (job, job[:-1], job[-7:], "shot 7"):
            self.assertEqual(self.succeed_json("status", name)["job_id"], job, name)
        status = self.succeed_json("status", "last")
        self.assertEqual((status["job_id"], status["width"], status["samples_per_pixel"]), (other, 40, 4))
        options = {"size": "40x30", "frames": "0", "spp": 4, "max-bounces": 3, "method": "default"}
        self.assertEqual(status["options"] | options, status["options"])
        self.assertIn("--max-bounces 3 --method default\n", self.succeed("status", "last"))
        code, _, err = self.run_lumifold("cancel", "j-")
        self.assertEqual((code, err), (2, f"lumifold: 'j-' means 2 jobs: {other}, {job}\n"))
        self.succeed("cancel", "shot 8")
        self.assertEqual(self.succeed_json("status", other)["state"], "cancelled")
        self.assertNotEqual(self.succeed_json("status", job)["state"], "cancelled")

    def test_what_a_worker_would_refuse_is_not_uploaded(self):
        code, _, err = self.run_lumifold("submit", self.scene, "--camera", "top")
        self.assertEqual((code, "no camera called 'top'" in err), (4, True), err)
        scene = json.loads(self.scene.read_text()) | {"extensionsRequired": ["EXT_unheard_of"]}
        self.scene.write_text(json.dumps(scene))
        code, _, err = self.run_lumifold("submit", self.scene)
        self.assertEqual((code, "EXT_unheard_of" in err), (1, True), err)
        self.assertEqual(self.succeed("list", "--json"), "")

    def test_cancel(self):
        job = self.submit(*NO_END)  # no worker yet
        self.assertEqual(self.succeed_json("status", job)["state"], "submitted")
        self.assertEqual(self.run_lumifold("cancel", job), (0, "", f"lumifold: job {job} cancelled\n"))
        self.assertEqual(self.run_lumifold("wait", job)[:2], (5, "cancelled\n"))
        self.assertEqual(self.run_lumifold("watch", job)[0], 5)
        self.assertEqual(self.succeed_json("cancel", job)["state"],
                         "cancelled")  # cancelling it again is not an error

    def test_pause_explain_and_resume(self):
        job = self.submit("--size", "40x30", "--spp", "4", "--paused", "--user", "ann")
        self.assertTrue(
            self.succeed("explain",
                         job).startswith(f"job: {job}\nstate: paused\npaused: the job is paused\n"))
        self.assertEqual(self.succeed_json("explain", job)["reasons"][0]["code"], "paused")
        self.assertEqual(self.succeed_json("list", "--user", "ann", "--state", "paused")["job_id"], job)
        self.assertEqual(self.succeed("list", "--user", "ben", "--json"), "")
        self.assertEqual(self.run_lumifold("set-priority", job, "-5"),
                         (0, "", f"lumifold: job {job} paused\n"))
        self.start_worker()
        self.assertEqual(self.succeed_json("resume", job)["priority"], -5)
        self.succeed("wait", job)
        explained = self.succeed("explain", job)
        self.assertTrue(explained.startswith(f"job: {job}\nstate: done\nnothing holds it up\n\nDECISION "),
                        explained)
        self.assertEqual(len(self.succeed_json("explain", job)["plan"]["decisions"]), 13)
        log = self.succeed("logs", job)
        for event in ("job_submitted", "job_planned", "job_resumed", "job_priority", "frame_finished",
                      "job_ended"):
            self.assertIn(f"event={event} job={job}", log)
        worker = self.succeed_json("workers")
        self.assertEqual((worker["worker_id"], worker["state"]), ("w-1", "idle"))
        self.assertGreater(worker["units_done"], 0)

    def test_download_before_the_end(self):
        job = self.submit(*NO_END)
        code, out, err = self.run_lumifold("download", job, "-o", "out.exr")
        self.assertEqual((code, out), (1, ""))
        self.assertRegex(err, r"\Alumifold: .+\n\Z")
        self.assertNotIn("out.exr", "".join(self.files()))

    def test_interrupted_wait_leaves_the_job_alone(self):
        job = self.submit(*NO_END)
        watch = self.start("watch", job, "--json")
        watch.stdout.readline()  # it is watching
        code, _, err = self.interrupt(watch)
        self.assertEqual((code, err.splitlines()[-1]), (130, "lumifold: interrupted"))
        self.assertEqual(self.succeed_json("status", job)["state"], "submitted")


class FileNames(FarmTest):
    SETTINGS = ("--size", "40x30", "--spp", "4")

    def test_encoded_uris_name_the_files_everywhere(self):
        self.start_worker()
        self.scene = harness.write_textured_scene(self.folder, "mesh.bin", "texture.png", str)
        self.succeed("render", self.scene, *self.SETTINGS, "-o", "plain.exr")
        for mesh, texture in (("my mesh.bin", "my texture.png"), ("gitter-ü.bin", "木.png"),
                              ("100%.bin", "50%20off.png")):
            for encode in (urllib.parse.quote, str) if "%" not in texture else (urllib.parse.quote,):
                with self.subTest(texture=texture, uri=encode(texture)):
                    self.scene = harness.write_textured_scene(self.folder, mesh, texture, encode)
                    self.succeed("render", self.scene, *self.SETTINGS, "-o", "local.exr")
                    self.assertEqual(self.succeed_json("compare", "local.exr", "plain.exr")["mse255"], 0)
                    job = self.submit(*self.SETTINGS)
                    self.succeed("wait", job)
                    self.succeed("download", job, "-o", "farm.exr")
                    self.assertEqual((self.folder / "farm.exr").read_bytes(),
                                     (self.folder / "local.exr").read_bytes())


class Refusals(FarmTest):
    def test_unknown_job(self):
        for command in (("status",), ("wait",), ("watch",), ("cancel",), ("download", "-o", "out.exr"),
                        ("explain",), ("logs",), ("pause",), ("resume",), ("set-priority",
                                                                           "5"), ("drain",), ("readmit",)):
            with self.subTest(command=command[0]):
                code, out, err = self.run_lumifold(command[0], "nonesuch", *command[1:])
                self.assertEqual((code, out), (4, ""))
                self.assertRegex(err, r"\Alumifold: .*nonesuch.*\n\Z")

    def test_unknown_method(self):
        code, out, err = self.run_lumifold("submit", self.scene, "--method", "nonesuch")
        self.assertEqual((code, out), (2, ""))
        self.assertRegex(err.splitlines()[-1], r"\Alumifold: .*nonesuch")


class Render(harness.CliTest):
    def setUp(self):
        super().setUp()
        self.scene = harness.write_scene(self.folder)
        (self.folder / "tmp").mkdir()
        self.environment["TMPDIR"] = str(self.folder / "tmp")  # files left there count as left behind

    def edit_scene(self, edit):
        scene = json.loads(self.scene.read_text())
        edit(scene)
        self.scene.write_text(json.dumps(scene))

    def test_writes_pictures_and_nothing_else(self):
        before = self.files()
        result = self.succeed_json("render", "room.gltf", "--size", "40x30", "--spp", "4", "--threads", "1",
                                   "-o", "out.exr", "--noisy", "noisy.png")
        self.assertEqual((result["state"], result["output"], result["noisy_output"]),
                         ("done", "out.exr", "noisy.png"))
        self.assertEqual(self.files(), sorted([*before, "noisy.png", "out.exr"]))
        self.assertRegex(self.succeed("compare", "out.exr", "out.exr"), r"\AMSE255 0\.0000\nPSNR inf dB\n")

    def test_same_settings_give_the_same_picture(self):
        for name in ("a.exr", "b.exr"):
            self.succeed("render", "room.gltf", "--size", "40x30", "--spp", "4", "--seed", "5", "-o", name)
        self.assertEqual(self.succeed_json("compare", "a.exr", "b.exr")["mse255"], 0)
        self.succeed("render", "room.gltf", "--size", "40x30", "--spp", "4", "--seed", "6", "-o", "c.exr")
        self.assertGreater(self.succeed_json("compare", "a.exr", "c.exr")["mse255"], 0)

    def test_a_picture_is_lean_unless_it_is_to_be_compared(self):
        settings = (self.scene, "--size", "64x48", "--spp", "4")
        self.environment["LUMIFOLD_CONFIG"] = str(self.folder / "none.yaml")
        layers = {}
        for name, options in (("lean", ()), ("full", ("--exr", "full")), ("film", ("--save-film",)),
                              ("equal", ("--reproducible",))):
            path = self.folder / f"{name}.exr"
            _, err = self.run_lumifold("render", *settings, *options, "-o", path)[1:]
            self.assertNotIn("loading", err, "nothing is uploaded or downloaded")
            layers[name] = set(self.succeed_json("info", path)["layers"])
        self.assertEqual(layers["lean"], {"", "albedo", "emission", "N", "id"})
        self.assertLess(layers["lean"] | {"noisy", "direct"}, layers["full"])
        self.assertEqual(layers["equal"], layers["full"])
        self.assertIn("noisy_a", layers["film"])
        size = {name: (self.folder / f"{name}.exr").stat().st_size for name in ("lean", "full")}
        self.assertLess(size["lean"], size["full"])

    def test_a_picture_for_a_display_is_filtered_with_a_warning(self):
        self.succeed("render", self.scene, "--size", "64x48", "--spp", "4", "-o", "noisy.png")
        code, _, err = self.run_lumifold("filter", "noisy.png", "-o", "clean.exr")
        self.assertEqual((code, "light brighter than white" in err), (0, True), err)
        self.assertEqual([name for name in self.files() if "input" in name], [])

    def test_a_saved_film_is_filtered_again(self):
        self.succeed("render", "room.gltf", "--size", "40x30", "--spp", "4", "--save-film", "-o", "film.exr")
        self.succeed("filter", "film.exr", "-o", "again.exr")
        self.assertEqual(self.succeed_json("compare", "again.exr", "film.exr")["mse255"], 0)
        self.succeed("filter", "film.exr", "--method", "none", "-o", "noisy.exr")
        noisy = self.succeed_json("compare", "noisy.exr", "film.exr", "--reference-layer", "noisy")
        self.assertEqual(noisy["mse255"], 0)

    def test_two_pictures_are_two_halves(self):
        for seed in ("1", "2"):
            self.succeed("render", "room.gltf", "--size", "40x30", "--spp", "4", "--seed", seed, "-o",
                         f"{seed}.exr")
        self.succeed("render", "room.gltf", "--size", "40x30", "--spp", "512", "--seed", "3", "-o",
                     "true.exr")
        (self.folder / "our.layout").write_text(
            "combined = noisy\ndirect = direct\nindirect = indirect\n"
            "albedo = albedo\nemission = emission\nnormal = N\ndepth = distance\n")
        self.succeed("filter", "1.exr", "--half-b", "2.exr", "-o", "named.exr")
        self.succeed("filter", "1.exr", "--half-b", "2.exr", "--layout", "our.layout", "-o", "mapped.exr")
        self.assertEqual(self.succeed_json("compare", "named.exr", "mapped.exr")["mse255"], 0)
        noisy, filtered = (self.succeed_json("compare", "named.exr", "true.exr", "--reference-layer", "noisy",
                                             *layer) for layer in (("--layer", "noisy"), ()))
        self.assertLess(filtered["mse255"], noisy["mse255"])

    def test_bad_content_is_named_in_one_line(self):
        def leave_buffer(scene):
            scene["accessors"][1]["count"] = 30

        def no_number(scene):
            mesh = (self.folder / "mesh.bin").read_bytes()
            (self.folder / "mesh.bin").write_bytes(struct.pack("<f", float("nan")) + mesh[4:])

        def cut_short(scene):
            (self.folder / "mesh.bin").write_bytes(b"short")

        for edit in (leave_buffer, no_number, cut_short):
            with self.subTest(edit.__name__):
                self.scene = harness.write_scene(self.folder)
                self.edit_scene(edit)
                before = self.files()
                code, out, err = self.run_lumifold("render", "room.gltf", "--size", "8x8", "--spp", "2", "-o",
                                                   "a.exr")
                self.assertEqual((code, out), (1, ""))
                self.assertRegex(err.splitlines()[-1], r"\Alumifold: job \S+ failed: room\.gltf: .+\Z")
                self.assertEqual(self.files(), before)

    def test_no_camera_and_no_light_are_warnings(self):
        def neither(scene):
            scene["nodes"].pop()
            scene["scenes"][0]["nodes"].pop()
            scene["materials"][1] = {}

        self.edit_scene(neither)
        result = self.succeed_json("render", "room.gltf", "--size", "8x8", "--spp", "2", "-o", "a.exr")
        self.assertRegex("\n".join(result["warnings"]), r"(?s)(camera.*light|light.*camera)")

    def test_interrupted_render_leaves_nothing(self):
        before = self.files()
        render = self.start("render", "room.gltf", *NO_END, "--threads", "1", "-o", "out.exr")
        self.assertIn("running", self.read_until(render, "running"))
        code, out, err = self.interrupt(render)
        self.assertEqual((code, out, err.splitlines()[-1]), (130, "", "lumifold: interrupted"))
        self.assertEqual(self.files(), before)

    def read_until(self, process, word):
        for line in process.stderr:
            if word in line:
                return line
        self.fail(f"ended before it said '{word}'")


if __name__ == "__main__":
    unittest.main()
