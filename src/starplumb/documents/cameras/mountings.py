"""The mountings of several cameras in ``result.json``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...estimators.cameras.ties import POINTING
from ...judge.calibrate import Calibration
from ...judge.mountings import Mountings, mountings
from ...judge.trust import NORMAL_95
from ...mission.joint import Joint
from ...physics import so3
from ...physics.units import ARCSEC
from ..numbers import numbers

Array = NDArray[np.float64]


def mounting_part(start: str, to: str, C: Array) -> dict[str, Any]:
    """A mounting from one frame to another."""
    quaternion = numbers(so3.to_quaternion(C))
    return {"from": start, "to": to, "matrix": numbers(C), "quaternion_xyzw": quaternion}


def mountings_part(c: Calibration, tracker: str) -> dict[str, Any]:
    """The mounting of every camera that has a name, and the joint covariance of their errors about the star tracker's
    axes, x, y, z of the first camera, then of the next; nothing where there is one camera without a name."""
    found = mountings(c)
    if found is None:
        return {}
    P = found.covariance_E
    return {
        "mountings": [_one(found, k, tracker) for k in range(len(found.names))],
        "mountings_covariance_arcsec2": None
        if P is None or not np.all(found.known)
        else numbers(P / ARCSEC**2),
    }


def joint_part(found: Joint, first: str, tracker: str, widened: float) -> dict[str, Any]:
    """The mounting of every camera of a rig by several campaigns, and their joint covariance."""
    C_EC = np.concatenate([found.C_EK[None], found.C_EC])
    P = found.covariance_all_E
    known = np.max(np.diagonal(P).reshape(-1, 3), axis=-1) < POINTING**2
    rig = Mountings((first, *found.cameras), C_EC, C_EC, P, known, widened)
    each = [_one(rig, k, tracker) for k in range(len(C_EC))]
    return {
        "mountings": [{key: part for key, part in one.items() if key != "correction_arcsec"} for one in each],
        "mountings_covariance_arcsec2": numbers(P / ARCSEC**2) if np.all(known) else None,
    }


def _one(found: Mountings, k: int, tracker: str) -> dict[str, Any]:
    P, good = found.covariance_of(k), found.known[k]
    lost = found.covariance_E is None or not good
    sigma = None if P is None else np.sqrt(np.diagonal(P))
    return {
        "camera": found.names[k],
        **mounting_part(found.names[k], tracker, found.C_EC[k] if good else found.C_EC_model[k]),
        "correction_arcsec": None if lost else numbers(found.correction_E[k] / ARCSEC),
        **_error(P),
        "interval_95_arcsec": None if sigma is None else numbers(NORMAL_95 * found.widened * sigma / ARCSEC),
        "against_first": None if k == 0 else _against_first(found, k),
    }


def _against_first(found: Mountings, k: int) -> dict[str, Any]:
    P = found.covariance_against_first(k)
    return {"to": found.names[0], "matrix": numbers(found.C_against_first(k)), **_error(P)}


def _error(P: Array | None) -> dict[str, Any]:
    if P is None:
        return {"sigma_arcsec": None, "covariance_arcsec2": None}
    return {
        "sigma_arcsec": numbers(np.sqrt(np.diagonal(P)) / ARCSEC),
        "covariance_arcsec2": numbers(P / ARCSEC**2),
    }
