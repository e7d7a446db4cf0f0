"""The parts of the Blender add-on that need no Blender: command lines, progress, cancelling, materials, the
list of losses, files.

Node trees are small imitations with the sockets of each version of Blender; the tests in a real Blender are
in addon_test.py.
"""

import pathlib
import signal
import sys
import tempfile
import time
import types
import unittest
import unittest.mock

try:
    import numpy
except ImportError:
    numpy = None

from lumifold import frame_jobs, materials, program, unsupported, versions

needs_numpy = unittest.skipIf(numpy is None, "numpy is not installed (Debian package python3-numpy)")


class CommandLines(unittest.TestCase):
    picture = program.Picture("room.gltf", (64, 48), 7, "sky.exr", 2.8, 3.5)

    def test_render(self):
        command = program.render_command("lumifold", program.Place(threads=2), self.picture,
                                         program.Quality(), "out.exr", "p.exr")
        self.assertEqual(
            " ".join(command),
            "lumifold render room.gltf -o out.exr --size 64x48 --frame 7 --env sky.exr --f-stop 2.8 --focus 3.5 --spp 64 "
            "--max-bounces 8 --seed 0 --method default --threads 2 --preview p.exr")

    def test_submit(self):
        place = program.Place(True, "farm:7700", "studio", True, 5, threads=3)
        command = program.submit_command("lumifold", place, program.Picture("room.gltf", (64, 48)),
                                         program.Quality("ERROR", 4096))
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
        command = program.submit_command("lumifold", program.Place(True, "; rm -rf /"), self.picture,
                                         program.Quality())
        self.assertIn("; rm -rf /", command)


