"""Reference systems by pyproj: places between a file's own system and WGS 84, without guesses and without network.

PROJ answers every question.  Where it knows no transformation between two datums it leaves the numbers as they are (a
"ballpark" of up to hundreds of metres), and where a grid is missing it takes a coarser way.  Here a transformation must
be known at the place itself, and what it is worth is told.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...physics.errors import InputError
from ..text.files import show

if TYPE_CHECKING:
    from pyproj import CRS, Transformer

Array = NDArray[np.float64]

_ODM = re.compile(r"WGS[ _]?84\s+UTM\s+(\d{1,2})\s*([NS])", re.IGNORECASE)
_CODE = re.compile(r"(urn:ogc:def:crs:)?[A-Za-z_]+:[\w.]*:{0,2}[\w.]+(\+\d+)?", re.ASCII)
_WKT = re.compile(r"[A-Z_]+\d*\s*[\[(]", re.ASCII)
_PLAIN_PROJ = re.compile(
    r"(\s*\+(proj|zone|south|north|ellps|datum|units|no_defs|type|lat_\w+|lon_\w+|x_0|y_0|k|k_0|a|b|rf|towgs84|axis|pm)"
    r"(=[\w.,+-]*)?)+",
    re.ASCII,
)
_NAMES_A_FILE = re.compile(r"PARAMETERFILE|grids\s*=|init\s*=|\+proj=pipeline", re.IGNORECASE)
WGS84 = ("EPSG:4326", "EPSG:4979", "OGC:CRS84")
_EARTH_AXIS_M = (6.3770e6, 6.3790e6)
_SAME_HEIGHT_M = 0.01


@dataclass(frozen=True)
class Wgs84Places:
    """Longitude and latitude (n,) in degrees and heights (n,) m of WGS 84, None where none were given."""

    longitude: Array
    latitude: Array
    height: Array | None
    notices: tuple[str, ...] = ()


def to_wgs84(
    where: Path,
    reference: str,
    x: Array,
    y: Array,
    height: Array | None = None,
    *,
    on_own_ellipsoid: bool = False,
) -> Wgs84Places:
    """Places (n,) of the system ``reference``: ``x`` eastward or longitude, ``y`` northward or latitude.

    ``on_own_ellipsoid`` says that ``height`` is above the ellipsoid of the file's own datum.  Raises InputError for a
    system that is not known, has heights of its own, is not of the Earth, or from which no transformation is known.
    """
    if reference in WGS84:
        _require_degrees(where, x, y)
        return Wgs84Places(x, y, height)
    with _without_network(where):
        crs = horizontal(where, reference)
        if crs.to_epsg() in (4326, 4979):
            return to_wgs84(where, WGS84[0], x, y, height)
        own_x, own_y = _own_degrees(where, reference, crs, x, y)
        way = _known_way(crs, own_x, own_y)
        if way is None:
            raise InputError(
                f"{where}: found the reference system {show(crs.name)}, whose datum no known transformation takes to "
                f"WGS 84 at latitude {np.mean(own_y):.4f}, longitude {np.mean(own_x):.4f}, wanted places in WGS 84"
            )
        above = np.zeros_like(x) if height is None else height
        longitude, latitude, raised = (
            np.asarray(values) for values in way.transform(x, y, above, errcheck=True)
        )
    shift = float(np.abs(raised - above).max())
    if height is not None and not on_own_ellipsoid and shift > _SAME_HEIGHT_M:
        found = f"found heights beside the reference system {show(crs.name)}, whose ellipsoid lies {shift:.0f} m off"
        raise InputError(f"{where}: {found} at the places, wanted places and heights in WGS 84")
    notices = _worth(where, crs, way)
    return Wgs84Places(longitude, latitude, None if height is None else raised, notices)


def horizontal(where: Path, reference: str) -> CRS:
    """The system of the Earth by its code, WKT or plain PROJ parameters; InputError where it is none, or has a vertical
    part."""
    from pyproj import CRS
    from pyproj.exceptions import CRSError

    text = reference.strip()
    if zone := _ODM.fullmatch(text):
        text = f"EPSG:{326 if zone[2].upper() == 'N' else 327}{int(zone[1]):02d}"
    try:
        if not _is_definition(text):
            raise CRSError("a name, which PROJ would look for in files")
        crs = CRS.from_user_input(text)
    except (CRSError, UnicodeError):
        raise InputError(
            f"{where}: found the reference system {show(reference)}, wanted one such as EPSG:32633 or its WKT"
        ) from None
    if crs.is_compound or crs.is_vertical:
        found = f"found the reference system {show(crs.name)}, which has heights of its own"
        raise InputError(
            f"{where}: {found}, wanted the horizontal one alone (what heights are above: --heights)"
        )
    low, high = _EARTH_AXIS_M
    on_earth = crs.ellipsoid is not None and low < crs.ellipsoid.semi_major_metre < high
    if not on_earth or not (crs.is_geographic or crs.is_projected):
        found = f"found the reference system {show(crs.name)} ({crs.type_name})"
        raise InputError(f"{where}: {found}, wanted a geographic or projected one of the Earth")
    return crs


def _is_definition(text: str) -> bool:
    """Whether a text is ``AUTHORITY:CODE``, WKT or plain PROJ parameters (as OpenDroneMap has them), and names no
    file."""
    shaped = _CODE.fullmatch(text) or _WKT.match(text) or _PLAIN_PROJ.fullmatch(text)
    return shaped is not None and not _NAMES_A_FILE.search(text)


def datum_of(where: Path, reference: str) -> str:
    """The geographic system, with heights above its ellipsoid, that a projected one stands on, as WKT."""
    with _without_network(where):
        crs = horizontal(where, reference)
        return str((crs.geodetic_crs or crs).to_3d().to_wkt())


class Grid:
    """From WGS 84 to the system of a georeferenced grid, of which ``wkt`` says what it is."""

    def __init__(self, where: Path, wkt: str, middle: tuple[float, float]) -> None:
        from pyproj import CRS, Transformer

        with _without_network(where):
            if _NAMES_A_FILE.search(wkt):
                raise InputError(
                    f"{where}: found a reference system that names a file, wanted one that is whole in itself"
                )
            crs = CRS.from_wkt(wkt)
            crs = crs.sub_crs_list[0] if crs.is_compound else crs
            own_x, own_y = _own_degrees(where, crs.name, crs, *(np.array([value]) for value in middle))
            way = _known_way(crs, own_x, own_y)
            if way is None and _nameless_wgs84(crs):
                way = Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
        if way is None:
            raise InputError(
                f"{where}: found the reference system {show(crs.name)}, whose datum no known transformation takes to "
                "WGS 84 there, wanted a grid in WGS 84 or one of its projections"
            )
        self._way = way
        self.in_degrees = bool(crs.is_geographic)

    def of(self, longitude: Array, latitude: Array) -> tuple[Array, Array]:
        """Places (n,) in degrees as the grid counts; infinite where its projection has none."""
        x, y = self._way.transform(longitude, latitude, direction="INVERSE")[:2]
        return np.asarray(x), np.asarray(y)

    def back(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Longitudes and latitudes (n,) in degrees of places (n,) as the grid counts."""
        longitude, latitude = self._way.transform(x, y)[:2]
        return np.asarray(longitude), np.asarray(latitude)


