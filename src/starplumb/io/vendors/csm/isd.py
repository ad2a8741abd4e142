"""ISD files of ALE: what a sensor model is made from, in J2000 and kilometres.

``instrument_pointing`` takes J2000 to an instrument frame at each time (quaternion scalar first, in Hamilton's sense),
and by a constant matrix to the camera's. Source: DOI-USGS/ale, ale/formatters/formatter.py.
"""

from __future__ import annotations

import numpy as np

from ....physics import so3
from ....physics.errors import InputError
from ...text.files import show
from ...text.json_node import JsonNode
from .model import Array, CsmModel, require_earth, require_whole
from .optics import RADIAL, RADTAN, CsmOptics
from .state import FRAME, LINE_SCANNER

_J2000 = 1
_KM = 1e3


def read_isd(isd: JsonNode) -> CsmModel:
    """The model that an ISD describes, its orbit and attitude in the GCRF."""
    name = isd.text("name_model")
    if name not in (LINE_SCANNER, FRAME):
        raise isd.error("name_model", name, f"{LINE_SCANNER} or {FRAME}")
    radii = isd.child("radii")
    scale = _KM if radii.text("unit", "km").lower() == "km" else 1.0
    require_earth(isd.path, scale * radii.number("semimajor"), scale * radii.number("semiminor"))
    orbit, pointing = isd.child("instrument_position"), isd.child("instrument_pointing")
    for node in (orbit, pointing):
        if node.number("reference_frame", _J2000) != _J2000:
            raise node.error("reference_frame", node.value["reference_frame"], "1, which is J2000")
    center = isd.number("center_ephemeris_time")
    return CsmModel(
        path=isd.path,
        name=isd.path.stem,
        size=(isd.count("image_samples"), isd.count("image_lines")),
        optics=_optics(isd, name),
        frame="GCRF",
        orbit_s=orbit.numbers("ephemeris_times", -1),
        r_F=_KM * orbit.numbers("positions", -1, 3),
        v_F=_KM * orbit.numbers("velocities", -1, 3) if orbit.has("velocities") else None,
        attitude_s=pointing.numbers("ephemeris_times", -1),
        q_FC=_pointing(pointing),
        time_s=center,
        lines=_lines(isd, center) if name == LINE_SCANNER else None,
        dated=True,
    )


def _pointing(pointing: JsonNode) -> Array:
    """q_FC (n, 4): the inverse of the constant rotation behind the varying one."""
    q_BF = np.roll(pointing.numbers("quaternions", -1, 4), -1, axis=1)
    norm = np.linalg.norm(q_BF, axis=1, keepdims=True)
    if not np.all(np.abs(norm - 1.0) < 1e-3):
        raise pointing.error("quaternions", float(norm.min()), "quaternions of norm 1")
    C_CB = pointing.numbers("constant_rotation", 3, 3) if pointing.has("constant_rotation") else np.eye(3)
    if np.abs(C_CB @ C_CB.mT - np.eye(3)).max() > 1e-6:
        raise pointing.error("constant_rotation", C_CB.ravel().tolist(), "a rotation, row by row")
    return so3.to_quaternion((C_CB @ so3.from_quaternion(q_BF / norm)).mT)


def _lines(isd: JsonNode, center: float) -> Array:
    """Lines, times of their middle, durations; the ISD counts from the centre of the image in time."""
    rate = isd.numbers("line_scan_rate", -1, 3)
    return np.stack([rate[:, 0], center + rate[:, 1] + 0.5 * rate[:, 2], rate[:, 2]], axis=-1)


def _optics(isd: JsonNode, name: str) -> CsmOptics:
    center = isd.child("detector_center")
    whole = isd.child("optical_distortion")
    start = (isd.number("starting_detector_line", 0.0), isd.number("starting_detector_sample", 0.0))
    summing = (isd.number("detector_line_summing", 1.0), isd.number("detector_sample_summing", 1.0))
    if name == FRAME:
        require_whole(isd.path, start, summing)
    return CsmOptics(
        focal_length=isd.child("focal_length_model").number("focal_length"),
        lines=isd.numbers("focal2pixel_lines", 3),
        samples=isd.numbers("focal2pixel_samples", 3),
        origin=(center.number("line"), center.number("sample")),
        start=start,
        summing=summing,
        kind=RADTAN if whole.has("radtan") else RADIAL,
        coefficients=_coefficients(isd, whole),
    )


def _coefficients(isd: JsonNode, distortion: JsonNode) -> Array:
    kinds = list(distortion.value)
    if kinds not in (["radial"], ["radtan"]):
        raise InputError(f"{isd.path}, optical_distortion: found {show(kinds)}, wanted radial or radtan")
    found = distortion.child(kinds[0]).numbers("coefficients", -1)
    if kinds == ["radtan"] and found.size != 5:
        raise distortion.child("radtan").error("coefficients", found.tolist(), "k1, k2, p1, p2, k3")
    return found
