"""What can go wrong, as exceptions."""

from __future__ import annotations

import grpc


class FarmError(Exception):
    """All errors of this package."""


class Unreachable(FarmError):
    """No coordinator answers, or its storage is away. Later it may."""


class AuthenticationError(FarmError):
    """The farm does not know the caller: no token, or one that has ended."""


class NotAllowed(FarmError):
    """The caller's scopes do not allow this."""


class NotFound(FarmError):
    """There is no such job, frame or worker, or it is somebody else's."""


class InvalidRequest(FarmError):
    """A value that the farm does not take; the text names it."""


class NotReady(FarmError):
    """What is asked for cannot be done in the job's state, such as saving a frame that is not finished."""


class SceneError(FarmError):
    """A scene's file that is missing, or that is no glTF."""


class TimedOut(FarmError):
    """What was waited for did not come in time."""


class JobFailed(FarmError):
    """The job has failed. `status` is its last one."""

    def __init__(self, status):
        super().__init__(f"{status.name} ({status.id}) failed: {status.error}")
        self.status = status


class JobCancelled(FarmError):
    """The job was cancelled. `status` is its last one."""

    def __init__(self, status):
        super().__init__(f"{status.name} ({status.id}) was cancelled")
        self.status = status


_KINDS = {
    grpc.StatusCode.UNAVAILABLE: Unreachable,
    grpc.StatusCode.DEADLINE_EXCEEDED: Unreachable,
    grpc.StatusCode.UNAUTHENTICATED: AuthenticationError,
    grpc.StatusCode.PERMISSION_DENIED: NotAllowed,
    grpc.StatusCode.NOT_FOUND: NotFound,
    grpc.StatusCode.INVALID_ARGUMENT: InvalidRequest,
    grpc.StatusCode.OUT_OF_RANGE: InvalidRequest,
    grpc.StatusCode.FAILED_PRECONDITION: NotReady,
    grpc.StatusCode.ALREADY_EXISTS: NotReady,
}


def error_of(error: grpc.RpcError) -> FarmError:
    """The exception for an error of gRPC."""
    return _KINDS.get(error.code(), FarmError)(error.details() or error.code().name)
