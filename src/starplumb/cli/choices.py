"""What the options of ``calibrate`` come to: the estimator, and the landmarks of detections without names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..estimators.protocol import Estimator
    from ..identify.labelling import Labels
    from ..io.campaign.read import LoadedCampaign
    from ..judge.calibrate import Calibration
    from ..table.campaign import Campaign

WEIGHTED = ("gls", "robust")
"""Methods whose adjustment can carry further parameters."""


def estimator_of(method: str, estimate: Sequence[str], campaign: Campaign) -> Estimator:
    """The estimator of a method's name, with the parameters wanted beside the alignment.

    Raises InputError for an unknown method or parameter.
    """
    from ..estimators import METHODS
    from ..estimators.robust import Robust
    from ..estimators.selfcal import SelfCalibration
    from ..io.text.files import nearest
    from ..physics.errors import InputError
    from ..table.parameter_names import parameters

    if method not in METHODS:
        near = nearest(method, METHODS)
        hint = f" (did you mean {near}?)" if near else ""
        raise InputError(f"--method: found {method!r}, wanted one of {', '.join(METHODS)}{hint}")
    wanted = [name.strip() for text in estimate for name in text.split(",") if name.strip()]
    if not wanted:
        return METHODS[method]()
    if method not in WEIGHTED:
        raise InputError(f"--estimate: found --method {method}, wanted {' or '.join(WEIGHTED)}")
    calibration = SelfCalibration(parameters(wanted, campaign))
    return Robust(calibration) if method == "robust" else calibration


def labelled(loaded: LoadedCampaign, reach_deg: float) -> tuple[LoadedCampaign, Labels | None]:
    """The campaign with its detections named, and the labels; as it is where its landmarks are known."""
    from dataclasses import replace

    from ..identify.labelling import label
    from ..physics.errors import InputError
    from ..physics.units import DEG

    if loaded.detections is None:
        return loaded, None
    if not 0.0 < reach_deg <= 10.0:
        raise InputError(
            f"--reach-deg: found {reach_deg:g}, wanted the largest error of the mounting, 0 to 10"
        )
    labels = label(loaded.campaign, loaded.detections, reach_deg * DEG)
    campaign = replace(loaded.campaign, sightings=labels.sightings(loaded.detections))
    return replace(loaded, campaign=campaign), labels


def label_files(loaded: LoadedCampaign, labels: Labels) -> dict[str, str]:
    """``labels.csv``: what became of each detection; ``observations.csv``: the named ones, to be used as such."""
    from ..io.results.labels import LABEL_COLUMNS, OBSERVATION_COLUMNS, label_columns, observation_columns
    from ..io.text.write import csv_text

    return {
        "labels.csv": csv_text(LABEL_COLUMNS, label_columns(loaded, labels)),
        "observations.csv": csv_text(OBSERVATION_COLUMNS, observation_columns(loaded)),
    }


def label_sentence(labels: Labels) -> str:
    """How many detections were named, and why the others were not."""
    counts: dict[str, Any] = labels.counts
    return (
        f"{counts['labelled']} of {counts['detections']} detections named; {counts['no_landmark']} fit no landmark, "
        f"{counts['ambiguous']} more than one"
    )


def outcome_sentences(done: Calibration) -> list[str]:
    """What was rejected and what was estimated beside the alignment, a line each; nothing where there was none."""
    import numpy as np

    from ..judge.separability import known
    from ..table.parameter_names import UNITS, unit_of

    lines = []
    if done.rejected:
        kinds = [r.reason.split(":")[0] for r in done.rejected]
        counts = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        lines.append(f"rejected {len(done.rejected)} sightings ({counts}): see result.json")
    p = done.estimate.parameters
    if p is not None:
        sigma = np.sqrt(np.diagonal(p.covariance))[3:]
        trusted = known(p, list(done.combinations))
        for name, value, spread, good in zip(p.names, p.values, sigma, trusted, strict=True):
            unit = unit_of(name)
            number = f"{value / UNITS[unit]:+.4g} +- {spread / UNITS[unit]:.2g} {unit}".rstrip()
            lines.append(f"{name}: {number if good else 'not known from these data'}")
    return lines
