"""What ``starplumb archive trend`` and its neighbours print."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from ..document import Document, Matrix3, Number, Numbers3, Part


class TrendPoint(Part):
    """A campaign's own mounting, turned by ``value_arcsec`` from ``matrix``, the trend as it was known after it, and
    the probability that the mounting had jumped since the campaign before."""

    id: str
    name: str
    time: str
    value_arcsec: Numbers3
    sigma_arcsec: Numbers3
    trend_arcsec: Numbers3
    trend_sigma_arcsec: Numbers3
    jumped: float
    temperatures_c: dict[str, float]
    argument_of_latitude_deg: Number


class TrendModel(Part):
    """A kind of motion between jumps, and its weight by how well it foretold the next campaign."""

    name: str
    weight: float


class TrendChange(Part):
    """A change with its significance and its size on the ground at the nadir, m."""

    kind: str
    words: str
    size_arcsec: Numbers3
    sigma_arcsec: Numbers3
    p: float
    significant: bool
    ground_m: Number


class Foretold(Part):
    """The mounting at a time to come."""

    time: str
    value_arcsec: Numbers3
    sigma_arcsec: Numbers3
    interval_95_arcsec: Numbers3


class Recommendation(Part):
    """What to do, by the rms error across the line of sight over the horizon."""

    action: Literal["keep", "issue", "calibrate"]
    sentence: str
    horizon_days: float
    rms_in_use_arcsec: Number
    rms_if_issued_arcsec: float
    rms_if_calibrated_arcsec: float
    rms_in_use_m: Number
    rms_if_issued_m: Number
    rms_if_calibrated_m: Number
    gain_m: Number
    calibrate_by: str | None


class ArchiveTrendDocument(Document):
    """The mounting of a mission against time: ``exp(value) matrix``; times in UTC."""

    schema_: Literal["starplumb-archive-trend/1"] = Field(alias="schema")
    archive: str
    satellite: str
    from_: str = Field(alias="from")
    to: str
    time_scale: str
    at: str
    matrix: Matrix3
    metres_per_arcsec: Number
    points: list[TrendPoint]
    models: list[TrendModel]
    changes: list[TrendChange]
    forecast: list[Foretold]
    events: list[dict[str, str]]
    issued: list[dict[str, Any]]
    recommendation: Recommendation


class ArchiveEventDocument(Document):
    """Something that happened to a satellite (UTC)."""

    schema_: Literal["starplumb-archive-event/1"] = Field(alias="schema")
    archive: str
    id: str
    satellite: str
    time: str
    kind_: str = Field(alias="kind")
    note: str


class IssuedModel(Part):
    """The mounting ``exp(turn) matrix`` with ``turn = level + slope_per_year dt + year_cos cos(2 pi t) + year_sin sin(2
    pi t)``, dt years (of 365.25 days) after ``time`` and t after ``year_time``; ``covariance_arcsec2`` is of all
    coefficients, column after column, and the variance about each axis grows by the walk besides."""

    time: str
    year_time: str
    time_scale: str
    matrix: Matrix3
    columns: list[str]
    coefficients_arcsec: list[Numbers3]
    covariance_arcsec2: list[list[float]]
    walk_arcsec2_per_year: float


class ArchiveIssueDocument(Document):
    """A mounting that was issued, valid ``from`` a time ``to`` another (null: until further notice)."""

    schema_: Literal["starplumb-archive-issue/1"] = Field(alias="schema")
    archive: str
    id: str
    satellite: str
    camera: str
    tracker: str
    spice_frame: str | None = None
    spice_id: int | None = None
    from_: str = Field(alias="from")
    to: str | None
    supersedes: str | None
    reason: str
    model: IssuedModel
    matrix: Matrix3
    quaternion_xyzw: list[float]
    sigma_arcsec: Numbers3
    covariance_arcsec2: Matrix3
