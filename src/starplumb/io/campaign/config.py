"""``campaign.toml`` as checked models: the keys, units and admissible values, section by section.

Values stay in the units their keys name; :mod:`starplumb.io.campaign.read` brings them inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from ..imagery.config import ImageryConfig, MeasureConfig, ReferenceConfig
from ..tables.keys import TimedKeys, UnitsConfig
from ..text.sections import Section
from ..text.values import (
    Frame,
    InMemory,
    Positive,
    Quaternion,
    Sigma,
    Text,
    choice,
)
from .attitude_config import (
    AttitudeConfig,
    FusionConfig,
    Mounting,
    Shared,
    TrackerConfig,
    attitude_rules,
    sharing_rules,
)
from .cameras.config import CameraConfig, NamedCamera, camera_rules, several_rules
from .fixed_frames import CAMERA, FixedFrame, Frames, frame_rules
from .spice_config import SpiceConfig
from .table_config import DetectionsConfig, ImagesConfig, LandmarksConfig, ObservationsConfig


class General(Section):
    """[campaign]"""

    name: Text = Field(description="the campaign's name in quotes")
    satellite: Text | None = Field(default=None, description="the satellite's name, for archives of several")
    time_scale: Annotated[Literal["UTC", "TAI", "GPS", "TT"], choice("UTC", "TAI", "GPS", "TT")] = Field(
        description='the scale of all times in the tables, "UTC", "TAI", "GPS" or "TT"'
    )


class EphemerisConfig(TimedKeys):
    """[ephemeris]"""

    by_content: ClassVar[bool] = True

    file: Text = Field(description="the name of the file of positions")
    frame: Frame = Field(description='"ITRF", "GCRF", "TEME", "TOD" or "MOD"')
    sigma_m: Sigma = Field(description="the position's sigma (one number or three), which the solution needs")
    max_gap_s: Positive | None = Field(
        default=None, description="the largest spacing joined by interpolation, a positive number"
    )
    units: UnitsConfig = Field(
        default_factory=lambda: UnitsConfig(),
        description='a section with position ("m" or "km") and velocity',
    )
    object: Text | None = Field(
        default=None, description="the satellite's name or number in a file that holds several"
    )
    shared_by: Shared | None = Field(
        default=None, description='what has one position error: "image", "pass", "session" or "campaign"'
    )
    correlation_time_s: Positive | None = Field(
        default=None,
        description="in place of shared_by the correlation time of the error, a positive number of seconds",
    )
    session_sigma_m: Sigma | None = Field(
        default=None, description="a further error of each session, one number or three"
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        yield from super().rules(given)
        yield from sharing_rules(given)
        if "object" in given and isinstance(given.get("file"), InMemory):
            yield (
                "object",
                "found beside a table (CSV or the like), wanted it where the file names its satellites",
            )


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


_PIXELS, _NUMBER = 'a sigma in pixels such as "0.4px"', 'a sigma, a number in quotes such as "0.01"'
_ANGLE, _TIME = 'a sigma at the ends of the line such as "0.4px" or "1arcsec"', 'a sigma such as "2ms"'


class ConsiderConfig(Section):
    """[consider]: each with its unit; a group stands for each of its members."""

    focal_length: Text | None = Field(default=None, description='a sigma such as "5um"')
    principal_point: Text | None = Field(default=None, description=_PIXELS)
    principal_column: Text | None = Field(default=None, description=_PIXELS)
    principal_row: Text | None = Field(default=None, description=_PIXELS)
    distortion: Text | None = Field(default=None, description=_NUMBER)
    k1: Text | None = Field(default=None, description=_NUMBER)
    k2: Text | None = Field(default=None, description=_NUMBER)
    k3: Text | None = Field(default=None, description=_NUMBER)
    p1: Text | None = Field(default=None, description=_NUMBER)
    p2: Text | None = Field(default=None, description=_NUMBER)
    look_angles: Text | None = Field(default=None, description=_ANGLE)
    look_x_1: Text | None = Field(default=None, description=_ANGLE)
    look_x_2: Text | None = Field(default=None, description=_ANGLE)
    look_x_3: Text | None = Field(default=None, description=_ANGLE)
    look_y_2: Text | None = Field(default=None, description=_ANGLE)
    look_y_3: Text | None = Field(default=None, description=_ANGLE)
    time_offset: Text | None = Field(default=None, description=_TIME)
    time_offset_attitude: Text | None = Field(default=None, description=_TIME)
    time_offset_orbit: Text | None = Field(default=None, description=_TIME)
    trackers: Text | None = Field(default=None, description='a sigma such as "5arcsec"')
    refraction: Text | None = Field(
        default=None, description='the part by which it may be wrong, such as "10%"'
    )

    @property
    def stated(self) -> dict[str, str]:
        """What is stated, by name."""
        return {name: text for name, text in self if text is not None}


class CampaignConfig(Section):
    """The whole of campaign.toml."""

    campaign: General = Field(description="the section [campaign] with name and time_scale")
    camera: CameraConfig | None = Field(default=None, description="the section [camera]")
    mounting: Mounting | None = Field(default=None, description="the section [mounting]")
    cameras: list[NamedCamera] | None = Field(
        default=None,
        description="in place of [camera] and [mounting] tables [[cameras]], each with a name, a mounting and the keys "
        "of [camera]",
    )
    ephemeris: EphemerisConfig = Field(description="the section [ephemeris] with file, frame and sigma_m")
    attitude: AttitudeConfig | None = Field(
        default=None, description="the section [attitude] with file, from, to and sigma_arcsec"
    )
    trackers: list[TrackerConfig] | None = Field(
        default=None, description="tables [[trackers]] with file, from, to, sigma_arcsec and mounting"
    )
    fusion: FusionConfig | None = Field(
        default=None, description="the section [fusion] with frame and method"
    )
    frames: dict[str, FixedFrame] = Field(
        default_factory=dict, description="the section [frames], NAME = { from = ..., and a rotation }"
    )
    spice: SpiceConfig = Field(
        default_factory=lambda: SpiceConfig(), description="the section [spice] with camera and tracker"
    )
    landmarks: LandmarksConfig = Field(description="the section [landmarks] with file")
    images: ImagesConfig = Field(description="the section [images] with file")
    observations: ObservationsConfig | None = Field(
        default=None, description="the section [observations] with file"
    )
    detections: DetectionsConfig | None = Field(
        default=None, description="the section [detections] with file"
    )
    imagery: ImageryConfig | None = Field(
        default=None, description="the section [imagery] with files, the raw images"
    )
    reference: ReferenceConfig | None = Field(
        default=None, description="the section [reference] with files, dem, heights and sigma_m"
    )
    measure: MeasureConfig = Field(
        default_factory=lambda: MeasureConfig(), description="the section [measure] with chip_px and grid"
    )
    corrections: CorrectionsConfig = Field(
        default_factory=lambda: CorrectionsConfig(), description="the section [corrections]"
    )
    consider: ConsiderConfig = Field(
        default_factory=lambda: ConsiderConfig(),
        description='the section [consider], sigmas such as focal_length = "5um" of what is not estimated',
    )
    earth: EarthConfig | None = Field(default=None, description="the section [earth] with orientation_file")
    truth: TruthConfig | None = Field(default=None, description="the section [truth] with quaternion_xyzw")

    @property
    def joined_frames(self) -> Frames:
        """The frames that [frames] and the trackers' own mountings join."""
        turns = [tracker.mounting for tracker in self.trackers or ()]
        return Frames.of(self.frames, filter(None, turns))

    @property
    def optics(self) -> dict[str, tuple[CameraConfig, Mounting]]:
        """Every camera and its mounting by the name of its frame; that of [camera] is "camera"."""
        if self.cameras:
            return {each.name: (each, each.mounting) for each in self.cameras}
        if self.camera is None or self.mounting is None:
            raise ValueError("the rules want a camera and its mounting")
        return {CAMERA: (self.camera, self.mounting)}

    @property
    def first(self) -> tuple[str, CameraConfig, Mounting]:
        """The name, the section and the mounting of the only camera, or of the first."""
        name, (camera, mounting) = next(iter(self.optics.items()))
        return name, camera, mounting

    def key_of(self, name: str) -> str:
        """The key of a camera's mounting."""
        return "mounting" if self.cameras is None else f"cameras.{list(self.optics).index(name)}.mounting"

    @property
    def tracker(self) -> str:
        """The name of E: the side of the first mounting that is not the camera's."""
        name, _, mounting = self.first
        at_camera = mounting.source in {CAMERA, *self.joined_frames.joined(name)}
        return mounting.target if at_camera else mounting.source

    @property
    def attitudes(self) -> dict[str, AttitudeConfig]:
        """Every section that states an attitude, by its key."""
        if self.attitude is not None:
            return {"attitude": self.attitude}
        return {f"trackers.{i}": tracker for i, tracker in enumerate(self.trackers or ())}

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        if "observations" in given and "detections" in given:
            yield "detections", "found beside [observations], wanted exactly one of the two"
        if "observations" not in given and "detections" not in given:
            first = " (starplumb measure makes them of the raw images)" if "imagery" in given else ""
            yield (
                "observations",
                f"missing, wanted the section [observations] or [detections] with file{first}",
            )
        yield from camera_rules(
            given, {key: cls.model_fields[key].description for key in ("camera", "mounting")}
        )
        yield from several_rules(given)
        yield from frame_rules(given)
        yield from attitude_rules(given)
        cameras = given.get("cameras")
        named = isinstance(cameras, list) and bool(cameras)
        model = _section({"camera": cameras[0]} if named and cameras else given, "camera").get("model")
        if model == "line-scan" and "images" in given and "file" not in _section(given, "images"):
            yield "images.file", "missing, wanted a table with line_period_s for a line scanner"


def _section(given: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = given.get(key)
    return value if isinstance(value, dict) else {}