class Progress(unittest.TestCase):
    def test_of_render(self):
        self.assertEqual(program.progress_of_text("running 40% (2 workers)"),
                         program.Progress("running", 0.4))
        self.assertEqual(program.progress_of_text("filtering"), program.Progress("filtering"))
        self.assertIsNone(program.progress_of_text("lumifold: wrote a.exr (render 0.07 s)"))

    def test_of_a_job(self):
        job = {"job_id": "j-1", "state": "running", "workers": 1, "samples_done": 1, "samples_total": 4}
        self.assertEqual(program.progress_of_job(job), program.Progress("running, 1 worker", 0.25, "j-1"))
        filtering = {"job_id": "j-1", "state": "filtering", "frames_filtered": 0.5}
        self.assertEqual(program.progress_of_job(filtering), program.Progress("filtering", 0.5, "j-1"))


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
        jobs = [
            frame_jobs.FrameJob("j", i, "", state) for i, state in enumerate(("running", "done", "running"))
        ]
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
            code = (
                "import pathlib, signal, sys, time\n"
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


EACH_VERSION = ((3, 4), (3, 6), (4, 0), (4, 3), (5, 0), (5, 2))


def in_version(version):
    """Lets the add-on believe that it runs in this version of Blender."""
    return unittest.mock.patch.object(versions, "running", lambda: version)


class Socket:
    """A socket of a node; `source` is a socket of another. The name is what Blender 5 shows."""

    def __init__(self, identifier, value=None, source=None):
        self.identifier, self.default_value, self.node = identifier, value, None
        self.name = {"Fac": "Factor", "Shader_001": "Shader"}.get(identifier, identifier)
        self.links = [types.SimpleNamespace(from_socket=source)] if source else []
        self.is_linked = bool(source)


def node(kind, outputs=(), inputs=(), **values):
    made = types.SimpleNamespace(type=kind, name=kind, bl_label=values.pop("label", kind), **values)
    made.inputs, made.outputs = list(inputs), list(outputs)
    for socket in (*made.inputs, *made.outputs):
        socket.node = made
    return made


COMMON = {
    "Base Color": (0.5, 0.5, 0.5, 1), "Metallic": 0.0, "Roughness": 0.5, "Anisotropic": 0.0,
    "Emission Strength": 1.0, "Alpha": 1.0, "Normal": (0, 0, 0), "Tangent": (0, 0, 0)
}
# inputs and their values, as a new node of the version has them but for the strength of emission
PRINCIPLED = {
    (3, 4): {**COMMON, "Subsurface": 0.0, "Specular": 0.5, "Specular Tint": 0.0, "Sheen": 0.0, "Clearcoat": 0.0, "Clearcoat Roughness": 0.03,
             "IOR": 1.45, "Transmission": 0.0, "Transmission Roughness": 0.0, "Emission": (0, 0, 0, 1), "Clearcoat Normal": (0, 0, 0)},
    (4, 0): {**COMMON, "IOR": 1.5, "Subsurface Weight": 0.0, "Specular IOR Level": 0.5, "Specular Tint": (1, 1, 1, 1),
             "Transmission Weight": 0.0, "Coat Weight": 0.0, "Coat Roughness": 0.03, "Coat IOR": 1.5, "Coat Tint": (1, 1, 1, 1),
             "Coat Normal": (0, 0, 0), "Sheen Weight": 0.0, "Sheen Roughness": 0.5, "Sheen Tint": (1, 1, 1, 1), "Emission Color": (1, 1, 1, 1)},
}
PRINCIPLED[4, 3] = {**PRINCIPLED[4, 0], "Diffuse Roughness": 0.0, "Thin Film Thickness": 0.0}
PRINCIPLED[5, 2] = {**PRINCIPLED[4, 3], "Thin Wall": False}


def principled(links=(), **values):
    """Principled of the version that runs. Keys of versions.PRINCIPLED and identifiers have underscores for
    spaces."""
    sockets = dict(versions.at(PRINCIPLED))
    for key, value in values.items():
        name = key.replace("_", " ")
        sockets[versions.at(versions.PRINCIPLED).get(name, name)] = value
    return node("BSDF_PRINCIPLED", [Socket("BSDF")],
                [Socket(name, value,
                        dict(links).get(name)) for name, value in sockets.items()],
                label="Principled BSDF")


def material(shader, name="paint", **sources):
    links = [
        Socket("Surface", source=shader.outputs[0]),
        *(Socket(one, source=sources.get(one)) for one in ("Volume", "Displacement"))
    ]
    output = node("OUTPUT_MATERIAL", inputs=links, target="ALL", is_active_output=True)
    return types.SimpleNamespace(name=name,
                                 use_nodes=True,
                                 use_backface_culling=False,
                                 node_tree=types.SimpleNamespace(nodes=[output, shader]))


def picture(name="bricks"):
    image = types.SimpleNamespace(name=name, source="FILE")
    return node("TEX_IMAGE", [Socket("Color"), Socket("Alpha")], [Socket("Vector")],
                image=image,
                projection="FLAT",
                extension="REPEAT")


def diffuse(color):
    return node("BSDF_DIFFUSE", [Socket("BSDF")], [Socket("Color", color), Socket("Normal")], label="Diffuse BSDF")


def glossy(color):
    return node("BSDF_GLOSSY", [Socket("BSDF")],
                [Socket("Color", color), Socket("Roughness", 0.3), Socket("Normal")],
                label="Glossy BSDF", distribution="GGX")


def mixed(first, second, share, source=None):
    return node("MIX_SHADER", [Socket("Shader")], [
        Socket("Fac", share, source=source),
        Socket("Shader", source=first.outputs[0]),
        Socket("Shader_001", source=second.outputs[0])
    ], label="Mix Shader")


class Materials(unittest.TestCase):
    """Rules that hold in all versions, in the newest one."""

    def setUp(self):
        self.enterContext(in_version(EACH_VERSION[-1]))

    def test_constants(self):
        made = materials.translate(material(principled(Metallic=1.0, Roughness=0.2)))
        self.assertEqual((made.base_color, made.metallic, made.roughness, made.losses),
                         ((0.5, 0.5, 0.5), 1, 0.2, []))

    def test_pictures(self):
        bricks = picture()
        split = node("SEPARATE_COLOR",
                     [Socket("Red"), Socket("Green"), Socket("Blue")],
                     [Socket("Color", source=bricks.outputs[0])],
                     mode="RGB")
        links = {"Base Color": bricks.outputs[0], "Roughness": split.outputs[1], "Alpha": bricks.outputs[1]}
        made = materials.translate(material(principled(links, Metallic=1.0)))
        channels = [one.channels for one in (made.base_color, made.roughness, made.alpha)]
        self.assertEqual((channels, made.losses), (["RGB", "G", "A"], []))

    def test_what_cannot_be_carried_is_listed(self):
        noise = node("TEX_NOISE", [Socket("Color")], label="Noise Texture")
        made = materials.translate(
            material(principled({"Base Color": noise.outputs[0]}, Subsurface_Weight=0.3),
                     Volume=noise.outputs[0]))
        self.assertEqual(
            made.losses,
            ["'Noise Texture' at Base Color", "Subsurface Weight of 'Principled BSDF'", "volumes"])

    def test_energy_that_cycles_loses_is_listed(self):
        shader = principled(Metallic=1.0, Roughness=0.8)
        shader.distribution = "GGX"
        self.assertEqual(materials.translate(material(shader)).losses, [materials.SINGLE_SCATTERING])

    def test_unknown_shader(self):
        hair = node("BSDF_HAIR", [Socket("BSDF")], [Socket("Color", (1, 0, 0, 1))], label="Hair BSDF")
        made = materials.translate(material(hair))
        self.assertEqual((made.base_color, made.losses),
                         ((1, 0, 0), ["shader node 'Hair BSDF' (rendered as a matt surface)"]))

    def test_mixture_with_transparent_is_alpha(self):
        clear = node("BSDF_TRANSPARENT", [Socket("BSDF")], [Socket("Color", (1, 1, 1, 1))])
        opaque = principled(Metallic=1.0)
        mix = node("MIX_SHADER", [Socket("Shader")], [
            Socket("Fac", 0.25),
            Socket("Shader", source=clear.outputs[0]),
            Socket("Shader_001", source=opaque.outputs[0])
        ])
        made = materials.translate(material(mix))
        self.assertEqual((made.alpha, made.metallic, made.losses), (0.25, 1, []))

    def test_mixture_of_two_surfaces_is_one(self):
        made = materials.translate(
            material(mixed(diffuse((0.8, 0.4, 0.0, 1)), glossy((0.4, 0.0, 0.8, 1)), 0.25)))
        self.assertEqual([round(channel, 6) for channel in made.base_color], [0.7, 0.3, 0.2], "the colours are added with their shares")
        bright = [share * versions.luminance(color)
                  for share, color in ((0.75, (0.8, 0.4, 0)), (0.25, (0.4, 0, 0.8)))]
        self.assertAlmostEqual(made.metallic, bright[1] / sum(bright))
        self.assertAlmostEqual(made.roughness, 0.3, msg="matt surfaces have no say about highlights")
        self.assertEqual(made.alpha, 1)
        self.assertEqual(made.losses[-1:],
                         ["'Mix Shader' of 'Diffuse BSDF' and 'Glossy BSDF' (rendered as one surface)"])

    def test_the_order_of_a_mixture_does_not_matter(self):
        first, second = diffuse((0.8, 0.4, 0.0, 1)), principled(Metallic=1.0, Roughness=0.2, coat=0.5)
        one, other = (materials.translate(material(made))
                      for made in (mixed(first, second, 0.25), mixed(second, first, 0.75)))
        for name in ("metallic", "roughness", "reflectance", "clearcoat", "alpha"):
            self.assertAlmostEqual(getattr(one, name), getattr(other, name), msg=name)
        for a, b in zip(one.base_color, other.base_color):
            self.assertAlmostEqual(a, b)

    def test_light_in_a_mixture_is_exact(self):
        glow = node("EMISSION", [Socket("Emission")], [Socket("Color", (1, 0.5, 0, 1)), Socket("Strength", 4.0)])
        made = materials.translate(material(mixed(diffuse((0.8, 0.4, 0.2, 1)), glow, 0.25)))
        self.assertEqual([round(channel, 6) for channel in made.base_color], [0.6, 0.3, 0.15])
        self.assertEqual((made.emission, made.emission_strength, made.losses), ((1, 0.5, 0), 1, []))
        bricks = picture()
        textured = node("BSDF_DIFFUSE", [Socket("BSDF")],
                        [Socket("Color", (1, 1, 1, 1), source=bricks.outputs[0]), Socket("Normal")])
        made = materials.translate(material(mixed(textured, glow, 0.25)))
        self.assertEqual((made.base_color.image.name, made.base_color.factor, made.losses), ("bricks", 0.75, []))

    def test_fresnel_over_a_base_is_its_highlight(self):
        for kind, name, value, output in (("FRESNEL", "IOR", 2.0, "Fac"), ("LAYER_WEIGHT", "Blend", 0.5, "Fresnel")):
            share = node(kind, [Socket(output)], [Socket(name, value)])
            made = materials.translate(
                material(mixed(diffuse((0.8, 0.4, 0.0, 1)), glossy((1, 1, 1, 1)), 0.5, share.outputs[0])))
            self.assertAlmostEqual(made.reflectance, 1 / 9, msg=kind)
            self.assertEqual((made.base_color, made.metallic, made.roughness, made.losses),
                             ((0.8, 0.4, 0), 0, 0.3, []))

    def test_transparent_by_any_order(self):
        clear = node("BSDF_TRANSPARENT", [Socket("BSDF")], [Socket("Color", (1, 1, 1, 1))])
        for shader in (mixed(clear, diffuse((0.8, 0.4, 0.2, 1)), 0.25),
                       mixed(diffuse((0.8, 0.4, 0.2, 1)), clear, 0.75)):
            made = materials.translate(material(shader))
            self.assertEqual([round(channel, 6) for channel in made.base_color], [0.8, 0.4, 0.2])
            self.assertEqual((made.alpha, made.losses), (0.25, []))

    def test_colours_of_vertices(self):
        paint = node("VERTEX_COLOR", [Socket("Color"), Socket("Alpha")], layer_name="paint")
        made = materials.translate(material(principled({"Base Color": paint.outputs[0]})))
        self.assertEqual((made.vertex_colors, made.base_color, made.losses), ("paint", (1, 1, 1), []))
        bricks = picture()
        product = node("MIX", [Socket("Result_Color")], [
            Socket("Factor_Float", 1.0),
            Socket("A_Color", (1, 1, 1, 1), source=bricks.outputs[0]),
            Socket("B_Color", (1, 1, 1, 1), source=paint.outputs[0])
        ], blend_type="MULTIPLY")
        made = materials.translate(material(principled({"Base Color": product.outputs[0]})))
        self.assertEqual((made.vertex_colors, made.base_color.image.name, made.losses), ("paint", "bricks", []))

    def test_a_volume_alone_is_invisible(self):
        fog = material(principled(), Volume=Socket("Volume"))
        output = fog.node_tree.nodes[0]
        output.inputs[0].links, output.inputs[0].is_linked = [], False
        made = materials.translate(fog)
        self.assertEqual((made.alpha, made.losses), (0, ["volume without a surface (not rendered)"]))

    def test_anisotropy_has_the_widths_of_principled(self):
        for roughness, anisotropy in ((0.35, 0.6), (0.2, 0.0), (0.5, 0.9)):
            made, strength = materials.gltf_anisotropy(roughness, anisotropy)
            across, aspect = made**2, (1 - 0.9 * anisotropy) ** 0.5
            self.assertAlmostEqual(across, roughness**2 * aspect)
            self.assertAlmostEqual(across + (1 - across) * strength**2, roughness**2 / aspect)

    def test_ior_of_a_reflectance(self):
        self.assertAlmostEqual(materials.ior_of_reflectance(0.04), 1.5)


class Versions(unittest.TestCase):
    """What differs between versions of Blender, by their tables."""

    def each(self):
        for version in EACH_VERSION:
            with self.subTest(version=version), in_version(version):
                yield version

    def test_principled_is_read_in_each(self):
        for version in self.each():
            shader = principled(specular=0.25,
                                transmission=0.5,
                                coat=1.0,
                                coat_roughness=0.2,
                                emission=(3, 2, 1, 1),
                                IOR=1.5)
            made = materials.translate(material(shader))
            read = (made.transmission, made.clearcoat_roughness, made.emission, made.emission_strength,
                    made.ior)
            self.assertEqual(read, (0.5, 0.2, (3, 2, 1), 1, 1.5))
            self.assertAlmostEqual(made.reflectance, 0.02)
            self.assertEqual(made.clearcoat, 0.25 if version < (4, 0) else 1)

    def test_a_new_principled_loses_only_what_disneys_diffuse_lobe_has(self):
        for version in self.each():
            self.assertEqual(
                materials.translate(material(principled())).losses, [materials.DISNEY_DIFFUSE] if version <
                (4, 0) else [])

    def test_highlights_follow_the_index_of_refraction_since_4_0(self):
        for version in self.each():
            made = materials.translate(material(principled(IOR=2.0)))
            self.assertAlmostEqual(made.reflectance, 0.04 if version < (4, 0) else 1 / 9)

    def test_sheen_is_carried_since_4_0(self):
        for version in self.each():
            made = materials.translate(
                material(principled(sheen=0.5) if version >= (4, 0) else principled(Sheen=0.5)))
            color = (0, 0, 0) if version < (4, 0) else (0.5, 0.5, 0.5)
            self.assertEqual((made.sheen_color, len(made.losses)), (color, 2 if version < (4, 0) else 1))

    def test_thin_walls_of_5_2(self):
        with in_version((5, 2)):
            for thin in (False, True):
                made = materials.translate(material(principled(transmission=1.0, Thin_Wall=thin)))
                self.assertEqual((made.is_thin, made.losses), (thin, []))

    def test_what_a_version_adds_is_listed(self):
        for version in self.each():
            tint = {"Specular_Tint": 0.5 if version < (4, 0) else (1, 0, 0, 1)}
            film = {"Thin_Film_Thickness": 300} if version >= (4, 3) else {}
            lost = materials.translate(material(principled(Metallic=1.0, **tint, **film))).losses
            self.assertEqual(lost, [
                f"{name} of 'Principled BSDF'"
                for name in ("Specular Tint", "Thin Film Thickness")[:1 + len(film)]
            ])

    def test_passes_have_the_names_of_the_version(self):
        for version in self.each():
            self.assertEqual(versions.pass_name("Diffuse Direct"), "DiffDir" if version <
                             (5, 0) else "Diffuse Direct")
            self.assertEqual(versions.pass_name("Depth"), "Depth")

    def test_nodes_that_are_switched_off(self):
        paint = material(node("BSDF_HAIR", [Socket("BSDF")]))
        self.assertIsNotNone(versions.node_tree(paint))
        paint.use_nodes = False
        self.assertIsNone(versions.node_tree(paint))
        del paint.use_nodes  # as in Blender 6
        self.assertIsNotNone(versions.node_tree(paint))

    def test_lights_of_3_4_and_of_4_5(self):
        light = types.SimpleNamespace(color=(1, 0.5, 0), energy=100)
        self.assertEqual((versions.light_color(light), versions.light_power(light, None)), ([1, 0.5, 0], 100))
        light = types.SimpleNamespace(color=(1, 0.5, 0),
                                      energy=100,
                                      exposure=1,
                                      normalize=False,
                                      area=lambda matrix_world: 3,
                                      use_temperature=True,
                                      temperature_color=(1, 0.5, 0.5))
        self.assertEqual((versions.light_color(light), versions.light_power(light, None)),
                         ([1, 0.25, 0], 600))


def scene(*objects, **render):
    plain = {
        "pixel_aspect_x": 1, "pixel_aspect_y": 1, "use_motion_blur": False, "use_multiview": False,
        "film_transparent": False
    }
    dof = types.SimpleNamespace(use_dof=False)
    camera = types.SimpleNamespace(name="camera",
                                   data=types.SimpleNamespace(type="PERSP", shift_x=0, shift_y=0, dof=dof))
    return types.SimpleNamespace(objects=objects,
                                 camera=camera,
                                 world=None,
                                 render=types.SimpleNamespace(**{**plain, **render}),
                                 lumifold=types.SimpleNamespace(soft_points=True, bake_resolution=0))


def thing(kind, name, data=None, **values):
    plain = {
        "hide_render": False, "particle_systems": (), "material_slots": (), "is_holdout": False,
        "is_shadow_catcher": False
    }
    return types.SimpleNamespace(type=kind, name=name, data=data, **{**plain, **values})


class Losses(unittest.TestCase):
    def test_nothing_is_lost(self):
        self.assertEqual(unsupported.losses_of(scene(thing("MESH", "cube"))), [])

    def test_each_is_named(self):
        sun = types.SimpleNamespace(type="SUN", use_nodes=False, node_tree=None, angle=0.1)
        linking = types.SimpleNamespace(receiver_collection="some", blocker_collection=None)
        lost = scene(thing("VOLUME", "smoke"), thing("LIGHT", "sun", sun, light_linking=linking),
                     thing("GREASEPENCIL", "notes", hide_render=True), use_motion_blur=True)
        self.assertEqual(unsupported.losses_of(lost), [
            "Not rendered, volume object: smoke", "Light linking (lights reach all objects): sun",
            "Angle of sun (sharp shadows): sun", "Motion blur"
        ])

    def test_shadow_catchers_need_a_transparent_film(self):
        floor = thing("MESH", "floor", is_shadow_catcher=True)
        self.assertEqual(unsupported.losses_of(scene(floor, film_transparent=True)), [])
        self.assertEqual(unsupported.losses_of(scene(floor)),
                         ["Shadow catcher without a transparent film (shown like others): floor"])

    def test_long_lists_are_cut(self):
        many = scene(*(thing("VOLUME", f"smoke {i}") for i in range(5)))
        self.assertEqual(unsupported.losses_of(many),
                         ["Not rendered, volume object: smoke 0, smoke 1, smoke 2 and 2 more"])


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

        for version, factor in (((3, 4), 4), ((4, 0), numpy.pi)):
            for shape, area in (("SQUARE", 1.0), ("RECTANGLE", 0.5), ("ELLIPSE", 0.5 * numpy.pi / 4)):
                builder = gltf.GltfBuilder()
                light = types.SimpleNamespace(type="AREA",
                                              shape=shape,
                                              size=1.0,
                                              size_y=0.5,
                                              energy=100,
                                              color=(1, 0.5, 0))
                with in_version(version):
                    lights.add_light(builder, "lamp", light, numpy.eye(4), True)
                emission = builder.json["materials"][0]["extensions"]["KHR_materials_emissive_strength"][
                    "emissiveStrength"]
                self.assertAlmostEqual(emission * area * factor / 100, 1, delta=0.01, msg=shape)
        points, triangles = lights.icosphere(2)
        a, b, c = (points[triangles[:, i]] for i in range(3))
        self.assertTrue((numpy.einsum("ij,ij->i", numpy.cross(b - a, c - a), a) > 0).all(),
                        "faces look outwards")

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
