"""The usual mistakes in a campaign, each as the change that would undo it.

Every one is a function from a campaign to the campaign as it would be had the mistake not been made: a quaternion read
in the other order or direction, a table in another frame or time scale, pixels counted otherwise, a switch, an axis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..physics import so3
from ..physics.errors import InputError
from ..physics.light import inertial_velocity
from ..physics.orientation import EarthOrientation
from ..physics.series import Attitude, Ephemeris, Orientation
from ..physics.timescales import SCALES, format_iso, parse
from ..table.campaign import Campaign

Array = NDArray[np.float64]

_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Written:
    """How the campaign's files say what they hold; needed to undo a misreading in the file's own terms."""

    time_scale: str = "UTC"
    attitude_to_tracker: bool = True
    mounting_from_camera: bool = True


@dataclass(frozen=True)
class Mistake:
    """A possible mistake: ``key`` for programs, what would be wrong, what to change, and the change itself.

    ``undo`` raises InputError where the campaign leaves no room for it.
    """

    key: str
    what: str
    remedy: str
    undo: Callable[[Campaign], Campaign]


def usual_mistakes(campaign: Campaign, written: Written) -> list[Mistake]:
    """All mistakes worth trying on a campaign, the simplest first."""
    return [
        *_switches(campaign),
        *_pixels(),
        *_attitude(campaign, written),
        *_ephemeris(campaign),
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


def _pixels() -> Iterator[Mistake]:
    """Columns and rows swapped, counted from the other side or from another origin."""

    def swapped(c: Campaign) -> Campaign:
        s = c.sightings
        return replace(c, sightings=replace(s, column_px=s.row_px, row_px=s.column_px))

    yield Mistake(
        "pixels.swapped",
        "columns and rows of the observations are swapped",
        "exchange column_px and row_px",
        swapped,
    )
    for axis, side, field in ((0, "right", "column_px"), (1, "bottom", "row_px")):

        def mirrored(c: Campaign, axis: int = axis, field: str = field) -> Campaign:
            count = c.camera.size_px[axis]
            if not np.isfinite(count):
                raise InputError("the image has no stated end to count from")
            pixel = count - 1.0 - getattr(c.sightings, field)
            return replace(c, sightings=replace(c.sightings, **{field: pixel}))

        yield Mistake(
            f"pixels.{field}_from_{side}",
            f"{field} is counted from the {side} of the image",
            f"count {field} from the other side",
            mirrored,
        )
    origins = (
        (0.5, "0.5 px too small"),
        (-0.5, "0.5 px too large (a corner as origin)"),
        (-1.0, "1 px too large"),
    )
    for shift, words in origins:

        def shifted(c: Campaign, shift: float = shift) -> Campaign:
            s = c.sightings
            return replace(c, sightings=replace(s, column_px=s.column_px + shift, row_px=s.row_px + shift))

        yield Mistake(
            f"pixels.origin{shift:+g}",
            f"the observations' pixels are {words} against the camera's principal point",
            "check camera.pixel_origin, and whether pixels are counted from 0 or from 1",
            shifted,
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
    other = "ITRF" if stated == "GCRF" else "GCRF"
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
            "mend the attitude's columns, attitude.from and attitude.to",
            undo,
        )


def _orientation(campaign: Campaign) -> Orientation:
    return campaign.orientation or EarthOrientation.load()


def _inertial(e: Ephemeris, orientation: Orientation) -> tuple[Array, Array | None]:
    """States of an Earth-fixed ephemeris along inertial axes."""
    C_IJ = orientation.C_IJ(e.t_ns)
    v_I = None if e.v_J is None else np.einsum("nij,nj->ni", C_IJ, inertial_velocity(e.r_J, e.v_J))
    return np.einsum("nij,nj->ni", C_IJ, e.r_J), v_I


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
    other = "ITRF" if stated == "GCRF" else "GCRF"

    def undo(c: Campaign) -> Campaign:
        orientation = _orientation(c)
        if stated == "GCRF":
            r, v = _inertial(c.ephemeris, orientation)
            return replace(c, ephemeris=replace(c.ephemeris, r_J=r, v_J=v), position_frame="ITRF")
        ephemeris = _earth_fixed(c.ephemeris, c.ephemeris.r_J, c.ephemeris.v_J, orientation)
        return replace(c, ephemeris=ephemeris, position_frame="GCRF", orientation=orientation)

    yield Mistake(
        "ephemeris.frame",
        f"the positions refer to {other}, not {stated}",
        f'set ephemeris.frame = "{other}"',
        undo,
    )


def _retimed(c: Campaign, tables: tuple[str, ...], shift_ns: int) -> Campaign:
    """The campaign with the epochs of some tables moved; inertial positions are turned at their new epochs."""
    if "images" in tables:
        c = replace(c, images=replace(c.images, t_ns=c.images.t_ns + shift_ns))
    if "attitude" in tables:
        c = c.with_attitude(lambda a: replace(a, t_ns=a.t_ns + shift_ns))
    if "ephemeris" in tables:
        moved = replace(c.ephemeris, t_ns=c.ephemeris.t_ns + shift_ns)
        if c.position_frame == "GCRF" and c.orientation is not None:
            moved = _earth_fixed(moved, *_inertial(c.ephemeris, c.orientation), c.orientation)
        c = replace(c, ephemeris=moved)
    return c


_TABLES = {
    "images": ("the images' times", ("images",)),
    "attitude": ("the attitude's times", ("attitude",)),
    "ephemeris": ("the ephemeris' times", ("ephemeris",)),
    "all": ("all times", ("images", "attitude", "ephemeris")),
}


_PRESENT_S = (18, 37)
"""GPS and TAI less UTC since 2017: a table of any year may be off by what was written into a program as a constant."""


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
            "mend [mounting]",
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
