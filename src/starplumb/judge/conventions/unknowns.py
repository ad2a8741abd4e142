"""Quantities that a campaign states slightly wrong: each is estimated beside the alignment to see whether it matters.

A free number always lowers chi-square; its prior standard deviation says by how much it must, see
:func:`starplumb.judge.trials.occam`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.camera import FrameCamera, LineScanCamera
from ...physics.earth import C_JT, itrf_to_geodetic
from ...physics.units import ARCSEC, DEG
from ...table.campaign import Campaign
from ...table.observations import Observations
from ...table.parameters import LookAngles, Moves, Optics, Parameter, TimeOffset, TrackerMounting
from .mistake import Mistake

Array = NDArray[np.float64]

GEOID_M = 50.0
"""A typical height of the geoid above or below the ellipsoid."""
OPTICS = 0.02
"""Part of the focal length, or of the line's length, by which a pre-launch value may be off."""
DISTORTION = 1e-3
"""Part of the field angle by which an unmodelled lens may move the edge of an image."""
CLOCK_S = 0.3
RARER = 6.0
"""Cost of a clock that is wrong against one of two others that agree: odds of 1 to 20."""
CROP = 0.25
"""Part of the image by which a window on the sensor may be shifted."""
TRACKER = 0.2 * DEG


@dataclass(frozen=True)
class HeightOffset:
    """One number added to the height of every landmark, m: geoid heights taken as ellipsoidal, or the reverse."""

    names: tuple[str] = ("height_offset",)
    sigma: tuple[float] = (GEOID_M,)
    range: tuple[float] = (1000.0,)

    def apply(self, observations: Observations, value: Array) -> Observations:
        o = observations
        return o.with_geometry(p_J=o.p_J + value[..., None, :] * _up(o.p_J))

    def moves(self, observations: Observations, value: Array) -> Moves:
        return Moves(shift_J=-_up(observations.p_J)[..., None])


def _up(p_J: Array) -> Array:
    """The ellipsoid's upward normal at places (..., 3)."""
    latitude, longitude, _ = itrf_to_geodetic(p_J)
    return C_JT(latitude, longitude)[..., 2]


@dataclass(frozen=True)
class WindowOffset:
    """Columns and rows (px) that the first pixel of the images lies from that of the described sensor.

    A column moves the tangents, ``d xy_K = slope_K d px``; a row of a line scanner is an epoch, and moves attitude and
    position by its line period instead.
    """

    sigma: tuple[float, float]
    range: tuple[float, float]
    names: tuple[str, str] = ("window_column", "window_row")

    def apply(self, observations: Observations, value: Array) -> Observations:
        o = observations
        xy_K = o.xy_K + (o.slope_K @ value[..., None, :, None])[..., 0]
        late_s = value[..., None, 1:] * o.line_period_s[:, None]
        if not np.any(late_s):
            return replace(o, xy_K=xy_K)
        moved = o.with_geometry(C_EJ=so3.exp(late_s * o.omega_E) @ o.C_EJ, r_J=o.r_J + late_s * o.v_J)
        return replace(moved, xy_K=xy_K)

    def moves(self, observations: Observations, value: Array) -> Moves:
        o = observations
        row = np.array([0.0, 1.0]) * o.line_period_s[:, None, None]
        return Moves(o.slope_K, o.omega_E[..., None] * row, o.v_J[..., None] * row)


def unknowns(campaign: Campaign) -> list[Mistake]:
    """The quantities worth estimating for a campaign, the simplest first."""
    return [
        _one(HeightOffset(), "landmarks.height_offset", _HEIGHT, 1.0, "m"),
        *(() if campaign.several else _optics(campaign)),
        *_clocks(campaign),
        *(() if campaign.several else _window(campaign)),
        *_trackers(campaign),
    ]


def numbers(campaign: Campaign) -> list[Mistake]:
    """Those that are one number."""
    return [m for m in unknowns(campaign) if len(m.free) == len(m.free[0].names) == 1]


_HEIGHT = (
    "the heights of all landmarks are {} too {low} against the ellipsoid (heights above the geoid or sea level?)",
    'state landmarks.heights = "geoid" with landmarks.geoid, or give heights above the WGS84 ellipsoid',
)


def _one(
    parameter: Parameter, key: str, words: tuple[str, str], unit: float, unit_name: str, cost: float = 0.0
) -> Mistake:
    """A mistake that is one number: ``{}`` in its words is its size, ``{low}`` and ``{small}`` say its direction."""
    what, remedy = words

    def measured(value: Array, sigma: Array) -> str:
        size, error = abs(value[0]) / unit, sigma[0] / unit
        low, small, early = ("low", "small", "early") if value[0] > 0 else ("high", "large", "late")
        return what.format(f"{_rounded(size, error)} {unit_name}".strip(), low=low, small=small, early=early)

    return Mistake(key, what, remedy, free=(parameter,), measured=measured, cost=cost)


