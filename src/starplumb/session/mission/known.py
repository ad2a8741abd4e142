"""What an archive knows of one mounting: its campaigns in the order of time, their trend, and what was issued."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...io.archive import cells, records
from ...io.archive.rows import Entry, ImageRow, Instrument, images_of, result_text
from ...mission.advice import altitude_m
from ...mission.points import points
from ...mission.trend import Trend, trend
from ...physics import so3
from ...physics.errors import ArgumentError, EpochError
from ...physics.timescales import format_iso, moment
from .issued import at, valid_at
from .joint import standing

if TYPE_CHECKING:
    from ...documents.prediction import Prediction

Array = NDArray[np.float64]

A_SECOND_NS = 1_000_000_000
"""Times are told to it, and what was told is taken again."""
GATHERED = 0.5
"""Resultant of the phases of a campaign's images from which on they have a middle."""


@dataclass(frozen=True)
class Known:
    """What an archive knows of one mounting: its campaigns in the order of time, their trend and what was issued."""

    archive: str
    instrument: Instrument
    entries: tuple[Entry, ...]
    trend: Trend
    temperatures_c: Mapping[str, Array]
    u: Array
    events: tuple[records.Event, ...]
    issued: tuple[records.Validity, ...]
    height_m: float | None


def known(name: str, database: sqlite3.Connection, instrument: Instrument) -> Known:
    """Of an instrument with a campaign or more that counts."""
    known_of, parts = standing(name, database, instrument).own
    images = [images_of(database, entry.id) for entry in known_of]
    t_ns = np.array([_middle(some) for some in images])
    order = np.argsort(t_ns, kind="stable")
    entries, images = [known_of[k] for k in order], [images[k] for k in order]
    happened = records.events(database, instrument.satellite)
    own = points([parts[k] for k in order])
    own = own.about(so3.exp(np.mean(own.value_E, axis=0)) @ own.C_EK)
    period_s = cells.period_s(result_text(database, entries[-1].id))
    return Known(
        name,
        instrument,
        tuple(entries),
        trend(t_ns[order], own, [event.t_ns for event in happened]),
        _temperatures(images),
        np.array([_phase(some) for some in images]),
        tuple(happened),
        tuple(records.issued(database, instrument)),
        None if period_s is None else altitude_m(period_s),
    )


def mounting_at(of: Known, t_ns: int) -> Prediction:
    """The mounting at an epoch: what was issued for it, else what the trend says."""
    from ...documents.prediction import Prediction

    start = of.trend.points.C_EK
    first, last = int(of.trend.t_ns[0]), int(of.trend.t_ns[-1])
    outside = max(first - t_ns, t_ns - last, 0) * 1e-9
    issued = valid_at(of.issued, t_ns)
    if issued is not None:
        C, P = at(issued.model, t_ns)
        said = f"as issued at {issued.issued_utc[:19]}: {issued.reason}"
    else:
        turn, P = of.trend.at(t_ns)
        C, said = so3.exp(turn) @ start, "by the trend of the campaigns: nothing was issued for this time"
    return Prediction(C, P, so3.log(C @ start.T), outside, (said,))


def time_of(argument: str, text: str) -> int:
    """The epoch of an ISO 8601 time in UTC, a day alone being its midnight.  Raises ArgumentError where it is none."""
    try:
        return moment(text, "UTC")
    except EpochError as error:
        raise ArgumentError(argument, str(error)) from None


def from_the_last_on(of: Known, argument: str, text: str | None) -> int:
    """The epoch that is asked for, by default that of the last campaign.  Raises ArgumentError for one before: what is
    foretold then rests on campaigns that were not yet there."""
    last = int(of.trend.t_ns[-1])
    t_ns = last if text is None else time_of(argument, text)
    if t_ns < last - A_SECOND_NS:
        latest = format_iso([last], "UTC", 0)[0]
        raise ArgumentError(argument, f"found {text}, wanted a time from the last campaign on ({latest})")
    return max(t_ns, last)


def _middle(some: Sequence[ImageRow]) -> int:
    """Mean time of the images of a campaign."""
    first = some[0].t_ns
    return first + round(float(np.mean([image.t_ns - first for image in some])))


def _temperatures(images: Sequence[Sequence[ImageRow]]) -> dict[str, Array]:
    """Mean temperature of each campaign by name, NaN where a campaign has none."""
    names = dict.fromkeys(name for some in images for image in some for name in image.temperatures_c)

    def mean(some: Sequence[ImageRow], name: str) -> float:
        values = [image.temperatures_c[name] for image in some if name in image.temperatures_c]
        return float(np.mean(values)) if values else float("nan")

    return {name: np.array([mean(some, name) for some in images]) for name in names}


def _phase(some: Sequence[ImageRow]) -> float:
    """Middle of the arguments of latitude of a campaign's images, rad; NaN where they are all around the orbit."""
    u = np.array([image.u for image in some if image.u is not None], dtype=np.float64)
    if u.size == 0:
        return float("nan")
    middle = complex(np.mean(np.exp(1j * u)))
    return float(np.angle(middle)) if abs(middle) > GATHERED else float("nan")
