"""The star tracker's quaternions of SPOT 5.

The format says neither order nor direction nor frame nor axes of them.  These are found by what the quaternions must
do: turn with the vendor's attitude, and keep to axes that lie along his but for a mounting.  Aberration
is already in them.
"""

from __future__ import annotations

from itertools import permutations, product
from typing import Literal

import numpy as np

from ...physics import so3
from ...physics.orientation import C_IF, FRAMES_OF_DATE, EarthOrientation
from ...physics.series import Attitude
from ...physics.units import ARCSEC, DEG
from ..text.tree import Array, Epochs, Node
from .dimap_attitude import AttitudeSamples, quaternion_list

_FRAMES = ("GCRF", "TOD", "MOD", "ITRF")
_CLEARLY = 0.2
"""Another frame than GCRF, or another order than scalar first, is believed where it misses the vendor's attitude by
less than this part of what they do."""
_MOST_OFF = 1.0 * DEG
_INVERSE = np.array([-1.0, -1.0, -1.0, 1.0])


def star_tracker(root: Node, attitudes: str, vendor: AttitudeSamples) -> AttitudeSamples:
    """The quaternions as GCRF (or ITRF) to V, with a notice of how they were understood.

    Raises InputError where the product has none, or none that agree with the attitude ``vendor``, ITRF to V.
    """
    listed = root.need(attitudes).below("Quaternion_List")
    if not listed:
        raise root.error("no quaternions of a star tracker", 'attitude "vendor", which every product has')
    time = "TIME" if listed[0].find("Quaternion/TIME") is not None else "Q_TIME"
    samples = quaternion_list(listed[0], "GCRF", "UTC", time)
    own = Attitude(vendor.t_ns, vendor.q_EF, "ITRF")
    common = own.bursts.covers(samples.t_ns)
    if np.count_nonzero(common) < 2:
        raise listed[0].error("quaternions at other times than the attitude's", "at least two in common")
    C_VJ = own.at(samples.t_ns[common])[0]
    read = {(order, way): _from_frame(samples.q_EF, order, way) for order in (0, 1) for way in (1, -1)}
    tried = {
        (frame, sense): _agreement(C_EF[common], frame, samples.t_ns[common], C_VJ)
        for frame, (sense, C_EF) in product(_FRAMES, read.items())
    }
    usual = {key: key[0] == _FRAMES[0] and key[1][0] == 0 for key in tried}
    best = min(tried, key=lambda key: tried[key][0] / (1.0 if usual[key] else _CLEARLY))
    off, axes = tried[best]
    if not off <= _MOST_OFF:
        raise listed[0].error(
            f"quaternions that differ by {off / DEG:.3g} deg from the vendor's attitude in any frame",
            "those of the satellite's axes",
        )
    frame, sense = best
    opposite = (sense[0], -sense[1])
    if min(tried[other, opposite][0] for other in _FRAMES) * _CLEARLY < off:
        raise listed[0].error(
            "quaternions that fit the vendor's attitude from either frame to the other",
            "a scene that tells which way they are meant",
        )
    C_VF = axes @ read[sense]
    if frame in FRAMES_OF_DATE:
        C_VF = C_VF @ C_IF(frame, samples.t_ns).mT
    said = (
        f"{root.path}: the star tracker's quaternions are taken as those of {frame}, in which they agree with the "
        f"vendor's attitude to {off / ARCSEC:.3g} arcsec"
    )
    kept: Literal["ITRF", "GCRF"] = "ITRF" if frame == "ITRF" else "GCRF"
    return AttitudeSamples(samples.t_ns, so3.to_quaternion(C_VF), kept, (*samples.notices, said))


def _from_frame(q: Array, order: int, way: int) -> Array:
    """C_EF of quaternions (n, 4) that were read scalar first, with ``order`` 1 taken scalar last; or the inverses."""
    C = so3.from_quaternion(np.roll(q * _INVERSE, order, axis=-1) * _INVERSE if order else q)
    return C if way > 0 else C.mT


def _agreement(C_EF: Array, frame: str, t_ns: Epochs, C_VJ: Array) -> tuple[float, Array]:
    """The largest turn between the axes that the quaternions mean and V, and which of the axes are which."""
    C_EJ = C_EF if frame == "ITRF" else C_EF @ _C_FJ(frame, t_ns)
    C_VE = C_VJ @ C_EJ.mT
    axes = max(_AXES, key=lambda turn: float(np.sum(turn * C_VE.mean(axis=0))))
    off = np.linalg.norm(so3.log(C_VE @ axes.mT), axis=-1)
    return float(off.max()), axes


def _C_FJ(frame: str, t_ns: Epochs) -> Array:
    C_IJ = np.asarray(EarthOrientation.load().C_IJ(t_ns))
    return np.asarray(C_IF(frame, t_ns).mT @ C_IJ) if frame in FRAMES_OF_DATE else C_IJ


def _proper_turns() -> list[Array]:
    """The 24 rotations that take axes to axes."""
    every = (
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3))
    )
    return [turn for turn in every if np.linalg.det(turn) > 0.0]


_AXES = _proper_turns()
