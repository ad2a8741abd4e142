"""The mounting at a time, from a ``result.json`` alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..judge.motion.averaging import Motion
from ..judge.motion.directed import FOUND_P
from ..judge.motion.regressors import TEMPERATURE, Scales, When
from ..judge.trust import NORMAL_95
from ..physics import so3
from ..physics.errors import InputError
from ..physics.timescales import parse
from ..physics.units import ARCSEC, DEG
from ..table.phases import OrbitPhase
from .document import Document, Matrix3, MatrixOrNulls3, Numbers3
from .motion import MotionModel
from .result import ResultDocument

Array = NDArray[np.float64]

LEAST_SPAN_S = 5_700.0
"""Shortest span by which the time beyond it is counted: an orbit or so."""
EVEN = 12.0
"""Covariance of a steady change over the span, over that of a mounting at rest, for images evenly over it."""
LEVER = NORMAL_95**-2
"""Variance of a temperature that is not given, over the square of half its range."""


class PredictionDocument(Document):
    """What ``starplumb predict`` prints: the mounting at ``time`` and the covariance of its error about the star
    tracker's axes."""

    schema_: Literal["starplumb-prediction/1"] = Field(alias="schema")
    time: str
    time_scale: str
    from_: str = Field(alias="from")
    to: str
    matrix: Matrix3
    quaternion_xyzw: list[float]
    correction_arcsec: Numbers3
    sigma_arcsec: Numbers3 | None
    covariance_arcsec2: MatrixOrNulls3 | None
    interval_95_arcsec: Numbers3 | None
    outside_span_s: float
    notices: list[str]


@dataclass(frozen=True)
class Prediction:
    """The mounting ``C_EK`` (3, 3) at a time and the covariance (3, 3) rad^2 of its error, None where none is stated;
    ``turn_E`` (3,) rad from the result's own matrix, ``outside_s`` beyond the span of the images."""

    C_EK: Array
    covariance_E: Array | None
    turn_E: Array
    outside_s: float
    notices: tuple[str, ...]


def predicted(
    document: ResultDocument,
    t_ns: int,
    u: float | None = None,
    temperatures_c: Mapping[str, float] | None = None,
) -> Prediction:
    """The mounting of a usable result at an epoch; ``u`` rad is the argument of latitude, by default from the result's
    own ``orbit``.

    Outside the span of the images the covariance holds what a further session adds, where the result tells that, and
    grows by the steady change that they leave possible, as the square of the time beyond it over the span; where they
    found none, up to the one that they would have found.
    """
    outside_s, span_s = outside(document, t_ns)
    known = document.covariance_E
    model = None if document.motion is None else document.motion.model
    turn: Array = np.zeros(3)
    notices: list[str] = []
    if model is not None:
        motion = motion_of(document, model)
        turn, known = _moved(motion, t_ns, u, temperatures_c or {}, notices)
    if known is None:
        return Prediction(document.C_EK, None, turn, outside_s, tuple(notices))
    known = known + _widening(document)
    if outside_s > 0.0:
        steady = model is not None and "linear" in model.columns
        known = known + _further(document, known)
        unseen = _unseen(document, known) * (not steady)
        drift, limit = (outside_s / span_s) ** 2 * unseen, _most(document, unseen)
        share = np.minimum(1.0, limit / np.maximum(np.sqrt(np.diagonal(drift)), 1e-300))
        known = known + share[:, None] * drift * share
        notices.append(
            f"{outside_s / 86400.0:.3g} d outside the span of the images: the covariance is larger by what they leave "
            f"possible there{_held(limit, share)}"
        )
    return Prediction(so3.exp(turn) @ document.C_EK, known, turn, outside_s, tuple(notices))


def _most(document: ResultDocument, unseen: Array) -> Array:
    """Sigmas (3,) rad of a change at any time: of a mounting that rests the amplitude that would have been found, no
    less than what is possible over the span."""
    amplitude = unseen_amplitude(document)
    return np.full(3, np.inf) if amplitude is None else np.maximum(amplitude, np.sqrt(np.diagonal(unseen)))


def _held(limit: Array, share: Array) -> str:
    if np.all(share == 1.0):
        return ""
    sigma = ", ".join(f"{x:.2g}" for x in limit / ARCSEC)
    return (
        f", a mounting that showed no motion being taken to stay within {sigma} arcsec about x, y, z (one sigma): the "
        "motion that would have been found, or what is possible over the span"
    )


