"""The attitudes of a DIMAP file: the vendor's own, camera to ITRF, and the telemetry, AOCS frame to J2000."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...physics.timescales import format_iso, parse, utc_minus_tai
from ..text.files import show
from ..text.tree import Array, Epochs, Node, require_increasing
from ..text.values import UNIT_TOLERANCE

_SAMPLES_PER_SCALE = 32
"""Quaternions sampled per unit of the polynomial's scaled time; the cubic through four of them leaves nothing."""
_DAY_S = 86_400.0
_DAY_NS = 86_400 * 10**9
_REACH = 10.0
_MOST_OFFSET_S = 1e6
"""An image farther than this from the polynomial's middle, in units of its scale, is not the one it was made for."""
_INVERSE_XYZW = np.array([-1.0, -1.0, -1.0, 1.0])
_TELEMETRY = {
    "raw": "Data_Strip/Satellite_Attitudes/Raw_Attitudes/Quaternion_List",
    "filtered": "Data_Strip/Satellite_Attitudes/Accurate_Attitudes/Quaternion_List",
}


@dataclass(frozen=True)
class AttitudeSamples:
    """``q_EF`` (n, 4), scalar last, takes ``frame`` to the vendor's frame E at ``t_ns`` (n,)."""

    t_ns: Epochs
    q_EF: Array
    frame: Literal["GCRF", "ITRF"]
    notices: tuple[str, ...] = ()


def sampled_polynomial(polynomial: Node, scaling: Node, start_ns: int, end_ns: int) -> AttitudeSamples:
    """Quaternion polynomials ``q_i = sum c_ij s^j``, ``s = (t - OFFSET) / SCALE``, t seconds of the day in UTC.

    Sampled over s = -1 .. 1, for which they were made, and over the image from ``start_ns`` to ``end_ns``.
    """
    coefficients = [polynomial.need(f"Q{i}/COEFFICIENTS").numbers() for i in range(4)]
    scale, offset = scaling.need("SCALE").positive(), scaling.need("OFFSET")
    if scale > _DAY_S:
        raise scaling.need("SCALE").error(f"{scale:g} s", "half the duration of the attitude, s")
    middle_ns = _nearest_day(offset, start_ns, end_ns)
    image = (np.array([start_ns, end_ns]) - middle_ns) * 1e-9 / scale
    if np.abs(image).max() > _REACH:
        found = f"{show(offset.text)} s of the day, {np.abs(image).max() * scale:.6g} s from the image"
        raise offset.error(found, "the middle of the attitude in seconds of the UTC day")
    first, last = min(-1.0, image[0]), max(1.0, image[1])
    s = np.linspace(first, last, int(np.ceil((last - first) * _SAMPLES_PER_SCALE)) + 1)
    q = np.stack([np.polynomial.polynomial.polyval(s, c) for c in coefficients], axis=-1).astype(np.float64)
    _require_unit(q, [polynomial] * s.size)
    return AttitudeSamples(middle_ns + np.rint(1e9 * scale * s).astype(np.int64), _inverse(q), "ITRF")


def _nearest_day(offset: Node, start_ns: int, end_ns: int) -> int:
    """Epoch of the seconds of a day that brings it next to the image, which may be of the day before or after."""
    midnight = int(parse([format_iso(start_ns, "UTC", 0)[0][:10] + "T00:00:00"], "UTC")[0])
    seconds = offset.number()
    if abs(seconds) > _MOST_OFFSET_S:
        raise offset.error(show(offset.text), "the middle of the attitude in seconds of the UTC day")
    epoch = midnight + round(1e9 * seconds)
    middle = (start_ns + end_ns) // 2
    return epoch + _DAY_NS * round((middle - epoch) / _DAY_NS)


def quaternion_list(parent: Node, frame: Literal["GCRF", "ITRF"], scale: str, time: str) -> AttitudeSamples:
    """Quaternions from the vendor's frame to ``frame``; those not NOMINAL (or numbered) are left out, with a notice."""
    nodes = parent.all("Quaternion")
    status = [node.find("Q_STATUS") for node in nodes]
    kept = [
        node
        for node, word in zip(nodes, status, strict=True)
        if word is None or word.text == "NOMINAL" or word.text.isdecimal()
    ]
    if len(kept) < 2:
        raise parent.error(f"{len(kept)} usable quaternions", "at least two")
    t_ns = np.array([node.need(time).epoch(scale) for node in kept])
    require_increasing(kept, t_ns)
    q = np.stack([_wxyz(node) for node in kept])
    _require_unit(q, kept)
    left_out = len(nodes) - len(kept)
    notices = (f"{parent.path}: left out {left_out} quaternions that are not NOMINAL",) if left_out else ()
    return AttitudeSamples(t_ns, _inverse(q), frame, notices)


def telemetry(root: Node, choice: Literal["raw", "filtered"]) -> AttitudeSamples:
    """The satellite's own quaternions, AOCS frame to J2000, dated in TAI; only the production layout has them."""
    if root.find(_TELEMETRY[choice]) is None:
        raise root.error(f"no {_TELEMETRY[choice]}", 'attitude "vendor", which every product has')
    counted = root.find("Data_Strip/Sensor_Configuration/Time_Stamp/TAI_UTC")
    samples = quaternion_list(root.need(_TELEMETRY[choice]), "GCRF", "TAI", "TAI_TIME")
    if counted is not None and counted.number() != -utc_minus_tai(samples.t_ns[0]):
        raise counted.error(
            show(counted.text), f"TAI - UTC = {-int(utc_minus_tai(samples.t_ns[0]))} s at that date"
        )
    return samples


def _wxyz(node: Node) -> Array:
    together = node.find("Q_VALUES")
    if together is not None:
        return together.numbers(4)
    return np.array([node.need(f"Q{i}").number() for i in range(4)])


def _require_unit(q: Array, nodes: list[Node]) -> None:
    norm = np.linalg.norm(q, axis=-1)
    off = np.abs(norm - 1.0) > UNIT_TOLERANCE
    if off.any():
        row = int(np.argmax(off))
        raise nodes[row].error(f"a quaternion of norm {norm[row]:.6g}", "norm 1")


def _inverse(q_wxyz: Array) -> Array:
    """From scalar first to last, normalised, and from E -> F to F -> E."""
    q = np.roll(q_wxyz, -1, axis=-1) * _INVERSE_XYZW
    return np.asarray(q / np.linalg.norm(q, axis=-1, keepdims=True))
