"""Operators of the panel *Frames at the Farm*. Frames are exported by Blender's own render, which alone has
the scene as it is set for rendering: it calls the engine, and the engine submits instead of waiting."""

import bpy

from . import engine, frame_jobs, preferences, program


class FarmOperator:
    """What all have in common: a program, a coordinator, and errors in Blender's words."""

    def execute(self, context):
        executable = preferences.program_path()
        if not executable:
            self.report({"ERROR"}, preferences.MISSING)
            return {"CANCELLED"}
        try:
            return self.run(context, executable)
        except (program.ProgramError, ValueError, OSError,
                RuntimeError) as error:  # the last one is Blender's own
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}


class LUMIFOLD_OT_submit_frames(FarmOperator, bpy.types.Operator):
    bl_idname = "lumifold.submit_frames"
    bl_label = "Submit Frames"
    bl_description = "Export the frames and submit a job for each; Blender is free again once they are uploaded"

    def run(self, context, _executable):
        scene, settings = context.scene, context.scene.lumifold
        frames = frame_jobs.frames_of(settings.frames, scene.frame_start, scene.frame_end, scene.frame_step)
        before, manager = scene.frame_current, context.window_manager
        engine.submission = engine.Submission(settings)
        manager.progress_begin(0, len(frames))
        try:
            for index, frame in enumerate(frames):
                scene.frame_set(frame)
                bpy.ops.render.render()
                if engine.submission.error:
                    raise program.ProgramError(f"Frame {frame}: {engine.submission.error}")
                manager.progress_update(index + 1)
        finally:
            engine.submission = None
            manager.progress_end()
            scene.frame_set(before)
        self.report({"INFO"}, f"Submitted {len(frames)} frames")
        return {"FINISHED"}


class LUMIFOLD_OT_update_frames(FarmOperator, bpy.types.Operator):
    bl_idname = "lumifold.update_frames"
    bl_label = "Download Finished"
    bl_description = "Ask the farm for the state of the jobs and download the pictures of those that are done"

    def run(self, context, executable):
        settings = context.scene.lumifold
        for job in settings.jobs:
            if job.state not in ("downloaded", "failed", "cancelled"):
                frame_jobs.update(executable, settings.place(), job)
        self.report({"INFO"}, frame_jobs.summary(settings.jobs) or "No jobs")
        return {"FINISHED"}


class LUMIFOLD_OT_cancel_frames(FarmOperator, bpy.types.Operator):
    bl_idname = "lumifold.cancel_frames"
    bl_label = "Cancel All"
    bl_description = "Cancel the jobs that have not ended"

    def run(self, context, executable):
        settings = context.scene.lumifold
        for job in settings.jobs:
            frame_jobs.cancel(executable, settings.place(), job)
        return {"FINISHED"}


class LUMIFOLD_OT_forget_frames(bpy.types.Operator):
    bl_idname = "lumifold.forget_frames"
    bl_label = "Clear List"
    bl_description = "Forget the jobs that have ended; files that were downloaded stay"

    def execute(self, context):
        jobs = context.scene.lumifold.jobs
        for index in reversed(range(len(jobs))):
            if jobs[index].state in (*frame_jobs.ENDED, "downloaded"):
                jobs.remove(index)
        return {"FINISHED"}


CLASSES = (LUMIFOLD_OT_submit_frames, LUMIFOLD_OT_update_frames, LUMIFOLD_OT_cancel_frames,
           LUMIFOLD_OT_forget_frames)


def register():
    for made in CLASSES:
        bpy.utils.register_class(made)


def unregister():
    for made in reversed(CLASSES):
        bpy.utils.unregister_class(made)
