"""``campaign.toml`` as checked models: the keys, units and admissible values, section by section.

Values stay in the units their keys name; :mod:`starplumb.io.campaign` brings them inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from math import sqrt
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from .files import nearest, show
from .sections import Section, number, one_or_three, vector, wrong

CAMERA = "camera"
"""The camera's side of the mounting."""
EARTH_FRAMES = ("GCRF", "J2000", "ITRF")
"""Frames an attitude may start from or lead to; J2000 is read as a synonym of GCRF."""
UNIT_TOLERANCE = 1e-3
"""How far a quaternion's norm may be from 1 and a matrix from orthonormal; both are then made exact."""

SUFFIXES = {
    "ephemeris": (".csv", ".oem", ".xml", ".sp3", ".bsp"),
    "attitude": (".csv", ".aem", ".xml"),
    "landmarks": (".csv", ".gpkg", ".geojson", ".json", ".shp"),
    "images": (".csv",),
    "observations": (".csv",),
    "detections": (".csv",),
}


def _positive(x: float) -> bool:
    return x > 0.0


def _not_negative(x: float) -> bool:
    return x >= 0.0


def _text(value: object) -> object:
    if isinstance(value, str) and (not value.strip() or not value.isprintable()):
        raise wrong(value, "a name of printable letters")
    return value


def _frame(value: object) -> object:
    return "GCRF" if value == "J2000" else value


def _choice(*words: str) -> BeforeValidator:
    """One of a few words; a near miss is told the word that is meant."""

    def check(value: object) -> object:
        if value in words:
            return value
        listed = (
            " or ".join([", ".join(f'"{word}"' for word in words[:-1]), f'"{words[-1]}"'])
            if words[1:]
            else words[0]
        )
        meant = nearest(value, words) if isinstance(value, str) else None
        raise wrong(value, listed + (f' (perhaps "{meant}")' if meant and len(words) > 2 else ""))

    return BeforeValidator(check)


def _unit_quaternion(value: object) -> tuple[float, ...]:
    q = vector(4, "four finite numbers, a quaternion of norm 1")(value)
    norm = sqrt(sum(x * x for x in q))
    if abs(norm - 1.0) > UNIT_TOLERANCE:
        raise wrong(value, f"a quaternion of norm 1 (its norm is {norm:.6g})")
    return q


def _rotation_matrix(value: object) -> tuple[tuple[float, ...], ...]:
    wanted = "three rows of three numbers, a rotation matrix"
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise wrong(value, wanted)
    rows = tuple(vector(3, wanted)(row) for row in value)
    C = np.array(rows)
    off = float(np.abs(C @ C.mT - np.eye(3)).max())
    if off > UNIT_TOLERANCE:
        raise wrong(value, f"a rotation matrix (C times its transpose is off the identity by {off:.3g})")
    if np.linalg.det(C) < 0.0:
        raise wrong(value, "a rotation matrix of determinant +1 (this one mirrors: its determinant is -1)")
    return rows


def _euler_order(value: object) -> object:
    order = value if isinstance(value, str) else ""
    one_case = order in (order.lower(), order.upper())
    if (
        len(order) != 3
        or set(order.lower()) - set("xyz")
        or not one_case
        or any(a == b for a, b in pairwise(order))
    ):
        raise wrong(
            value,
            'three axes such as "ZYX" (about the turned axes) or "xyz" (about the fixed axes)',
        )
    return value


def _whole_pair(value: object) -> tuple[int, ...]:
    items = value if isinstance(value, list | tuple) else ()
    whole = tuple(n for n in items if isinstance(n, int) and not isinstance(n, bool) and 1 <= n <= 10_000_000)
    if len(items) != 2 or len(whole) != 2:
        raise wrong(value, "two positive whole numbers, columns and rows")
    return whole


Text = Annotated[str, BeforeValidator(_text)]
Positive = Annotated[float, BeforeValidator(number("a positive number", _positive))]
Quaternion = Annotated[tuple[float, float, float, float], BeforeValidator(_unit_quaternion)]
Matrix = Annotated[tuple[tuple[float, float, float], ...], BeforeValidator(_rotation_matrix)]
Triple = Annotated[tuple[float, float, float], BeforeValidator(vector(3, "three finite numbers"))]
Pair = Annotated[tuple[float, float], BeforeValidator(vector(2, "two finite numbers"))]
WholePair = Annotated[tuple[int, int], BeforeValidator(_whole_pair)]
Sigma = Annotated[
    tuple[float, float, float],
    BeforeValidator(
        one_or_three("one number or three, none negative (0 claims an exact value)", _not_negative)
    ),
]
Prior = Annotated[
    tuple[float, float, float], BeforeValidator(one_or_three("one positive number or three", _positive))
]
Frame = Annotated[Literal["ITRF", "GCRF"], _choice("ITRF", "GCRF"), BeforeValidator(_frame)]


class General(Section):
    """[campaign]"""

    name: Text = Field(description="the campaign's name in quotes")
    time_scale: Annotated[Literal["UTC", "TAI", "GPS", "TT"], _choice("UTC", "TAI", "GPS", "TT")] = Field(
        description='the scale of all times in the CSV tables, "UTC", "TAI", "GPS" or "TT"'
    )


