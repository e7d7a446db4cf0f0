"""The render engine: exports what Blender hands it, runs the program, and gives back the passes."""

import os
import pathlib
import tempfile

import bpy
import gpu
from gpu_extras.presets import draw_texture_2d

from . import exr, export, frame_jobs, passes, preferences, program, unsupported, viewport, world


class Submission:
    """Frames that the operator has rendered only to be submitted. Its jobs are kept in the scene's
    settings."""

    def __init__(self, settings):
        self.settings, self.error = settings, ""

    def add(self, job):
        made = self.settings.jobs.add()
        made.job, made.frame, made.path = job.job, job.frame, job.path


submission = None  # while frames are submitted
told = set()  # losses that a Blender without a window has printed


class LumifoldEngine(bpy.types.RenderEngine):
    bl_idname = "LUMIFOLD"
    bl_label = "Lumifold"
    bl_use_preview = False
    bl_use_shading_nodes_custom = False  # materials, lights and worlds have the nodes of Cycles
    bl_use_eevee_viewport = True  # the viewport's material preview is Eevee's

    def update_render_passes(self, scene=None, renderlayer=None):
        for one in passes.wanted(renderlayer, scene.lumifold):
            self.register_pass(scene, renderlayer, one.name_in_blender(), len(one.channels), one.channels,
                               one.kind)

    def render(self, depsgraph):
        """Renders one view layer of one frame. Blender calls it in a thread of its own, or in background mode
        in the only one."""
        try:
            with tempfile.TemporaryDirectory(prefix="lumifold-blender-") as folder:
                Frame(self, depsgraph, pathlib.Path(folder)).render()
        except program.Cancelled:
            if not self.test_break():
                self.fail("The job was cancelled at the farm")
        except (program.ProgramError, export.ExportError, world.WorldError, ValueError, OSError) as error:
            self.fail(str(error))

    viewport = texture = None

    def view_update(self, context, depsgraph):
        """The scene of a rendered viewport has changed; Blender calls it first of all, too."""
        if self.viewport is None:
            executable = preferences.program_path()
            if not executable:
                self.update_stats("Lumifold", preferences.MISSING)
                return
            self.viewport = viewport.ViewportRender(executable, self.tag_redraw)
        try:
            self.viewport.set_scene(depsgraph)
            self.viewport.set_view(viewport.View.of(context.region, context.region_data))
        except (world.WorldError, ValueError, OSError) as error:
            self.update_stats("Lumifold", str(error))

    def view_draw(self, context, depsgraph):
        """Draws the newest picture, and begins another if the view has changed."""
        if self.viewport is None:
            return
        self.viewport.set_view(viewport.View.of(context.region, context.region_data))
        self.update_stats("Lumifold", self.viewport.stage)
        picture = self.viewport.picture
        if picture is None:
            return
        if self.texture is None or self.texture[0] is not picture:
            height, width, _ = picture.shape
            pixels = gpu.types.Buffer("FLOAT", width * height * 4, passes.from_the_bottom(picture).ravel())
            self.texture = picture, gpu.types.GPUTexture((width, height), format="RGBA16F", data=pixels)
        self.bind_display_space_shader(depsgraph.scene)
        draw_texture_2d(self.texture[1], (0, 0), context.region.width, context.region.height)
        self.unbind_display_space_shader()

    def __del__(self):
        if self.viewport is not None:
            self.viewport.close()
        getattr(super(), "__del__", lambda: None)()  # Blender's own, since 4.4

    def fail(self, text):
        if submission:
            submission.error = text
            return  # the operator stops and reports it
        self.report({"ERROR"}, text)
        self.error_set(text)


