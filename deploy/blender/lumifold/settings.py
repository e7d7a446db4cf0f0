"""Settings of a scene: `scene.lumifold`."""

import bpy
from bpy.props import BoolProperty, CollectionProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from . import program


class LumifoldFrameJob(bpy.types.PropertyGroup):
    """A `frame_jobs.FrameJob`, kept in the file."""

    job: StringProperty()
    frame: IntProperty()
    path: StringProperty()
    state: StringProperty(default="submitted")


class LumifoldSettings(bpy.types.PropertyGroup):
    where: EnumProperty(
        name="Render on",
        items=(
            ("HERE", "This Machine", "Render with this machine's processors"),
            ("FARM", "Farm", "Submit a job to a coordinator"),
        ),
    )
    server: StringProperty(
        name="Coordinator",
        description=
        "HOST:PORT, or a list of them with commas; empty: LUMIFOLD_SERVER, or the server of the default profile",
    )
    profile: StringProperty(name="Profile",
                            description="Profile made by 'lumifold login'; empty: that of the server")
    insecure: BoolProperty(
        name="Unencrypted",
        description="Allow a coordinator on another machine without a profile: all goes there unencrypted")
    priority: IntProperty(name="Priority",
                          min=-100,
                          max=100,
                          description="Ten more doubles the job's share of the farm")
    frames: StringProperty(name="Frames",
                           description="Frames to submit, such as 1-48,60; empty: those of the scene")
    jobs: CollectionProperty(type=LumifoldFrameJob)
    threads: IntProperty(name="Threads", min=0, max=1024, description="Threads on this machine; 0: all")

    until: EnumProperty(
        name="Stop at",
        items=(
            ("SAMPLES", "Samples", "A number of samples per pixel"),
            ("ERROR", "Error", "An estimated error of the filtered picture"),
            ("TIME", "Time", "A render time for each frame"),
        ),
    )
    samples: IntProperty(name="Samples",
                         default=64,
                         min=1,
                         max=1 << 20,
                         description="Samples per pixel; at most, where sampling is adaptive")
    adaptive: BoolProperty(name="Adaptive",
                           description="Put the samples where the filtered picture still errs")
    most_samples: IntProperty(name="Max Samples",
                              default=4096,
                              min=1,
                              max=1 << 20,
                              description="Samples per pixel, at most")
    target_error: FloatProperty(name="Error",
                                default=10,
                                min=0.001,
                                description="Mean squared error in steps of 8-bit sRGB, after the filter")
    seconds: FloatProperty(name="Time",
                           default=60,
                           min=1,
                           subtype="TIME_ABSOLUTE",
                           description="Render time of a frame")
    max_bounces: IntProperty(name="Max Bounces",
                             default=8,
                             min=0,
                             max=1024,
                             description="Scattering events after the first surface")
    seed: IntProperty(name="Seed", min=0)
    method: StringProperty(name="Filter",
                           default="default",
                           description="Method of the filter: 'default', 'none' or another")

    soft_points: BoolProperty(
        name="Points as Spheres",
        default=True,
        description=
        "Point lights with a radius become emitting spheres with soft shadows, which the camera sees",
    )
    world_width: IntProperty(name="World Width",
                             default=1024,
                             min=16,
                             max=8192,
                             description="Width of the picture into which the world is baked")
    bake_resolution: IntProperty(
        name="Bake Textures",
        default=0,
        min=0,
        max=16384,
        description="Width of the pictures into which procedural textures and bumps of objects with a UV map are "
        "baked; 0: they are not carried over")
    pass_noisy: BoolProperty(name="Noisy Image", default=True, description="The picture before the filter")
    pass_reflection: BoolProperty(name="Reflection",
                                  description="Light of glossy lobes, mirrors and glass, before the filter")

    def quality(self):
        """The settings that `program` understands."""
        return program.Quality(
            until=self.until,
            samples=self.samples if self.until == "SAMPLES" else self.most_samples,
            adaptive=self.adaptive,
            target_error=self.target_error,
            seconds=self.seconds,
            max_bounces=self.max_bounces,
            seed=self.seed,
            method=self.method,
        )

    def place(self):
        return program.Place(
            on_farm=self.where == "FARM",
            server=self.server,
            profile=self.profile,
            insecure=self.insecure,
            priority=self.priority,
            threads=self.threads,
        )


def register():
    bpy.utils.register_class(LumifoldFrameJob)
    bpy.utils.register_class(LumifoldSettings)
    bpy.types.Scene.lumifold = PointerProperty(type=LumifoldSettings)


def unregister():
    del bpy.types.Scene.lumifold
    bpy.utils.unregister_class(LumifoldSettings)
    bpy.utils.unregister_class(LumifoldFrameJob)
