"""The attitude of a campaign to its files, one series or one for each star tracker, and the sections that name them."""

from __future__ import annotations

import numpy as np

from ...physics import so3
from ...physics.series import Attitude
from ...physics.timescales import format_iso
from ...physics.trackers import FusedAttitude, TrackerSeries
from ...physics.units import ARCSEC
from ...table.campaign import Campaign, SharedErrors
from ..tables.cells import Array
from ..tables.read import Epochs
from ..text.write import csv_text
from .motion import QUATERNION, SIGMA_ATTITUDE
from .toml_text import Sections, in_unit

_ALONG_AXES = 1e-6
"""Correlation that a table of three sigmas may leave out."""


def attitude_files(campaign: Campaign, scale: str) -> dict[str, str]:
    """Every table of attitude by its file's name.

    Raises ValueError where covariances that differ from image to image are not along E's axes.
    """
    attitude = campaign.attitude
    if isinstance(attitude, FusedAttitude):
        return {
            _file(i): _table(tracker.attitude, tracker.sigma_S if tracker.sigma_S.ndim == 2 else None, scale)
            for i, tracker in enumerate(attitude.trackers)
        }
    if campaign.cov_attitude_E.ndim == 2:
        return {"attitude.csv": _table(attitude, None, scale)}
    sigma = along_axes(
        campaign.cov_attitude_E, "the images' attitude covariances are not along the axes of E"
    )
    order = np.argsort(campaign.images.t_ns)
    at = (attitude.t_ns - attitude.t_ns[0]) * 1e-9
    known = (campaign.images.t_ns[order] - attitude.t_ns[0]) * 1e-9
    sigma = np.stack([np.interp(at, known, column) for column in sigma[order].mT], axis=-1)
    return {"attitude.csv": _table(attitude, sigma, scale)}


def attitude_sections(campaign: Campaign, frame: str) -> Sections:
    """[attitude], or [[trackers]] and [fusion]; ``frame`` is the name of E."""
    attitude = campaign.attitude
    if isinstance(attitude, FusedAttitude):
        stated = shared(campaign.attitude_errors, ARCSEC, "session_sigma_arcsec")
        trackers = [
            ("[trackers]", _tracker(i, tracker, frame) | stated)
            for i, tracker in enumerate(attitude.trackers)
        ]
        axes = {_axes(t): _turn(t.C_AS.mT, {"from": t.name}) for t in attitude.trackers if _turned(t)}
        frames = [("frames", axes)] if axes else []
        return [*trackers, ("fusion", {"frame": frame, "method": attitude.fusion}), *frames]
    keys: dict[str, object] = {"file": "attitude.csv", "from": attitude.frame, "to": frame}
    if campaign.cov_attitude_E.ndim == 2:
        keys |= _stated(campaign.cov_attitude_E)
    stated = shared(campaign.attitude_errors, ARCSEC, "session_sigma_arcsec")
    return [("attitude", keys | stated | gap(attitude.gap_s))]


def _tracker(i: int, tracker: TrackerSeries, frame: str) -> dict[str, object]:
    keys: dict[str, object] = {"file": _file(i), "from": tracker.attitude.frame, "to": tracker.name}
    if tracker.sigma_S.ndim == 1:
        keys["sigma_arcsec"] = in_unit(tracker.sigma_S, ARCSEC)
    if _turned(tracker):
        keys["sigma_frame"] = _axes(tracker)
    if tracker.name != frame:
        keys["mounting"] = _turn(tracker.C_EA, {"from": tracker.name, "to": frame})
    return keys | gap(tracker.attitude.gap_s)


def _stated(covariance: Array) -> dict[str, object]:
    """The covariance (3, 3) rad^2, as three sigmas where it is along its axes."""
    try:
        return {"sigma_arcsec": in_unit(along_axes(covariance, ""), ARCSEC)}
    except ValueError:
        return {"covariance_arcsec2": covariance / ARCSEC**2}


def _turned(tracker: TrackerSeries) -> bool:
    """Whether its sigmas are about other axes than its own."""
    return not np.array_equal(tracker.C_AS, np.eye(3))


def _axes(tracker: TrackerSeries) -> str:
    """The name of the frame about whose axes its sigmas are."""
    return f"{tracker.name} sigmas"


def _turn(C: Array, ends: dict[str, object]) -> dict[str, object]:
    return ends | {"quaternion_xyzw": so3.to_quaternion(C)}


def _file(i: int) -> str:
    return f"tracker{i + 1}.csv"


def _table(attitude: Attitude, sigma: Array | None, scale: str) -> str:
    """Samples with their sigmas (n, 3) rad, where they have sigmas of their own."""
    header, columns = ["time", *QUATERNION], [times(attitude.t_ns, scale), *attitude.q_EF.mT]
    if sigma is not None:
        header, columns = [*header, *SIGMA_ATTITUDE], [*columns, *(sigma / ARCSEC).mT]
    return csv_text(header, columns)


def along_axes(covariance: Array, complaint: str) -> Array:
    """Sigmas (..., 3) of covariances (..., 3, 3); ValueError where more than they is in them."""
    variance = np.diagonal(covariance, axis1=-2, axis2=-1)
    left_out = covariance - variance[..., None, :] * np.eye(3)
    if np.any(np.abs(left_out) > _ALONG_AXES * np.max(variance, axis=-1)[..., None, None]):
        raise ValueError(complaint)
    return np.sqrt(variance)


def times(t_ns: Epochs, scale: str) -> list[str]:
    return format_iso(t_ns, scale, digits=9)


def gap(gap_s: float | None) -> dict[str, object]:
    return {} if gap_s is None else {"max_gap_s": gap_s}


def shared(errors: SharedErrors, unit: float, session: str) -> dict[str, object]:
    """The keys that state how errors are shared, where that is stated; ``session`` is the key of a session's own.

    Raises ValueError for errors about other axes than E's and those of a session by several trackers.
    """
    keys: dict[str, object] = {"shared_by": errors.shared_by, "correlation_time_s": errors.correlation_time_s}
    if errors.session_estimated:
        keys[session] = "estimate"
    elif errors.session_sigma is not None:
        if errors.session_sigma.ndim > 1:
            raise ValueError("errors of a session about other axes than those of E cannot be written")
        keys[session] = in_unit(errors.session_sigma, unit)
    if errors.wander_sigma is not None:
        if errors.wander_sigma.ndim > 1:
            raise ValueError("errors within an image about other axes than those of E cannot be written")
        sigma = in_unit(errors.wander_sigma, unit)
        keys["wander"] = {"sigma_arcsec": sigma, "correlation_time_s": errors.wander_time_s}
    return {key: value for key, value in keys.items() if value is not None}