class Frame:
    """One view layer of one frame on its way to the program and back."""

    def __init__(self, engine, depsgraph, folder):
        self.engine, self.depsgraph, self.folder = engine, depsgraph, folder
        self.scene = depsgraph.scene
        self.settings = self.scene.lumifold
        render = self.scene.render
        scale = render.resolution_percentage / 100
        self.size = max(int(render.resolution_x * scale), 1), max(int(render.resolution_y * scale), 1)
        self.part = passes.part_of(self.size, border_of(render))
        self.wanted = passes.wanted(depsgraph.view_layer_eval, self.settings)
        self.preview = folder / "preview.exr"
        self.preview_time = 0
        self.background = None

    def render(self):
        executable = preferences.program_path()
        if not executable:
            raise program.ProgramError(preferences.MISSING)
        if bpy.app.background:
            self.tell_losses()
        self.show(program.Progress("exporting"))
        picture = export.export(self.depsgraph, self.folder, self.size, self.engine.test_break)
        if self.engine.test_break():
            return
        picture.region = self.part.region(self.size) if self.part.size != self.size else ()
        place = self.settings.place()
        if submission:
            self.submit(executable, place, picture)
            return
        if picture.environment:
            self.background = self.part.cropped(self.seen_background(picture.environment))
        output = str(self.folder / "result.exr")
        run = program.render_on_farm if place.on_farm else program.render_here
        warnings = run(executable, place, picture, self.settings.quality(), output, str(self.preview),
                       self.engine.test_break, self.show, self.show_preview)
        for text in warnings:
            self.engine.report({"WARNING"}, text)
        self.hand_over(exr.read(output), self.wanted)

    def tell_losses(self):
        """Prints what the panel lists, each once: nobody sees the panel."""
        for text in unsupported.losses_of(self.scene):
            if text not in told:
                told.add(text)
                print(f"Lumifold: not carried over: {text}", flush=True)

    def submit(self, executable, place, picture):
        """Submits the frame and lets Blender go on; its own result stays empty."""
        scene, layers = self.scene, [layer for layer in self.scene.view_layers if layer.use]
        path = frame_jobs.picture_path(bpy.path.abspath(scene.render.frame_path(frame=scene.frame_current)),
                                       self.depsgraph.view_layer_eval.name, len(layers))
        job = frame_jobs.submit(executable, place, picture, self.settings.quality(), self.engine.test_break)
        submission.add(frame_jobs.FrameJob(job, picture.frame, path))

    def show(self, progress):
        name = f"{progress.job}: " if progress.job else ""
        share = "" if progress.share is None else f" {progress.share:.0%}"
        self.engine.update_stats("", f"Lumifold | {name}{progress.stage}{share}")
        if progress.share is not None:
            self.engine.update_progress(progress.share)

    def show_preview(self):
        """Shows the growing picture, if there is a newer one."""
        try:
            changed = os.stat(self.preview).st_mtime_ns
        except OSError:
            return
        if changed == self.preview_time:
            return
        self.preview_time = changed
        try:
            film = {
                name: passes.fitted(plane, self.part.size) for name, plane in exr.read(self.preview).items()
            }
        except (OSError, ValueError, KeyError):
            return  # the result does not depend on a preview
        if "A" not in film:
            film["A"] = film["R"] * 0 + 1
        self.hand_over(film, [one for one in self.wanted if one.name == "Combined"])

    def hand_over(self, film, wanted):
        """Gives passes to Blender: all of the picture, or the part within the render border."""
        result = self.engine.begin_result(0, 0, *self.part.size, layer=self.depsgraph.view_layer_eval.name)
        try:
            given = result.layers[0].passes
            for one in wanted:
                name = one.name_in_blender()
                if name not in given:
                    continue
                pixels = passes.pixels_of(one.name, film, self.background, self.scene.render.film_transparent)
                given[name].rect = passes.from_the_bottom(pixels).reshape(-1, len(one.channels))
        finally:
            self.engine.end_result(result)

    def seen_background(self, environment):
        camera = self.scene.camera.evaluated_get(self.depsgraph)
        projection = camera.calc_matrix_camera(self.depsgraph, x=self.size[0], y=self.size[1])
        film = exr.read(environment)
        return passes.background_of(passes.layer(film, ""), self.size, camera.matrix_world, projection)


def border_of(render):
    """The render border as shares of the frame, left, bottom, right and top; None without one."""
    return (render.border_min_x, render.border_min_y, render.border_max_x,
            render.border_max_y) if render.use_border else None


def register():
    bpy.utils.register_class(LumifoldEngine)


def unregister():
    bpy.utils.unregister_class(LumifoldEngine)
