"""The camera of a DigitalGlobe product: the geometric calibration of its .GEO file, or what the user states instead."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...physics import so3
from ...physics.errors import InputError
from ...physics.series import Attitude
from ...physics.units import DEG
from ..text.tree import Node
from ..text.values import UNIT_TOLERANCE
from .vendor import C_KV, CORNERS_AGREE_M, Array, Detectors, Product, corners_missed

_COLUMN_STEP = 16
"""Columns between look directions of a line that is not straight."""
_TELLS_M = 1.0
"""Senses of a distortion that differ less than this in the corners are not told apart by them."""
_SAME_PX = 0.2
"""Senses that differ less than this everywhere are one."""


@dataclass(frozen=True)
class Bend:
    """Distortion: a place (x, y) mm of the focal plane is moved by ``sign`` times polynomials with ``a`` and ``b``.

    Their terms are ``c x^(i-j) y^j`` for i = 0 .. order and j = 0 .. i, or with ``y_first`` those of x and y exchanged.
    """

    a: tuple[float, ...]
    b: tuple[float, ...]
    sign: float = 1.0
    y_first: bool = False

    def moved(self, x: Array, y: Array) -> tuple[Array, Array]:
        u, v = (y, x) if self.y_first else (x, y)
        order = range(round((2 * len(self.a)) ** 0.5))
        terms = np.stack([u ** (i - j) * v**j for i in order for j in range(i + 1)], axis=-1)
        return x + self.sign * (terms @ np.array(self.a)), y + self.sign * (terms @ np.array(self.b))


@dataclass(frozen=True)
class Optics:
    """The line of detectors behind the lens in the camera axes V (x along the flight, z down).

    Column s looks along ``(ox + p s sin a, oy - p s cos a, pd)``: origin o, pitch p, rotation a, principal distance pd;
    ``bend`` then moves the first two.
    """

    principal_distance_mm: float
    pitch_mm: float
    origin_mm: tuple[float, float]
    rotation_deg: float = 0.0
    bend: Bend | None = None

    def __post_init__(self) -> None:
        for name in ("principal_distance_mm", "pitch_mm"):
            value = getattr(self, name)
            if not 0.0 < value < float("inf"):
                raise InputError(f"{name}: found {value:g}, wanted a positive number of millimetres")

    def detectors(self, columns: int) -> Detectors:
        """Look directions of the first column and the last of a straight line; of a bent one of many columns."""
        step = columns - 1 if self.bend is None else _COLUMN_STEP
        column = np.unique(np.append(np.arange(0, columns, step), columns - 1)).astype(np.float64)
        along_mm, angle = self.pitch_mm * column, DEG * self.rotation_deg
        x = self.origin_mm[0] + along_mm * np.sin(angle)
        y = self.origin_mm[1] - along_mm * np.cos(angle)
        if self.bend is not None:
            x, y = self.bend.moved(x, y)
        return Detectors.from_vendor(column, x / self.principal_distance_mm, y / self.principal_distance_mm)


def band_group(parent: Node, band: str) -> Node:
    """The group of a band: ``BAND_<band>``, or the first where the file keeps several under one name as ``Multi``."""
    groups = {
        child.tag.upper(): parent.need(child.tag)
        for child in parent.element
        if child.tag.upper().startswith("BAND_")
    }
    if f"BAND_{band.upper()}" in groups:
        return groups[f"BAND_{band.upper()}"]
    if not groups or band.upper() != "MULTI":
        raise parent.error(f"the bands {', '.join(groups) or 'none'}", f"BAND_{band}")
    return next(iter(groups.values()))


def read_optics(geo: Node, band: str) -> Optics:
    """Optics of a band. Raises InputError for staggered arrays.

    ``detRotAngle`` is in degrees, and turns the line of detectors from -y of V to x.
    """
    mounting = geo.need("DETECTOR_MOUNTING")
    array = band_group(mounting, band).one("DETECTOR_ARRAY")
    return Optics(
        principal_distance_mm=geo.need("PRINCIPAL_DISTANCE/pd").positive(),
        pitch_mm=array.need("detPitch").positive(),
        origin_mm=(array.need("detOriginX").number(), array.need("detOriginY").number()),
        rotation_deg=array.need("detRotAngle").number(),
        bend=_bend(geo),
    )


def _bend(geo: Node) -> Bend | None:
    """The coefficients of the optical distortion, None where all of them are zero."""
    values = {}
    for key in ("aList", "bList"):
        listed = geo.find(f"OPTICAL_DISTORTION/{key}List")
        rows = [row.numbers().tolist() for row in listed.all(key) if row.text] if listed else []
        values[key] = tuple(value for row in rows for value in row)
    if not any(values["aList"]) and not any(values["bList"]):
        return None
    node = geo.need("OPTICAL_DISTORTION/polyOrder")
    order = round(node.number())
    terms = (order + 1) * (order + 2) // 2
    if order < 0 or {len(value) for value in values.values()} != {terms}:
        found = f"an optical distortion of {len(values['aList'])} and {len(values['bList'])} terms"
        raise node.error(found, f"{terms} each for the order {node.text}")
    return Bend(values["aList"], values["bList"])


def told_by_corners(product: Product, optics: Optics) -> Product:
    """The product with its distortion in the sense, which is not published, with which it meets its own corners.

    Raises InputError where the corners are missing, contradict every sense or do not tell two apart.
    """
    if optics.bend is None:
        return product
    unknown = f"{product.path}: found an optical distortion, whose convention is not published,"
    if product.corners is None or not product.corners.have_heights:
        raise InputError(f"{unknown} and no corners to tell it by, wanted the optics stated")
    tried = [
        replace(product, detectors=replace(optics, bend=bend).detectors(product.columns))
        for sign in (1.0, -1.0)
        for bend in (replace(optics.bend, sign=sign), replace(optics.bend, sign=sign, y_first=True))
    ]
    away = [corners_missed(other, other.campaign(1.0, 1.0)) for other in tried]
    best = int(np.argmin(away))
    if not away[best] <= CORNERS_AGREE_M:
        raise InputError(
            f"{unknown} and corners {away[best]:.4g} m away in any sense, wanted the optics stated"
        )
    pixel = optics.pitch_mm / optics.principal_distance_mm
    for other, missed in zip(tried, away, strict=True):
        apart = np.hypot(
            other.detectors.tan_x - tried[best].detectors.tan_x,
            other.detectors.tan_y - tried[best].detectors.tan_y,
        )
        if missed <= away[best] + _TELLS_M and apart.max() > _SAME_PX * pixel:
            raise InputError(f"{unknown} and corners that do not tell it, wanted the optics stated")
    said = (
        f"{product.path}: the optical distortion is taken in the sense with which the corners are met within "
        f"{away[best]:.4g} m"
    )
    return replace(tried[best], notices=(*product.notices, said))


def mounted(product: Product, geo: Node) -> Product:
    """The product with the .GEO's mounting, C_EV of its quaternion (scalar last), and with the positions of the
    perspective centre (metres in E) in place of the spacecraft's."""
    attitude = geo.need("CAMERA_ATTITUDE")
    q = np.array([attitude.need(f"qcs{i}").number() for i in range(1, 5)])
    if abs(np.linalg.norm(q) - 1.0) > UNIT_TOLERANCE:
        raise attitude.error(f"a quaternion of norm {np.linalg.norm(q):.6g}", "norm 1")
    center = geo.need("PERSPECTIVE_CENTER")
    arm_E = np.array([center.need(f"c{axis}").number() for axis in "xyz"])
    product = replace(product, C_EK=so3.from_quaternion(q) @ C_KV.mT, own_mounting=True)
    return _moved(product, arm_E) if np.any(arm_E != 0.0) else product


def _moved(product: Product, arm_E: np.ndarray[tuple[int], np.dtype[np.float64]]) -> Product:
    """Positions ``r_J + C_JE c`` and velocities ``v_J - C_JE (omega_E x c)`` where the attitude is known."""
    series = Attitude(product.attitude_t_ns, product.q_EF, product.frame)
    known = (product.orbit_t_ns >= series.t_ns[0]) & (product.orbit_t_ns <= series.t_ns[-1])
    C_EJ, omega_E = series.at(product.orbit_t_ns[known])
    r_J = product.r_J[known] + np.einsum("nji,j->ni", C_EJ, arm_E)
    v_J = product.v_J
    if v_J is not None:
        v_J = v_J[known] - np.einsum("nji,nj->ni", C_EJ, np.cross(omega_E, arm_E))
    return replace(product, orbit_t_ns=product.orbit_t_ns[known], r_J=r_J, v_J=v_J)
