"""The files of a calibration: result.json, residuals.csv and the SPICE kernel mounting.tf."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import __version__, so3
from ..calibration import Calibration
from ..errors import InputError
from ..estimators.protocol import ParameterVector
from ..residuals import Accuracy, rms
from ..separability import known
from ..shares import shares
from ..snooping import Snooping
from ..units import ARCSEC
from ..wanted import UNITS, unit_of
from .campaign import LoadedCampaign
from .files import read_text

Array = NDArray[np.float64]

SCHEMA = "starplumb-result/1"


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
    covariance, sigma = estimate.covariance_E, estimate.sigma_E
    return {
        "schema": SCHEMA,
        "status": c.status.name.lower(),
        "message": c.message,
        "method": method,
        "mounting": {
            "from": frames[0],
            "to": frames[1],
            "matrix": numbers(estimate.C_EK),
            "quaternion_xyzw": numbers(so3.to_quaternion(estimate.C_EK)),
        },
        "correction_arcsec": numbers(c.correction_E / ARCSEC),
        "sigma_arcsec": None if sigma is None else numbers(sigma / ARCSEC),
        "covariance_arcsec2": None if covariance is None else numbers(covariance / ARCSEC**2),
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
        **({} if estimate.parameters is None else _parameters(c, estimate.parameters)),
        "images": _images(c),
        "landmarks": _landmarks(c),
        **({} if truth is None else {"truth": _truth(c, truth)}),
        "inputs": dict(inputs),
        "software": {"starplumb": __version__, "numpy": np.__version__},
        **provenance,
    }


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


def provenance(loaded: LoadedCampaign) -> dict[str, Any]:
    """Where the Earth's orientation came from, whether it was predicted, and which corrections were on."""
    c = loaded.campaign.corrections
    orientation = loaded.orientation
    return {
        "earth_orientation": None
        if orientation is None
        else {"source": orientation.source, "predicted": loaded.predicted_orientation},
        "corrections": {"light_time": c.light_time, "aberration": c.aberration, "refraction": c.refraction},
        "notices": list(loaded.notices),
    }


def read_mounting(path: Path, loaded: LoadedCampaign) -> tuple[Array, Array, str]:
    """C_EK, its covariance (rad^2 about E; zero where none is stated) and a word on it from a ``result.json``.

    Raises InputError where the file is no such result, its frames are not the campaign's, or its status forbids it.
    """
    try:
        document = json.loads(read_text(path))
        mounting, status = document["mounting"], document["status"]
        C_EK = np.array(mounting["matrix"], dtype=np.float64)
        stated = document["covariance_arcsec2"]
        covariance = np.zeros((3, 3)) if stated is None else ARCSEC**2 * np.array(stated, dtype=np.float64)
        frames = (mounting["from"], mounting["to"])
        usable = C_EK.shape == covariance.shape == (3, 3) and np.allclose(
            C_EK @ C_EK.mT, np.eye(3), atol=1e-6
        )
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: found no usable mounting ({error!r}), wanted a {SCHEMA} result") from None
    if status not in ("ok", "weak") or not usable:
        raise InputError(
            f"{path}: status: found {status!r}, wanted a result whose mounting may be used (ok or weak)"
        )
    wanted = ("camera", loaded.config.tracker)
    if frames != wanted:
        raise InputError(
            f"{path}: mounting: found {frames[0]} to {frames[1]}, wanted {wanted[0]} to {wanted[1]}"
        )
    return C_EK, covariance, f"{path.name}, {document['method']}" + ("" if stated else ", no sigma stated")


