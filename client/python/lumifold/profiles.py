"""Profiles that `lumifold login` has written: how one gets into a farm."""

from __future__ import annotations

import os
import pathlib
from typing import Optional

import grpc

from lumifold.errors import InvalidRequest

DEFAULT = "default"


class Profile:
    """A folder with the files `profile`, `ca.pem`, and `token` or `person.pem`."""

    def __init__(self, folder: pathlib.Path):
        self.folder = folder
        text = (folder / "profile").read_text(encoding="utf-8")
        self.values = dict(line.split("=", 1) for line in text.splitlines() if "=" in line)

    @property
    def servers(self) -> list[str]:
        return self.values["server"].split(",")

    def credentials(self) -> grpc.ChannelCredentials:
        authority = (self.folder / "ca.pem").read_bytes()
        if (self.folder / "token").exists():
            token = (self.folder / "token").read_text(encoding="ascii").strip()
            return token_credentials(authority, token)
        person = (self.folder / "person.pem").read_bytes()
        return grpc.ssl_channel_credentials(authority, person, person)


def token_credentials(authority: Optional[bytes], token: str) -> grpc.ChannelCredentials:
    """TLS with a token in each call. `authority`: certificates in PEM; None: those of the system."""
    return grpc.composite_channel_credentials(grpc.ssl_channel_credentials(authority),
                                              grpc.access_token_call_credentials(token))


def _root() -> pathlib.Path:
    config = os.environ.get("XDG_CONFIG_HOME")
    return (pathlib.Path(config) if config else pathlib.Path.home() / ".config") / "lumifold"


def choose(name: Optional[str], servers: list[str]) -> Optional[Profile]:
    """The named profile; otherwise the default one, if it has one of the servers or none is given; otherwise
    the first by name that has one. None where there is none."""
    root = _root()
    if name:
        if not (root / name / "profile").is_file():
            raise InvalidRequest(f"there is no profile '{name}' in {root}")
        profile = Profile(root / name)
        if servers and not set(servers) & set(profile.servers):
            own = ",".join(profile.servers)
            raise InvalidRequest(f"the profile '{name}' is of {own}, not of {','.join(servers)}")
        return profile
    names = sorted(path.parent.name for path in root.glob("*/profile")) if root.is_dir() else []
    for each in sorted(names, key=lambda one: one != DEFAULT):
        profile = Profile(root / each)
        if profile.values.get("kind") == "worker" or (not servers and each != DEFAULT):
            continue
        if not servers or set(servers) & set(profile.servers):
            return profile
    return None