class Distortion(Section):
    """camera.distortion: Brown-Conrady, from ideal tangents to those the optics give."""

    model: Annotated[Literal["brown-conrady"], _choice("brown-conrady")] = Field(
        description='"brown-conrady"'
    )
    k: Triple = Field((0.0, 0.0, 0.0), description="the three radial coefficients")
    p: Pair = Field((0.0, 0.0), description="the two tangential coefficients")


_OPTICS = ("focal_length_mm", "pixel_pitch_um", "image_size_px", "principal_point_px")


class CameraConfig(Section):
    """[camera]: optics, or a line scanner's table of look directions."""

    model: Annotated[Literal["frame", "line-scan"], _choice("frame", "line-scan")] = Field(
        description='"frame" or "line-scan"'
    )
    focal_length_mm: Positive | None = Field(
        None, description="the focal length, a positive number of millimetres"
    )
    pixel_pitch_um: Positive | None = Field(
        None, description="the pixel pitch, a positive number of micrometres"
    )
    image_size_px: WholePair | None = Field(None, description="two positive whole numbers, columns and rows")
    principal_point_px: Pair | None = Field(
        None, description="two numbers, column and row of the principal point"
    )
    pixel_origin: Annotated[Literal["center", "corner"], _choice("center", "corner")] = Field(
        "center", description='"center" or "corner"'
    )
    distortion: Distortion | None = Field(None, description="a section with model, k and p")
    look_angles: Text | None = Field(None, description="the name of a CSV table")

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        table = "look_angles" in given
        if table and given.get("model") == "frame":
            yield "look_angles", 'found a table of look directions, wanted it for model = "line-scan" only'
        for key in _OPTICS:
            if key not in given and not table:
                yield key, f"missing, wanted {cls.model_fields[key].description}"
            elif key in given and table and key != "image_size_px":
                yield (
                    key,
                    "found beside look_angles, wanted only one of the two ways to state the look directions",
                )
        if table and "distortion" in given:
            yield (
                "distortion",
                "found beside look_angles, wanted it with a focal length only (the table has it already)",
            )


_ROTATIONS = ("quaternion_xyzw", "quaternion_wxyz", "matrix", "rotation_vector_deg", "euler_deg")


class Mounting(Section):
    """[mounting]: the model alignment, a rotation that takes coordinates in ``from`` to those in ``to``.

    ``euler_deg`` and ``euler_order`` read as ``scipy.spatial.transform.Rotation.from_euler``: capital letters turn
    about the axes as turned so far, small ones about the fixed axes, in the order written.
    """

    source: Text = Field(alias="from", description='"camera" or the star tracker\'s name')
    target: Text = Field(alias="to", description='the star tracker\'s name or "camera"')
    quaternion_xyzw: Quaternion | None = Field(None, description="four numbers, scalar last")
    quaternion_wxyz: Quaternion | None = Field(None, description="four numbers, scalar first")
    matrix: Matrix | None = Field(None, description="three rows of three numbers")
    rotation_vector_deg: Triple | None = Field(None, description="three numbers")
    euler_deg: Triple | None = Field(None, description="three angles")
    euler_order: Annotated[str, BeforeValidator(_euler_order)] | None = Field(
        None, description='three axes such as "ZYX" or "xyz"'
    )
    sigma_arcsec: Prior | None = Field(None, description="one positive number or three")

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        stated = [key for key in _ROTATIONS if key in given]
        if not stated:
            yield "quaternion_xyzw", f"missing, wanted exactly one of {', '.join(_ROTATIONS)}"
        for key in stated[1:]:
            yield key, f"found beside {stated[0]}, wanted exactly one of {', '.join(_ROTATIONS)}"
        if "euler_deg" in given and "euler_order" not in given:
            yield "euler_order", 'missing, wanted the three axes of euler_deg such as "ZYX" or "xyz"'
        if "euler_order" in given and "euler_deg" not in given:
            yield "euler_deg", "missing, wanted the three angles that euler_order names"


def _table(section: str) -> BeforeValidator:
    """A file name whose ending tells one of the formats of this section."""
    endings = SUFFIXES[section]

    def check(value: object) -> object:
        if isinstance(value, str) and not value.lower().endswith(endings):
            raise wrong(value, f"a file name ending in {', '.join(endings)}")
        return _text(value)

    return BeforeValidator(check)


class EphemerisConfig(Section):
    """[ephemeris]"""

    file: Annotated[str, _table("ephemeris")] = Field(description="the name of the file of positions")
    frame: Frame = Field(description='"ITRF" or "GCRF"')
    sigma_m: Sigma = Field(description="the position's sigma (one number or three), which the solution needs")
    max_gap_s: Positive | None = Field(
        None, description="the largest spacing joined by interpolation, a positive number"
    )
    object: Text | None = Field(
        None, description="the satellite's name or number in a file that holds several"
    )


