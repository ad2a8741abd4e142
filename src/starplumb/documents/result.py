"""``result.json``: what a calibration found."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from ..estimators.protocol import Status
from ..physics import so3
from ..physics.errors import InputError
from ..physics.units import ARCSEC
from .document import Document, Files, Finite, Matrix3, MatrixOrNulls3, Number, Numbers3, Part, require_times
from .motion import MotionPart, OrbitPart, Span

ROTATION = 1e-6
"""A matrix farther from a rotation than this is refused."""
ROUNDING = 1e-9
"""Part of its largest entry by which a covariance may fail to be symmetric or positive."""
DIGITS = 0.01
"""Part by which sigmas may differ from those of their covariance: both may be rounded, not contradict."""


class Mounting(Part):
    """The mounting: coordinates in ``from`` times ``matrix`` are coordinates in ``to``."""

    from_: str = Field(alias="from")
    to: str
    matrix: Matrix3
    quaternion_xyzw: Annotated[list[Finite], Field(min_length=4, max_length=4)]


class AgainstFirst(Part):
    """A camera's mounting against the first camera's: ``matrix`` takes coordinates from its frame to the first one's;
    sigma and covariance are of the difference of the errors of the two, about the star tracker's axes."""

    to: str
    matrix: Matrix3
    sigma_arcsec: Numbers3 | None
    covariance_arcsec2: MatrixOrNulls3 | None


class CameraMounting(Mounting):
    """One of several cameras: its mounting, correction, sigma and covariance as those of the only one."""

    camera: str
    correction_arcsec: Numbers3 | None
    sigma_arcsec: Numbers3 | None
    covariance_arcsec2: MatrixOrNulls3 | None
    interval_95_arcsec: Numbers3 | None
    against_first: AgainstFirst | None


class Fit(Part):
    """Counts and quality of the fit."""

    images: int
    observations: int
    degrees_of_freedom: int
    chi2: Number
    chi2_p: Number
    rms_px: Number
    rms_own_px: Number = None
    iterations: int | None


class Accuracy(Part):
    """Horizontal geolocation error: root mean square and circular 90 %, m."""

    rmse_m: Number
    ce90_m: Number


class Check(Accuracy):
    """That of the check points after the calibration, and ``before``."""

    observations: int
    before: Accuracy


class Geolocation(Part):
    """Geolocation errors with the model mounting and with the new one."""

    before: Accuracy
    after: Accuracy
    check: Check | None


class LeftOut(Part):
    """A mark that attitude or orbit do not cover, left out as asked; ``where`` names its row."""

    image_id: str
    landmark_id: str | None
    where: str
    reason: str


class Rejected(Part):
    """An observation that was left out."""

    image_id: str
    landmark_id: str
    statistic: Number
    reason: str


class Share(Part):
    """What one error source alone contributes to the sigmas."""

    source: str
    sigma_arcsec: Numbers3


class Source(Part):
    """One source of error: its sigma as stated (0: not at all) and as found, their ratio, and the probability of at
    least such a scatter if it is as stated."""

    name: str
    unit: str
    stated: Number
    found: Number
    ratio: Number
    ratio_interval_95: Annotated[list[float], Field(min_length=2, max_length=2)] | None
    p: Number


class Parameter(Part):
    """A parameter that was estimated beside the alignment; ``known`` says whether the data determine it."""

    name: str
    unit: str
    known: bool
    correction: Number
    sigma: Number
    prior_sigma: Number


class ParameterCovariance(Part):
    """The covariance of the alignment and of these parameters."""

    names: list[str]
    matrix: list[list[Number]]


class Residuals(Part):
    """Residuals of an image or a landmark, px."""

    observations: int
    rms_px: Number
    rms_own_px: Number


class Image(Part):
    """An image: its own estimated errors, and its residuals."""

    image_id: str
    attitude_error_arcsec: Numbers3
    position_error_m: Numbers3
    statistic: Number
    time: str | None = None
    pass_: str | None = Field(default=None, alias="pass")
    session: str | None = None
    argument_of_latitude_deg: Number = None
    sun_beta_deg: Number = None
    temperatures_c: dict[str, float] | None = None
    observations: int
    rms_px: Number
    rms_own_px: Number


