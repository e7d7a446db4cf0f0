"""A job of a farm."""

from __future__ import annotations

import pathlib
import re
import time
from typing import Callable, Iterator, Optional, Sequence

import grpc

from lumifold import files
from lumifold.connection import Connection
from lumifold.errors import InvalidRequest, JobCancelled, JobFailed, NotFound, TimedOut, Unreachable, error_of
from lumifold.preview import Preview, preview_of
from lumifold.scene import Path
from lumifold.status import Event, Reason, Status, event_of, status_of
from lumifold.v1 import farm_pb2

_LOOK_SECONDS = 60.0


class Job:
    """Made by Farm.render, Farm.job and Farm.jobs. Calls ask the farm; nothing is kept but the id."""

    def __init__(self, connection: Connection, job_id: str):
        self._connection = connection
        self.id = job_id

    def __repr__(self) -> str:
        return f"Job({self.id!r})"

    def status(self) -> Status:
        return status_of(self._connection.call("GetJob", farm_pb2.GetJobRequest(job_id=self.id)))

    def watch(self) -> Iterator[Status]:
        """The status now and after each change, until the job has ended. Goes on over lost connections."""
        last: Optional[Status] = None
        request = farm_pb2.WatchJobRequest(job_id=self.id)
        pauses = self._connection.pauses()
        while last is None or not last.has_ended:
            try:
                for message in self._connection.stub().WatchJob(request, timeout=_LOOK_SECONDS):
                    pauses = self._connection.pauses()
                    status = status_of(message)
                    if last is None or status.message != last.message:
                        yield status
                    last = status
            except grpc.RpcError as error:
                if error.code() is grpc.StatusCode.DEADLINE_EXCEEDED:
                    continue  # nothing has changed for a while
                failure = error_of(error)
                pause = next(pauses, None)
                if not isinstance(failure, Unreachable) or pause is None:
                    raise failure from error
                self._connection.use_next()
                time.sleep(pause)

    def wait(self, progress: Optional[Callable[[Status], None]] = None,
             timeout: Optional[float] = None) -> Status:
        """Waits until the job is done. `progress` is called with each status, `timeout` is in seconds.
        Raises JobFailed, JobCancelled and TimedOut."""
        end = None if timeout is None else time.monotonic() + timeout
        for status in self._poll(end) if end is not None else self.watch():
            if progress is not None:
                progress(status)
        if status.state == "failed":
            raise JobFailed(self.status())
        if status.state == "cancelled":
            raise JobCancelled(status)
        return status

    def _poll(self, end: float) -> Iterator[Status]:
        """As watch, but raises TimedOut at `end`, also while nothing changes."""
        last: Optional[Status] = None
        while last is None or not last.has_ended:
            status = self.status()
            if last is None or status.message != last.message:
                yield status
            last = status
            if not last.has_ended:
                if time.monotonic() >= end:
                    raise TimedOut(f"{last} after the time to wait for it")
                time.sleep(min(0.5, max(0.0, end - time.monotonic())))

    def save(self, path: Path, frame: Optional[int] = None) -> pathlib.Path:
        """Writes the OpenEXR file of a frame, by default of the first one. "#" in the name stand for digits
        of its number. Returns the file's path. Raises NotReady while the frame is not finished."""
        target = pathlib.Path(path)
        if target.suffix.lower() != ".exr":
            raise InvalidRequest(f"{target}: results are OpenEXR files, name it .exr; 'lumifold convert'"
                                 " makes others")
        number = self.status().frames()[0] if frame is None else frame
        name = re.sub("#+", lambda digits: str(number).zfill(len(digits[0])), target.name)
        files.download(self._connection, self.id, number, target.with_name(name))
        return target.with_name(name)

    def save_all(self, path: Path) -> list[pathlib.Path]:
        """Writes the files of all frames; "####" in the name stands for the number. Frames that the job skips
        have none."""
        status = self.status()
        gaps = status.message.scheduling.gaps.skipped
        skipped = {each.first + i for each in gaps for i in range(each.count)}
        frames = [frame for frame in status.frames() if frame not in skipped]
        if len(frames) > 1 and "#" not in pathlib.Path(path).name:
            raise InvalidRequest(f"{path}: several frames need '####' for their numbers in it")
        return [self.save(path, frame) for frame in frames]

    def preview(self, layer: str = "", frame: Optional[int] = None,
                newer_than: Optional[Preview] = None) -> Optional[Preview]:
        """A small picture of what is rendered so far; waits up to 5 s for one that has more units. None:
        there is nothing newer."""
        number = self.status().frames()[0] if frame is None else frame
        request = farm_pb2.GetPreviewRequest(job_id=self.id, frame=number, layer=layer,
                                             newer_than_units=newer_than.units if newer_than else 0)
        try:
            return preview_of(self._connection.stub().GetPreview(request, timeout=30))
        except grpc.RpcError as error:
            if error.code() is grpc.StatusCode.OUT_OF_RANGE:
                return None
            raise error_of(error) from error

    def explain(self) -> list[Reason]:
        """Why the job does not run, or runs slowly; empty for one that runs as it should."""
        explained = self._connection.call("ExplainJob", farm_pb2.ExplainJobRequest(job_id=self.id))
        return [Reason(each.code, each.text) for each in explained.reasons]

    def log(self, limit: int = 100) -> list[Event]:
        """The last lines of the farm's log about the job, oldest first."""
        answer = self._connection.call("GetLog", farm_pb2.GetLogRequest(job_id=self.id, limit=limit))
        return [event_of(each) for each in answer.events]

    def cancel(self) -> Status:
        return self._change("CancelJob", farm_pb2.CancelJobRequest(job_id=self.id))

    def pause(self) -> Status:
        return self._change("PauseJob", farm_pb2.PauseJobRequest(job_id=self.id))

    def resume(self) -> Status:
        return self._change("ResumeJob", farm_pb2.ResumeJobRequest(job_id=self.id))

    def set_priority(self, priority: int) -> Status:
        request = farm_pb2.SetJobPriorityRequest(job_id=self.id, priority=priority)
        return self._change("SetJobPriority", request)

    def move_to_front(self) -> Status:
        request = farm_pb2.SetJobPriorityRequest(job_id=self.id, to_front=True)
        return self._change("SetJobPriority", request)

    def add_samples(self, samples: int) -> Status:
        """Gives the job this many samples per pixel in all."""
        request = farm_pb2.AddSamplesRequest(job_id=self.id, samples_per_pixel=samples)
        return self._change("AddSamples", request)

    def retry(self, frames: Sequence[int] = (), skip: bool = False) -> Status:
        """Renders what failed or is named again; with `skip` goes on without it."""
        request = farm_pb2.RetryJobRequest(job_id=self.id, frames=frames, skip=skip)
        return status_of(self._connection.call_once("RetryJob", request))

    def delete(self) -> None:
        """Deletes the job, which must have ended, with its pictures."""
        try:
            self._connection.call("DeleteJob", farm_pb2.DeleteJobRequest(job_id=self.id))
        except NotFound:
            pass  # an earlier try has deleted it, or somebody else

    def _change(self, method: str, request) -> Status:
        return status_of(self._connection.call(method, request))
