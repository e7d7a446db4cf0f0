"""Panels of the properties editor."""

import textwrap
import time

import bpy

from . import frame_jobs, preferences, unsupported, versions
from .engine import LumifoldEngine

ENGINE = LumifoldEngine.bl_idname
PIXELS_OF_A_LETTER = 9  # of a label, a little more than the mean, at an interface scale of 1
LIST_SECONDS = 1  # for which a list of losses is shown before the scene is looked at again


class RenderPanel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context):
        return context.engine in cls.COMPAT_ENGINES

    def columns(self):
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        return self.layout


def add_paragraph(column, context, text, icon):
    """A text in lines of the panel's width; Blender cuts a label that is longer."""
    letters = context.region.width / PIXELS_OF_A_LETTER / context.preferences.system.ui_scale
    for index, line in enumerate(textwrap.wrap(text, max(int(letters), 20))):
        column.label(text=line, icon="BLANK1" if index else icon)


class LUMIFOLD_PT_place(RenderPanel, bpy.types.Panel):
    bl_label = "Lumifold"

    def draw(self, context):
        layout, settings = self.columns(), context.scene.lumifold
        layout.prop(settings, "where", expand=True)
        if settings.where == "FARM":
            for name in ("server", "profile", "insecure", "priority"):
                layout.prop(settings, name)
        else:
            layout.prop(settings, "threads")
        if not preferences.program_path():
            add_paragraph(layout.column(align=True), context, preferences.MISSING, "ERROR")


class LUMIFOLD_PT_frames(RenderPanel, bpy.types.Panel):
    bl_label = "Frames at the Farm"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.scene.lumifold.where == "FARM"

    def draw(self, context):
        layout, settings = self.columns(), context.scene.lumifold
        layout.prop(settings, "frames")
        layout.operator("lumifold.submit_frames")
        if settings.jobs:
            layout.label(text=frame_jobs.summary(settings.jobs))
            for name in ("update_frames", "cancel_frames", "forget_frames"):
                layout.operator(f"lumifold.{name}")


class LUMIFOLD_PT_sampling(RenderPanel, bpy.types.Panel):
    bl_label = "Sampling"

    def draw(self, context):
        layout, settings = self.columns(), context.scene.lumifold
        layout.prop(settings, "until", expand=True)
        if settings.until == "SAMPLES":
            layout.prop(settings, "samples")
            layout.prop(settings, "adaptive")
        else:
            layout.prop(settings, "target_error" if settings.until == "ERROR" else "seconds")
            layout.prop(settings, "most_samples")
        for name in ("max_bounces", "seed", "method"):
            layout.prop(settings, name)


class LUMIFOLD_PT_scene(RenderPanel, bpy.types.Panel):
    bl_label = "Light and Film"

    def draw(self, context):
        layout, settings = self.columns(), context.scene.lumifold
        layout.prop(settings, "soft_points")
        layout.prop(settings, "world_width")
        layout.prop(settings, "bake_resolution")
        layout.prop(context.scene.render, "film_transparent")


class LUMIFOLD_PT_losses(RenderPanel, bpy.types.Panel):
    bl_label = "Not Carried Over"

    def draw(self, context):
        losses = recent_losses(context.scene)
        column = self.layout.column(align=True)
        for text in losses:
            add_paragraph(column, context, text, "DOT")
        if not losses:
            column.label(text="Everything is carried over", icon="CHECKMARK")


class LUMIFOLD_PT_passes(RenderPanel, bpy.types.Panel):
    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context):
        layout, view_layer, settings = self.columns(), context.view_layer, context.scene.lumifold
        for name in ("z", "normal", "diffuse_direct", "diffuse_indirect", "diffuse_color", "emit",
                     "environment"):
            layout.prop(view_layer, f"use_pass_{name}")
        layout.prop(settings, "pass_noisy")
        layout.prop(settings, "pass_reflection")


recent = {"scene": "", "time": 0.0, "losses": []}


def recent_losses(scene):
    """The losses, looked for again at most once a second: panels are drawn at every movement of the
    pointer."""
    now = time.monotonic()
    if recent["scene"] != scene.name or now - recent["time"] > LIST_SECONDS:
        recent.update(scene=scene.name, losses=unsupported.losses_of(scene), time=time.monotonic())
    return recent["losses"]


CLASSES = (LUMIFOLD_PT_place, LUMIFOLD_PT_frames, LUMIFOLD_PT_sampling, LUMIFOLD_PT_scene, LUMIFOLD_PT_losses,
           LUMIFOLD_PT_passes)


def shared_panels():
    """Blender's own panels that also suit this engine."""
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", None)
        if engines is not None and (panel.__name__ in versions.COMMON_PANELS or "BLENDER_RENDER" in engines):
            yield engines


def register():
    for made in CLASSES:
        bpy.utils.register_class(made)
    for engines in shared_panels():
        engines.add(ENGINE)


def unregister():
    for engines in shared_panels():
        engines.discard(ENGINE)
    for made in reversed(CLASSES):
        bpy.utils.unregister_class(made)
