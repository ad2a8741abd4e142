"""A choice of images as a document and in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...documents.numbers import numbers
from ...io.scenario.tied import ACROSS
from ...physics.earth import itrf_to_geodetic
from ...physics.timescales import format_iso
from ...physics.units import ARCSEC, DEG
from ...plan.choice.kinds import TIES, USUAL
from ...plan.scene import epochs_ns
from ...report.text import counted
from ...study.budget_document import about
from .choice import Choice

Array = NDArray[np.float64]

SCHEMA = "starplumb-plan/1"
CRITERION = (
    "rms error on the ground, m, over the field of view straight down, by the mounting alone "
    "(A-optimality: the trace of its covariance, weighted by what a turn does on the ground)"
)
INITIAL = "the scenario's [initial]"
"""What is known before by the scenario itself: of the first camera alone."""
NAMED = 0.1
"""A source is named in a sentence from this part of the variance on."""
DIFFERENT = 0.02
"""Part by which the whole noise model may differ from the sums that images are chosen by, and be the same."""
WORTH_SAYING = 1.05
"""A kind of view cures where it is so many times better than more of the usual."""


def document(found: Choice, given: str | None, notices: Sequence[str]) -> dict[str, Any]:
    """``plan.json`` as a dictionary."""
    config, v = found.stage.config, found.views
    start, end = _utc(found, np.array([found.asked.start_s, found.asked.end_s]))
    last = found.known[-1] if found.known else found.design.P_theta
    axis = _worst(found, last)
    bound, rms = float(np.sqrt(found.certificate.bound)), found.rms(last)
    return {
        "schema": SCHEMA,
        "scenario": config.scenario.name,
        "description": config.scenario.description,
        "start": start,
        "end": end,
        "criterion": CRITERION,
        "candidates": {
            "views": v.n,
            "passes": int(np.unique(v.pass_of).size),
            "sites": [found.sites.names[k] for k in np.unique(v.site).tolist()],
        },
        "before": _before(found, given),
        "kinds": [
            {"kind": cure.kind, "images": cure.count, "rms_m": float(np.sqrt(cure.value))}
            for cure in found.cures
        ],
        "in_words": list(words(found)),
        "images": _images(found),
        "bound": {
            "rms_m": bound,
            "within_percent": 100.0 * max(rms / bound - 1.0, 0.0),
            "rounds": found.certificate.rounds,
        },
        "usual": _usual(found),
        "tie_points": _ties(found),
        "checked": _checked(found),
        "cameras": _cameras(found, given),
        "shared_errors": found.shares(found.picks, axis),
        "target": None if found.asked.sigma <= 0.0 else _target(found, last),
        "notices": [*notices, *_doubts(found)],
    }


def _utc(found: Choice, time_s: Array) -> list[str]:
    return list(format_iso(epochs_ns(found.stage.epoch_ns, time_s), "UTC", 3))


def _sigma(P: Array) -> list[float]:
    return [float(x) for x in np.sqrt(np.diagonal(P)) / ARCSEC]


def _worst(found: Choice, P: Array) -> Array:
    """Direction (3,) in E of the error that is largest on the ground."""
    R = found.design.root
    _, axes = np.linalg.eigh(R.T @ P @ R)
    turn = P @ R @ axes[:, -1]
    return np.asarray(turn / np.linalg.norm(turn))


def _before(found: Choice, given: str | None) -> dict[str, Any]:
    P = found.before_E
    axis = _worst(found, P)
    return {
        "given": given,
        "images": len(found.before),
        "sigma_arcsec": _sigma(P),
        "rms_m": found.rms(P),
        "axis_tracker": numbers(axis),
        "axis_sigma_arcsec": float(np.sqrt(axis @ P @ axis)) / ARCSEC,
        "sources": found.shares(found.before, axis),
    }


def _images(found: Choice) -> list[dict[str, Any]]:
    v, sites = found.views, found.sites
    latitude, longitude, _ = itrf_to_geodetic(sites.r_J)
    times = _utc(found, v.time_s)
    passes = {p: k + 1 for k, p in enumerate(np.unique(v.pass_of[list(found.picks)]).tolist())}
    before = found.design.P_theta if found.asked.P_theta is not None else None
    rows = []
    for k, (j, P) in enumerate(zip(found.picks, found.known, strict=True)):
        size, site = found.detectable[k], int(v.site[j])
        rows.append(
            {
                "order": k + 1,
                "time": times[j],
                "site": sites.names[site],
                "latitude_deg": float(latitude[site]) / DEG,
                "longitude_deg": float(longitude[site]) / DEG,
                "pitch_deg": float(v.pitch[j]) / DEG,
                "roll_deg": float(v.roll[j]) / DEG,
                "yaw_deg": float(v.yaw[j]) / DEG,
                "look_deg": float(v.look[j]) / DEG,
                "sun_deg": float(v.sun[j]) / DEG,
                "clear_probability": float(sites.clear[site]),
                "pass": passes[int(v.pass_of[j])],
                "argument_of_latitude_deg": float(v.u[j]) / DEG,
                "sigma_arcsec": _sigma(P),
                "rms_m": found.rms(P),
                "gain_m": None if before is None else found.rms(before) - found.rms(P),
                "detectable_arcsec": None if size is None else size / ARCSEC,
            }
        )
        before = P
    return rows


def _usual(found: Choice) -> dict[str, Any]:
    from .choice import covariance

    P = covariance(found.design, list(found.usual)) if found.usual else None
    return {"images": len(found.usual), "rms_m": None if P is None else found.rms(P)}


def _ties(found: Choice) -> dict[str, Any] | None:
    """What tie points at each site would add to the images chosen; null where that cannot be said."""
    P = found.tied(found.picks)
    return None if P is None else {"each": ACROSS**2, "sigma_arcsec": _sigma(P), "rms_m": found.rms(P)}


def _checked(found: Choice) -> dict[str, Any]:
    P = found.checked_E
    return {
        "sigma_arcsec": _sigma(P),
        "covariance_arcsec2": numbers(P / ARCSEC**2),
        "rms_m": found.rms(P),
        "chosen_by_rms_m": found.rms(found.clear_E),
    }


def _cameras(found: Choice, given: str | None) -> list[dict[str, Any]]:
    """How each further camera is known against the first after all images; ``left_out`` is what is not counted."""
    first = next(iter(found.stage.config.optics))
    return [
        {
            "camera": name,
            "against": first,
            "sigma_arcsec": _sigma(P),
            "left_out": None if given in (None, INITIAL) else f"what {given} says of {name}",
        }
        for name, P in found.cameras.items()
    ]


def _doubts(found: Choice) -> Iterator[str]:
    """What of the plan should not be taken at its word."""
    exact, sums = found.rms(found.checked_E), found.rms(found.clear_E)
    if abs(exact / sums - 1.0) > DIFFERENT:
        yield (
            f"by the whole noise model the chosen images give {exact:.3g} m, by the sums they were chosen by "
            f"{sums:.3g} m: errors that are correlated in time or on the ground were taken as shared or not at all"
        )
    if np.any(found.sites.clear < 1.0):
        yield "each image counts by its chance of a clear sky; which of them succeed decides the real accuracy"
    if len(found.picks) < found.asked.count and found.asked.sigma <= 0.0:
        yield (
            f"found {counted(len(found.picks), 'image')} that can be taken in the span, wanted {found.asked.count}; a "
            "longer span, more sites or quicker turns give more"
        )


def words(found: Choice) -> Iterator[str]:
    """What is badly determined, and which kind of view cures it."""
    P, n = found.before_E, len(found.before)
    axis = _worst(found, P)
    have = "what is given" if found.asked.P_theta is not None else f"{counted(n, 'view')} of the usual kind"
    if n or found.asked.P_theta is not None:
        size = float(np.sqrt(axis @ P @ axis)) / ARCSEC
        named = [
            f"{name} (its variance would fall by {100.0 * part:.0f} % were that known)"
            for name, part in found.shares(found.before, axis).items()
            if part >= NAMED
        ]
        causes = (
            f", mostly for {' and '.join(named)}" if named else ", by errors that each image has for itself"
        )
        yield (
            f"badly determined by {have}: {about(found.stage.C_EK.T @ axis)}, {size:.3g} arcsec"
            f"{causes if n else ''}; all axes together are {found.rms(P):.3g} m on the ground"
        )
    yield from _cure(found)


def _cure(found: Choice) -> Iterator[str]:
    if not [cure for cure in found.cures if cure.kind != TIES]:
        return
    best, usual = found.cures[0], next((c for c in found.cures if c.kind == USUAL), None)
    rms = float(np.sqrt(best.value))
    if best.kind == TIES:
        other = found.cures[1]
        yield (
            f"cured by tie points: {ACROSS**2} places at each site that nobody surveyed, measured in all images of it "
            f"that there are, leave {rms:.3g} m; {other.count} more images, {other.kind}, "
            f"{float(np.sqrt(other.value)):.3g} m"
        )
        return
    worth = f"{counted(best.count, 'image')} of that kind leave{'s' * (best.count == 1)} {rms:.3g} m"
    if usual is None:
        yield f"the kind of view that helps most: {best.kind}; {worth}"
        return
    more = float(np.sqrt(usual.value))
    if more > WORTH_SAYING * rms:
        yield f"cured by {best.kind}: {worth}, as many of the usual kind {more:.3g} m"
    else:
        yield f"no kind of view is much better than more of the same ({more:.3g} m); best is {best.kind}: {worth}"


def _target(found: Choice, last: Array) -> dict[str, Any]:
    wanted, have = found.asked.sigma / ARCSEC, max(_sigma(last))
    reached = have <= wanted * (1.0 + 1e-9)
    if reached:
        said = f"{wanted:g} arcsec about each axis is reached with {counted(len(found.picks), 'image')}"
    else:
        k = int(np.argmax(np.diagonal(last)))
        shares = found.shares(found.picks, np.eye(3)[k])
        name, part = next(iter(shares.items()), ("", 0.0))
        cause = (
            f"it is limited by {name}: were that known, the variance would fall by {100.0 * part:.0f} %"
            if part >= NAMED
            else "it is limited by errors that each image has for itself: more images lower it"
        )
        said = (
            f"{wanted:g} arcsec about each axis is not reached with {counted(len(found.picks), 'image')}: "
            f"{have:.3g} arcsec about {'xyz'[k]} are left; {cause}"
        )
    return {"target_arcsec": wanted, "reached": reached, "in_words": said}
