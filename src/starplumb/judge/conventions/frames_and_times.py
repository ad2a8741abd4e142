"""The usual mistakes in reading rotations, frames and times, each as the change that would undo it.

Every one is a function from a campaign to the campaign as it would be had the mistake not been made: a quaternion read
in the other order or direction, a table in another frame or time scale, a switch, an axis.  Those of the image and the
ground stand in :mod:`starplumb.judge.conventions.image_and_ground`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ...physics import so3
from ...physics.light import inertial_velocity
from ...physics.orientation import C_IF, FRAMES_OF_DATE, EarthOrientation, FrameOfDate
from ...physics.series import Attitude, Ephemeris, Orientation
from ...physics.timescales import SCALES, format_iso, parse
from ...table.campaign import Campaign
from .mistake import Mistake, Written

Array = NDArray[np.float64]

_HOUR_NS = 3_600 * 10**9
_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


def misread_frames_and_times(campaign: Campaign, written: Written) -> list[Mistake]:
    """The mistakes of this module worth trying on a campaign, the simplest first."""
    return [
        *_switches(campaign),
        *_attitude(campaign, written),
        *_ephemeris(campaign),
        *_frames_of_date(campaign),
        *_times(campaign, written),
        *_mounting(written),
        *_axes(),
    ]


def _switches(campaign: Campaign) -> Iterator[Mistake]:
    """Light effects that the data contain and the model does not, or the other way round."""
    for name in ("aberration", "light_time", "refraction"):
        on = bool(getattr(campaign.corrections, name))
        right = "false" if on else "true"

        def undo(c: Campaign, name: str = name, right: bool = not on) -> Campaign:
            return replace(c, corrections=replace(c.corrections, **{name: right}))

        yield Mistake(
            f"corrections.{name}",
            f"the switch {name} is set wrongly",
            f"set corrections.{name} = {right}",
            undo,
        )


_ORDERS = {
    "": 0,
    "written scalar first but named scalar last": -1,
    "written scalar last but named scalar first": 1,
}
"""Ways to write a quaternion that is read as x, y, z, w, and the roll that undoes them."""


def _reread(q_xyzw: Array, roll: int, reverse: bool, inverse_in_file: bool) -> Array:
    """Quaternions (..., 4) as they are when the file's four numbers are rolled and the direction then reversed."""
    q = q_xyzw * _CONJUGATE if inverse_in_file else q_xyzw
    q = np.roll(q, roll, axis=-1)
    return q * _CONJUGATE if inverse_in_file != reverse else q


def _attitude(campaign: Campaign, written: Written) -> Iterator[Mistake]:
    """Order, direction and frame of the attitude, alone and together."""
    stated = campaign.attitudes[0].frame
    other = "GCRF" if stated == "ITRF" else "ITRF"
    for (order, roll), reverse, reframe in product(_ORDERS.items(), (False, True), (False, True)):
        parts = [order] if order else []
        parts += ["turning the other way (from and to exchanged)"] if reverse else []
        parts += [f"relative to {other}, not {stated}"] if reframe else []
        if not parts:
            continue

        def undo(c: Campaign, roll: int = roll, reverse: bool = reverse, reframe: bool = reframe) -> Campaign:
            def reread(a: Attitude) -> Attitude:
                a = replace(a, q_EF=_reread(a.q_EF, roll, reverse, not written.attitude_to_tracker))
                if not reframe:
                    return a
                inertial = a.frame == "GCRF"
                orientation = None if inertial else _orientation(c)
                return replace(a, frame="ITRF" if inertial else "GCRF", orientation=orientation)

            return c.with_attitude(reread)

        key = "+".join(
            name
            for name, there in (("order", bool(roll)), ("direction", reverse), ("frame", reframe))
            if there
        )
        yield Mistake(
            f"attitude.{key}" + ("-moved" if roll == 1 else ""),
            f"the attitude's quaternions are {' and '.join(parts)}",
            "correct the attitude's columns, or attitude.from and attitude.to",
            undo,
        )


def _orientation(campaign: Campaign) -> Orientation:
    return campaign.orientation or EarthOrientation.load()


def _inertial(e: Ephemeris, orientation: Orientation) -> tuple[Array, Array | None]:
    """States of an Earth-fixed ephemeris along inertial axes."""
    C_IJ = orientation.C_IJ(e.t_ns)
    v_I = None if e.v_J is None else np.einsum("nij,nj->ni", C_IJ, inertial_velocity(e.r_J, e.v_J))
    return np.einsum("nij,nj->ni", C_IJ, e.r_J), v_I


