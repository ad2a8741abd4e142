"""DigitalGlobe image support data of QuickBird and the WorldView family: .IMD, .ATT, .EPH and .GEO, or one XML file.

Positions and quaternions are in ITRF and UTC, every ``timeInterval`` from ``startTime`` on; quaternions stand scalar
last and take the spacecraft body to ITRF.  They do not contain the aberration of light.  The camera axes V have x
along the flight and z down; column s looks along ``(ox + p s sin a, oy - p s cos a, pd)`` (detector origin o, pitch p,
rotation a, principal distance pd).  Rows and columns count from 0 at the centre of the first pixel.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...physics import so3
from ...physics.errors import InputError
from ...physics.light import Corrections
from ...physics.units import DEG
from ..text.pvl import read_pvl
from ..text.tree import Array, Epochs, Node, read_xml
from ..text.values import UNIT_TOLERANCE
from .digitalglobe_geo import Optics, band_group, mounted, read_optics, told_by_corners
from .digitalglobe_times import timing, true_columns
from .metadata_files import DIGITALGLOBE
from .vendor import C_KV, Corners, Product

_INVERSE_XYZW = np.array([-1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class _Parts:
    imd: Node
    att: Node
    eph: Node
    geo: Node | None
    til: Node | None
    rpb: Node | None


@dataclass(frozen=True)
class _Samples:
    """Equidistant samples: epochs (n,), values (n, k), covariances (n, m, m)."""

    t_ns: Epochs
    values: Array
    covariance: Array

    def mean_covariance(self, first_ns: int, last_ns: int) -> Array:
        """Over the samples from the one before the image to the one after it."""
        first = max(int(np.searchsorted(self.t_ns, first_ns, side="right")) - 1, 0)
        last = int(np.searchsorted(self.t_ns, last_ns))
        return np.asarray(np.mean(self.covariance[first : last + 1], axis=0))


def read_digitalglobe(path: Path, optics: Optics | None = None, band: str | None = None) -> Product:
    """The image that the files of ``path``'s name describe, or the XML file ``path``, in our axes.

    ``optics`` stands in for a .GEO that is not among the files (then the mounting is the turn of the axes alone), and
    goes before it.  Raises InputError for what is missing, contradicts itself or would have to be guessed.
    """
    parts = _parts(path)
    times = timing(parts.imd)
    padded = times.rows < parts.imd.need("numRows").whole(2)
    columns, said = true_columns(parts.imd, parts.til, parts.rpb, padded)
    orbit = _samples(parts.eph, "ephemList", 6, 3)
    attitude = _samples(parts.att, "attList", 4, 4)
    _require_unit(parts.att, attitude.values)
    band = band or parts.imd.need("bandId").text
    stated = optics is not None
    if optics is None:
        if parts.geo is None:
            raise InputError(f"{path}: found no .GEO beside it, wanted it or the camera's optics stated")
        optics = read_optics(parts.geo, band)
    image = parts.imd.need("IMAGE")
    product = Product(
        path=path,
        name=_name(path, parts.imd),
        columns=columns,
        rows=times.rows,
        detectors=optics.detectors(columns),
        t_ns=times.t_ns,
        line_period_s=times.period_s,
        row_times=times.uneven,
        orbit_t_ns=orbit.t_ns,
        r_J=orbit.values[:, :3],
        v_J=orbit.values[:, 3:],
        attitude_t_ns=attitude.t_ns,
        q_EF=attitude.values * _INVERSE_XYZW,
        frame="ITRF",
        C_EK=C_KV.mT,
        corrections=Corrections(light_time=True, aberration=True, refraction=False),
        sigma_position=_sigma(orbit.mean_covariance(*times.span)),
        sigma_attitude=_sigma(_turned(attitude).mean_covariance(*times.span)),
        corners=_corners(parts.imd, band, columns, times.rows),
        notices=(*times.notices, *said, *_knowledge(image)),
    )
    product = product if parts.geo is None else mounted(product, parts.geo)
    return product if stated else told_by_corners(product, optics)


def _name(path: Path, imd: Node) -> str:
    """That of the text files, or the catalogue's of an XML file, where it has one."""
    listed = imd.find("IMAGE/catId") or imd.find("productCatalogId")
    return path.stem if path.suffix.lower() in DIGITALGLOBE or listed is None else listed.text