def rests(document: ResultDocument) -> bool:
    """Whether a motion was neither found nor estimated."""
    motion = document.motion
    return motion is None or (motion.model is None and all(test.p >= FOUND_P for test in motion.tests))


def unseen_amplitude(document: ResultDocument) -> float | None:
    """The motion, rad, that a mounting at rest would have shown; None where there is none such."""
    motion = document.motion
    if motion is None or motion.detectable_arcsec is None or not rests(document):
        return None
    return ARCSEC * float(motion.detectable_arcsec)


def outside(document: ResultDocument, t_ns: int) -> tuple[float, float]:
    """Time beyond the span of the images, and what it is counted by, s."""
    if document.span is None:
        return 0.0, LEAST_SPAN_S
    first, last = parse([document.span.first, document.span.last], "UTC").tolist()
    beyond = max(first - t_ns, t_ns - last, 0) * 1e-9
    # times of the span have microseconds
    return (beyond if beyond > 1e-6 else 0.0), max((last - first) * 1e-9, LEAST_SPAN_S)


def _unseen(document: ResultDocument, known: Array) -> Array:
    stated = None if document.motion is None else document.motion.unseen_drift_arcsec2
    return EVEN * known if stated is None else ARCSEC**2 * np.array(stated)


def _further(document: ResultDocument, known: Array) -> Array:
    """What the interval at a further session has beyond a covariance (3, 3), as one."""
    if document.next_session is None:
        return np.zeros((3, 3))
    half = ARCSEC * np.array(document.next_session.interval_95_arcsec, dtype=np.float64)
    return np.diag(np.maximum((half / NORMAL_95) ** 2 - np.diagonal(known), 0.0))


def _widening(document: ResultDocument) -> Array:
    """What the 95 % interval of a weak answer has beyond its sigmas, as a covariance (3, 3)."""
    half, stated = document.interval_95_E, document.covariance_E
    if document.status != "weak" or half is None or stated is None:
        return np.zeros((3, 3))
    return np.diag(np.maximum((half / NORMAL_95) ** 2 - np.diagonal(stated), 0.0))


def motion_of(document: ResultDocument, model: MotionModel) -> Motion:
    """The motion that a result states."""
    first, last = parse([model.span.first, model.span.last], "UTC").tolist()
    orbit = document.orbit
    phase = None
    if orbit is not None:
        node = int(parse([orbit.node_time], orbit.time_scale)[0])
        phase = OrbitPhase(node, orbit.mean_motion_deg_s * DEG)
    ends = model.temperatures_c or {}
    scales = {name: ((low + high) / 2.0, (high - low) / 2.0) for name, (low, high) in ends.items()}
    return Motion(
        tuple(model.columns),
        ARCSEC * np.array(model.coefficients_arcsec, dtype=np.float64),
        ARCSEC**2 * np.array(model.covariance_arcsec2, dtype=np.float64),
        Scales(first, last, phase, scales),
        model.weights,
    )


def _moved(
    motion: Motion, t_ns: int, u: float | None, temperatures_c: Mapping[str, float], notices: list[str]
) -> tuple[Array, Array]:
    """The turn (3,) and its covariance (3, 3) at an epoch; a temperature that is not given is the middle one."""
    scales = motion.scales
    if u is None and any(name.startswith("orbit:") for name in motion.names):
        if scales.orbit is None:
            raise InputError("orbit: found null, wanted the orbit that the motion of this result needs")
        u = float(scales.orbit.at(t_ns))
    lacking = [name for name in scales.temperatures if name not in temperatures_c]
    given = {name: temperatures_c.get(name, middle) for name, (middle, _) in scales.temperatures.items()}
    when = When(
        np.array([t_ns]), np.array([u or 0.0]), {name: np.array([value]) for name, value in given.items()}
    )
    turn, covariance = motion.at(when)
    total = covariance[0]
    for name in lacking:
        column = f"{TEMPERATURE}:{name}"
        if column in motion.names:
            c = motion.coefficients[motion.names.index(column)]
            total = total + LEVER * np.outer(c, c)
            notices.append(f"the temperature {name} is not given: taken at the middle of its range")
    return turn[0], total