class Landmark(Part):
    """A landmark and its residuals."""

    landmark_id: str
    observations: int
    rms_px: Number
    rms_own_px: Number


class NextSession(Part):
    """Half-widths of the 95 % intervals of the mounting as a further session or pass (``of``) shows it, from so many
    ``groups``."""

    of: str
    groups: int
    interval_95_arcsec: Numbers3


class RestsOn(Part):
    """What the answer rests on that was not estimated: an error of it, in its unit, moves the answer about each axis by
    a sigma from ``matters_from`` on; ``estimate`` is its name for ``--estimate``, null where it has none."""

    what: str
    estimate: str | None
    unit: str
    matters_from: Numbers3
    sigma_if_estimated_arcsec: Numbers3


def _known(status: str) -> str:
    names = [each.name.lower() for each in Status]
    if status not in names:
        raise ValueError(f"status: found {status!r}, wanted one of {', '.join(names)}")
    return status


class Required(Part):
    """What was required, and whether it is met; null where that cannot be said."""

    text: str
    limit: Finite
    unit: str
    found: Number
    of: str
    met: bool | None
    sentence: str


class ResultDocument(Document):
    """``result.json``; ``sigma_arcsec`` and ``covariance_arcsec2`` are about x, y, z of the star tracker, and so
    are ``interval_95_arcsec``, half-widths of the 95 % intervals widened by all that was found."""

    schema_: Literal["starplumb-result/1"] = Field(alias="schema")
    status: Annotated[str, AfterValidator(_known)]
    message: str
    campaign: str | None = None
    satellite: str | None = None
    method: str
    mounting: Mounting
    mountings: list[CameraMounting] | None = None
    mountings_covariance_arcsec2: list[list[float]] | None = None
    correction_arcsec: Numbers3 | None
    sigma_arcsec: Numbers3 | None
    covariance_arcsec2: MatrixOrNulls3 | None
    interval_95_arcsec: Numbers3 | None = None
    sigma_from_data_arcsec: Numbers3 | None = None
    degrees_of_freedom_from_data: Numbers3 | None = None
    jackknife_sigma_arcsec: Numbers3 | None = None
    next_session: NextSession | None = None
    sources: list[Source] | None = None
    rests_on: list[RestsOn] | None = None
    motion: MotionPart | None = None
    span: Span | None = None
    orbit: OrbitPart | None = None
    fit: Fit
    geolocation: Geolocation
    rejected: list[Rejected]
    budget: list[Share] | None = None
    parameters: list[Parameter] | None = None
    parameter_covariance: ParameterCovariance | None = None
    images: list[Image] | None = None
    landmarks: list[Landmark] | None = None
    not_listed: dict[str, int] | None = None
    truth: dict[str, Any] | None = None
    inputs: dict[str, str]
    software: dict[str, str]
    earth_orientation: dict[str, Any] | None = None
    corrections: dict[str, bool] | None = None
    left_out: list[LeftOut] | None = None
    notices: list[str] | None = None
    labels: dict[str, int] | None = None
    requirement: Required | None = None
    files: Files = None

    @model_validator(mode="after")
    def _believable(self) -> Self:
        """A usable result has a rotation and, if it states a covariance, one that is possible."""
        if self.usable:
            _require_rotation(self.C_EK)
            _require_one_mounting(self.C_EK, self.mounting.quaternion_xyzw)
            if self.covariance_arcsec2 is not None:
                P = np.array(self.covariance_arcsec2, dtype=np.float64)
                _require_covariance(P)
                _require_one_sigma(P, self.sigma_arcsec)
                _require_wide_enough(P, self.interval_95_arcsec)
        return self

    @model_validator(mode="after")
    def _has_times(self) -> Self:
        """Whatever is said of times can be read."""
        times = [image.time for image in self.images or () if image.time is not None]
        times += [] if self.span is None else [self.span.first, self.span.last]
        if times:
            require_times(times)
        return self

    def of_camera(self, name: str) -> Self:
        """The result of one of several cameras alone.  Raises InputError where it has no mounting of that name."""
        for each in self.mountings or ():
            if each.camera == name:
                own = ("correction_arcsec", "sigma_arcsec", "covariance_arcsec2", "interval_95_arcsec")
                return self.model_copy(
                    update={"mounting": each, "mountings": None} | {key: getattr(each, key) for key in own}
                )
        names = ", ".join(each.camera for each in self.mountings or ()) or "none"
        raise InputError(f"mountings: found {names}, wanted one of the camera {name}")

    @property
    def usable(self) -> bool:
        """Whether the mounting may be used."""
        return Status[self.status.upper()].usable

    @property
    def C_EK(self) -> NDArray[np.float64]:
        """The mounting (3, 3)."""
        return np.array(self.mounting.matrix, dtype=np.float64)

    @property
    def interval_95_E(self) -> NDArray[np.float64] | None:
        """Half-widths (3,) rad of the 95 % intervals about E; None where none are stated."""
        stated = self.interval_95_arcsec
        return None if stated is None or None in stated else ARCSEC * np.array(stated, dtype=np.float64)

    @property
    def covariance_E(self) -> NDArray[np.float64] | None:
        """The covariance (3, 3) rad^2 of its error about E; None where none is stated."""
        stated = self.covariance_arcsec2
        return None if stated is None else ARCSEC**2 * np.array(stated, dtype=np.float64)


