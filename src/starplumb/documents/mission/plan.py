"""``plan.json``: which images to take, in which order, and what they are worth."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from ..document import Document, Files, Matrix3, Number, Part, Triple


class PlannedImage(Part):
    """An image to take (time in UTC), and what is known after it: sigma about x, y, z of the star tracker, the rms
    error on the ground over the field, by how much it falls, and the motion of the mounting that would be found."""

    order: int
    time: str
    site: str
    latitude_deg: float
    longitude_deg: float
    pitch_deg: float
    roll_deg: float
    yaw_deg: float
    look_deg: float
    sun_deg: float
    clear_probability: float
    pass_: int = Field(alias="pass")
    argument_of_latitude_deg: float
    sigma_arcsec: Triple
    rms_m: float
    gain_m: Number
    detectable_arcsec: Number


class KindOfView(Part):
    """What so many images of a kind are worth after those of ``before``; tie points in these are a kind of none."""

    kind: str
    images: int
    rms_m: float


class BeforePart(Part):
    """What is known before, from ``images`` views of the usual kind or from what was given; the axis that is worst on
    the ground, and the sources of error whose knowledge would lower its variance, by which part."""

    given: str | None
    images: int
    sigma_arcsec: Triple
    rms_m: float
    axis_tracker: Triple
    axis_sigma_arcsec: float
    sources: dict[str, float]


class BoundPart(Part):
    """No choice of as many images is better than ``rms_m``; the one found is within ``within_percent`` of that."""

    rms_m: float
    within_percent: float
    rounds: int


class CheckedPart(Part):
    """The chosen images by the whole noise model, each being clear, and by the sums that they were chosen by."""

    sigma_arcsec: Triple
    covariance_arcsec2: Matrix3
    rms_m: float
    chosen_by_rms_m: float


class UsualPart(Part):
    """As many views of the usual kind as there are, up to the number chosen."""

    images: int
    rms_m: Number


class TiesPart(Part):
    """The chosen images with so many tie points at ``each`` site: places that nobody surveyed, measured in all its
    images as well as markers are."""

    each: int
    sigma_arcsec: Triple
    rms_m: float


class AgainstPart(Part):
    """How the mounting of a further camera is known against that of the first after all chosen images; ``left_out`` is
    what is given and not counted."""

    camera: str
    against: str
    sigma_arcsec: Triple
    left_out: str | None = None


class ReachedPart(Part):
    """Whether the wanted sigma about each axis is reached, or else what limits."""

    target_arcsec: float
    reached: bool
    in_words: str


class CandidatesPart(Part):
    """What is chosen from."""

    views: int
    passes: int
    sites: list[str]


class PlanDocument(Document):
    """``plan.json``."""

    schema_: Literal["starplumb-plan/1"] = Field(alias="schema")
    scenario: str
    description: str
    start: str
    end: str
    criterion: str
    candidates: CandidatesPart
    before: BeforePart
    kinds: list[KindOfView]
    in_words: list[str]
    images: list[PlannedImage]
    bound: BoundPart
    usual: UsualPart
    tie_points: TiesPart | None = None
    checked: CheckedPart
    cameras: list[AgainstPart] = Field(default_factory=list)
    shared_errors: dict[str, float]
    target: ReachedPart | None
    notices: list[str]
    files: Files = None
