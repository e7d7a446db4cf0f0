#!/usr/bin/env python3
"""Renders a scene on a farm from Python: uploads it, submits a job, follows it and downloads the picture, over TLS.

    farm.py SCENE.glb OUT.exr [PROFILE]

PROFILE is one of `lumifold login` (default: "default"). Needs Debian's python3-grpcio, python3-protobuf, python3-xxhash and
protobuf-compiler. The messages are those of proto/lumifold/v1, which says what each field means.
"""

import hashlib
import importlib
import os
import pathlib
import secrets
import subprocess
import sys
import tempfile

import grpc
import xxhash

PROTO = pathlib.Path(__file__).resolve().parents[2] / "proto"
PIECE = 1 << 20


def load_messages():
    """Compiles the .proto files and returns the modules farm_pb2 and job_pb2."""
    folder = tempfile.mkdtemp(prefix="lumifold-proto-")
    files = sorted(str(path.relative_to(PROTO)) for path in (PROTO / "lumifold/v1").glob("*.proto"))
    subprocess.run(["protoc", f"--proto_path={PROTO}", f"--python_out={folder}", *files], check=True)
    sys.path.insert(0, folder)
    return importlib.import_module("lumifold.v1.farm_pb2"), importlib.import_module("lumifold.v1.job_pb2")


class Farm:
    """The calls of lumifold.v1.FarmService. The service's descriptor says which messages they take and return."""

    def __init__(self, messages, profile):
        config = pathlib.Path(os.environ.get("XDG_CONFIG_HOME", pathlib.Path.home() / ".config"))
        folder = config / "lumifold" / profile
        settings = dict(line.split("=", 1) for line in (folder / "profile").read_text().splitlines() if "=" in line)
        security = grpc.composite_channel_credentials(
            grpc.ssl_channel_credentials((folder / "ca.pem").read_bytes()),
            grpc.access_token_call_credentials((folder / "token").read_text().strip()))
        self.channel = grpc.secure_channel(settings["server"].split(",")[0], security)
        service = messages.DESCRIPTOR.services_by_name["FarmService"]
        kinds = {(False, False): self.channel.unary_unary, (False, True): self.channel.unary_stream,
                 (True, False): self.channel.stream_unary, (True, True): self.channel.stream_stream}
        for method in service.methods:
            is_upload = method.name == "UploadAsset"
            is_download = method.name in ("WatchJob", "DownloadResult")
            make = kinds[is_upload, is_download]
            setattr(self, method.name, make(f"/{service.full_name}/{method.name}",
                                            request_serializer=lambda message: message.SerializeToString(),
                                            response_deserializer=method.output_type._concrete_class.FromString))


def upload(farm, messages, asset, path):
    def parts():
        yield messages.UploadAssetRequest(announce=asset)
        with open(path, "rb") as file:
            offset = 0
            while data := file.read(PIECE):
                part = messages.UploadAssetRequest()
                part.chunk.offset, part.chunk.data, part.chunk.total_size = offset, data, asset.size
                part.chunk.checksum = xxhash.xxh3_64_intdigest(data)
                offset += len(data)
                yield part

    farm.UploadAsset(parts())


def render(scene, output, profile="default"):
    messages, job_messages = load_messages()
    farm = Farm(messages, profile)
    content = pathlib.Path(scene).read_bytes()

    spec = job_messages.JobSpec(width=320, height=240, frame_count=1, samples_per_pixel=16, max_bounces=8)
    spec.scene.display_name = pathlib.Path(scene).name
    spec.scene.file.sha256, spec.scene.file.size = hashlib.sha256(content).hexdigest(), len(content)
    if farm.FindMissingAssets(messages.FindMissingAssetsRequest(assets=[spec.scene.file])).missing_sha256:
        upload(farm, messages, spec.scene.file, scene)
    job = farm.SubmitJob(messages.SubmitJobRequest(spec=spec, request_id=secrets.token_hex(16))).job_id

    for status in farm.WatchJob(messages.WatchJobRequest(job_id=job)):
        print(f"{job}: {job_messages.JobState.Name(status.state)}, {status.samples_done} of {status.samples_total} samples", file=sys.stderr)
    if status.state != job_messages.JOB_STATE_DONE:
        sys.exit(f"{job}: {status.error}")

    with open(output, "wb") as file:
        for chunk in farm.DownloadResult(messages.DownloadResultRequest(job_id=job)):
            if chunk.sha256:
                expected = chunk.sha256
            file.write(chunk.data)
    if hashlib.sha256(pathlib.Path(output).read_bytes()).hexdigest() != expected:
        sys.exit(f"{output} is not what the coordinator sent")
    print(job)


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    render(*sys.argv[1:])