def _as_written(c: Campaign, orientation: Orientation) -> tuple[Array, Array | None]:
    """States of a campaign's inertial ephemeris along the axes of its own frame."""
    r, v = _inertial(c.ephemeris, orientation)
    if c.position_frame == "ITRF" or c.position_frame == "GCRF":  # mypy follows this
        return r, v
    C_FI = C_IF(c.position_frame, c.ephemeris.t_ns).mT
    return np.einsum("nij,nj->ni", C_FI, r), None if v is None else np.einsum("nij,nj->ni", C_FI, v)


def _earth_fixed(e: Ephemeris, r_I: Array, v_I: Array | None, orientation: Orientation) -> Ephemeris:
    """The ephemeris of inertial states at the epochs of ``e``."""
    C_JI = orientation.C_IJ(e.t_ns).mT
    r_J = np.einsum("nij,nj->ni", C_JI, r_I)
    if v_I is None:
        return replace(e, r_J=r_J, v_J=None)
    return replace(
        e, r_J=r_J, v_J=np.einsum("nij,nj->ni", C_JI, v_I) - inertial_velocity(r_J, np.zeros_like(r_J))
    )


def _ephemeris(campaign: Campaign) -> Iterator[Mistake]:
    """Positions in the other frame than stated."""
    stated = campaign.position_frame
    other = "GCRF" if stated == "ITRF" else "ITRF"

    def undo(c: Campaign) -> Campaign:
        orientation = _orientation(c)
        if stated != "ITRF":
            r, v = _as_written(c, orientation)
            return replace(c, ephemeris=replace(c.ephemeris, r_J=r, v_J=v), position_frame="ITRF")
        ephemeris = _earth_fixed(c.ephemeris, c.ephemeris.r_J, c.ephemeris.v_J, orientation)
        return replace(c, ephemeris=ephemeris, position_frame="GCRF", orientation=orientation)

    yield Mistake(
        "ephemeris.frame",
        f"the positions refer to {other}, not {stated}",
        f'set ephemeris.frame = "{other}"',
        undo,
    )


def _frames_of_date(campaign: Campaign) -> Iterator[Mistake]:
    """An inertial frame of date taken as GCRF: of the attitude, of the positions, of both."""
    inertial = {
        "attitude": campaign.attitudes[0].frame == "GCRF",
        "ephemeris": campaign.position_frame == "GCRF",
    }
    tables = [name for name, there in inertial.items() if there]
    choices = [(name,) for name in tables] + ([tuple(tables)] if len(tables) > 1 else [])
    for chosen, frame in product(choices, FRAMES_OF_DATE):

        def undo(c: Campaign, chosen: tuple[str, ...] = chosen, frame: FrameOfDate = frame) -> Campaign:
            if "attitude" in chosen:
                c = c.with_attitude(lambda a: _attitude_of_date(a, frame))
            return _ephemeris_of_date(c, frame) if "ephemeris" in chosen else c

        words = " and ".join(
            {"attitude": "the attitude", "ephemeris": "the positions"}[name] for name in chosen
        )
        keys = " and ".join(f"{name}.{'frame' if name == 'ephemeris' else 'from'}" for name in chosen)
        yield Mistake(
            f"frames.{'+'.join(chosen)}.{frame}",
            f"{words} refer to {_FRAME_NAMES[frame]}, not to GCRF",
            f"turn {words} from {frame} to GCRF before they are read ({keys} names GCRF)",
            undo,
        )


_FRAME_NAMES = {
    "TOD": "the true equator and equinox of date (TOD)",
    "MOD": "the mean equator and equinox of date (MOD)",
    "TEME": "TEME, the frame of SGP4 and two-line elements",
}


