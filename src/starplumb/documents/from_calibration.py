"""``result.json`` of a calibration, and that of detections that could not be matched with landmarks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__
from ..estimators.protocol import ParameterVector, Status
from ..judge.accuracy.requirement import Met
from ..judge.calibrate import Calibration
from ..judge.conventions.rests_on import RestsOn
from ..judge.error_shares import shares
from ..judge.parameters.separability import known, of_camera
from ..judge.residuals import Accuracy, rms
from ..physics import so3
from ..physics.timescales import format_iso
from ..physics.units import ARCSEC, DEG
from ..table.campaign import Campaign
from ..table.parameter_names import UNITS, unit_of
from ..table.phases import Phases, phases
from ..table.sharing import passes, sessions
from .cameras.mountings import mounting_part, mountings_part
from .motion import motion_document, orbit_document
from .numbers import numbers

if TYPE_CHECKING:
    from ..identify.labelling import Labels

Array = NDArray[np.float64]

RESULT_SCHEMA = "starplumb-result/1"
LISTED_AT_MOST = 10_000
"""Images, and landmarks, in ``result.json``; of more the worst: who opens it looks for those."""


def result_document(
    calibration: Calibration,
    method: str,
    frames: tuple[str, str],
    inputs: Mapping[str, str],
    provenance: Mapping[str, Any],
    truth: Array | None = None,
) -> dict[str, Any]:
    """``result.json`` as a dictionary; ``frames`` are the user's names of camera and star tracker.

    Numbers that cannot be stated (no covariance, a singular solution, lines of sight that miss the Earth) are null.
    """
    c, estimate = calibration, calibration.estimate
    covariance, sigma, interval = c.covariance_E, c.sigma_E, c.interval_95_E
    refuted, where = c.status is Status.REFUTED, phases(c.campaign)
    return {
        "schema": RESULT_SCHEMA,
        "status": c.status.name.lower(),
        "message": c.message,
        "campaign": c.campaign.name,
        "method": method,
        "mounting": mounting_part(*frames, c.C_EK),
        **mountings_part(c, frames[1]),
        "correction_arcsec": None if refuted else numbers(c.correction_E / ARCSEC),
        "sigma_arcsec": None if sigma is None else numbers(sigma / ARCSEC),
        "covariance_arcsec2": None if covariance is None else numbers(covariance / ARCSEC**2),
        "interval_95_arcsec": None if interval is None else numbers(interval / ARCSEC),
        **_from_data(c),
        "rests_on": [_rests_on(one) for one in c.rests_on],
        **motion_document(c),
        "span": _span(c),
        "orbit": orbit_document(where.orbit),
        "fit": _fit(c),
        "geolocation": {
            "before": accuracy_document(c.accuracy(after=False)),
            "after": accuracy_document(c.accuracy(after=True)),
            "check": _check(c),
        },
        "rejected": [
            {
                "image_id": c.campaign.images.ids[r.image],
                "landmark_id": c.campaign.landmarks.ids[r.landmark],
                "statistic": r.statistic,
                "reason": r.reason,
            }
            for r in c.rejected
        ],
        **_budget(c),
        **({} if estimate.parameters is None or refuted else _parameters(c, estimate.parameters)),
        **_shared(c, where),
        **({} if truth is None or refuted else {"truth": _truth(c, truth)}),
        "inputs": dict(inputs),
        "software": software(),
        **provenance,
        "notices": [*provenance.get("notices", ()), *c.notices],
    }


def _from_data(c: Calibration) -> dict[str, Any]:
    """What the scatter of the images says of the answer and of each source; null where it cannot tell."""
    found = c.from_data
    if found is None:
        none = (
            "sigma_from_data_arcsec",
            "degrees_of_freedom_from_data",
            "jackknife_sigma_arcsec",
            "next_session",
        )
        return {**dict.fromkeys(none), "sources": []}

    def arcsec(angles: Array | None) -> Any:
        return None if angles is None else numbers(angles / ARCSEC)

    return {
        "sigma_from_data_arcsec": arcsec(found.sigma_E),
        "degrees_of_freedom_from_data": None if found.degrees is None else numbers(found.degrees),
        "jackknife_sigma_arcsec": arcsec(found.jackknife_E),
        "next_session": _next_session(c),
        "sources": [
            {
                "name": source.name,
                "unit": source.unit,
                "stated": numbers(source.stated),
                "found": numbers(source.found),
                "ratio": None if source.ratio is None else numbers(source.ratio),
                "ratio_interval_95": None if source.interval is None else numbers(np.array(source.interval)),
                "p": numbers(source.p),
            }
            for source in found.sources
        ],
    }


def _next_session(c: Calibration) -> dict[str, Any] | None:
    """What a further session or pass shows; null where the data tell of none."""
    further, half = None if c.from_data is None else c.from_data.next_session, c.next_session_95_E
    if further is None or half is None:
        return None
    return {"of": further.of, "groups": further.groups, "interval_95_arcsec": numbers(half / ARCSEC)}


def _rests_on(one: RestsOn) -> dict[str, Any]:
    """A number that was not estimated, from where it matters to each axis, and the sigmas if it is estimated."""
    return {
        "what": one.of.words,
        "estimate": one.of.key,
        "unit": one.of.unit,
        "matters_from": numbers(one.matters),
        "sigma_if_estimated_arcsec": numbers(one.sigma_E / ARCSEC),
    }


def _span(c: Calibration) -> dict[str, str] | None:
    """First and last time of the images, UTC."""
    t_ns = c.campaign.images.t_ns
    if t_ns.size == 0:
        return None
    first, last = format_iso(np.array([t_ns.min(), t_ns.max()]), "UTC")
    return {"first": first, "last": last}


def _truth(c: Calibration, C_EK_true: Array) -> dict[str, Any]:
    """Where a simulation started from: the true correction, the error of the estimate and that over its sigma."""
    error = so3.log(c.estimate.C_EK @ C_EK_true.mT)
    sigma = c.estimate.sigma_E
    return {
        "quaternion_xyzw": numbers(so3.to_quaternion(C_EK_true)),
        "correction_arcsec": numbers(so3.log(C_EK_true @ c.campaign.C_EK.mT) / ARCSEC),
        "error_arcsec": numbers(error / ARCSEC),
        "error_over_sigma": None if sigma is None else numbers(error / sigma),
    }


def requirement_document(found: Met) -> dict[str, Any]:
    """What was required and whether it is met, for ``result.json``."""
    wanted = found.requirement
    said = {"text": wanted.text, "limit": wanted.limit, "unit": wanted.unit}
    return said | {"found": found.found, "of": found.of, "met": found.met, "sentence": found.sentence}


def unmatched_document(
    campaign: Campaign, labels: Labels, method: str, frames: tuple[str, str], inputs: Mapping[str, str]
) -> dict[str, Any]:
    """``result.json`` where detections could not be matched with landmarks: no number but the model mounting's."""
    nothing = {"rmse_m": None, "ce90_m": None}
    return {
        "schema": RESULT_SCHEMA,
        "status": "not_converged",
        "message": labels.refusal,
        "method": method,
        "mounting": mounting_part(*frames, campaign.C_EK),
        "correction_arcsec": None,
        "sigma_arcsec": None,
        "covariance_arcsec2": None,
        "interval_95_arcsec": None,
        "fit": {
            "images": len(campaign.images.ids),
            "observations": 0,
            "degrees_of_freedom": 0,
            **dict.fromkeys(("chi2", "chi2_p", "rms_px", "iterations")),
        },
        "geolocation": {"before": nothing, "after": nothing, "check": None},
        "rejected": [],
        "labels": labels.counts,
        "inputs": dict(inputs),
        "software": software(),
    }


