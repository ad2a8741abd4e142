"""What a campaign's files hold, before anything is solved: spans, gaps, digits, who sees what."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...physics.covariance import pixel_axes
from ...physics.rounding import ROUNDING
from ...physics.series import Attitude, Bursts, Ephemeris, seconds
from ...physics.units import ARCSEC
from ...table.appearance import row_span
from ...table.campaign import Campaign, some_of
from ...table.coverage import covered
from ...table.equation import linearise
from ...table.geometry import observe, stations
from .digits import DESIGNED_QUATERNION, landmark_rounding, step_px, written_step

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True)
class Span:
    """The samples of one series: ``ends_ns`` (2,) the first and the last, ``step_s`` their median spacing (None for one
    sample), and the ``gaps_ns`` (g, 2) across which nothing is interpolated."""

    kind: str
    name: str
    frame: str
    samples: int
    ends_ns: Index
    step_s: float | None
    gaps_ns: Index


@dataclass(frozen=True)
class Rounding:
    """The last digit of a column (``step`` in ``unit``) as a standard deviation, in the unit of the ``stated`` sigma
    that it is held against."""

    column: str
    step: float
    unit: str
    sigma: float
    stated: float
    stated_unit: str

    @property
    def share(self) -> float:
        """Rounding over the stated sigma; infinite where that is 0."""
        return self.sigma / self.stated if self.stated > 0.0 else float("inf")


def spans(campaign: Campaign) -> list[Span]:
    """Every series of orbit and attitude."""
    series: list[tuple[str, Ephemeris | Attitude, str]] = [
        ("ephemeris", campaign.ephemeris, campaign.position_frame)
    ]
    series += [("attitude", attitude, attitude.frame) for attitude in campaign.attitudes]
    return [_span(kind, each.name, frame, each.bursts) for kind, each, frame in series]


def _span(kind: str, name: str, frame: str, bursts: Bursts) -> Span:
    t_ns = bursts.t_ns
    last = bursts.bounds[1]
    ends = np.flatnonzero(last[:-1] == np.arange(t_ns.size - 1))
    step = float(np.median(seconds(np.diff(t_ns)))) if t_ns.size > 1 else None
    gaps = np.stack([t_ns[ends], t_ns[ends + 1]], axis=-1)
    return Span(kind, name, frame, int(t_ns.size), t_ns[[0, -1]], step, gaps)


def covered_images(campaign: Campaign) -> NDArray[np.bool_]:
    """Whether orbit and attitude cover each image (m,), or some of a line scanner's rows."""
    spans = [row_span(campaign, image) for image in range(len(campaign.images.ids))]
    return np.array([span is not None for span in spans], dtype=np.bool_)


def rates(campaign: Campaign) -> tuple[Array, Array]:
    """Speed (k,) m/s relative to the turning Earth and rate of rotation (k,) rad/s at the images that are covered."""
    spans = {image: row_span(campaign, image) for image in range(len(campaign.images.ids))}
    first = {image: max(span[0], 0.0) for image, span in spans.items() if span is not None}
    at = stations(campaign, np.array(list(first), dtype=np.int64), np.array(list(first.values())))
    return np.linalg.norm(at.v_J, axis=-1), np.linalg.norm(at.omega_E, axis=-1)


def roundings(campaign: Campaign) -> Iterator[Rounding]:
    """Columns that are written to a last digit, against the sigma that contains it or should."""
    attitude = float(np.sqrt(np.diagonal(campaign.cov_attitude_E, axis1=-2, axis2=-1)).min()) / ARCSEC
    position = float(np.min(campaign.sigma_position))
    speed, turn = rates(campaign)
    for what, step, moved, stated, unit in (
        ("image times", written_step(campaign.images.t_ns), speed, position, "m"),
        ("ephemeris times", written_step(campaign.ephemeris.t_ns), speed, position, "m"),
        *(
            ("attitude times", written_step(a.t_ns), turn / ARCSEC, attitude, "arcsec")
            for a in campaign.attitudes
        ),
    ):
        if step and moved.size:
            yield Rounding(what, step, "s", float(np.median(moved)) * step * ROUNDING, stated, unit)
    for series in campaign.attitudes:
        if 0.0 < series.quaternion_step <= DESIGNED_QUATERNION:
            sigma = 2.0 * series.quaternion_step * ROUNDING / ARCSEC
            yield Rounding("attitude quaternions", series.quaternion_step, "", sigma, attitude, "arcsec")
    yield from _of_marks(campaign)


def _of_marks(campaign: Campaign) -> Iterator[Rounding]:
    marks, sites = campaign.sightings, campaign.landmarks
    if marks.image.size and (step := step_px(np.stack([marks.column_px, marks.row_px]))):
        stated, _ = pixel_axes(marks.sigma_px, marks.ellipse)
        yield Rounding("pixels", step, "px", step * ROUNDING, float(np.min(stated)), "px")
    if (found := landmark_rounding(sites.r_J)) is not None:
        rounded, stated = (
            np.sqrt(np.trace(c, axis1=-2, axis2=-1) / 3.0) for c in (found[1], sites.covariance_J)
        )
        step = float(np.max(rounded)) / ROUNDING
        yield Rounding("places of landmarks", step, "m", float(np.max(rounded)), float(np.min(stated)), "m")


def misfits(campaign: Campaign) -> tuple[Array, Array, int]:
    """How far marks (k,) lie from where the model mounting puts their landmarks, in pixels and as angles, rad, and how
    many it puts behind the camera; marks outside orbit or attitude are left out."""
    marks = campaign.sightings
    seen = covered(campaign, marks.image, marks.row_px)
    if not seen.any():
        return np.empty(0), np.empty(0), 0
    chosen = some_of(marks, seen)
    table = observe(replace(campaign, sightings=chosen))
    at = linearise(table, campaign.C_EK)
    cosine = np.vecdot(table.e_E @ campaign.C_EK, table.e_K)
    return (
        np.linalg.norm(at.z_px[at.in_front], axis=-1),
        np.arccos(np.clip(cosine, -1.0, 1.0)),
        int(np.sum(~at.in_front)),
    )