def numbers(values: Any) -> Any:
    """Nested lists of floats; a number that is not finite becomes null, which JSON can say."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim == 0:
        return float(array) if np.isfinite(array) else None
    return [numbers(row) for row in array]


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
    images = c.observations.image[used]
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
    ]
    axes = [f"alignment_{axis}_arcsec" for axis in "xyz"]
    names = [f"{name}_{unit}".rstrip("_") for name, unit in zip(p.names, units, strict=True)]
    covariance = {"names": axes + names, "matrix": numbers(p.covariance / scale[:, None] / scale)}
    return {"parameters": listed, "parameter_covariance": covariance}


def _images(c: Calibration) -> list[dict[str, Any]]:
    """Each image's residuals and its own estimated attitude and position error, and how many sigmas that is."""
    r, rows = c.residuals, []
    statistic = None if c.snooping is None else np.sqrt(c.snooping.tested.images[0])
    for i, name in enumerate(c.campaign.images.ids):
        mine = r.used & (c.observations.image == i)
        rows.append(
            {
                "image_id": name,
                "observations": int(np.sum(mine)),
                "rms_px": numbers(rms(r.after_px[mine])),
                "rms_own_px": numbers(rms(r.fit_px[mine])),
                "attitude_error_arcsec": numbers(r.alpha_E[i] / ARCSEC),
                "position_error_m": numbers(r.rho_J[i]),
                "statistic": None if statistic is None else numbers(statistic[i]),
            }
        )
    return rows


def _landmarks(c: Calibration) -> list[dict[str, Any]]:
    r, rows = c.residuals, []
    order = np.argsort(c.observations.landmark, kind="stable")
    bounds = np.searchsorted(c.observations.landmark[order], np.arange(len(c.campaign.landmarks.ids) + 1))
    for i, name in enumerate(c.campaign.landmarks.ids):
        mine = order[bounds[i] : bounds[i + 1]]
        mine = mine[r.used[mine]]
        rows.append(
            {
                "landmark_id": name,
                "observations": int(mine.size),
                "rms_px": numbers(rms(r.after_px[mine])),
                "rms_own_px": numbers(rms(r.fit_px[mine])),
            }
        )
    return rows


RESIDUAL_COLUMNS = [
    "image_id",
    "landmark_id",
    "role",
    "column_px",
    "row_px",
    "before_column_px",
    "before_row_px",
    "after_column_px",
    "after_row_px",
    "own_column_px",
    "own_row_px",
    "normalised",
    "before_east_m",
    "before_north_m",
    "after_east_m",
    "after_north_m",
]
"""``residuals.csv``: predicted minus measured pixel before, after, and less each image's and landmark's own error."""
RELIABILITY_COLUMNS = [
    "statistic",
    "w_column",
    "w_row",
    "tau_column",
    "tau_row",
    "redundancy",
    "detectable_column_px",
    "detectable_row_px",
    "effect_arcsec",
]
"""What :class:`starplumb.snooping.Snooping` says of each sighting, behind the others where the method says it."""


def residual_names(c: Calibration) -> Sequence[str]:
    """Header of ``residuals.csv``."""
    return [*RESIDUAL_COLUMNS, *([] if c.snooping is None else RELIABILITY_COLUMNS)]


def residual_columns(c: Calibration, shift_px: float) -> Sequence[Sequence[object]]:
    """Columns of ``residuals.csv``, one row a sighting in the order of the observation table.

    Pixels are given as the user counts them, ``shift_px`` ahead of ours.
    """
    s, r = c.campaign.sightings, c.residuals
    images, landmarks = c.campaign.images.ids, c.campaign.landmarks.ids
    role = np.where(s.check, "check", np.where(r.used, "control", "rejected"))
    pairs = (r.before_px, r.after_px, r.fit_px)
    ground = (r.before_m, r.after_m)
    return [
        [images[i] for i in s.image],
        [landmarks[i] for i in s.landmark],
        role.tolist(),
        (s.column_px + shift_px).tolist(),
        (s.row_px + shift_px).tolist(),
        *(pair[:, i].tolist() for pair in pairs for i in range(2)),
        r.normalised.tolist(),
        *(pair[:, i].tolist() for pair in ground for i in range(2)),
        *([] if c.snooping is None else _reliability_columns(c.snooping)),
    ]


def _reliability_columns(s: Snooping) -> Sequence[Sequence[object]]:
    """An error that nothing would show (infinite) is left empty."""
    detectable = [["" if np.isinf(x) else x for x in s.detectable_px[:, i].tolist()] for i in range(2)]
    effect = ["" if not np.isfinite(x) else x for x in (s.effect_E / ARCSEC).tolist()]
    pairs = [values[:, i].tolist() for values in (s.w, s.tau) for i in range(2)]
    return [s.statistic.tolist(), *pairs, s.redundancy.tolist(), *detectable, effect]
