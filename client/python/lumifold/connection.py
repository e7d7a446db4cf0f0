"""Calls of a farm's coordinators, of which one that answers is used."""

from __future__ import annotations

import ipaddress
import time
from typing import Callable, Iterator, Optional, TypeVar

import grpc

from lumifold.errors import FarmError, InvalidRequest, Unreachable, error_of
from lumifold.v1 import farm_pb2_grpc

Answer = TypeVar("Answer")
_CALL_SECONDS = 30.0
_PAUSES = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
_MESSAGE_BYTES = 4 << 20
_OPTIONS = [("grpc.max_receive_message_length", _MESSAGE_BYTES),
            ("grpc.max_send_message_length", _MESSAGE_BYTES), ("grpc.keepalive_time_ms", 30000)]


def check_plain(servers: list[str]) -> None:
    """Plain text is for the own machine alone, unless the caller has said that it may be read."""
    for server in servers:
        host = server.rpartition(":")[0].strip("[]")
        try:
            is_loopback = ipaddress.ip_address(host).is_loopback
        except ValueError:
            is_loopback = host == "localhost"
        if not is_loopback:
            raise InvalidRequest(f"{server}: there is no profile for this farm, and plain text off this"
                                 " machine needs insecure=True: log in with 'lumifold login', or give token"
                                 " and ca")


class Connection:
    """`patience`: seconds for which a farm that is away is waited for."""

    def __init__(self, servers: list[str], credentials: Optional[grpc.ChannelCredentials], patience: float):
        self.servers = servers
        self.patience = patience
        self._credentials = credentials
        self._at = 0
        self._channel: Optional[grpc.Channel] = None

    def close(self) -> None:
        if self._channel is not None:
            self._channel.close()
        self._channel = None

    def stub(self) -> farm_pb2_grpc.FarmServiceStub:
        if self._channel is None:
            server = self.servers[self._at % len(self.servers)]
            self._channel = (grpc.insecure_channel(server, _OPTIONS) if self._credentials is None else
                             grpc.secure_channel(server, self._credentials, _OPTIONS))
        return farm_pb2_grpc.FarmServiceStub(self._channel)

    def call(self, method: str, request) -> object:
        """A unary call, again where the farm is away: for calls that may be made twice."""
        return self.again(lambda stub: getattr(stub, method)(request, timeout=_CALL_SECONDS))

    def call_once(self, method: str, request) -> object:
        try:
            return getattr(self.stub(), method)(request, timeout=_CALL_SECONDS)
        except grpc.RpcError as error:
            raise error_of(error) from error

    def again(self, work: Callable[[farm_pb2_grpc.FarmServiceStub], Answer]) -> Answer:
        """Does what may be done twice until it succeeds, with the next coordinator where one is away."""
        for pause in self.pauses():
            try:
                return work(self.stub())
            except grpc.RpcError as error:
                failure: FarmError = error_of(error)
                if not isinstance(failure, Unreachable):
                    raise failure from error
            except Unreachable as error:
                failure = error
            self.use_next()
            time.sleep(pause)
        raise failure

    def pauses(self) -> Iterator[float]:
        """Between tries, until the patience ends; at least one."""
        end = time.monotonic() + self.patience
        for number in range(1 << 30):
            yield _PAUSES[min(number, len(_PAUSES) - 1)]
            if time.monotonic() >= end:
                return

    def use_next(self) -> None:
        self.close()
        self._at += 1
