"""Frames that are rendered at the farm while Blender does something else: which frames, their jobs, and how
to ask for these. Needs no Blender."""

import dataclasses
import json
import pathlib
import re

from . import program

MOST_FRAMES = 100000
ENDED = ("done", "failed", "cancelled")
# Blender adds the suffix of its own format to a name without one.
SUFFIXES = {
    ".png", ".jpg", ".jpeg", ".exr", ".tif", ".tiff", ".bmp", ".tga", ".hdr", ".webp", ".cin", ".dpx", ".jp2",
    ".rgb"
}


@dataclasses.dataclass
class FrameJob:
    """A frame of a view layer, its job at the farm, and the file that its picture becomes."""

    job: str
    frame: int
    path: str
    state: str = "submitted"


def frames_of(text, first, last, step=1):
    """The frames of a text such as '1-48,60', in order and each once; all of the scene's range where the text
    is empty."""
    if not text.strip():
        return list(range(first, last + 1, step))
    frames = set()
    for part in text.split(","):
        found = re.fullmatch(r"\s*(\d{1,6})\s*(?:-\s*(\d{1,6})\s*)?", part)
        if not found or int(found[2] or found[1]) < int(found[1]):
            raise ValueError(f"'{part.strip()}' is no frame and no range of frames; for example 1-48,60")
        frames.update(range(int(found[1]), int(found[2] or found[1]) + 1))
        if len(frames) > MOST_FRAMES:
            raise ValueError(f"more than {MOST_FRAMES} frames")
    return sorted(frames)


def picture_path(blenders_path, layer="", layers=1):
    """The file of a frame: Blender's own name for it as OpenEXR, with the view layer where there are
    several."""
    path = pathlib.Path(blenders_path)
    stem = path.name if path.suffix.lower() not in SUFFIXES else path.stem
    return str(path.with_name((f"{stem}-{layer}" if layers > 1 else stem) + ".exr"))


def submit(executable, place, picture, quality, is_cancelled=lambda: False):
    """Submits a frame's scene; returns the job's id."""
    lines = []
    program.run(program.submit_command(executable, place, picture, quality),
                is_cancelled,
                on_output=lines.append)
    return json.loads(lines[-1])["job_id"]


def update(executable, place, job):
    """Asks for the job's state, and downloads the picture of one that is done."""
    lines = []
    program.run([executable, "status", job.job, "--json", *place.connection()], on_output=lines.append)
    job.state = json.loads(lines[-1])["state"]
    if job.state != "done":
        return
    pathlib.Path(job.path).parent.mkdir(parents=True, exist_ok=True)
    download = program.download_command(executable, place, job.job, job.frame, job.path)
    program.run(download + program.all_layers(executable))
    job.state = "downloaded"


def cancel(executable, place, job):
    if job.state in (*ENDED, "downloaded"):
        return
    program.run([executable, "cancel", job.job, *place.connection()])
    job.state = "cancelled"


def summary(jobs):
    """What the panel says of the jobs: how many are in which state."""
    counts = {}
    for job in jobs:
        counts[job.state] = counts.get(job.state, 0) + 1
    return ", ".join(f"{count} {state}" for state, count in sorted(counts.items()))