def _parts(path: Path) -> _Parts:
    if path.suffix.lower() not in DIGITALGLOBE:
        root = read_xml(path)
        main = (root.need(key) for key in ("IMD", "ATT", "EPH"))
        return _Parts(*main, *(root.find(key) for key in ("GEO", "TIL", "RPB")))
    beside = {file.suffix.lower(): file for file in path.parent.glob(f"{_literal(path.stem)}.*")}
    missing = [suffix.upper() for suffix in (".imd", ".att", ".eph") if suffix not in beside]
    if missing:
        raise InputError(
            f"{path}: found no {', '.join(missing)} of that name beside it, wanted .IMD, .ATT and .EPH"
        )
    imd, att, eph = (read_pvl(beside[suffix]) for suffix in (".imd", ".att", ".eph"))
    others = (read_pvl(beside[suffix]) if suffix in beside else None for suffix in (".geo", ".til", ".rpb"))
    return _Parts(imd, att, eph, *others)


def _literal(name: str) -> str:
    """``name`` for a glob."""
    return "".join(f"[{c}]" if c in "*?[" else c for c in name)


def _samples(part: Node, key: str, count: int, size: int) -> _Samples:
    """The list ``key``: rows of an index from 1, ``count`` values and the upper triangle of a covariance."""
    parent = part.need(f"{key}List")
    listed = parent.all(key)
    stated = part.need("numPoints").whole(2)
    if len(listed) != stated:
        raise parent.error(f"{len(listed)} rows", f"{stated} as numPoints says")
    upper = np.triu_indices(size)
    table = np.stack([node.numbers(1 + count + len(upper[0])) for node in listed])
    wrong = table[:, 0] != np.arange(1, stated + 1)
    if wrong.any():
        raise listed[int(np.argmax(wrong))].error(f"the index {table[wrong, 0][0]:g}", "rows counted from 1")
    step = part.need("timeInterval").positive()
    t_ns = part.need("startTime").epoch() + np.rint(1e9 * step * np.arange(stated)).astype(np.int64)
    covariance = np.zeros((stated, size, size))
    covariance[:, upper[0], upper[1]] = covariance[:, upper[1], upper[0]] = table[:, 1 + count :]
    return _Samples(t_ns, table[:, 1 : 1 + count], covariance)


def _require_unit(att: Node, q: Array) -> None:
    norm = np.linalg.norm(q, axis=-1)
    off = np.abs(norm - 1.0) > UNIT_TOLERANCE
    if off.any():
        row = int(np.argmax(off))
        raise (
            att.need("attListList")
            .all("attList")[row]
            .error(f"a quaternion of norm {norm[row]:.6g}", "norm 1")
        )


def _turned(attitude: _Samples) -> _Samples:
    """Quaternion covariances P (n, 4, 4) as those of small angles about the body's axes (n, 3, 3), rad^2.

    ``alpha = -2 vec(q* dq) = -2 G dq`` with ``G = [w I - [v], -v]``, so ``4 G P G^T``.
    """
    v, w = attitude.values[:, :3], attitude.values[:, 3]
    G = np.concatenate([w[:, None, None] * np.eye(3) - so3.skew(v), -v[:, :, None]], axis=-1)
    return replace(attitude, covariance=4.0 * G @ attitude.covariance @ G.mT)


def _sigma(covariance: Array) -> Array | None:
    """Standard deviations (3,) of a stated covariance, None where none is (some products fill in zeros)."""
    variance = np.diagonal(covariance)
    return np.asarray(np.sqrt(variance)) if np.all(variance > 0.0) else None


def _corners(imd: Node, band: str, columns: int, rows: int) -> Corners | None:
    """The image's four corners, the centres of its corner pixels, with their heights above the ellipsoid.

    Programs that join the parts of a strip may leave them out.
    """
    if not any(child.tag.upper().startswith("BAND_") for child in imd.element):
        return None
    group = band_group(imd, band)
    names = ("UL", "UR", "LR", "LL")
    lon, lat, height = (
        np.array([group.need(f"{name}{key}").number() for name in names]) for key in ("Lon", "Lat", "HAE")
    )
    right, low = columns - 1.0, rows - 1.0
    return Corners(
        names,
        DEG * lat,
        DEG * lon,
        height,
        np.array([0.0, right, right, 0.0]),
        np.array([0.0, 0.0, low, low]),
    )


def _knowledge(image: Node) -> tuple[str, ...]:
    """A notice where the vendor says that orbit or attitude are not refined."""
    sources = [image.find(key) for key in ("positionKnowledgeSrc", "attitudeKnowledgeSrc")]
    return tuple(
        f"{node.path}: {node.name} is {node.text}, not R (refined)"
        for node in sources
        if node is not None and node.text != "R"
    )
