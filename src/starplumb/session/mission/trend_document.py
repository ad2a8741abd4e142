"""The trend of a mounting as a document: what ``starplumb archive trend --json`` prints."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...documents.numbers import numbers
from ...io.archive import records
from ...judge.trust import NORMAL_95
from ...mission.advice import Advice, across, advice
from ...mission.changes import Change, changes
from ...mission.trend import YEAR_NS, Trend
from ...physics.errors import ArgumentError, EpochError
from ...physics.timescales import LATEST_UTC_MINUS_TAI, format_iso, moment
from ...physics.units import ARCSEC, DEG
from .issued import foretold_by
from .known import Known

AHEAD = 13
"""Times of the forecast, evenly over the horizon."""
SHOWN_P = 0.01
"""Probability by chance below which a change is called one."""
LAST = "2285-01-01"
"""End of a horizon: a few years behind it, in which the next campaign is looked for, are still epochs."""


def trend_document(of: Known, at_ns: int | None, horizon_days: float) -> dict[str, Any]:
    """The trend, seen from a time (None: that of the last campaign).  Raises ArgumentError where the horizon ends
    beyond times that are counted."""
    horizon = round(horizon_days * 86_400e9)
    now = int(of.trend.t_ns[-1]) if at_ns is None else at_ns
    if now + horizon > moment(LAST, "TAI"):
        raise ArgumentError(
            "horizon_days",
            f"found {horizon_days:g} days after {_time(now)[:19]}, wanted an end before {LAST}",
        )
    in_use = foretold_by(of.issued, now, of.trend.points.C_EK)
    found = advice(of.trend, in_use, now, horizon)
    listed = changes(of.trend, of.temperatures_c, of.u)
    ahead = now + np.linspace(0, horizon, AHEAD).astype(np.int64)
    return {
        "schema": "starplumb-archive-trend/1",
        "archive": of.archive,
        "satellite": of.instrument.satellite,
        "from": of.instrument.frame_from,
        "to": of.instrument.frame_to,
        "time_scale": "UTC",
        "at": _time(now),
        "matrix": numbers(of.trend.points.C_EK),
        "metres_per_arcsec": None if of.height_m is None else of.height_m * ARCSEC,
        "points": _points(of),
        "models": [{"name": name, "weight": weight} for name, weight in of.trend.bank.kinds.items()],
        "changes": [_change(of, change) for change in listed],
        "forecast": [_foretold(of.trend, int(t)) for t in ahead],
        "events": [{"id": e.id, "time": _time(e.t_ns), "kind": e.kind, "note": e.note} for e in of.events],
        "issued": [_issued(one) for one in of.issued],
        "recommendation": _recommendation(found, of.height_m, now, horizon_days),
    }


def _time(t_ns: int) -> str:
    return _times(np.array([t_ns]))[0]


def _times(t_ns: NDArray[np.int64]) -> list[str]:
    """Times in UTC; beyond the leap seconds that are known, as if none were to come."""
    try:
        return format_iso(t_ns, "UTC")
    except EpochError:
        if t_ns.size > 1:
            return [_time(int(t)) for t in t_ns]
        return format_iso(t_ns + LATEST_UTC_MINUS_TAI * 10**9, "TAI")


def _points(of: Known) -> list[dict[str, Any]]:
    t = of.trend
    sigma = t.points.sigma_E / ARCSEC
    known = np.sqrt(np.diagonal(t.covariance_E, axis1=1, axis2=2)) / ARCSEC
    times = _times(t.t_ns)
    return [
        {
            "id": entry.id,
            "name": entry.name,
            "time": times[k],
            "value_arcsec": numbers(t.points.value_E[k] / ARCSEC),
            "sigma_arcsec": numbers(sigma[k]),
            "trend_arcsec": numbers(t.value_E[k] / ARCSEC),
            "trend_sigma_arcsec": numbers(known[k]),
            "jumped": float(t.jumped[k]),
            "temperatures_c": {
                name: float(values[k]) for name, values in of.temperatures_c.items() if np.isfinite(values[k])
            },
            "argument_of_latitude_deg": numbers(of.u[k] / DEG % 360.0),
        }
        for k, entry in enumerate(of.entries)
    ]


def _foretold(found: Trend, t_ns: int) -> dict[str, Any]:
    value, P = found.at(t_ns)
    sigma = np.sqrt(np.diagonal(P)) / ARCSEC
    return {
        "time": _time(t_ns),
        "value_arcsec": numbers(value / ARCSEC),
        "sigma_arcsec": numbers(sigma),
        "interval_95_arcsec": numbers(NORMAL_95 * sigma),
    }


def _change(of: Known, change: Change) -> dict[str, Any]:
    sigma = np.sqrt(np.diagonal(change.covariance_E)) / ARCSEC
    size = across(of.trend.points.C_EK) @ change.size_E
    ground = None if of.height_m is None else float(np.linalg.norm(size) * of.height_m)
    return {
        "kind": change.kind,
        "words": _words(of, change),
        "size_arcsec": numbers(change.size_E / ARCSEC),
        "sigma_arcsec": numbers(sigma),
        "p": change.p,
        "significant": change.p < SHOWN_P,
        "ground_m": ground,
    }


def _words(of: Known, change: Change) -> str:
    t = of.trend.t_ns
    if change.between is not None:
        before, after = (int(t[k]) for k in change.between)
        told = [e.kind for e in of.events if before < e.t_ns <= after]
        why = f" ({', '.join(told)})" if told else ""
        return f"jump {_time(before)[:10]} to {_time(after)[:10]}{why}"
    if change.kind == "trend":
        long = f"{(t[-1] - t[0]) / YEAR_NS:.2g}"
        return f"steady trend, over {long} year{'s' * (long != '1')}"
    kind, _, name = change.kind.partition(":")
    return {"season": "with the year, half its range", "orbit phase": "with the orbit, half its range"}.get(
        kind, f"with the temperature {name}, half its range"
    )


def _issued(one: records.Validity) -> dict[str, Any]:
    return {
        "id": one.id,
        "from": _time(one.from_ns),
        "to": None if one.to_ns is None else _time(one.to_ns),
        "issued": one.issued_utc,
        "supersedes": one.supersedes,
        "reason": one.reason,
    }


def _recommendation(found: Advice, height_m: float | None, now: int, days: float) -> dict[str, Any]:
    def metres(angle: float | None) -> float | None:
        return None if angle is None or height_m is None else angle * height_m

    by = None if found.calibrate_by_ns is None else _time(found.calibrate_by_ns)
    return {
        "action": found.action,
        "sentence": _sentence(found, height_m, by, days),
        "horizon_days": days,
        "rms_in_use_arcsec": None if found.in_use is None else found.in_use / ARCSEC,
        "rms_if_issued_arcsec": found.if_issued / ARCSEC,
        "rms_if_calibrated_arcsec": found.if_calibrated / ARCSEC,
        "rms_in_use_m": metres(found.in_use),
        "rms_if_issued_m": metres(found.if_issued),
        "rms_if_calibrated_m": metres(found.if_calibrated),
        "gain_m": metres(found.gain),
        "calibrate_by": by,
    }


def _sentence(found: Advice, height_m: float | None, by: str | None, days: float) -> str:
    def size(angle: float) -> str:
        return f"{angle / ARCSEC:.2f} arcsec" if height_m is None else f"{angle * height_m:.2f} m"

    over = f"over the next {days:g} days" if days != 1 else "over the next day"
    due = "" if by is None else f"; calibrate again by {by[:10]}"
    if found.action == "calibrate":
        change = f"{size(found.if_issued)} to {size(found.if_calibrated)}"
        return f"calibrate again by {str(by)[:10]}: a campaign like the latest brings the expected error from {change}"
    if found.in_use is None:
        right = f"it is expected to be right to {size(found.if_issued)} {over}"
        return f"issue the mounting foretold: nothing was issued, {right}{due}"
    change = f"{size(found.in_use)} to {size(found.if_issued)} {over}"
    if found.action == "issue":
        return f"issue the mounting foretold: it brings the expected error from {change}{due}"
    return f"keep the mounting in use: another would bring the expected error from {change}{due}"
