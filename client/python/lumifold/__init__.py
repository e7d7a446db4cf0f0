"""Renders glTF scenes on a Lumifold farm.

    from lumifold import Farm

    farm = Farm("host:7700")
    job = farm.render("scene.glb", size=(1920, 1080), samples=256)
    job.wait(progress=print)
    job.save("out.exr")

The messages of the protocol are in lumifold.v1, made of proto/lumifold/v1, which says what each field means.
"""

from lumifold.errors import (AuthenticationError, FarmError, InvalidRequest, JobCancelled, JobFailed,
                             NotAllowed, NotFound, NotReady, SceneError, TimedOut, Unreachable)
from lumifold.farm import Farm
from lumifold.job import Job
from lumifold.preview import Preview
from lumifold.status import Event, Reason, Status, Worker

__all__ = [
    "AuthenticationError", "Event", "Farm", "FarmError", "InvalidRequest", "Job", "JobCancelled", "JobFailed",
    "NotAllowed", "NotFound", "NotReady", "Preview", "Reason", "SceneError", "Status", "TimedOut",
    "Unreachable", "Worker"
]
