"""``campaign.toml`` as checked models: the keys, units and admissible values, section by section.

Values stay in the units their keys name; :mod:`starplumb.io.campaign.read` brings them inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from ..imagery.config import ImageryConfig, MeasureConfig, ReferenceConfig
from ..tables.keys import TimedKeys, UnitsConfig
from ..text.files import show
from ..text.sections import Section
from ..text.values import (
    Frame,
    InMemory,
    Pair,
    Positive,
    Quaternion,
    Sigma,
    Text,
    Triple,
    WholePair,
    Window,
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


class Distortion(Section):
    """camera.distortion: Brown-Conrady, from ideal tangents to those the optics give."""

    model: Annotated[Literal["brown-conrady"], choice("brown-conrady")] = Field(description='"brown-conrady"')
    k: Triple = Field(default=(0.0, 0.0, 0.0), description="the three radial coefficients")
    p: Pair = Field(default=(0.0, 0.0), description="the two tangential coefficients")


_OPTICS = ("focal_length_mm", "pixel_pitch_um", "image_size_px", "principal_point_px")


def _readout_rules(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """A frame camera's pixels stay square, and its window lies on the sensor."""
    if given.get("model") != "frame":
        return
    size, window = _whole(given.get("image_size_px"), 2), _whole(given.get("window_px"), 4)
    binning = _whole(given.get("binning", [1, 1]), 2)
    if binning and binning[0] != binning[1]:
        yield (
            "binning",
            f"found {show(binning)}, wanted two equal numbers: a pixel of a frame camera is square",
        )
    elif size and binning and window:
        most = [size[0] // binning[0], size[1] // binning[1]]
        if window[0] + window[2] > most[0] or window[1] + window[3] > most[1]:
            found = f"found {show(window)}, which ends beyond the sensor"
            yield "window_px", f"{found}, wanted it within {most[0]} x {most[1]} binned pixels"


def _whole(value: object, n: int) -> list[int] | None:
    """``n`` whole numbers, those of a pair positive; None for anything else, which is refused elsewhere."""
    least = 1 if n == 2 else 0
    good = isinstance(value, list) and len(value) == n and all(type(x) is int and x >= least for x in value)
    return value if good and isinstance(value, list) else None


class CameraConfig(Section):
    """[camera]: optics, or a line scanner's table of look directions, of the full sensor, and what is read of it."""

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
    binning: WholePair = Field(
        default=(1, 1),
        description="two positive whole numbers, columns and rows joined in a pixel of the image",
    )
    window_px: Window | None = Field(
        default=None,
        description="first column, first row, columns and rows of the image, counted in binned pixels",
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        yield from _readout_rules(given)
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
    camera: CameraConfig = Field(description="the section [camera]")
    mounting: Mounting = Field(description="the section [mounting]")
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
    def tracker(self) -> str:
        """The name of E: the side of [mounting] that is not the camera's."""
        at_camera = self.mounting.source in self.joined_frames.joined(CAMERA)
        return self.mounting.target if at_camera else self.mounting.source

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
        yield from frame_rules(given)
        yield from attitude_rules(given)
        model = _section(given, "camera").get("model")
        if model == "line-scan" and "images" in given and "file" not in _section(given, "images"):
            yield "images.file", "missing, wanted a table with line_period_s for a line scanner"


def _section(given: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = given.get(key)
    return value if isinstance(value, dict) else {}