def _of_date(frame: FrameOfDate, t_ns: NDArray[np.int64]) -> Array:
    """C_IF at many epochs (n,), linear between whole hours: within 2e-5 arcsec of the series, which take long."""
    hour, back = np.unique(t_ns // _HOUR_NS, return_inverse=True)
    since = (t_ns - hour[back] * _HOUR_NS) / _HOUR_NS
    here, next_ = (C_IF(frame, (hour + k) * _HOUR_NS) for k in (0, 1))
    return np.asarray(here[back] + since[:, None, None] * (next_ - here)[back])


def _attitude_of_date(a: Attitude, frame: FrameOfDate) -> Attitude:
    """An attitude stated from GCRF that is from a frame of date: ``C_EI = C_EF C_FI``."""
    C_EI = so3.from_quaternion(a.q_EF) @ _of_date(frame, a.t_ns).mT
    return replace(a, q_EF=so3.to_quaternion(C_EI))


def _ephemeris_of_date(c: Campaign, frame: FrameOfDate) -> Campaign:
    """The campaign whose inertial states are those of a frame of date: ``r_I = C_IF r_F``."""
    orientation = _orientation(c)
    r_F, v_F = _inertial(c.ephemeris, orientation)
    turn = _of_date(frame, c.ephemeris.t_ns)
    r_I = np.einsum("nij,nj->ni", turn, r_F)
    v_I = None if v_F is None else np.einsum("nij,nj->ni", turn, v_F)
    return replace(c, ephemeris=_earth_fixed(c.ephemeris, r_I, v_I, orientation))


def _retimed(c: Campaign, tables: tuple[str, ...], shift_ns: int) -> Campaign:
    """The campaign with the epochs of some tables moved; inertial positions are turned at their new epochs."""
    if "images" in tables:
        c = replace(c, images=replace(c.images, t_ns=c.images.t_ns + shift_ns))
    if "attitude" in tables:
        c = c.with_attitude(lambda a: replace(a, t_ns=a.t_ns + shift_ns))
    if "ephemeris" in tables:
        moved = replace(c.ephemeris, t_ns=c.ephemeris.t_ns + shift_ns)
        if c.position_frame != "ITRF" and c.orientation is not None:
            moved = _earth_fixed(moved, *_inertial(c.ephemeris, c.orientation), c.orientation)
        c = replace(c, ephemeris=moved)
    return c


_TABLES = {
    "images": ("the images' times", ("images",)),
    "attitude": ("the attitude's times", ("attitude",)),
    "ephemeris": ("the ephemeris' times", ("ephemeris",)),
    "all": ("all times", ("images", "attitude", "ephemeris")),
}


_PRESENT_S = (18, 37, 1)
"""GPS and TAI less UTC since 2017, which a program may hold as a constant whatever the year; and one leap second."""


def _shifts(campaign: Campaign, stated: str) -> dict[int, str]:
    """Moves of epochs (ns) that undo a mistaken time scale, and the mistake in words."""
    t_ns = campaign.images.t_ns[:1]
    label = format_iso(t_ns, stated, 9)
    scales = {int(parse(label, scale)[0] - t_ns[0]): scale for scale in SCALES if scale != stated}
    found = {by: f"in {scale}, not {stated} ({abs(by) * 1e-9:.9g} s)" for by, scale in scales.items() if by}
    for size in (*found, *(second * 10**9 for second in _PRESENT_S)):
        for by in (size, -size):
            found.setdefault(by, f"{abs(by) * 1e-9:.9g} s too {'early' if by > 0 else 'late'}")
    return found


def _times(campaign: Campaign, written: Written) -> Iterator[Mistake]:
    """Epochs in another time scale than stated, or moved by such a difference the wrong way."""
    for (name, (words, tables)), (shift_ns, wrong) in product(
        _TABLES.items(), _shifts(campaign, written.time_scale).items()
    ):

        def undo(c: Campaign, tables: tuple[str, ...] = tables, by: int = shift_ns) -> Campaign:
            return _retimed(c, tables, by)

        yield Mistake(
            f"times.{name}{shift_ns * 1e-9:+.9g}s",
            f"{words} are {wrong}",
            "check campaign.time_scale and the scale of each table",
            undo,
        )


def _mounting(written: Written) -> Iterator[Mistake]:
    """Order and direction of the model mounting."""
    for (order, roll), reverse in product(_ORDERS.items(), (False, True)):
        parts = [order] if order else []
        parts += ["turning the other way (from and to exchanged)"] if reverse else []
        if not parts:
            continue

        def undo(c: Campaign, roll: int = roll, reverse: bool = reverse) -> Campaign:
            q = _reread(so3.to_quaternion(c.C_EK), roll, reverse, not written.mounting_from_camera)
            return replace(c, C_EK=so3.from_quaternion(q))

        key = "+".join(name for name, there in (("order", bool(roll)), ("direction", reverse)) if there)
        yield Mistake(
            f"mounting.{key}" + ("-moved" if roll == 1 else ""),
            f"the model mounting is {' and '.join(parts)}",
            "correct [mounting]",
            undo,
        )


def _axes() -> Iterator[Mistake]:
    """The camera's or the tracker's axes a quarter or half turn off."""
    for frame, axis, quarters in product(("camera", "tracker"), range(3), (1, 2, 3)):
        turn = so3.exp(0.5 * np.pi * quarters * np.eye(3)[axis])
        angle = (90, 180, -90)[quarters - 1]

        def undo(c: Campaign, frame: str = frame, turn: Array = turn) -> Campaign:
            return replace(c, C_EK=c.C_EK @ turn if frame == "camera" else turn @ c.C_EK)

        yield Mistake(
            f"axes.{frame}.{'xyz'[axis]}{angle:+d}",
            f"the {frame}'s axes are {angle:+d} deg off about {'xyz'[axis]}",
            f"turn the model mounting by {angle:+d} deg about the {frame}'s {'xyz'[axis]}",
            undo,
        )
