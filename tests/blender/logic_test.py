"""The parts of the Blender add-on that need no Blender: command lines, progress, cancelling, materials, the list of losses, files."""

import pathlib
import signal
import sys
import tempfile
import time
import types
import unittest

try:
    import numpy
except ImportError:
    numpy = None

from lumifold import frame_jobs, materials, program, unsupported

needs_numpy = unittest.skipIf(numpy is None, "numpy is not installed (Debian package python3-numpy)")


class CommandLines(unittest.TestCase):
    picture = program.Picture("room.gltf", (64, 48), 7, "sky.exr", 2.8, 3.5)

    def test_render(self):
        command = program.render_command("lumifold", program.Place(threads=2), self.picture, program.Quality(), "out.exr", "p.exr")
        self.assertEqual(
            " ".join(command),
            "lumifold render room.gltf -o out.exr --size 64x48 --frame 7 --env sky.exr --f-stop 2.8 --focus 3.5 --spp 64 "
            "--max-bounces 8 --seed 0 --method default --threads 2 --preview p.exr")

    def test_submit(self):
        place = program.Place(True, "farm:7700", "studio", True, 5, threads=3)
        command = program.submit_command("lumifold", place, program.Picture("room.gltf", (64, 48)), program.Quality("ERROR", 4096))
        self.assertEqual(
            " ".join(command),
            "lumifold submit room.gltf --json --size 64x48 --frame 0 --spp 4096 --max-bounces 8 --seed 0 --method default "
            "--target-error 10 --server farm:7700 --profile studio --insecure --priority 5")

    def test_region(self):
        picture = program.Picture("room.gltf", (64, 48), region=(16, 0, 48, 24))
        self.assertEqual(picture.options(), ["--size", "64x48", "--frame", "0", "--region", "16,0,48,24"])

    def test_time(self):
        self.assertIn("90s", program.Quality("TIME", seconds=90).options())

    def test_names_stay_one_argument(self):
        command = program.submit_command("lumifold", program.Place(True, "; rm -rf /"), self.picture, program.Quality())
        self.assertIn("; rm -rf /", command)


class Progress(unittest.TestCase):
    def test_of_render(self):
        self.assertEqual(program.progress_of_text("running 40% (2 workers)"), program.Progress("running", 0.4))
        self.assertEqual(program.progress_of_text("filtering"), program.Progress("filtering"))
        self.assertIsNone(program.progress_of_text("lumifold: wrote a.exr (render 0.07 s)"))

    def test_of_a_job(self):
        job = {"job_id": "j-1", "state": "running", "workers": 1, "samples_done": 1, "samples_total": 4}
        self.assertEqual(program.progress_of_job(job), program.Progress("running, 1 worker", 0.25, "j-1"))


class Frames(unittest.TestCase):
    def test_which(self):
        self.assertEqual(frame_jobs.frames_of("", 3, 9, 3), [3, 6, 9])
        self.assertEqual(frame_jobs.frames_of(" 60, 1-3 ,2", 1, 250), [1, 2, 3, 60])
        for wrong in ("a", "1-", "5-3", "1,,2", "1-999999", "-4", "1;2"):
            with self.assertRaises(ValueError, msg=wrong):
                frame_jobs.frames_of(wrong, 1, 2)

    def test_files(self):
        self.assertEqual(frame_jobs.picture_path("/out/room_0007.png"), "/out/room_0007.exr")
        self.assertEqual(frame_jobs.picture_path("/out/v1.2_0007", "Fog", 2), "/out/v1.2_0007-Fog.exr")

    def test_states(self):
        jobs = [frame_jobs.FrameJob("j", i, "", state) for i, state in enumerate(("running", "done", "running"))]
        self.assertEqual(frame_jobs.summary(jobs), "1 done, 2 running")


class Runs(unittest.TestCase):
    """`program.run` with Python in place of the program."""

    def test_lines_and_error(self):
        lines = []
        code = "import sys; print('one'); print('lumifold: no such job', file=sys.stderr); sys.exit(4)"
        with self.assertRaisesRegex(program.ProgramError, "^lumifold: no such job$"):
            program.run([sys.executable, "-c", code], on_output=lines.append)
        self.assertEqual(lines, ["one"])

    def test_cancelled_job(self):
        with self.assertRaises(program.Cancelled):
            program.run([sys.executable, "-c", "raise SystemExit(5)"])

    def test_cancel_interrupts(self):
        with tempfile.TemporaryDirectory() as folder:
            mark = pathlib.Path(folder) / "interrupted"
            code = ("import pathlib, signal, sys, time\n"
                    f"signal.signal(signal.SIGINT, lambda *_: (pathlib.Path({str(mark)!r}).touch(), sys.exit(130)))\n"
                    "print('ready', flush=True); time.sleep(600)")
            ready = []
            start = time.monotonic()
            with self.assertRaises(program.Cancelled):
                program.run([sys.executable, "-c", code], lambda: bool(ready), ready.append)
            self.assertTrue(mark.exists())
            self.assertLess(time.monotonic() - start, 60)
        self.assertEqual(signal.SIGINT, 2)

    def test_no_program(self):
        with self.assertRaisesRegex(program.ProgramError, "none/lumifold: No such file"):
            program.run(["none/lumifold"])


