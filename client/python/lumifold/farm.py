"""A farm: the coordinators that one talks to."""

from __future__ import annotations

import getpass
import os
import pathlib
import secrets
from typing import Callable, Iterator, Optional, Sequence, Union

import grpc

from lumifold import files, profiles, scene
from lumifold.connection import Connection, check_plain
from lumifold.errors import InvalidRequest
from lumifold.job import Job
from lumifold.scene import Path
from lumifold.status import Status, Worker, status_of, worker_of
from lumifold.v1 import farm_pb2, job_pb2

_DEFAULT_SERVER = "127.0.0.1:7700"
_PAGE = 1000
Frames = Union[int, range, Sequence[int]]


class Farm:
    """`address`: "host:7700", or several of one farm with commas between them; by default $LUMIFOLD_SERVER,
    else that of the profile, else this machine. `profile`: one of `lumifold login`; by default that of the
    address. Without a profile `token` and `ca` (a file of PEM certificates) say how one gets in. Plain text
    off this machine needs `insecure`. `patience`: seconds for which calls wait for a farm that is away.

    A farm may be used by several threads, and as a context manager."""

    def __init__(self, address: Optional[str] = None, *, profile: Optional[str] = None,
                 token: Optional[str] = None, ca: Optional[Path] = None, insecure: bool = False,
                 patience: float = 30.0):
        address = address or os.environ.get("LUMIFOLD_SERVER") or ""
        servers = [each.strip() for each in address.split(",") if each.strip()]
        credentials: Optional[grpc.ChannelCredentials] = None
        if token is not None:
            authority = pathlib.Path(ca).read_bytes() if ca is not None else None
            credentials = profiles.token_credentials(authority, token)
        elif (chosen := profiles.choose(profile, servers)) is not None:
            servers = servers or chosen.servers
            credentials = chosen.credentials()
        servers = servers or [_DEFAULT_SERVER]
        if credentials is None and not insecure:
            check_plain(servers)
        self._connection = Connection(servers, credentials, patience)
        # The farm knows who has credentials.
        self._user = getpass.getuser() if credentials is None else ""

    def __enter__(self) -> "Farm":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._connection.close()

    def render(self, path: Path, *, size: tuple[int, int] = (1024, 768), samples: int = 64,
               frames: Frames = 0, camera: str = "", method: str = "default",
               environment: Optional[Path] = None, max_bounces: int = 8, seed: int = 0,
               frames_per_second: float = 0.0, save_film: bool = False, name: str = "",
               user: Optional[str] = None, priority: int = 0, tags: Sequence[str] = (),
               after: Sequence[Job] = (), paused: bool = False, webhook: str = "",
               spec: Optional[job_pb2.JobSpec] = None,
               uploaded: Optional[Callable[[int, int], None]] = None) -> Job:
        """Submits a scene, a .gltf or .glb file, and returns its job. Files that the farm lacks are uploaded,
        with those that the scene names; `uploaded` is called with bytes that were sent and bytes in all.
        `webhook`: a URL that is called when the job has ended, at a host that the farm's operator allows.
        `frames`: a number, a range or a list. `environment`: a picture, or "studio". `spec`: further fields
        of JobSpec, which count more."""
        assets = scene.assets_of(path)
        job = job_pb2.JobSpec(width=size[0], height=size[1], samples_per_pixel=samples, camera=camera,
                              seed=seed, max_bounces=max_bounces, frames_per_second=frames_per_second,
                              save_film=save_film)
        job.filter.method = method
        _set_frames(job, frames)
        job.scene.file.CopyFrom(assets[0].ref)
        job.scene.display_name = pathlib.Path(path).name
        if environment == scene.STUDIO:
            job.environment.uri, job.environment.scale = scene.STUDIO, 1
        elif environment is not None:
            assets.append(scene.environment_asset(pathlib.Path(environment)))
            job.environment.uri, job.environment.scale = assets[-1].ref.uri, 1
        job.scene.dependencies.extend(asset.ref for asset in assets[1:])
        if spec is not None:
            job.MergeFrom(spec)
        self._upload(assets, uploaded)
        scheduling = job_pb2.Scheduling(priority=priority, tags=tags, name=name, paused=paused,
                                        webhook=webhook,
                                        user=self._user if user is None else user,
                                        after=[each.id for each in after])
        request = farm_pb2.SubmitJobRequest(spec=job, request_id=secrets.token_hex(16), scheduling=scheduling)
        return Job(self._connection, self._connection.call("SubmitJob", request).job_id)

    def _upload(self, assets: list[scene.Asset], uploaded: Optional[Callable[[int, int], None]]) -> None:
        request = farm_pb2.FindMissingAssetsRequest(assets=[asset.ref for asset in assets])
        missing = set(self._connection.call("FindMissingAssets", request).missing_sha256)
        lacking = {asset.ref.sha256: asset for asset in assets if asset.ref.sha256 in missing}
        total = sum(asset.ref.size for asset in lacking.values())
        done = 0

        def sent(count: int) -> None:
            nonlocal done
            done = min(total, done + count)
            if uploaded is not None:
                uploaded(done, total)

        for asset in lacking.values():
            files.upload(self._connection, asset, sent)

    def job(self, job_id: str) -> Job:
        """A job by its id. Raises NotFound."""
        job = Job(self._connection, job_id)
        job.status()
        return job

    def jobs(self, user: str = "", states: Sequence[str] = ()) -> Iterator[Status]:
        """The jobs that the caller may see, newest first. `states`: such as "done"; none: all."""
        values = [job_pb2.JobState.Value("JOB_STATE_" + state.upper().replace(" ", "_")) for state in states]
        request = farm_pb2.ListJobsRequest(limit=_PAGE, user=user, states=values)
        while True:
            page = self._connection.call("ListJobs", request)
            yield from map(status_of, page.jobs)
            if not page.next_page_token:
                return
            request.page_token = page.next_page_token

    def workers(self) -> list[Worker]:
        """The connected workers, and those that are blocked."""
        request = farm_pb2.ListWorkersRequest(limit=_PAGE)
        found: list[Worker] = []
        while True:
            page = self._connection.call("ListWorkers", request)
            found.extend(map(worker_of, page.workers))
            if not page.next_page_token:
                return found
            request.page_token = page.next_page_token

    def server_status(self) -> farm_pb2.ServerStatus:
        return self._connection.call("GetServerStatus", farm_pb2.GetServerStatusRequest())


def _set_frames(job: job_pb2.JobSpec, frames: Frames) -> None:
    numbers = [frames] if isinstance(frames, int) else sorted(set(frames))
    if not numbers:
        raise InvalidRequest("frames: there is none")
    ranges: list[list[int]] = []
    for number in numbers:
        if ranges and number == ranges[-1][0] + ranges[-1][1]:
            ranges[-1][1] += 1
        else:
            ranges.append([number, 1])
    job.first_frame, job.frame_count = ranges[0]
    job.more_frames.extend(job_pb2.FrameRange(first=first, count=count) for first, count in ranges[1:])
