"""What the farm says of jobs and workers, without the protocol's own names."""

from __future__ import annotations

import dataclasses

from lumifold.v1 import farm_pb2, job_pb2, log_pb2

ENDED = ("done", "done with gaps", "failed", "cancelled")


@dataclasses.dataclass(frozen=True)
class Status:
    """A job at one time. `message` has all that the farm says of it."""
    id: str
    name: str
    state: str  # "submitted", "planned", "running", "filtering", "paused" or one of ENDED
    error: str
    progress: float  # of its samples, 0 to 1
    samples_done: int
    samples_total: int
    frames_done: int
    frames_total: int
    warnings: tuple[str, ...]
    seconds: float  # of rendering, filtering and writing
    message: job_pb2.JobStatus = dataclasses.field(repr=False, compare=False)

    @property
    def has_ended(self) -> bool:
        return self.state in ENDED

    @property
    def is_done(self) -> bool:
        """Every frame can be saved, but for those that were skipped."""
        return self.state in ("done", "done with gaps")

    def frames(self) -> list[int]:
        """The numbers of the job's frames."""
        ranges = [job_pb2.FrameRange(first=self.message.first_frame, count=self.message.frame_count),
                  *self.message.more_frames]
        return [each.first + i for each in ranges for i in range(each.count)]

    def __str__(self) -> str:
        parts = [self.name, self.state]
        if not self.has_ended:
            parts.append(f"{100 * self.progress:.0f} %")
        if self.frames_total > 1:
            parts.append(f"{self.frames_done} of {self.frames_total} frames")
        if self.error:
            parts.append(self.error)
        return ", ".join(parts)


@dataclasses.dataclass(frozen=True)
class Reason:
    """Why a job does not run, or runs slowly."""
    code: str
    text: str

    def __str__(self) -> str:
        return self.text


@dataclasses.dataclass(frozen=True)
class Event:
    """A line of the farm's log."""
    unix_seconds: float
    level: str
    text: str


@dataclasses.dataclass(frozen=True)
class Worker:
    """A worker of the farm. `message` has all that the farm says of it."""
    id: str
    name: str
    state: str
    slots: int
    jobs: tuple[str, ...]
    message: farm_pb2.WorkerStatus = dataclasses.field(repr=False, compare=False)


def status_of(message: job_pb2.JobStatus) -> Status:
    state = _word(job_pb2.JobState.Name(message.state), "JOB_STATE_")
    progress = message.samples_done / message.samples_total if message.samples_total else 0.0
    times = message.times
    return Status(
        id=message.job_id, name=message.display_name or message.job_id, state=state, error=message.error,
        progress=1.0 if state.startswith("done") else min(1.0, progress), samples_done=message.samples_done,
        samples_total=message.samples_total, frames_done=message.frames_done,
        frames_total=message.frames_total, warnings=tuple(message.warnings), message=message,
        seconds=times.render_seconds + times.assemble_seconds + times.filter_seconds + times.write_seconds)


def worker_of(message: farm_pb2.WorkerStatus) -> Worker:
    return Worker(id=message.worker_id, name=message.name or message.process,
                  state=_word(farm_pb2.WorkerState.Name(message.state), "WORKER_STATE_"), slots=message.slots,
                  jobs=tuple(message.job_ids), message=message)


def event_of(message: log_pb2.LogEvent) -> Event:
    return Event(unix_seconds=message.unix_ms / 1000, level=message.level,
                 text=message.text.decode("utf-8", "replace"))


def _word(name: str, prefix: str) -> str:
    return name[len(prefix):].lower().replace("_", " ")
