"""``SCENARIO.toml`` as checked models: what is flown and photographed, which errors there are and which are stated.

Values stay in the units their keys name; :mod:`starplumb.io.scenario.read` brings them inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from ..campaign.attitude_config import Mounting
from ..campaign.cameras.config import CameraConfig, NamedCamera
from ..campaign.config import CorrectionsConfig
from ..campaign.fixed_frames import CAMERA
from ..text.files import show
from ..text.sections import Section, wrong
from ..text.values import Frame, Positive, Text, choice, number, vector
from .error_config import ErrorConfig, InitialConfig, NotNegative, StatedConfig, TrackerConfig, fitting
from .optics_rules import optics_rules
from .plan_config import Numbers, PlanConfig


def _rows(width: int, wanted: str) -> BeforeValidator:
    """A list of rows of ``width`` numbers each."""

    def check(value: object) -> tuple[tuple[float, ...], ...]:
        if not isinstance(value, list | tuple) or not value:
            raise wrong(value, wanted)
        return tuple(vector(width, wanted)(row) for row in value)

    return BeforeValidator(check)


def _count(value: object) -> tuple[int, ...]:
    items = value if isinstance(value, list | tuple) else [value]
    whole = tuple(n for n in items if isinstance(n, int) and not isinstance(n, bool) and 1 <= n <= 1_000_000)
    if len(items) not in (1, 2) or len(whole) != len(items):
        raise wrong(value, "a positive whole number (grid: two, columns and rows)")
    return whole


def _extent(value: object) -> tuple[float, ...]:
    items = value if isinstance(value, list | tuple) else [value, value]
    return vector(2, "one positive number or two", lambda x: x > 0.0)(items)


_HEIGHT_WORDS = "a height in metres, or the lowest and the highest, -1000 to 9500"


def _heights(value: object) -> tuple[float, ...]:
    items = value if isinstance(value, list | tuple) else [value, value]
    heights = vector(2, _HEIGHT_WORDS, lambda x: -1000.0 <= x <= 9500.0)(items)
    if heights[0] > heights[1]:
        raise wrong(value, _HEIGHT_WORDS)
    return heights


_OneOrTwo = float | tuple[float, float]
Latitude = Annotated[float, BeforeValidator(number("degrees between -90 and 90", lambda x: abs(x) <= 90.0))]
Finite = Annotated[float, BeforeValidator(number("a number"))]
Seconds = Annotated[
    float, BeforeValidator(number("seconds within a century of the epoch", lambda x: abs(x) <= 3.2e9))
]
Part = Annotated[float, BeforeValidator(number("a number above 0, at most 1", lambda x: 0.0 < x <= 1.0))]


class General(Section):
    """[scenario]"""

    name: Text = Field(description="the scenario's name in quotes")
    description: str = Field(default="", description="what it stands for, in quotes")
    epoch: Text = Field(description='the time of time_s = 0 such as "2026-03-21T10:30:00"')
    time_scale: Annotated[Literal["UTC", "TAI", "GPS", "TT"], choice("UTC", "TAI", "GPS", "TT")] = Field(
        default="UTC", description='the scale of epoch, "UTC", "TAI", "GPS" or "TT"'
    )
    scene_seed: int = Field(default=1, ge=0, description="a whole number that draws the scene, once")
    fusion: Annotated[Literal["weighted", "mean"], choice("weighted", "mean")] = Field(
        default="weighted", description='how several trackers are joined, "weighted" or "mean"'
    )


_SHAPES = {
    "circular": ("altitude_km", "inclination_deg"),
    "kepler": ("semi_major_axis_km", "eccentricity", "inclination_deg", "perigee_deg"),
    "file": ("file", "frame"),
}


class OrbitConfig(Section):
    """[orbit]"""

    model: Annotated[Literal["circular", "kepler", "file"], choice("circular", "kepler", "file")] = Field(
        description='"circular", "kepler" or "file"'
    )
    altitude_km: Positive | None = Field(
        default=None, description="the height above the equatorial radius, km"
    )
    semi_major_axis_km: Positive | None = Field(default=None, description="the semi-major axis, km")
    eccentricity: Annotated[float, BeforeValidator(number("0 to 0.9", lambda x: 0.0 <= x <= 0.9))] | None = (
        Field(default=None, description="the eccentricity, 0 to 0.9")
    )
    inclination_deg: Finite | None = Field(default=None, description="the inclination in degrees")
    perigee_deg: Finite | None = Field(default=None, description="the argument of perigee in degrees")
    node_deg: Finite | None = Field(
        default=None, description="the right ascension of the ascending node, degrees"
    )
    mean_anomaly_deg: Finite | None = Field(
        default=None, description="the mean anomaly at the epoch, degrees"
    )
    file: Text | None = Field(default=None, description="the name of an ephemeris file")
    frame: Frame | None = Field(default=None, description='"ITRF" or "GCRF"')
    object: Text | None = Field(default=None, description="the satellite in a file that holds several")

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        model = given.get("model")
        if model not in _SHAPES:
            return
        optional = ("object",) if model == "file" else ("node_deg", "mean_anomaly_deg")
        yield from fitting(cls, given, f'model = "{model}"', _SHAPES[model], (*optional, "model"))


class SiteConfig(Section):
    """[site]"""

    latitude_deg: Latitude = Field(description="the geodetic latitude in degrees")
    longitude_deg: Finite = Field(description="the longitude in degrees, east positive")
    height_m: Finite = Field(default=0.0, description="the height above the ellipsoid, m")


class PassConfig(Section):
    """[[passes]]: images of the site at the pitch angles of one pass."""

    time_s: Seconds = Field(default=0.0, description="the time at which the site is abeam, s after the epoch")
    roll_deg: Finite | None = Field(
        default=None, description="the roll that looks at the site abeam, degrees"
    )
    pitch_deg: Numbers = Field(description="the pitch angles of its images, degrees, ahead positive")
    yaw_deg: Numbers = Field(default=(0.0,), description="their turns about the boresight, degrees")
    direction: Annotated[Literal["ascending", "descending"], choice("ascending", "descending")] = Field(
        default="descending", description='"ascending" or "descending"'
    )
    session: Text | None = Field(
        default=None, description="the name of the session it belongs to; left out: one of its own"
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        yield from one_or_as_many(given, "pitch_deg", ("yaw_deg",))


def one_or_as_many(given: Mapping[str, Any], leader: str, keys: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    """Complaints about lists that are neither of one number nor as long as the leading one."""
    length = len(given[leader]) if isinstance(given.get(leader), list) else 1
    for key in keys:
        if isinstance(given.get(key), list) and len(given[key]) not in (1, length):
            yield key, f"found {len(given[key])} numbers, wanted one or as many as {leader} has ({length})"


class ImagesConfig(Section):
    """[images]: times and turns of images that belong to no pass over the site, and what holds for all images."""

    times_s: Numbers | None = Field(default=None, description="the times of the images, s after the epoch")
    roll_deg: Numbers = Field(default=(0.0,), description="their roll, degrees, to the left positive")
    pitch_deg: Numbers = Field(default=(0.0,), description="their pitch, degrees, ahead positive")
    yaw_deg: Numbers = Field(default=(0.0,), description="their turns about the boresight, degrees")
    line_period_s: Positive | None = Field(
        default=None, description="the duration of a row of a line scanner, s"
    )
    pointing_sigma_m: NotNegative = Field(
        default=0.0, description="the error of aiming on the ground, m per axis"
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        turns = ("roll_deg", "pitch_deg", "yaw_deg")
        if "times_s" not in given:
            for key in turns:
                if key in given:
                    yield key, "found it without times_s, wanted the turns of images beside their times"
        yield from one_or_as_many(given, "times_s", turns)


_LAYOUTS: dict[tuple[str, str], tuple[str, ...]] = {
    ("grid", "site"): ("count", "extent_km"),
    ("ring", "site"): ("count", "extent_km"),
    ("random", "site"): ("count", "extent_km"),
    ("list", "site"): ("east_north_km",),
    ("file", "site"): ("file",),
    ("grid", "image"): ("count", "extent"),
    ("ring", "image"): ("count", "extent"),
    ("random", "image"): ("count", "extent"),
}


class MarkersConfig(Section):
    """[markers]: on the site, where every image that has them in its frame sees them, or each image's own."""

    layout: Annotated[
        Literal["grid", "ring", "random", "list", "file"], choice("grid", "ring", "random", "list", "file")
    ] = Field(description='"grid", "ring", "random", "list" or "file"')
    on: Annotated[Literal["site", "image"], choice("site", "image")] = Field(
        default="site", description='"site" or "image"'
    )
    count: (
        Annotated[tuple[int, ...], BeforeValidator(_count, json_schema_input_type=int | list[int])] | None
    ) = Field(default=None, description="how many (grid: columns and rows)")
    extent_km: (
        Annotated[tuple[float, float], BeforeValidator(_extent, json_schema_input_type=_OneOrTwo)] | None
    ) = Field(default=None, description="the width and height of the layout (ring: its diameter), km")
    extent: Part | None = Field(
        default=None, description="the part of the image that the layout fills, at most 1"
    )
    east_north_km: Annotated[tuple[tuple[float, float], ...], _rows(2, "rows of two numbers, km")] | None = (
        Field(default=None, description="rows of two offsets from the site, east and north, km")
    )
    file: Text | None = Field(default=None, description="the name of a file of landmarks")
    height_m: Annotated[tuple[float, float], BeforeValidator(_heights, json_schema_input_type=_OneOrTwo)] = (
        Field(default=(0.0, 0.0), description="the height above the ellipsoid, or the lowest and highest, m")
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        layout, on = str(given.get("layout")), str(given.get("on", "site"))
        if layout in ("list", "file") and on == "image":
            yield "on", f'found "image", wanted "site" for layout = "{layout}"'
        elif (layout, on) in _LAYOUTS:
            case = f'layout = "{layout}" on = "{on}"'
            optional = ("layout", "on") + (() if layout == "file" else ("height_m",))
            yield from fitting(cls, given, case, _LAYOUTS[layout, on], optional)


class ScenarioConfig(Section):
    """The whole of SCENARIO.toml."""

    scenario: General = Field(description="the section [scenario] with name and epoch")
    orbit: OrbitConfig = Field(description="the section [orbit] with model")
    site: SiteConfig | None = Field(default=None, description="the section [site]")
    camera: CameraConfig | None = Field(default=None, description="the section [camera]")
    cameras: list[NamedCamera] = Field(
        default_factory=list, description="sections [[cameras]], several in place of [camera]"
    )
    mounting: Mounting | None = Field(default=None, description="the section [mounting], the true one")
    trackers: list[TrackerConfig] = Field(default_factory=list, description="sections [[trackers]]")
    passes: list[PassConfig] = Field(default_factory=list, description="sections [[passes]]")
    images: ImagesConfig = Field(default_factory=lambda: ImagesConfig(), description="the section [images]")
    markers: MarkersConfig = Field(description="the section [markers] with layout")
    corrections: CorrectionsConfig = Field(
        default_factory=lambda: CorrectionsConfig(), description="the section [corrections]"
    )
    initial: InitialConfig = Field(
        default_factory=lambda: InitialConfig(), description="the section [initial]"
    )
    truth: dict[str, ErrorConfig] = Field(description="sections [truth.NAME], the sources of error")
    stated: StatedConfig = Field(default_factory=lambda: StatedConfig(), description="the section [stated]")
    plan: PlanConfig = Field(default_factory=lambda: PlanConfig(), description="the section [plan]")

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        yield from optics_rules(given, cls.model_fields["camera"].description)
        yield from _flight_rules(given)
        yield from _error_rules(given)

    @property
    def optics(self) -> dict[str, tuple[CameraConfig, Mounting | None]]:
        """The camera, or several by their names, each with its true mounting."""
        if self.camera is not None:
            return {CAMERA: (self.camera, self.mounting)}
        return {each.name: (each, each.mounting) for each in self.cameras}


def _section(given: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = given.get(key)
    return value if isinstance(value, dict) else {}


def _flight_rules(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Times or passes, and what each of them needs."""
    orbit, images, markers = (_section(given, key) for key in ("orbit", "images", "markers"))
    timed, passing = "times_s" in images, bool(given.get("passes"))
    if timed == passing:
        yield "passes", f"found {'both' if timed else 'neither'}, wanted [[passes]] or images.times_s"
    on_site = markers.get("on", "site") == "site" and markers.get("layout") != "file"
    if "site" not in given and (passing or on_site):
        yield "site", "missing, wanted the section [site] with latitude_deg and longitude_deg"
    for key in ("node_deg", "mean_anomaly_deg"):
        if passing and key in orbit:
            yield f"orbit.{key}", "found beside [[passes]], wanted it left out: the passes choose it"
        if timed and orbit.get("model") in ("circular", "kepler") and key not in orbit:
            yield f"orbit.{key}", f"missing, wanted {OrbitConfig.model_fields[key].description}"
    flights = given.get("passes")
    if orbit.get("model") == "file" and isinstance(flights, list):
        for i, flight in enumerate(flights):
            if isinstance(flight, dict) and "roll_deg" in flight:
                yield (
                    f"passes.{i}.roll_deg",
                    "found for an orbit from a file, wanted it left out: the file decides",
                )


def _error_rules(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Names that other sections refer to, and the pixel noise that every solution needs."""
    truth, stated = _section(given, "truth"), _section(given, "stated")
    listed = given.get("trackers")
    names = [t.get("name") for t in listed if isinstance(t, dict)] if isinstance(listed, list) else []
    sources = [*names, *truth]
    for name in {n for n in sources if sources.count(n) > 1}:
        yield "truth", f"found the name {show(name)} twice, wanted different names of trackers and errors"
    for name, error in truth.items():
        tracker = error.get("tracker") if isinstance(error, dict) else None
        if tracker is not None and tracker not in names:
            yield (
                f"truth.{name}.tracker",
                f"found {show(tracker)}, wanted the name of one of the [[trackers]]",
            )
    omit, factor = stated.get("omit", []), stated.get("factor", {})
    for key, entries in (("omit", omit), ("factor", factor)):
        for name in entries if isinstance(entries, list | dict) else ():
            if name not in sources:
                yield (
                    f"stated.{key}",
                    f"found {show(name)}, wanted names of trackers or of sections [truth.NAME]",
                )
    kinds = [e.get("error") for n, e in truth.items() if isinstance(e, dict) and n not in omit]
    if truth and not {"pixel", "rounding"} & set(kinds):
        yield (
            "truth",
            'found no stated error = "pixel" or "rounding", wanted one: every measured pixel has noise',
        )