def software() -> dict[str, str]:
    return {"starplumb": __version__, "numpy": np.__version__}


def accuracy_document(accuracy: Accuracy | None) -> dict[str, Any]:
    if accuracy is None:
        return {"rmse_m": None, "ce90_m": None}
    return {"rmse_m": accuracy.rmse, "ce90_m": accuracy.ce90}


def _check(c: Calibration) -> dict[str, Any] | None:
    after = c.accuracy(after=True, check=True)
    if after is None:
        return None
    before = c.accuracy(after=False, check=True)
    return {**accuracy_document(after), "observations": after.n, "before": accuracy_document(before)}


def _fit(c: Calibration) -> dict[str, Any]:
    """Counts and quality of the fit: ``rms_px`` at the estimate, ``rms_own_px`` less each image's and landmark's own
    estimated error."""
    used = c.residuals.used
    images = c.campaign.sightings.image[used]
    dof = c.estimate.degrees_of_freedom
    return {
        "images": int(np.unique(images).size),
        "observations": int(images.size),
        "degrees_of_freedom": int(2 * images.size - 3) if dof is None else int(dof),
        "chi2": None if c.estimate.chi2 is None else numbers(c.estimate.chi2),
        "chi2_p": c.chi2_p,
        "rms_px": numbers(rms(c.residuals.after_px[used])),
        "rms_own_px": numbers(rms(c.residuals.fit_px[used])),
        "iterations": int(c.estimate.iterations),
    }


def _budget(c: Calibration) -> dict[str, Any]:
    """What each error source alone contributes to the sigmas; nothing where the method does not say."""
    rows = [
        {"source": name, "sigma_arcsec": numbers(np.sqrt(np.diagonal(part)) / ARCSEC)}
        for name, part in shares(c).items()
    ]
    return {"budget": rows} if rows else {}