class Socket:
    """A socket of a node; `source` is a socket of another."""

    def __init__(self, name, value=None, source=None):
        self.name, self.default_value, self.node = name, value, None
        self.links = [types.SimpleNamespace(from_socket=source)] if source else []
        self.is_linked = bool(source)


def node(kind, outputs=(), inputs=(), **values):
    made = types.SimpleNamespace(type=kind, bl_label=values.pop("label", kind), **values)
    made.inputs = Sockets(inputs)
    made.outputs = Sockets(outputs)
    for socket in (*made.inputs, *made.outputs):
        socket.node = made
    return made


class Sockets(list):
    def __getitem__(self, key):
        return list.__getitem__(self, key) if isinstance(key, int) else next(one for one in self if one.name == key)

    def get(self, key):
        return next((one for one in self if one.name == key), None)

    def __contains__(self, key):
        return self.get(key) is not None


PRINCIPLED = {"Base Color": (0.5, 0.5, 0.5, 1), "Subsurface": 0.0, "Metallic": 0.0, "Specular": 0.5, "Roughness": 0.5, "Anisotropic": 0.0,
              "Sheen": 0.0, "Clearcoat": 0.0, "Clearcoat Roughness": 0.0, "IOR": 1.45, "Transmission": 0.0, "Emission": (0, 0, 0, 1),
              "Emission Strength": 1.0, "Alpha": 1.0, "Normal": (0, 0, 0)}


def principled(links=(), **values):
    values = {**PRINCIPLED, **{key.replace("_", " "): value for key, value in values.items()}}
    return node("BSDF_PRINCIPLED", [Socket("BSDF")], [Socket(name, value, dict(links).get(name)) for name, value in values.items()])


def material(shader, name="paint", **sources):
    links = [Socket("Surface", source=shader.outputs[0]), *(Socket(one, source=sources.get(one)) for one in ("Volume", "Displacement"))]
    output = node("OUTPUT_MATERIAL", inputs=links, target="ALL", is_active_output=True)
    return types.SimpleNamespace(name=name, use_nodes=True, use_backface_culling=False, node_tree=types.SimpleNamespace(nodes=[output, shader]))


def picture(name="bricks"):
    image = types.SimpleNamespace(name=name, source="FILE")
    return node("TEX_IMAGE", [Socket("Color"), Socket("Alpha")], [Socket("Vector")], image=image, projection="FLAT", extension="REPEAT")


class Materials(unittest.TestCase):
    def test_constants(self):
        made = materials.translate(material(principled(Metallic=1.0, Roughness=0.2)))
        self.assertEqual((made.base_color, made.metallic, made.roughness, made.losses), ((0.5, 0.5, 0.5), 1, 0.2, []))

    def test_pictures(self):
        bricks = picture()
        split = node("SEPARATE_COLOR", [Socket("Red"), Socket("Green"), Socket("Blue")], [Socket("Color", source=bricks.outputs[0])], mode="RGB")
        links = {"Base Color": bricks.outputs[0], "Roughness": split.outputs[1], "Alpha": bricks.outputs[1]}
        made = materials.translate(material(principled(links, Metallic=1.0)))
        channels = [one.channels for one in (made.base_color, made.roughness, made.alpha)]
        self.assertEqual((channels, made.losses), (["RGB", "G", "A"], []))

    def test_what_cannot_be_carried_is_listed(self):
        noise = node("TEX_NOISE", [Socket("Color")], label="Noise Texture")
        made = materials.translate(material(principled({"Base Color": noise.outputs[0]}, Metallic=1.0, Subsurface=0.3), Volume=noise.outputs[0]))
        self.assertEqual(made.losses, ["'Noise Texture' at Base Color", "Principled's Subsurface", "volumes"])

    def test_disney_diffuse_is_listed(self):
        self.assertEqual(materials.translate(material(principled())).losses, [materials.DISNEY_DIFFUSE])

    def test_energy_that_cycles_loses_is_listed(self):
        shader = principled(Metallic=1.0, Roughness=0.8)
        shader.distribution = "GGX"
        self.assertEqual(materials.translate(material(shader)).losses, [materials.SINGLE_SCATTERING])

    def test_unknown_shader(self):
        hair = node("BSDF_HAIR", [Socket("BSDF")], [Socket("Color", (1, 0, 0, 1))], label="Hair BSDF")
        made = materials.translate(material(hair))
        self.assertEqual((made.base_color, made.losses), ((1, 0, 0), ["shader node 'Hair BSDF' (rendered as a matt surface)"]))

    def test_mixture_with_transparent_is_alpha(self):
        clear = node("BSDF_TRANSPARENT", [Socket("BSDF")], [Socket("Color", (1, 1, 1, 1))])
        opaque = principled(Metallic=1.0)
        mix = node("MIX_SHADER", [Socket("Shader")],
                   [Socket("Fac", 0.25), Socket("Shader", source=clear.outputs[0]), Socket("Shader", source=opaque.outputs[0])])
        made = materials.translate(material(mix))
        self.assertEqual((made.alpha, made.metallic, made.losses), (0.25, 1, []))

    def test_specular_is_reflectance_at_normal_incidence(self):
        self.assertAlmostEqual(materials.ior_of_specular(0.5), 1.5)


