"""Files that go to the farm and come from it, in pieces, from where they broke."""

from __future__ import annotations

import hashlib
import os
import pathlib
from typing import Callable, Iterator, Optional

import grpc
import xxhash

from lumifold.connection import Connection
from lumifold.errors import FarmError, SceneError, Unreachable
from lumifold.scene import Asset
from lumifold.v1 import farm_pb2, image_pb2

_PIECE = 1 << 20
Sent = Callable[[int], None]


def upload(connection: Connection, asset: Asset, sent: Optional[Sent] = None) -> None:
    """Uploads one asset. A broken upload goes on where it was."""

    def parts(offset: int) -> Iterator[farm_pb2.UploadAssetRequest]:
        yield farm_pb2.UploadAssetRequest(announce=asset.ref)
        with open(asset.path, "rb") as file:
            file.seek(offset)
            while data := file.read(_PIECE):
                chunk = image_pb2.ByteChunk(offset=offset, data=data, total_size=asset.ref.size,
                                            checksum=xxhash.xxh3_64_intdigest(data))
                yield farm_pb2.UploadAssetRequest(chunk=chunk)
                offset += len(data)
                if sent is not None:
                    sent(len(data))

    def once(stub) -> None:
        received = stub.FindUpload(farm_pb2.FindUploadRequest(asset=asset.ref), timeout=30).received_bytes
        try:
            stub.UploadAsset(parts(received))
        except grpc.RpcError as error:
            if error.code() in (grpc.StatusCode.DATA_LOSS, grpc.StatusCode.ABORTED) and received > 0:
                raise Unreachable(error.details()) from error  # from the start, then
            if error.code() is grpc.StatusCode.DATA_LOSS:
                raise SceneError(f"{asset.path}: changed while it was sent") from error
            raise

    connection.again(once)


def download(connection: Connection, job: str, frame: int, path: pathlib.Path) -> None:
    """Downloads a frame's file. It has its name once it is whole and its SHA-256 is right."""
    part = path.with_name(f"{path.name}.part")
    path.parent.mkdir(parents=True, exist_ok=True)
    part.unlink(missing_ok=True)
    expected = ""

    def once(stub) -> None:
        nonlocal expected
        offset = part.stat().st_size if part.exists() else 0
        total = None
        request = farm_pb2.DownloadResultRequest(job_id=job, frame=frame, offset=offset)
        with open(part, "ab") as file:
            for chunk in stub.DownloadResult(request):
                if chunk.offset != offset or xxhash.xxh3_64_intdigest(chunk.data) != chunk.checksum:
                    raise Unreachable("a piece of the file is damaged")
                expected = chunk.sha256 or expected
                total = chunk.total_size
                offset += len(chunk.data)
                file.write(chunk.data)
        if offset != total:
            raise Unreachable(f"the coordinator stopped sending frame {frame} of job {job}")

    try:
        connection.again(once)
        digest = hashlib.sha256()
        with open(part, "rb") as file:
            while data := file.read(_PIECE):
                digest.update(data)
        if digest.hexdigest() != expected:
            raise FarmError(f"{path} is not what the coordinator sent")
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