def _parameters(c: Calibration, p: ParameterVector) -> dict[str, Any]:
    """What was estimated beside the alignment, each in its unit, and the covariance of all of it with the alignment.

    A parameter that the data do not tell is not ``known`` and its correction null.
    """
    units = [unit_of(name) for name in p.names]
    scale = np.array([ARCSEC] * 3 + [UNITS[unit] for unit in units])
    trusted = known(p, list(c.combinations))
    sigma = np.sqrt(np.diagonal(p.covariance)) / scale
    listed = [
        {
            "name": name,
            "unit": units[i],
            "known": bool(trusted[i]),
            "correction": numbers(p.values[i] / scale[3 + i]) if trusted[i] else None,
            "sigma": numbers(sigma[3 + i]),
            "prior_sigma": numbers(p.prior_sigma[i] / scale[3 + i]),
        }
        for i, name in enumerate(p.names)
        if not of_camera(name)
    ]
    if not listed:
        return {}
    axes = [f"alignment_{axis}_arcsec" for axis in "xyz"]
    names = [f"{name}_{unit}".rstrip("_") for name, unit in zip(p.names, units, strict=True)]
    covariance = {"names": axes + names, "matrix": numbers(p.covariance / scale[:, None] / scale)}
    return {"parameters": listed, "parameter_covariance": covariance}


def _shared(c: Calibration, where: Phases) -> dict[str, Any]:
    """Images and landmarks with their residuals; of very many those that fit worst, and how many are left out."""
    images, landmarks = c.campaign.images.ids, c.campaign.landmarks.ids
    of_images = _grouped(c, c.campaign.sightings.image, len(images))
    of_landmarks = _grouped(c, c.observations.landmark, len(landmarks))
    left = {
        "images": max(len(images) - LISTED_AT_MOST, 0),
        "landmarks": max(len(landmarks) - LISTED_AT_MOST, 0),
    }
    listed = _worst(of_images[:, 1])
    when = _when(c, listed, where)
    return {
        "images": [_image(c, i) | when[i] | _residuals(of_images, i) for i in listed],
        "landmarks": [
            {"landmark_id": landmarks[i]} | _residuals(of_landmarks, i) for i in _worst(of_landmarks[:, 2])
        ],
        **({"not_listed": left} if any(left.values()) else {}),
    }


def _when(c: Calibration, chosen: list[int], where: Phases) -> dict[int, dict[str, Any]]:
    """Time (UTC), pass, session and place on the orbit of images, by their number; passes and sessions without a name
    by their number."""
    images = c.campaign.images
    times = format_iso(images.t_ns[chosen], "UTC")
    of_pass, of_session = passes(c.campaign) + 1, sessions(c.campaign) + 1
    return {
        i: {
            "time": time,
            "pass": str(of_pass[i]) if images.passes is None else images.passes[i],
            "session": str(of_session[i]) if images.sessions is None else images.sessions[i],
            "argument_of_latitude_deg": numbers(where.u[i] / DEG % 360.0),
            "sun_beta_deg": numbers(where.beta[i] / DEG),
            **_temperatures(c, i),
        }
        for i, time in zip(chosen, times, strict=True)
    }


def _temperatures(c: Calibration, i: int) -> dict[str, Any]:
    found = {name: float(values[i]) for name, values in c.campaign.images.temperatures.items()}
    return {"temperatures_c": found} if found else {}


def _grouped(c: Calibration, group: NDArray[np.int64], n: int) -> Array:
    """Sightings used, rms and own rms in pixels of each of n groups, (n, 3); zeros for none."""
    r = c.residuals
    mine = group[r.used]
    count = np.bincount(mine, minlength=n)
    squares = (np.sum(px[r.used] ** 2, axis=-1) for px in (r.after_px, r.fit_px))
    roots = (np.sqrt(np.bincount(mine, s, n) / np.maximum(2 * count, 1)) for s in squares)
    return np.stack([count, *roots], axis=-1)


def _worst(rms_px: Array) -> list[int]:
    """Rows that are listed, in order: all, or those of the largest rms."""
    chosen = np.argsort(-rms_px, kind="stable")[:LISTED_AT_MOST]
    return [int(i) for i in np.sort(chosen)]


def _residuals(grouped: Array, i: int) -> dict[str, Any]:
    count, rms_px, own = grouped[i]
    return {"observations": int(count), "rms_px": numbers(rms_px), "rms_own_px": numbers(own)}


def _image(c: Calibration, i: int) -> dict[str, Any]:
    """An image's own estimated attitude and position error, and how many sigmas that is."""
    r = c.residuals
    tested = None if c.snooping is None else c.snooping.tested.images[0][i]
    return {
        "image_id": c.campaign.images.ids[i],
        "attitude_error_arcsec": numbers(r.alpha_E[i] / ARCSEC),
        "position_error_m": numbers(r.rho_J[i]),
        "statistic": None if tested is None else numbers(np.sqrt(tested)),
    }