def scene(*objects, **render):
    plain = {"pixel_aspect_x": 1, "pixel_aspect_y": 1, "use_motion_blur": False, "use_multiview": False}
    dof = types.SimpleNamespace(use_dof=False)
    camera = types.SimpleNamespace(name="camera", data=types.SimpleNamespace(type="PERSP", shift_x=0, shift_y=0, dof=dof))
    return types.SimpleNamespace(objects=objects, camera=camera, world=None, render=types.SimpleNamespace(**{**plain, **render}),
                                 lumifold=types.SimpleNamespace(soft_points=True))


def thing(kind, name, data=None, **values):
    plain = {"hide_render": False, "particle_systems": (), "material_slots": (), "is_holdout": False, "is_shadow_catcher": False}
    return types.SimpleNamespace(type=kind, name=name, data=data, **{**plain, **values})


class Losses(unittest.TestCase):
    def test_nothing_is_lost(self):
        self.assertEqual(unsupported.losses_of(scene(thing("MESH", "cube"))), [])

    def test_each_is_named(self):
        sun = types.SimpleNamespace(type="SUN", use_nodes=False, node_tree=None, angle=0.1)
        lost = scene(thing("VOLUME", "smoke"), thing("LIGHT", "sun", sun), thing("GPENCIL", "notes", hide_render=True), use_motion_blur=True)
        self.assertEqual(unsupported.losses_of(lost),
                         ["Not rendered, volume object: smoke", "Angle of sun (sharp shadows): sun", "Motion blur"])

    def test_long_lists_are_cut(self):
        many = scene(*(thing("VOLUME", f"smoke {i}") for i in range(5)))
        self.assertEqual(unsupported.losses_of(many), ["Not rendered, volume object: smoke 0, smoke 1, smoke 2 and 2 more"])


@needs_numpy
class Arrays(unittest.TestCase):
    def test_written_pictures_are_read(self):
        from lumifold import exr

        pixels = numpy.random.default_rng(1).random((5, 7, 3), numpy.float32)
        with tempfile.TemporaryDirectory() as folder:
            exr.write_rgb(f"{folder}/a.exr", pixels)
            channels = exr.read(f"{folder}/a.exr")
        numpy.testing.assert_array_equal(numpy.dstack([channels[name] for name in "RGB"]), pixels)

    def test_power_and_size_of_lights(self):
        from lumifold import gltf, lights

        for shape, area in (("SQUARE", 1.0), ("RECTANGLE", 0.5), ("ELLIPSE", 0.5 * numpy.pi / 4)):
            builder = gltf.GltfBuilder()
            light = types.SimpleNamespace(type="AREA", shape=shape, size=1.0, size_y=0.5, energy=100, color=(1, 0.5, 0))
            lights.add_light(builder, "lamp", light, numpy.eye(4), True)
            emission = builder.json["materials"][0]["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"]
            self.assertAlmostEqual(emission * area / 25, 1, delta=0.01, msg=shape)  # P / (4 A)
        points, triangles = lights.icosphere(2)
        a, b, c = (points[triangles[:, i]] for i in range(3))
        self.assertTrue((numpy.einsum("ij,ij->i", numpy.cross(b - a, c - a), a) > 0).all(), "faces look outwards")

    def test_parts_are_rounded_as_blenders(self):
        from lumifold import passes

        self.assertEqual(passes.part_of((64, 48), None), passes.Part(0, 0, (64, 48)))
        part = passes.part_of((64, 48), (0.26, 0.5, 0.8, 0.99))
        self.assertEqual(part, passes.Part(16, 24, (35, 23)))
        self.assertEqual(part.region((64, 48)), (16, 1, 51, 24))
        pixels = numpy.arange(48 * 64).reshape(48, 64)
        self.assertEqual(part.cropped(pixels)[0, 0], 1 * 64 + 16)
        self.assertEqual(part.cropped(pixels).shape, (23, 35))

    def test_background_is_where_the_environment_says(self):
        from lumifold import passes

        environment = numpy.zeros((64, 128, 3), numpy.float32)
        environment[:, 32 - 2 : 32 + 2] = 1  # the left quarter is +Y
        towards_y = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
        projection = [[20, 0, 0, 0], [0, 20, 0, 0], [0, 0, -1, 0], [0, 0, -1, 0]]
        self.assertTrue((passes.background_of(environment, (4, 4), towards_y, projection) == 1).all())

    def test_rows_that_occur_twice_are_stored_once(self):
        from lumifold import meshes

        rows = numpy.array([(1, 2), (0, 0), (1, 2), (-0.0, 0)], numpy.float32)
        kept, _, inverse = meshes.distinct_rows(rows)
        self.assertEqual(len(kept), 2)
        numpy.testing.assert_array_equal(kept[inverse], rows)


if __name__ == "__main__":
    unittest.main()
