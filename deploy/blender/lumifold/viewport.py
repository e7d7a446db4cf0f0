"""The rendered viewport: a coarse picture at once, then finer ones; begun anew when the scene or the view
changes. The program renders beside Blender, whose own thread only exports and draws."""

import dataclasses
import pathlib
import tempfile
import threading

import numpy

from . import camera, exr, export, program, world
from .gltf import GltfBuilder

# One after another: pixels of the window for a pixel of the picture, and samples.
STEPS = ((8, 4), (3, 16), (1, 64))


@dataclasses.dataclass(frozen=True)
class View:
    """What a region of the window shows of the scene: matrices as tuples of rows, size in pixels."""

    matrix: tuple
    projection: tuple
    size: tuple

    @staticmethod
    def of(region, region_data):
        rows = (region_data.view_matrix.inverted(), region_data.window_matrix)
        return View(*(tuple(map(tuple, one)) for one in rows), (region.width, region.height))


class ViewportRender:
    """One viewport's pictures. `on_change` is called in another thread when there is a newer picture or
    error."""

    def __init__(self, executable, on_change):
        self.executable, self.on_change = executable, on_change
        self.folder = tempfile.TemporaryDirectory(prefix="lumifold-viewport-")
        self.thread, self.cancelled = None, threading.Event()
        self.builder, self.environment, self.view = None, "", None
        self.picture, self.stage = None, ""  # (height, width, 4), rows from the top; replaced as a whole
        self.exports = self.runs = 0

    def set_scene(self, depsgraph):
        """Exports the scene as it is now. Its view is rendered anew by the next `set_view`."""
        self.stop()
        self.exports += 1
        folder = pathlib.Path(self.folder.name, f"scene-{self.exports}")
        folder.mkdir()
        scene = depsgraph.scene
        builder = GltfBuilder()
        export.add_objects(depsgraph, builder, folder)
        builder.write(folder / "scene.gltf")
        self.environment = world.write_environment(scene.world, folder, scene.lumifold.world_width,
                                                   scene.frame_current)
        self.quality = scene.lumifold.quality()
        self.builder, self.view, self.scene_folder = builder, None, folder

    def set_view(self, view):
        """Renders a view, unless that is done or in progress."""
        if self.builder is None or view == self.view or min(view.size) < 1:
            return
        self.stop()
        self.view, self.cancelled = view, threading.Event()
        self.thread = threading.Thread(target=self.run, args=(view, self.cancelled), daemon=True)
        self.thread.start()

    def run(self, view, cancelled):
        builder = self.builder.fork()
        builder.camera("view", numpy.array(view.matrix), camera.gltf_camera(view.projection))
        self.runs += 1
        scene = self.scene_folder / f"view-{self.runs}.gltf"
        builder.write(scene)
        try:
            for step, (divisor, samples) in enumerate(STEPS):
                size = tuple(max(side // divisor, 1) for side in view.size)
                picture = program.Picture(str(scene), size, environment=self.environment)
                quality = dataclasses.replace(self.quality, until="SAMPLES", samples=samples)
                output = self.scene_folder / f"view-{self.runs}-{step}.exr"
                program.render_here(self.executable, program.Place(), picture, quality, str(output), "",
                                    cancelled.is_set, lambda progress: None, lambda: None)
                self.show(exr.read(output), cancelled, f"{samples} samples")
                output.unlink()
        except program.Cancelled:
            pass
        except (program.ProgramError, OSError, ValueError) as error:
            self.show(None, cancelled, str(error))
        finally:
            scene.unlink(missing_ok=True)

    def show(self, film, cancelled, stage):
        if cancelled.is_set():
            return
        if film is not None:
            alpha = numpy.ones_like(film["R"])
            self.picture = numpy.dstack([*(film[name] for name in "RGB"), alpha])
        self.stage = stage
        self.on_change()

    def stop(self):
        """Ends what is being rendered."""
        self.cancelled.set()
        if self.thread is not None:
            self.thread.join()
            self.thread = None

    def close(self):
        self.stop()
        self.folder.cleanup()