class AttitudeConfig(Section):
    """[attitude]: the quaternion takes ``from`` to ``to``; one of them is GCRF or ITRF."""

    file: Annotated[str, _table("attitude")] = Field(description="the name of the file of quaternions")
    source: Annotated[str, BeforeValidator(_text), BeforeValidator(_frame)] = Field(
        alias="from", description='"GCRF", "ITRF" or the star tracker\'s name'
    )
    target: Annotated[str, BeforeValidator(_text), BeforeValidator(_frame)] = Field(
        alias="to", description='the star tracker\'s name, "GCRF" or "ITRF"'
    )
    sigma_arcsec: Sigma | None = Field(None, description="one number or three about the star tracker's axes")
    max_gap_s: Positive | None = Field(
        None, description="the largest spacing joined by interpolation, a positive number"
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        ends = (given.get("from"), given.get("to"))
        if all(isinstance(end, str) for end in ends) and sum(end in EARTH_FRAMES for end in ends) != 1:
            yield (
                "from",
                f'found "{ends[0]}" to "{ends[1]}", wanted GCRF (or J2000) or ITRF on exactly one side',
            )


class LandmarksConfig(Section):
    """[landmarks]"""

    file: Annotated[str, _table("landmarks")] = Field(description="the name of the file of landmarks")


class ImagesConfig(Section):
    """[images]"""

    file: Annotated[str, _table("images")] = Field(description="the name of the table of images")


class ObservationsConfig(Section):
    """[observations]"""

    file: Annotated[str, _table("observations")] = Field(description="the name of the table of observations")


class DetectionsConfig(Section):
    """[detections]"""

    file: Annotated[str, _table("detections")] = Field(description="the name of the table of detections")


class CorrectionsConfig(Section):
    """[corrections]; a key left out has the value written here."""

    light_time: bool = Field(True, description="true or false")
    aberration: bool = Field(True, description="true or false")
    refraction: bool = Field(False, description="true or false")


class EarthConfig(Section):
    """[earth]: another table of Earth orientation (IERS finals2000A) than the packaged one."""

    orientation_file: Text = Field(description="the name of an IERS finals2000A file")


class CampaignConfig(Section):
    """The whole of campaign.toml."""

    campaign: General = Field(description="the section [campaign] with name and time_scale")
    camera: CameraConfig = Field(description="the section [camera]")
    mounting: Mounting = Field(description="the section [mounting]")
    ephemeris: EphemerisConfig = Field(description="the section [ephemeris] with file, frame and sigma_m")
    attitude: AttitudeConfig = Field(
        description="the section [attitude] with file, from, to and sigma_arcsec"
    )
    landmarks: LandmarksConfig = Field(description="the section [landmarks] with file")
    images: ImagesConfig = Field(description="the section [images] with file")
    observations: ObservationsConfig | None = Field(None, description="the section [observations] with file")
    detections: DetectionsConfig | None = Field(None, description="the section [detections] with file")
    corrections: CorrectionsConfig = Field(
        default_factory=lambda: CorrectionsConfig(), description="the section [corrections]"
    )
    earth: EarthConfig | None = Field(None, description="the section [earth] with orientation_file")

    @property
    def tracker(self) -> str:
        """The star tracker's name: the side of the attitude that is not the Earth's."""
        return self.attitude.target if self.attitude.source in EARTH_FRAMES else self.attitude.source

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        if "observations" in given and "detections" in given:
            yield "detections", "found beside [observations], wanted exactly one of the two"
        if "observations" not in given and "detections" not in given:
            yield "observations", "missing, wanted the section [observations] or [detections] with file"
        mounting, tracker = _ends(given.get("mounting")), _tracker_of(_ends(given.get("attitude")))
        if mounting and tracker:
            yield from _mounting_names(mounting, tracker)


def _ends(section: object) -> tuple[str, str] | None:
    """``from`` and ``to`` of a section, where both are there and text."""
    ends = (section.get("from"), section.get("to")) if isinstance(section, dict) else (None, None)
    return (ends[0], ends[1]) if isinstance(ends[0], str) and isinstance(ends[1], str) else None


def _tracker_of(attitude: tuple[str, str] | None) -> str | None:
    trackers = [end for end in attitude or () if end not in EARTH_FRAMES]
    return trackers[0] if len(trackers) == 1 else None


def _mounting_names(mounting: tuple[str, str], tracker: str) -> Iterator[tuple[str, str]]:
    """The mounting must join the camera and the very frame in which the attitude is given."""
    if tracker == CAMERA:
        yield (
            "attitude.to",
            "found \"camera\" as the star tracker's name, wanted another: it is the camera's own",
        )
        return
    keys = ("mounting.from", "mounting.to")
    own = next((i for i, name in enumerate(mounting) if name == CAMERA), None)
    if own is None:
        key = keys[1] if mounting[0] == tracker else keys[0]
        found = mounting[1] if mounting[0] == tracker else mounting[0]
        yield key, f'found {show(found)}, wanted "camera" (the mounting joins the camera and {show(tracker)})'
    if own is not None and mounting[1 - own] != tracker:
        wanted = f"wanted {show(tracker)}, the star tracker's name in [attitude]"
        yield keys[1 - own], f"found {show(mounting[1 - own])}, {wanted}"
