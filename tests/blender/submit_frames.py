"""Submits frames of a scene by the add-on's operators, waits until they are downloaded, and reports; a script
for Blender.

    blender -b --factory-startup --addons lumifold --python submit_frames.py -- FOLDER JSON
"""

import json
import pathlib
import sys
import time

import bpy

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import render_scene
import scenes

PATIENCE_SECONDS = 600


def attempt(operator):
    try:
        return list(operator())
    except RuntimeError as error:
        return str(error)


def main(folder, wanted):
    scene = scenes.start()
    scenes.SCENES["animation"]()
    render_scene.set_up(scene, folder, wanted)
    scene.render.engine = "LUMIFOLD"
    scene.render.filepath = f"{folder}/out/shot_####"
    scene.frame_set(3)
    operators, jobs = bpy.ops.lumifold, scene.lumifold.jobs
    report = {"submitted": attempt(operators.submit_frames), "frame": scene.frame_current}
    if wanted.get("cancel"):
        report["cancelled"] = attempt(operators.cancel_frames)
    end = time.monotonic() + PATIENCE_SECONDS
    while any(job.state not in ("downloaded", "failed", "cancelled")
              for job in jobs) and time.monotonic() < end:
        attempt(operators.update_frames)
        time.sleep(0.2)
    report["jobs"] = [[job.frame, job.state, job.path, job.job] for job in jobs]
    report["forgotten"] = attempt(operators.forget_frames)
    report["left"] = len(jobs)
    (pathlib.Path(folder) / "report.json").write_text(json.dumps(report))


if __name__ == "__main__":
    folder, wanted = sys.argv[sys.argv.index("--") + 1 :]
    main(folder, json.loads(wanted))