def _require_rotation(C: NDArray[np.float64]) -> None:
    off = float(np.max(np.abs(C @ C.mT - np.eye(3))))
    if not off <= ROTATION:
        raise ValueError(f"mounting.matrix: found a matrix that is no rotation (C C^T is off by {off:.1g})")
    if np.linalg.det(C) < 0.0:
        raise ValueError("mounting.matrix: found a reflection (determinant -1) where a rotation must be")


def _require_one_mounting(C: NDArray[np.float64], q_xyzw: list[float]) -> None:
    """One rotation is stated twice: an edit of one alone leaves nobody knowing which to believe."""
    if not abs(np.linalg.norm(q_xyzw) - 1.0) <= ROTATION:
        raise ValueError(
            f"mounting.quaternion_xyzw: found the norm {np.linalg.norm(q_xyzw):.6g}, which is not 1"
        )
    angle = float(np.linalg.norm(so3.log(C @ so3.from_quaternion(q_xyzw).mT)))
    if angle > 2.0 * ROTATION:
        raise ValueError(
            f"mounting: found a matrix and a quaternion_xyzw that are {angle / ARCSEC:.3g} arcsec apart"
        )


def _require_one_sigma(P: NDArray[np.float64], sigma: Numbers3 | None) -> None:
    if sigma is None:
        return
    stated = np.array(sigma, dtype=np.float64)
    if not np.allclose(stated, np.sqrt(np.abs(np.diagonal(P))), rtol=DIGITS, atol=0.0):
        raise ValueError("sigma_arcsec: found other sigmas than the roots of covariance_arcsec2's diagonal")


def _require_wide_enough(P: NDArray[np.float64], half: Numbers3 | None) -> None:
    """An interval that was narrowed by hand: it is never less than the sigma."""
    if (
        half is not None
        and None not in half
        and np.any(np.array(half, dtype=np.float64) < np.sqrt(np.diagonal(P)))
    ):
        raise ValueError("interval_95_arcsec: found half-widths below the sigmas of covariance_arcsec2")


def _require_covariance(P: NDArray[np.float64]) -> None:
    if not np.all(np.isfinite(P)):
        raise ValueError("covariance_arcsec2: found null in a usable result")
    size = float(np.max(np.abs(P)))
    if np.max(np.abs(P - P.mT)) > ROUNDING * size:
        raise ValueError("covariance_arcsec2: found a matrix that is not symmetric")
    least = float(np.min(np.linalg.eigvalsh(P)))
    if least < -ROUNDING * size:
        raise ValueError(
            f"covariance_arcsec2: found a negative variance ({least:.3g} arcsec^2 along one direction)"
        )
    if not np.all(np.diagonal(P) > 0.0):
        raise ValueError("covariance_arcsec2: found a variance that is 0; no mounting is known exactly")