def _nameless_wgs84(crs: CRS) -> bool:
    """Whether a system has the ellipsoid of WGS 84 and a datum without a name, as many a grid has."""
    name = "" if crs.datum is None else crs.datum.name.lower()
    alike = crs.ellipsoid is not None and abs(crs.ellipsoid.semi_major_metre - 6378137.0) < 1e-3
    return alike and ("unknown" in name or "not specified" in name or "not_specified" in name)


@contextmanager
def _without_network(where: Path) -> Iterator[None]:
    """pyproj with PROJ's network off whatever the environment says, and as it was afterwards."""
    try:
        from pyproj.exceptions import CRSError, ProjError
        from pyproj.network import is_network_enabled, set_network_enabled  # type: ignore[attr-defined]
    except ImportError:
        raise InputError(f'{where}: reading it needs pyproj: pip install "starplumb[gis]"') from None
    before = is_network_enabled()
    set_network_enabled(active=False)
    try:
        yield
    except (CRSError, ProjError):
        raise InputError(
            f"{where}: found a reference system that PROJ cannot count with, wanted one such as EPSG:32633 or its WKT"
        ) from None
    finally:
        set_network_enabled(active=before)


def _own_degrees(where: Path, reference: str, crs: CRS, x: Array, y: Array) -> tuple[Array, Array]:
    """Longitude and latitude (n,) on the system's own datum: good enough to tell where on Earth they are."""
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    try:
        way = Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)
        own_x, own_y = (np.asarray(values) for values in way.transform(x, y, errcheck=True)[:2])
    except ProjError:
        own_x = own_y = np.full_like(x, np.inf)
    if not np.all(np.isfinite(own_x) & np.isfinite(own_y)):
        raise InputError(
            f"{where}: found a place that the reference system {show(reference)} does not have, wanted places in it"
        )
    _require_degrees(where, own_x, own_y)
    return own_x, own_y


def _require_degrees(where: Path, longitude: Array, latitude: Array) -> None:
    off = (np.abs(latitude) > 90.0) | (np.abs(longitude) > 360.0)
    if off.any():
        i = int(np.argmax(off))
        found = f"found latitude {latitude[i]:.12g}, longitude {longitude[i]:.12g}"
        raise InputError(
            f"{where}: {found}, wanted a place on the Earth (are the reference system or x and y others?)"
        )


def _known_way(crs: CRS, longitude: Array, latitude: Array) -> Transformer | None:
    """The best transformation to WGS 84 that is known at all of the places (n,) in degrees."""
    from pyproj.transformer import TransformerGroup

    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", UserWarning
        )  # of grids that are not there: what is left tells its accuracy
        group = TransformerGroup(crs.to_3d(), "EPSG:4979", always_xy=True, allow_ballpark=False)
    for way in group.transformers:
        if _covers(way.area_of_use, longitude, latitude):
            return way
    return None


def _covers(area: Any, longitude: Array, latitude: Array) -> bool:
    if area is None:
        return True
    east = np.mod(longitude - area.west, 360.0) <= np.mod(area.east - area.west, 360.0) + (
        360.0 if area.east - area.west >= 360.0 else 0.0
    )
    return bool(np.all(east & (latitude >= area.south) & (latitude <= area.north)))


def _worth(where: Path, crs: CRS, way: Transformer) -> tuple[str, ...]:
    """A sentence about a transformation that is not exact."""
    if way.accuracy == 0.0:
        return ()
    worth = f"is accurate to {way.accuracy:g} m" if way.accuracy > 0.0 else "states no accuracy"
    return (
        f"{where}: took the places from {crs.name} to WGS 84 by a transformation that {worth}; their sigmas must "
        "contain it",
    )
