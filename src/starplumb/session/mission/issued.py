"""Mountings that are issued: what is foretold, as coefficients with their covariance, and what they say of a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...documents.numbers import numbers
from ...io.archive.records import Validity
from ...mission.advice import Foretold
from ...mission.trend import YEAR_NS, Trend, years
from ...physics import so3
from ...physics.timescales import format_iso, parse
from ...physics.units import ARCSEC

Array = NDArray[np.float64]

COLUMNS = ("level", "slope_per_year", "year_cos", "year_sin")


def model_of(found: Trend, from_ns: int) -> dict[str, Any]:
    """What is foretold from a time on: the mounting is ``exp(turn) matrix`` with the turn ``level + slope dt +
    year_cos cos 2 pi t + year_sin sin 2 pi t``, t years after ``year_time`` and dt after ``time``; the variance of each
    axis grows by ``walk_arcsec2_per_year`` a year."""
    bank = found.bank.at(years(found.t_ns, from_ns))
    mean, P = bank.state
    P = P.copy()
    P[:3, :3] += found.shared_E
    time, year = format_iso([from_ns, int(found.t_ns[0])], "UTC", 9)
    return {
        "time": time,
        "year_time": year,
        "time_scale": "UTC",
        "matrix": numbers(found.points.C_EK),
        "columns": list(COLUMNS),
        "coefficients_arcsec": numbers(mean.reshape(4, 3) / ARCSEC),
        "covariance_arcsec2": numbers(P / ARCSEC**2),
        "walk_arcsec2_per_year": float(bank.wander) / ARCSEC**2,
    }


def at(model: Mapping[str, Any], t_ns: int) -> tuple[Array, Array]:
    """The mounting (3, 3) of an issued model at a time, and the covariance (3, 3) rad^2 of its error."""
    start, year = parse([model["time"], model["year_time"]], "UTC").tolist()
    dt, t = (t_ns - start) / YEAR_NS, (t_ns - year) / YEAR_NS
    angle = 2.0 * np.pi * t
    F = np.kron(np.array([1.0, dt, np.cos(angle), np.sin(angle)]), np.eye(3))
    c, P = np.array(model["coefficients_arcsec"]).reshape(-1), np.array(model["covariance_arcsec2"])
    walked = abs(dt) * float(model["walk_arcsec2_per_year"])
    covariance = ARCSEC**2 * (F @ P @ F.T + walked * np.eye(3))
    return so3.exp(ARCSEC * (F @ c)) @ np.array(model["matrix"]), covariance


def valid_at(issued: Sequence[Validity], t_ns: int) -> Validity | None:
    """What was issued for a time, the latest of several; None for nothing."""
    for one in reversed(issued):
        if one.from_ns <= t_ns and (one.to_ns is None or t_ns <= one.to_ns):
            return one
    return None


def foretold_by(issued: Sequence[Validity], now_ns: int, C_EK: Array) -> Foretold | None:
    """The mounting in use at a time, as a turn (3,) from ``C_EK`` with its covariance, as a function of time."""
    in_use = valid_at(issued, now_ns)
    if in_use is None:
        return None

    def turn(t_ns: int) -> tuple[Array, Array]:
        C, P = at(in_use.model, t_ns)
        return so3.log(C @ C_EK.T), P

    return turn


def issue_document(archive: str, one: Validity, frame: tuple[str, int]) -> dict[str, Any]:
    """What ``starplumb archive issue --json`` prints; ``frame`` is SPICE's name and id of the camera."""
    C, P = at(one.model, one.from_ns)
    return {
        "schema": "starplumb-archive-issue/1",
        "archive": archive,
        "id": one.id,
        "satellite": one.instrument.satellite,
        "camera": one.instrument.frame_from,
        "tracker": one.instrument.frame_to,
        "spice_frame": frame[0],
        "spice_id": frame[1],
        "from": format_iso([one.from_ns], "UTC")[0],
        "to": None if one.to_ns is None else format_iso([one.to_ns], "UTC")[0],
        "supersedes": one.supersedes,
        "reason": one.reason,
        "model": dict(one.model),
        "matrix": numbers(C),
        "quaternion_xyzw": numbers(so3.to_quaternion(C)),
        "sigma_arcsec": numbers(np.sqrt(np.diagonal(P)) / ARCSEC),
        "covariance_arcsec2": numbers(P / ARCSEC**2),
    }
