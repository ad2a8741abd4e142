"""The camera of a DigitalGlobe product: the geometric calibration of its .GEO file, or what the user states instead."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...physics import so3
from ...physics.errors import InputError
from ...physics.series import Attitude
from ...physics.units import DEG
from ..text.files import show
from ..text.tree import Node
from ..text.values import UNIT_TOLERANCE
from .vendor import C_KV, Detectors, Product


@dataclass(frozen=True)
class Optics:
    """The line of detectors behind the lens in the camera axes V (x along the flight, z down).

    Column s looks along ``(ox + p s sin a, oy - p s cos a, pd)``: origin o, pitch p, rotation a, principal distance pd.
    """

    principal_distance_mm: float
    pitch_mm: float
    origin_mm: tuple[float, float]
    rotation_deg: float = 0.0

    def __post_init__(self) -> None:
        for name in ("principal_distance_mm", "pitch_mm"):
            value = getattr(self, name)
            if not 0.0 < value < float("inf"):
                raise InputError(f"{name}: found {value:g}, wanted a positive number of millimetres")

    def detectors(self, columns: int) -> Detectors:
        """Look directions of the first column and the last; the line between them is straight."""
        column = np.array([0.0, columns - 1.0])
        along_mm, angle = self.pitch_mm * column, DEG * self.rotation_deg
        return Detectors.from_vendor(
            column,
            (self.origin_mm[0] + along_mm * np.sin(angle)) / self.principal_distance_mm,
            (self.origin_mm[1] - along_mm * np.cos(angle)) / self.principal_distance_mm,
        )


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
    """Optics of a band. Raises InputError for terms whose convention is not published, and for staggered arrays.

    ``detRotAngle`` is in degrees, and turns the line of detectors from -y of V to x.
    """
    for key in ("aList", "bList"):
        listed = geo.find(f"OPTICAL_DISTORTION/{key}List")
        for row in listed.all(key) if listed else []:
            if row.text and np.any(row.numbers() != 0.0):
                raise row.error(f"an optical distortion, {show(row.text)}", "none, or the optics stated")
    mounting = geo.need("DETECTOR_MOUNTING")
    array = band_group(mounting, band).one("DETECTOR_ARRAY")
    return Optics(
        principal_distance_mm=geo.need("PRINCIPAL_DISTANCE/pd").positive(),
        pitch_mm=array.need("detPitch").positive(),
        origin_mm=(array.need("detOriginX").number(), array.need("detOriginY").number()),
        rotation_deg=array.need("detRotAngle").number(),
    )


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
