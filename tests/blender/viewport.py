"""Renders viewports of a scene without their window, and reports what they would show; a script for Blender.

    blender -b --factory-startup --addons lumifold --python viewport.py -- FOLDER
"""

import json
import pathlib
import sys
import time

import bpy
import numpy

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import render_scene
import scenes
from lumifold import exr, preferences, viewport

PATIENCE_SECONDS = 600
WIDTH, HEIGHT = 320, 240


class Window:
    """Keeps what one viewport would draw."""

    def __init__(self):
        self.sizes, self.stages = [], []
        self.render = viewport.ViewportRender(preferences.program_path(), self.changed)

    def changed(self):
        self.sizes.append(list(self.render.picture.shape[:2]) if self.render.picture is not None else [])
        self.stages.append(self.render.stage)

    def wait(self, condition):
        end = time.monotonic() + PATIENCE_SECONDS
        while not condition() and time.monotonic() < end:
            time.sleep(0.05)

    def show(self, view):
        """Renders a view to its end."""
        self.render.set_view(view)
        self.render.thread.join(PATIENCE_SECONDS)


def view_of_camera(depsgraph):
    thing = bpy.context.scene.camera.evaluated_get(depsgraph)
    projection = thing.calc_matrix_camera(depsgraph, x=WIDTH, y=HEIGHT)
    return viewport.View(*(tuple(map(tuple, one)) for one in (thing.matrix_world, projection)),
                         (WIDTH, HEIGHT))


def main(folder):
    scene = scenes.start()
    scenes.SCENES["square_light"]()
    render_scene.set_up(scene, folder, {"settings": {"samples": 64}})
    scene.render.engine = "LUMIFOLD"
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    window, view = Window(), view_of_camera(depsgraph)
    window.render.set_scene(depsgraph)
    window.show(view)
    report = {"first": list(window.sizes)}
    seen, last = len(window.sizes), window.render.picture
    window.render.set_view(view)
    report["repeated"] = len(window.sizes) - seen
    turned = viewport.View(tuple(reversed(view.matrix[:2])) + view.matrix[2:], view.projection, view.size)
    window.render.set_view(turned)
    window.wait(lambda: len(window.sizes) > seen)
    window.show(view)
    report["interrupted"] = window.sizes[seen:]
    scene.lumifold.method = "shiny"
    window.render.set_scene(depsgraph)
    window.show(view)
    report["error"] = window.stages[-1]
    window.render.close()

    scene.lumifold.method = "default"
    scene.render.resolution_x, scene.render.resolution_y = 2 * WIDTH, 2 * HEIGHT  # at 50 %
    scene.render.filepath = f"{folder}/lumifold.exr"
    bpy.ops.render.render(write_still=True)
    film = exr.read(f"{folder}/lumifold.exr")
    rendered = numpy.dstack([film[f"ViewLayer.Combined.{channel}"] for channel in "RGB"])
    report["difference"] = float(numpy.abs(rendered - last[..., :3]).mean() / rendered.mean())
    (pathlib.Path(folder) / "report.json").write_text(json.dumps(report))


if __name__ == "__main__":
    main(sys.argv[-1])
