"""``campaign.toml`` as checked models: the keys, units and admissible values, section by section.

Values stay in the units their keys name; :mod:`starplumb.io.campaign` brings them inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from .files import show
from .sections import Section, wrong
from .values import (
    Frame,
    Matrix,
    Pair,
    Positive,
    Prior,
    Quaternion,
    Sigma,
    Text,
    Triple,
    WholePair,
    axis_order,
    choice,
    frame_name,
    printable,
)

CAMERA = "camera"
"""The camera's side of the mounting."""
EARTH_FRAMES = ("GCRF", "J2000", "ITRF")
"""Frames an attitude may start from or lead to; J2000 is read as a synonym of GCRF."""

SUFFIXES = {
    "ephemeris": (".csv", ".oem", ".xml", ".sp3", ".bsp"),
    "attitude": (".csv", ".aem", ".xml"),
    "landmarks": (".csv", ".gpkg", ".geojson", ".json", ".shp"),
    "table": (".csv",),
}


class General(Section):
    """[campaign]"""

    name: Text = Field(description="the campaign's name in quotes")
    time_scale: Annotated[Literal["UTC", "TAI", "GPS", "TT"], choice("UTC", "TAI", "GPS", "TT")] = Field(
        description='the scale of all times in the CSV tables, "UTC", "TAI", "GPS" or "TT"'
    )


class Distortion(Section):
    """camera.distortion: Brown-Conrady, from ideal tangents to those the optics give."""

    model: Annotated[Literal["brown-conrady"], choice("brown-conrady")] = Field(description='"brown-conrady"')
    k: Triple = Field(default=(0.0, 0.0, 0.0), description="the three radial coefficients")
    p: Pair = Field(default=(0.0, 0.0), description="the two tangential coefficients")


_OPTICS = ("focal_length_mm", "pixel_pitch_um", "image_size_px", "principal_point_px")


class CameraConfig(Section):
    """[camera]: optics, or a line scanner's table of look directions."""

    model: Annotated[Literal["frame", "line-scan"], choice("frame", "line-scan")] = Field(
        description='"frame" or "line-scan"'
    )
    focal_length_mm: Positive | None = Field(
        default=None, description="the focal length, a positive number of millimetres"
    )
    pixel_pitch_um: Positive | None = Field(
        default=None, description="the pixel pitch, a positive number of micrometres"
    )
    image_size_px: WholePair | None = Field(
        default=None, description="two positive whole numbers, columns and rows"
    )
    principal_point_px: Pair | None = Field(
        default=None, description="two numbers, column and row of the principal point"
    )
    pixel_origin: Annotated[Literal["center", "corner"], choice("center", "corner")] = Field(
        default="center", description='"center" or "corner"'
    )
    distortion: Distortion | None = Field(default=None, description="a section with model, k and p")
    look_angles: Text | None = Field(default=None, description="the name of a CSV table")

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        if "look_angles" in given and given.get("model") == "frame":
            yield "look_angles", 'found a table of look directions, wanted it for model = "line-scan" only'
            return
        table = "look_angles" in given
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

    ``euler_deg`` with ``euler_order`` reads as ``scipy.spatial.transform.Rotation.from_euler``: capital
    letters turn about the axes as turned so far, small ones about the fixed axes, in the order written.
    """

    source: Text = Field(alias="from", description='"camera" or the star tracker\'s name')
    target: Text = Field(alias="to", description='the star tracker\'s name or "camera"')
    quaternion_xyzw: Quaternion | None = Field(default=None, description="four numbers, scalar last")
    quaternion_wxyz: Quaternion | None = Field(default=None, description="four numbers, scalar first")
    matrix: Matrix | None = Field(default=None, description="three rows of three numbers")
    rotation_vector_deg: Triple | None = Field(default=None, description="three numbers")
    euler_deg: Triple | None = Field(default=None, description="three angles")
    euler_order: Annotated[str, BeforeValidator(axis_order)] | None = Field(
        default=None, description='three axes such as "ZYX" or "xyz"'
    )
    sigma_arcsec: Prior | None = Field(default=None, description="one positive number or three")

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
        return printable(value)

    return BeforeValidator(check)


class EphemerisConfig(Section):
    """[ephemeris]"""

    file: Annotated[str, _table("ephemeris")] = Field(description="the name of the file of positions")
    frame: Frame = Field(description='"ITRF" or "GCRF"')
    sigma_m: Sigma = Field(description="the position's sigma (one number or three), which the solution needs")
    max_gap_s: Positive | None = Field(
        default=None, description="the largest spacing joined by interpolation, a positive number"
    )
    object: Text | None = Field(
        default=None, description="the satellite's name or number in a file that holds several"
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        if "object" in given and str(given.get("file", "")).lower().endswith(".csv"):
            yield "object", "found beside a CSV table, wanted it with a file that names its satellites only"


class AttitudeConfig(Section):
    """[attitude]: the quaternion takes ``from`` to ``to``; one of them is GCRF or ITRF."""

    file: Annotated[str, _table("attitude")] = Field(description="the name of the file of quaternions")
    source: Annotated[str, BeforeValidator(printable), BeforeValidator(frame_name)] = Field(
        alias="from", description='"GCRF", "ITRF" or the star tracker\'s name'
    )
    target: Annotated[str, BeforeValidator(printable), BeforeValidator(frame_name)] = Field(
        alias="to", description='the star tracker\'s name, "GCRF" or "ITRF"'
    )
    sigma_arcsec: Sigma | None = Field(
        default=None, description="one number or three about the star tracker's axes"
    )
    max_gap_s: Positive | None = Field(
        default=None, description="the largest spacing joined by interpolation, a positive number"
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


class TableConfig(Section):
    """[images], [observations] or [detections]"""

    file: Annotated[str, _table("table")] = Field(description="the name of a CSV table")


class CorrectionsConfig(Section):
    """[corrections]; a key left out has the value written here."""

    light_time: bool = Field(default=True, description="true or false")
    aberration: bool = Field(default=True, description="true or false")
    refraction: bool = Field(default=False, description="true or false")


class EarthConfig(Section):
    """[earth]: another table of Earth orientation (IERS finals2000A) than the packaged one."""

    orientation_file: Text = Field(description="the name of an IERS finals2000A file")


class TruthConfig(Section):
    """[truth]: the mounting from the camera to the star tracker that a simulation started from."""

    quaternion_xyzw: Quaternion = Field(description="four numbers, scalar last")


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
    images: TableConfig = Field(description="the section [images] with file")
    observations: TableConfig | None = Field(default=None, description="the section [observations] with file")
    detections: TableConfig | None = Field(default=None, description="the section [detections] with file")
    corrections: CorrectionsConfig = Field(
        default_factory=lambda: CorrectionsConfig(), description="the section [corrections]"
    )
    earth: EarthConfig | None = Field(default=None, description="the section [earth] with orientation_file")
    truth: TruthConfig | None = Field(default=None, description="the section [truth] with quaternion_xyzw")

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