def _rounded(size: float, error: float) -> str:
    """A number with its standard deviation, both to the digits that mean something."""
    digits = max(0, 1 - int(np.floor(np.log10(error)))) if error > 0.0 else 3
    return f"{size:.{digits}f} (+- {error:.{digits}f})"


def _optics(campaign: Campaign) -> Iterator[Mistake]:
    """Focal length and distortion of a frame camera, look angles of a line scanner."""
    camera = campaign.camera
    if isinstance(camera, FrameCamera):
        edge = 0.5 * camera.pitch / camera.focal_length * float(np.hypot(*camera.size_px))
        yield _one(
            Optics(camera, ("focal_length",), (OPTICS * camera.focal_length,)),
            "camera.focal_length",
            ("the focal length is {} too {small}", "calibrate with --estimate focal_length"),
            1e-3,
            "mm",
        )
        yield _one(
            Optics(camera, ("k1",), (DISTORTION / edge**2,)),
            "camera.distortion",
            (
                "the lens distorts otherwise than stated: k1 is {} too {small}",
                "calibrate with --estimate distortion",
            ),
            1.0,
            "",
        )
    elif isinstance(camera, LineScanCamera):
        half = 0.5 * float(np.ptp(camera.tan_x))
        yield _one(
            LookAngles(camera, ("look_x_1",), (OPTICS * half,)),
            "camera.focal_length",
            (
                "the look angles at the ends of the line are {} too {small}: the focal length is off",
                "calibrate with --estimate look_x_1",
            ),
            ARCSEC,
            "arcsec",
        )
        names = ("look_x_2", "look_x_3", "look_y_2", "look_y_3")
        yield Mistake(
            "camera.look_angles",
            "the line of detectors is bent otherwise than stated",
            "calibrate with --estimate look_angles",
            free=(LookAngles(camera, names, (DISTORTION * half,) * 4),),
        )


def _clocks(campaign: Campaign) -> Iterator[Mistake]:
    """The clock of the camera against those of attitude and orbit, together and apart."""
    for name, words, cost in (
        ("time_offset", "the images' times are {} too {early}", 0.0),
        ("time_offset_attitude", "the images' times are {} too {early} against the attitude's", RARER),
        ("time_offset_orbit", "the images' times are {} too {early} against the ephemeris'", RARER),
    ):
        yield _one(
            TimeOffset((name,), (CLOCK_S,)),
            f"clock.{name}",
            (words, f"calibrate with --estimate {name}"),
            1e-3,
            "ms",
            cost,
        )


def _window(campaign: Campaign) -> Iterator[Mistake]:
    """A window on the sensor whose first pixel is not that of the camera as described."""
    columns, rows = campaign.camera.size_px
    size = (columns, rows if np.isfinite(rows) else columns)

    def measured(value: Array, sigma: Array) -> str:
        shift = " and ".join(
            f"{_rounded(abs(v), s)} {axis} too {'small' if v > 0 else 'large'}"
            for v, s, axis in zip(value, sigma, ("columns", "rows"), strict=True)
        )
        return f"the observations count from another first pixel than the camera: they are {shift} (a window or crop)"

    yield Mistake(
        "window.offset",
        "the observations count from another first pixel than the camera (a window or crop)",
        "add the first column and row of the window to the observations, or move camera.principal_point_px by them",
        free=(WindowOffset((CROP * size[0], CROP * size[1]), size),),
        measured=measured,
    )


def _trackers(campaign: Campaign) -> Iterator[Mistake]:
    """Star trackers by turns whose mountings differ from what is stated."""
    labels = campaign.images.tracker
    if labels is None:
        return
    member = np.array(labels)
    for name in dict.fromkeys(labels[1:]):
        if name != labels[0]:
            yield Mistake(
                f"tracker.{name}",
                f"the mounting of the star tracker {name!r} differs from that of {labels[0]!r}",
                "calibrate with --estimate trackers",
                free=(TrackerMounting(name, member == name, (TRACKER,) * 3),),
                measured=_turn_of(name, labels[0]),
            )


def _turn_of(name: str, first: str) -> Callable[[Array, Array], str]:
    def measured(value: Array, sigma: Array) -> str:
        size = float(np.linalg.norm(value)) / ARCSEC
        return (
            f"the mounting of the star tracker {name!r} differs from that of {first!r} by {size:.0f} arcsec"
        )

    return measured
