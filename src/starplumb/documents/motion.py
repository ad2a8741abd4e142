"""What ``result.json`` says of a mounting that moves, and of the orbit that it may move with."""

from __future__ import annotations

from math import pi
from typing import Annotated, Any, Self

from annotated_types import Len
from pydantic import model_validator

from ..judge.calibrate import Calibration
from ..judge.motion.asked import NONE
from ..judge.motion.averaging import Motion
from ..judge.motion.found import Moves
from ..physics.timescales import format_iso
from ..physics.units import ARCSEC, DEG
from ..table.phases import OrbitPhase
from .document import Finite, Matrix3, Number, Part, Triple, require_shape, require_times
from .numbers import numbers


class Span(Part):
    """First and last time of the images, UTC."""

    first: str
    last: str


class MotionTest(Part):
    """One test of a motion: ``p`` is corrected for all that is tried; of a step the most likely is named."""

    name: str
    columns: list[str]
    p: float
    detectable_arcsec: Number


class MotionModel(Part):
    """A motion that was estimated: the mounting is ``exp(sum of coefficients times columns) matrix``.

    The columns are ``mean``, 1; ``linear``, the time from the middle of ``span`` over its length; ``step:TIME``, -1/2
    before and 1/2 after; ``orbit:K cos`` and ``sin`` of K times the argument of latitude; ``temperature:NAME``, counted
    from the middle of ``temperatures_c`` over half their range. ``covariance_arcsec2`` is of all coefficients, column
    after column; ``weights`` are those of the models in the average.
    """

    asked: str
    span: Span
    columns: list[str]
    coefficients_arcsec: list[Triple]
    covariance_arcsec2: list[list[Finite]]
    weights: dict[str, Finite]
    temperatures_c: dict[str, Annotated[list[Finite], Len(2, 2)]] | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        require_times([self.span.first, self.span.last])
        n = 3 * len(self.columns)
        require_shape("motion.model.coefficients_arcsec", self.coefficients_arcsec, (len(self.columns), 3))
        require_shape("motion.model.covariance_arcsec2", self.covariance_arcsec2, (n, n))
        return self


class MotionPart(Part):
    """Tests of a mounting that moves; the amplitude that is found with 90 % probability, of a sine with the orbit
    where that is tested, else of a change over the span; the covariance of a steady change over the span that the
    images leave possible; what --drift estimated."""

    tests: list[MotionTest]
    detectable_arcsec: Number
    unseen_drift_arcsec2: Matrix3 | None = None
    model: MotionModel | None


class OrbitPart(Part):
    """Even motion along the orbit: the argument of latitude is ``mean_motion_deg_s`` times the time since
    ``node_time``."""

    node_time: str
    time_scale: str
    mean_motion_deg_s: Finite
    period_s: Finite

    @model_validator(mode="after")
    def _has_times(self) -> Self:
        require_times([self.node_time], self.time_scale)
        return self


def motion_document(c: Calibration) -> dict[str, Any]:
    """``motion`` of a calibration, null where too few images tell of any."""
    return {"motion": None if c.moves is None else _motion(c.moves)}


def _motion(found: Moves) -> dict[str, Any]:
    lead, unseen = found.detectable, found.unseen_E
    return {
        "tests": [
            {
                "name": test.name,
                "columns": list(test.columns),
                "p": test.p,
                "detectable_arcsec": numbers(test.detectable / ARCSEC),
            }
            for test in found.tests
        ],
        "detectable_arcsec": None if lead is None else numbers(lead / ARCSEC),
        "unseen_drift_arcsec2": None if unseen is None else numbers(unseen / ARCSEC**2),
        "model": None if found.asked == NONE or found.motion is None else _model(found.motion, found.asked),
    }


def _model(motion: Motion, asked: str) -> dict[str, Any]:
    scales = motion.scales
    first, last = format_iso([scales.first_ns, scales.last_ns], "UTC", 9)
    ends = {name: [middle - half, middle + half] for name, (middle, half) in scales.temperatures.items()}
    return {
        "asked": asked,
        "span": {"first": first, "last": last},
        "columns": list(motion.names),
        "coefficients_arcsec": numbers(motion.coefficients / ARCSEC),
        "covariance_arcsec2": numbers(motion.covariance / ARCSEC**2),
        "weights": dict(motion.weights),
        "temperatures_c": ends,
    }


def orbit_document(orbit: OrbitPhase | None) -> dict[str, Any] | None:
    """The even motion along an orbit."""
    if orbit is None:
        return None
    return {
        "node_time": format_iso([orbit.node_ns], "UTC")[0],
        "time_scale": "UTC",
        "mean_motion_deg_s": numbers(orbit.rate / DEG),
        "period_s": numbers(2.0 * pi / orbit.rate),
    }
