"""Where the files of a campaign are, and their digests."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..points.read import MARKED_SUFFIXES, POINT_SUFFIXES
from ..tables.read import Frame, TableSource
from ..text.files import fingerprint, trouble
from ..text.toml import refuse
from .config import CampaignConfig
from .marks.point_files import PointFiles
from .settings import Settings

_RASTERS = ("landmarks.dem", "landmarks.geoid")
_BESIDE = (".shx", ".dbf", ".prj", ".cpg")
"""Endings of files that belong to a shapefile."""


@dataclass(frozen=True)
class Files:
    """Tables and files by the key that names them, ``names`` as the campaign writes them; files of ground points are in
    ``points``, by their section.  ``folder`` is what names are relative to."""

    names: dict[str, str]
    tables: dict[str, TableSource]
    points: dict[str, PointFiles]
    folder: Path = Path()

    @classmethod
    def of(cls, config: CampaignConfig, given: Settings, without: Collection[str] = ()) -> Files:
        """Every table given, and where each named file is, but those of the sections ``without``.

        Raises InputError that lists all that cannot be opened.
        """
        points = {key: each for key, each in _point_files(config, given).items() if key not in without}
        names = {
            key: name
            for key, name in _named(config).items()
            if key.removesuffix(".file") not in points and key.partition(".")[0] not in without
        }
        tables = {key: given.tables.get(key, given.folder / name) for key, name in names.items()}
        places = {key: place for key, place in tables.items() if isinstance(place, Path)}
        places |= {f"{key}.file": path for key, each in points.items() for path in each.paths}
        faults = [(key, place, trouble(place)) for key, place in places.items()]
        if problems := [f"{key}: {place}: {fault}" for key, place, fault in faults if fault]:
            raise refuse(given.name, problems)
        return cls(names, tables, points, given.folder)

    def path(self, key: str) -> Path | None:
        """The file of a key that no data frame can stand for, where there is one."""
        place = self.tables.get(key)
        return place if isinstance(place, Path) else None

    def of_points(self, section: str) -> TableSource | PointFiles:
        """What a section names that may name files of ground points."""
        return self.points[section] if section in self.points else self.tables[f"{section}.file"]

    def paths(self, further: Sequence[str] = ()) -> tuple[Path, ...]:
        """Every file that is read, with ``further`` ones that the tables name."""
        tables = [place for place in self.tables.values() if isinstance(place, Path)]
        beside = [place.with_suffix(end) for place in tables for end in _BESIDE if _is_shape(place)]
        points = [path for each in self.points.values() for path in each.paths]
        return (*tables, *beside, *points, *map(self.folder.joinpath, further))

    def fingerprints(self, further: Sequence[str] = ()) -> dict[str, str]:
        """The digest of every table and file by its name, and of ``further`` ones that the tables name."""
        found: dict[str, str] = {}
        for key, name in self.names.items():
            found |= _fingerprints(name, self.tables[key], raster=key in _RASTERS)
        for each in self.points.values():
            found |= {name: fingerprint(path) for name, path in zip(each.names, each.paths, strict=True)}
        return found | {name: fingerprint(self.folder / name) for name in further}


def names_of(config: CampaignConfig) -> list[str]:
    """The names of the files of a campaign as it writes them, but those of its marks."""
    marks = ("landmarks", "observations", "detections")
    return [name for key, name in _named(config).items() if key.partition(".")[0] not in marks]


def _named(config: CampaignConfig) -> dict[str, str]:
    """Key and name of every file of the campaign."""
    named = {"ephemeris.file": config.ephemeris.file, "landmarks.file": _listed(config.landmarks.file)}
    optional = {
        "images.file": config.images.file,
        "landmarks.dem": config.landmarks.dem,
        "landmarks.geoid": config.landmarks.geoid,
        "observations.file": config.observations and _listed(config.observations.file),
        "detections.file": config.detections and _listed(config.detections.file),
        "earth.orientation_file": config.earth and config.earth.orientation_file,
    }
    optional |= {
        look_angles_key(config, name): camera.look_angles for name, (camera, _) in config.optics.items()
    }
    attitudes = {f"{key}.file": section.file for key, section in config.attitudes.items()}
    for key, section in config.attitudes.items():
        attitudes |= {f"{key}.kernels.{i}": name for i, name in enumerate(section.kernels)}
    return named | attitudes | {key: name for key, name in optional.items() if name}


def look_angles_key(config: CampaignConfig, name: str) -> str:
    """The key that names the look directions of a camera."""
    section = "camera" if config.cameras is None else f"cameras.{list(config.optics).index(name)}"
    return f"{section}.look_angles"


def _listed(file: str | Sequence[str]) -> str:
    return file if isinstance(file, str) else ", ".join(file)


def _point_files(config: CampaignConfig, given: Settings) -> dict[str, PointFiles]:
    """The sections that name files of ground points, and these."""
    sections = {"landmarks": config.landmarks, "observations": config.observations}
    same = config.observations is not None and config.landmarks.file == config.observations.file
    found = {}
    for key, section in sections.items():
        if section is not None and not isinstance(place := given.tables.get(f"{key}.file"), Frame):
            folder = given.folder if place is None else Path()
            endings = MARKED_SUFFIXES if same or key == "observations" else POINT_SUFFIXES
            found[key] = PointFiles.of(folder, section.file, section.crs, endings)
    return {key: files for key, files in found.items() if files is not None}


def _fingerprints(name: str, place: TableSource, raster: bool = False) -> dict[str, str]:
    """Digest of a table or file, and of those that are read with it: a shapefile keeps its attributes in a second one,
    a raster may keep what it lacks beside it."""
    if isinstance(place, Frame):
        return {name: place.fingerprint()}
    parts = [place.with_suffix(end) for end in _BESIDE] if _is_shape(place) else []
    if raster:
        from ..gis.drivers import parts_of

        parts = parts_of(place)
    beside = {Path(name).with_name(part.name).as_posix(): part for part in parts if part.is_file()}
    return {key: fingerprint(part) for key, part in ({name: place} | beside).items()}


def _is_shape(place: Path) -> bool:
    return place.suffix.lower() == ".shp"
