"""The settings of a campaign, a file or a dictionary, with the tables that are given in place of those it names."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...disk.parts import half_placed
from ...physics.errors import InputError, did_you_mean
from ..tables.read import Frame, TableSource
from ..text.files import fingerprint, show
from ..text.toml import plain, read_toml
from ..text.values import InMemory

TABLES = ("ephemeris", "attitude", "landmarks", "images", "observations", "detections", "look_angles")
"""Names of tables; those of several star trackers are ``trackers.0``, ``trackers.1`` and so on."""


@dataclass(frozen=True)
class Settings:
    """The content of ``campaign.toml``.

    ``name`` is what messages call it; ``folder`` is what the names of its files are relative to; ``digest`` is its
    entry among the inputs of a result; ``tables`` are those given in place of files, by the key that names them.
    """

    name: str
    document: dict[str, Any]
    folder: Path
    digest: dict[str, str]
    tables: dict[str, TableSource]


def read_settings(settings: Path | Mapping[str, Any], tables: Mapping[str, object] | None) -> Settings:
    """Settings from ``campaign.toml`` or its content, with the tables that go before those it names.

    Raises InputError for a file that cannot be read, and for a table of an unknown name or kind.
    """
    if isinstance(settings, Mapping):
        document = plain(settings)
        text = json.dumps(document, sort_keys=True, default=str)
        digest = {"settings": "sha256:" + hashlib.sha256(text.encode()).hexdigest()}
        read = Settings("settings", document, Path(), digest, {})
    else:
        _require_no_folder(settings)
        _require_whole(settings)
        document = read_toml(settings)
        digest = {"campaign.toml": fingerprint(settings)}
        read = Settings(str(settings), document, settings.parent, digest, {})
    for name, data in (tables or {}).items():
        if data is not None:
            _take(read, name, data)
    return read


def _require_no_folder(path: Path) -> None:
    """Raise InputError where the folder of a campaign is given for its description."""
    if (path / "campaign.toml").is_file():
        raise InputError(f"{path}: found a folder, wanted the campaign.toml in it: {path / 'campaign.toml'}")


def _require_whole(path: Path) -> None:
    """Raise InputError where some files beside a campaign are of another state than it."""
    begun = half_placed(path.parent)
    if begun is not None and path.name in begun[1]:
        raise InputError(
            f"{path}: found files that a killed command had begun to put in place, wanted all of them; run the same "
            "command again"
        )


def _take(read: Settings, name: str, data: object) -> None:
    """Enter a table among the settings, as the file of its section."""
    section, key = _section(read.document, name)
    if isinstance(data, str | Path):
        read.tables[f"{name}.file" if key == "file" else f"camera.{key}"] = Path(data)
        section[key] = str(data)
    else:
        frame = Frame.of(f"{name} data frame", data)
        read.tables[f"{name}.file" if key == "file" else f"camera.{key}"] = frame
        section[key] = InMemory(frame.name)


def _section(document: dict[str, Any], name: str) -> tuple[dict[str, Any], str]:
    """The section that names a table, and its key there; a section that is missing is begun."""
    trackers = document.get("trackers", [])
    if isinstance(trackers, list):
        for i, tracker in enumerate(trackers):
            if name == f"trackers.{i}" and isinstance(tracker, dict):
                return tracker, "file"
    if name not in TABLES:
        hint = did_you_mean(name, TABLES)
        raise InputError(f"tables: found {show(name)}, wanted names among {', '.join(TABLES)}{hint}")
    key = "look_angles" if name == "look_angles" else "file"
    section = document.setdefault("camera" if name == "look_angles" else name, {})
    return (section if isinstance(section, dict) else {}), key
