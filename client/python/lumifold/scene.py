"""The files of a scene: the glTF file and those that it names."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import pathlib
import re
import struct
import urllib.parse
from typing import Union

from lumifold.errors import SceneError
from lumifold.v1 import scene_pb2

Path = Union[str, "os.PathLike[str]"]
_GLB_MAGIC = 0x46546C67
_JSON_CHUNK = 0x4E4F534A
_ENVIRONMENT = "environment:"
STUDIO = "studio"


@dataclasses.dataclass(frozen=True)
class Asset:
    """A local file, and what the coordinator calls it."""
    path: pathlib.Path
    ref: scene_pb2.AssetRef


def asset_of(path: pathlib.Path, uri: str) -> Asset:
    digest, size = hashlib.sha256(), 0
    try:
        with open(path, "rb") as file:
            while piece := file.read(1 << 20):
                digest.update(piece)
                size += len(piece)
    except OSError as error:
        raise SceneError(f"{path}: {error.strerror}") from error
    return Asset(path, scene_pb2.AssetRef(uri=uri, sha256=digest.hexdigest(), size=size))


def assets_of(scene: Path) -> list[Asset]:
    """The scene file first, with an empty uri."""
    path = pathlib.Path(scene)
    document = _read_json(path)
    assets = {"": asset_of(path, "")}
    for array in ("buffers", "images"):
        for item in document.get(array) or []:
            uri = item.get("uri") if isinstance(item, dict) else None
            if uri is None or uri.startswith("data:"):
                continue
            name = _file_of(path, uri)
            if name not in assets:
                assets[name] = asset_of(path.parent / name, name)
    return list(assets.values())


def environment_asset(path: Path) -> Asset:
    picture = pathlib.Path(path)
    return asset_of(picture, _ENVIRONMENT + picture.name)


def _read_json(path: pathlib.Path) -> dict:
    try:
        with open(path, "rb") as file:
            content = file.read(20)
            if len(content) == 20 and struct.unpack("<I", content[:4])[0] == _GLB_MAGIC:
                length, kind = struct.unpack("<II", content[12:])
                content = file.read(length)
                if kind != _JSON_CHUNK or len(content) != length:
                    raise SceneError(f"{path}: a GLB file that is too short, or without JSON")
            else:
                content += file.read()
        document = json.loads(content)
    except OSError as error:
        raise SceneError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise SceneError(f"{path}: not a glTF file") from error
    if not isinstance(document, dict) or "asset" not in document:
        raise SceneError(f"{path}: not a glTF file")
    return document


def _file_of(scene: pathlib.Path, uri: str) -> str:
    """The file that a scene names: one within the scene's folder."""
    name = urllib.parse.unquote(uri)
    parts = name.split("/")
    is_file = name and not re.match(r"[A-Za-z0-9+.-]{2,}:", uri) and not name.startswith(_ENVIRONMENT)
    if not is_file or "\0" in name or name.startswith("/") or ".." in parts:
        raise SceneError(f"{scene}: '{uri}' is not the name of a file in its folder")
    return name
