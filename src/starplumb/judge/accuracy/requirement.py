"""A requirement on the accuracy, and whether a calibration meets it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from ...physics.errors import ArgumentError
from ...physics.units import ARCSEC

if TYPE_CHECKING:
    from ..calibrate import Calibration

Measure = Literal["CE90", "rms", "interval"]
_FORM = re.compile(
    r"\s*(\d+(?:\.\d*)?|\.\d+)\s*(m|km|arcsec)\s*(CE90|rms|rmse)?\s*", re.IGNORECASE | re.ASCII
)


@dataclass(frozen=True)
class Requirement:
    """At most ``limit`` in ``unit``: the circular 90 % or the root mean square of horizontal errors on the ground, or
    the half-width of the 95 % interval about every axis of the star tracker."""

    text: str
    limit: float
    unit: Literal["m", "km", "arcsec"]
    measure: Measure


@dataclass(frozen=True)
class Met:
    """What was found of a requirement, in its unit, and of what; ``met`` None where it cannot be said."""

    requirement: Requirement
    found: float | None
    of: str
    met: bool | None

    @property
    def sentence(self) -> str:
        wanted, unit = self.requirement.text, self.requirement.unit
        if self.found is None:
            return f"requirement {wanted}: it cannot be said whether it is met, {self.of}"
        return f"requirement {wanted}: {'met' if self.met else 'NOT met'}, {self.found:.3g} {unit} {self.of}"


def requirement(text: str) -> Requirement:
    """A requirement from its words: ``5 m CE90``, ``3 m rms``, ``2 arcsec``.  Raises ArgumentError."""
    found = _FORM.fullmatch(text)
    unit, measure = (found[2].lower(), (found[3] or "").lower()) if found else ("", "")
    if found is None or not 0.0 < float(found[1]) < np.inf or (unit == "arcsec") != (not measure):
        raise ArgumentError(
            "requirement", f"found {text!r}, wanted a limit such as '5 m CE90', '3 m rms' or '2 arcsec'"
        )
    kind: Measure = "CE90" if measure == "ce90" else "rms" if measure else "interval"
    return Requirement(" ".join(text.split()), float(found[1]), _unit(unit), kind)


def _unit(name: str) -> Literal["m", "km", "arcsec"]:
    return "m" if name == "m" else "km" if name == "km" else "arcsec"


def met(c: Calibration, wanted: Requirement) -> Met:
    """Whether a calibration meets a requirement: on the ground by its check points, by control points without any."""
    if not c.status.usable:
        return Met(wanted, None, "for the mounting must not be used", None)
    if wanted.measure == "interval":
        return _of_interval(c, wanted)
    check = c.accuracy(after=True, check=True)
    accuracy = check or c.accuracy(after=True)
    if accuracy is None:
        return Met(wanted, None, "for no error on the ground is known", None)
    of = (
        "check points"
        if check
        else "control points, which the solution has fitted: there are no check points"
    )
    size = accuracy.ce90 if wanted.measure == "CE90" else accuracy.rmse
    found = size / (1e3 if wanted.unit == "km" else 1.0)
    return Met(wanted, found, f"of {accuracy.n} {of}", found <= wanted.limit)


def _of_interval(c: Calibration, wanted: Requirement) -> Met:
    half = c.interval_95_E
    if half is None or not np.all(np.isfinite(half)):
        return Met(wanted, None, "for the method states no interval", None)
    found = float(np.max(half) / ARCSEC)
    return Met(wanted, found, "is the half-width of the widest 95 % interval", found <= wanted.limit)
