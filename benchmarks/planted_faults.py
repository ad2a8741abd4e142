"""Faults of campaigns, by kind, and by which keys `diagnose` names each: for `planted.py` and `diagnosing.py`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import planted_changes as changes
from planted_scenes import Rng, Scene, Wanted, deliver, drawn, sign

from starplumb.io.campaign.write import write_campaign
from starplumb.physics import so3
from starplumb.physics.earth import WGS84_F
from starplumb.table.campaign import Campaign
from starplumb.table.simulate import Errors

ANY = Wanted()


def _same(s: Scene, rng: Rng) -> Scene:
    return s


def _unchanged(c: Campaign, rng: Rng) -> Campaign:
    return c


def _nothing(folder: Path, rng: Rng) -> None:
    return None


@dataclass(frozen=True)
class Fault:
    """One kind of fault: what it does to the errors, the delivered campaign and the text of the files.

    ``said`` are words of which a message has one where it names the cause; ``keys`` begin the mistakes by which
    `diagnose` names it, none where it is not one of those that it knows.  ``by_directions``: see :class:`Planted`;
    ``absorbable`` tells whether the fault may leave no trace in the residuals.
    """

    name: str
    said: tuple[str, ...]
    keys: tuple[str, ...] = ()
    wanted: Wanted = ANY
    errors: Callable[[Scene, Rng], Scene] = _same
    delivered: Callable[[Campaign, Rng], Campaign] = _unchanged
    written: Callable[[Path, Rng], None] = _nothing
    by_directions: bool = False
    absorbable: bool = True

    def plant(self, folder: Path, rng: Rng, exact: bool = False) -> Planted:
        """Write a campaign with this fault into a folder; the truth.  ``exact`` leaves all other errors out."""
        s = drawn(rng, self.wanted)
        if exact:
            s = replace(
                s, errors=Errors(*(0.0 * value for value in vars(s.errors).values() if value is not None))
            )
        s = self.errors(s, rng)
        right = deliver(s)
        write_campaign(folder, self.delivered(right, rng))
        self.written(folder, rng)
        return Planted(s.C_EK_true, directions(right, s.C_EK_true) if self.by_directions else None)


@dataclass(frozen=True)
class Planted:
    """The true mounting (3, 3) and, where the fault is in how pixels are read, the true directions (n, 3) in E of the
    sightings: a mounting that gives these for the pixels as they are read is right."""

    C_EK: np.ndarray
    e_E: np.ndarray | None

    def error_E(self, campaign: Campaign, C_EK: np.ndarray) -> np.ndarray:
        """Error (3,) rad about E of an answer for the campaign as it was read."""
        if self.e_E is None:
            return so3.log(C_EK @ self.C_EK.mT)
        return so3.log(so3.nearest(directions(campaign, C_EK).mT @ self.e_E))


def directions(campaign: Campaign, C_EK: np.ndarray) -> np.ndarray:
    """Of the sightings in E (n, 3)."""
    s = campaign.sightings
    xy_K, _ = campaign.camera.tan_from_px(s.column_px, s.row_px)
    e_K = np.concatenate([xy_K, np.ones((len(xy_K), 1))], axis=-1)
    return e_K / np.linalg.norm(e_K, axis=-1, keepdims=True) @ C_EK.mT


WORST = ("fits worst", "implausible", "disagree")
IMAGE = ("image", "images disagree", "rejected")

FAULTS = [
    Fault(
        "one image's time wrong, 10 to 900 ms",
        IMAGE,
        ("image.", "sightings"),
        Wanted(4),
        delivered=changes.late_image,
    ),
    Fault(
        "one image's attitude, 30 arcsec to 180 deg",
        IMAGE,
        ("image.", "sightings"),
        Wanted(4),
        delivered=changes.turned_image,
    ),
    Fault(
        "labels of an image moved on by one",
        IMAGE,
        ("image.", "sightings"),
        Wanted(4),
        delivered=changes.exchanged_labels,
    ),
    Fault("latitude and longitude exchanged", WORST, ("landmarks.exchanged",), written=changes.exchanged),
    Fault(
        "sign of longitude",
        WORST,
        ("landmarks.longitude_sign",),
        delivered=changes.places(lambda a, b, h, _: (a, -b, h)),
    ),
    Fault(
        "geocentric latitudes",
        WORST,
        ("landmarks.geocentric",),
        Wanted(2),
        delivered=changes.places(lambda a, b, h, _: (np.arctan((1 - WGS84_F) ** 2 * np.tan(a)), b, h)),
    ),
    Fault(
        "heights in feet",
        WORST,
        ("landmarks.feet",),
        Wanted(3),
        delivered=changes.places(lambda a, b, h, _: (a, b, h / changes.FEET)),
    ),
    Fault(
        "heights above the geoid, 15 to 80 m",
        ("height", *WORST),
        ("landmarks.height_offset",),
        Wanted(4),
        delivered=changes.places(lambda a, b, h, rng: (a, b, h + sign(rng) * rng.uniform(15, 80))),
    ),
    Fault(
        "image times cut to 1, 10 or 100 ms",
        ("multiples", *WORST),
        ("digits.", "clock.", "image."),
        Wanted(3),
        delivered=changes.cut_times,
        written=changes.without_zeros,
    ),
    Fault(
        "quaternions of 3 to 5 decimals",
        ("decimals", "scatter", *WORST),
        ("digits.",),
        Wanted(2),
        written=changes.rounded("attitude.csv", ("qx", "qy", "qz", "qw"), 3, 5),
    ),
    Fault(
        "latitudes of 2 to 4 decimals",
        ("multiples", *WORST),
        ("digits.",),
        Wanted(2),
        written=changes.rounded("landmarks.csv", ("latitude_deg", "longitude_deg"), 2, 4),
    ),
    Fault(
        "pixels of 0 or 1 decimals",
        ("multiples", *WORST),
        ("digits.",),
        Wanted(2),
        written=changes.rounded("observations.csv", ("column_px", "row_px"), 0, 1),
    ),
    Fault(
        "attitude sampled too coarsely",
        ("too far apart", "scatter", *WORST),
        ("sampling.",),
        Wanted(3, swung=True, margin_s=12.0),
        delivered=changes.coarse,
    ),
    Fault(
        "one attitude sample, 20 to 3000 arcsec",
        ("sample", *IMAGE),
        ("sample.", "image.", "sightings"),
        Wanted(4),
        delivered=changes.bad_sample,
    ),
    Fault(
        "attitude sigma a third",
        ("disagree", "implausible"),
        (),
        Wanted(5),
        errors=changes.grown("alpha_E", 3.0),
        absorbable=False,
    ),
    Fault(
        "pixel sigma a third",
        ("implausible",),
        (),
        Wanted(2),
        errors=changes.grown("pixel", 3.0),
        absorbable=False,
    ),
    Fault(
        "landmark sigma a third",
        ("implausible",),
        (),
        Wanted(2),
        errors=changes.grown("pi_J", 3.0),
        absorbable=False,
    ),
    Fault(
        "position sigma a third",
        ("disagree", "implausible"),
        (),
        Wanted(5),
        errors=changes.grown("rho_J", 3.0),
        absorbable=False,
    ),
    Fault(
        "errors of a pass shared, not stated",
        ("shared_by",),
        (),
        Wanted(3, close=True),
        errors=changes.one_draw,
        absorbable=False,
    ),
    Fault(
        "an offset in each of three sessions",
        ("disagree", *WORST),
        (),
        Wanted(9, passes=3),
        errors=changes.sessions,
    ),
    Fault("a mounting that drifts", ("disagree", *WORST), (), Wanted(6), errors=changes.drift),
    Fault(
        "a mounting that moves with the orbit",
        ("disagree", *WORST),
        (),
        Wanted(10, passes=3),
        errors=changes.orbital,
    ),
    Fault(
        "clock of the camera, 5 to 500 ms",
        ("time_offset", *WORST),
        ("clock.",),
        Wanted(4),
        delivered=changes.clock,
    ),
    Fault("GPS time taken for UTC", WORST, ("times.",), Wanted(2, margin_s=22.0), delivered=changes.eighteen),
    Fault(
        "focal length, 0.05 to 5 %",
        ("focal", *WORST),
        ("camera.focal_length",),
        Wanted(3),
        delivered=changes.focal,
        by_directions=True,
    ),
    Fault(
        "unit of focal length or pitch",
        WORST,
        ("camera.unit", "camera.focal_length"),
        delivered=changes.pitch_unit,
        by_directions=True,
    ),
    Fault(
        "distortion of the lens",
        ("distort", *WORST),
        ("camera.distortion",),
        Wanted(3, frame=True),
        delivered=changes.lens,
        by_directions=True,
    ),
    Fault("binned pixels", WORST, ("binning.",), delivered=changes.binned, by_directions=True),
    Fault(
        "a window on the sensor",
        WORST,
        ("window.",),
        Wanted(2),
        delivered=changes.cropped,
        by_directions=True,
    ),
    Fault(
        "mirrored columns",
        WORST,
        ("pixels.column_px_from_right", "axes.camera"),
        Wanted(2),
        delivered=changes.moved_pixels(lambda x, y, size: (size[0] - 1 - x, y)),
        by_directions=True,
    ),
    Fault(
        "columns and rows exchanged",
        WORST,
        ("pixels.swapped",),
        Wanted(2, frame=True),
        delivered=changes.moved_pixels(lambda x, y, _: (y, x)),
        by_directions=True,
    ),
    Fault(
        "scalar first taken for last",
        WORST,
        ("attitude.order",),
        Wanted(2),
        delivered=changes.requaternion(lambda q: np.roll(q, 1, -1)),
    ),
    Fault(
        "attitude the other way round",
        WORST,
        ("attitude.direction",),
        Wanted(2),
        delivered=changes.requaternion(lambda q: q * [-1, -1, -1, 1]),
    ),
    Fault(
        "attitude's frame ITRF, not GCRF",
        WORST,
        ("attitude.frame",),
        Wanted(2),
        written=changes.other_key('from = "GCRF"', 'from = "ITRF"'),
    ),
    Fault(
        "positions' frame GCRF, not ITRF",
        WORST,
        ("ephemeris.frame",),
        Wanted(2),
        written=changes.other_key('frame = "ITRF"', 'frame = "GCRF"'),
    ),
    Fault(
        "attitude of date taken for GCRF", WORST, ("frames.attitude",), Wanted(6), delivered=changes.of_date
    ),
    Fault(
        "one blunder",
        ("fits worst", "rejected", "implausible"),
        ("sightings", "landmark."),
        Wanted(2),
        delivered=changes.one_blunder,
    ),
    Fault(
        "3 to 30 % random blunders",
        ("rejected", *WORST),
        ("sightings", "image."),
        Wanted(3),
        delivered=changes.random_blunders,
    ),
    Fault(
        "15 to 60 % coherent blunders",
        ("rejected", "agree", *WORST),
        ("sightings", "image."),
        Wanted(3),
        delivered=changes.coherent_blunders,
    ),
    Fault(
        "a landmark misplaced",
        ("landmark", *WORST),
        ("landmark.", "sightings"),
        Wanted(4, frame=True, site=True),
        delivered=changes.moved_landmark,
    ),
]
GOOD = Fault("nothing", ())
