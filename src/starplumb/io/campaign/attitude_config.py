"""Sections of ``campaign.toml`` about attitude: rotations in any form, the attitude's file, several star trackers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field

from ..tables.keys import TimedKeys
from ..text.files import show
from ..text.numbers import SIGMA_WORDS
from ..text.sections import Section, wrong
from ..text.values import (
    GCRF,
    Covariance,
    OneOrThree,
    Positive,
    Prior,
    Sigma,
    Text,
    choice,
    frame_name,
    one_or_three,
    printable,
    sigma_or_zero,
)
from .fixed_frames import CAMERA, Frames, Rotation, written_frames

EARTH_FRAMES = (*GCRF, "ITRF", "TEME", "TOD", "MOD")
"""Frames an attitude may start from or lead to."""

ESTIMATE = "estimate"


def _sigma_or_estimate(value: object) -> object:
    if value == ESTIMATE:
        return value
    wanted = f'one finite number or three, none negative (0 claims an exact value, else {SIGMA_WORDS}), or "{ESTIMATE}"'
    return one_or_three(wanted, sigma_or_zero)(value)


SigmaOrEstimate = Annotated[
    tuple[float, float, float] | Literal["estimate"],
    BeforeValidator(_sigma_or_estimate, json_schema_input_type=OneOrThree | Literal["estimate"]),
]

_SHARED = ("image", "pass", "session", "campaign")
Shared = Annotated[Literal["image", "pass", "session", "campaign"], choice(*_SHARED)]
"""What has one draw of an error in common."""
SharedOrSample = Annotated[
    Literal["image", "pass", "session", "campaign", "sample"], choice(*_SHARED, "sample")
]


def sharing_rules(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Complaints about keys of one section that say how its errors are shared."""
    if "shared_by" in given and "correlation_time_s" in given:
        yield "correlation_time_s", "found it beside shared_by, wanted only one of the two"


class WanderConfig(Section):
    """attitude.wander: an error that changes within an image, besides the one that its markers share."""

    sigma_arcsec: Sigma = Field(description="its sigma, one number or three about the star tracker's axes")
    correlation_time_s: Positive = Field(description="its correlation time, a positive number of seconds")


class Mounting(Rotation):
    """[mounting]: the model alignment of the camera, and what is known of its error."""

    source: Text = Field(alias="from", description='"camera" or the star tracker\'s name')
    target: Text = Field(alias="to", description='the star tracker\'s name or "camera"')
    sigma_arcsec: Prior | None = Field(default=None, description="one positive number or three")


def _names(value: object) -> object:
    """A list of names of files."""
    if not isinstance(value, list) or not value or not all(isinstance(name, str) and name for name in value):
        raise wrong(value, 'a list of names such as ["sat.tsc", "sat.tf"]')
    return tuple(value)


class AttitudeConfig(TimedKeys):
    """[attitude]: the quaternion takes ``from`` to ``to``; one of them is GCRF or ITRF."""

    by_content: ClassVar[bool] = True

    file: Text = Field(description="the name of the file of quaternions")
    source: Annotated[str, BeforeValidator(printable), BeforeValidator(frame_name)] = Field(
        alias="from", description='"GCRF", "ITRF" or the star tracker\'s name'
    )
    target: Annotated[str, BeforeValidator(printable), BeforeValidator(frame_name)] = Field(
        alias="to", description='the star tracker\'s name, "GCRF" or "ITRF"'
    )
    kernels: Annotated[tuple[str, ...], BeforeValidator(_names)] = Field(
        default=(), description="a list of names of the SPICE kernels that a C-kernel needs (SCLK, FK)"
    )
    object: Text | None = Field(
        default=None, description="the satellite's name or number in a file that holds several"
    )
    sigma_arcsec: Sigma | None = Field(
        default=None, description="one number or three about the star tracker's axes"
    )
    covariance_arcsec2: Covariance | None = Field(
        default=None, description="three rows of three numbers, a covariance matrix"
    )
    sigma_frame: Text | None = Field(
        default=None, description="the name of the frame about whose axes the sigmas or the covariance are"
    )
    max_gap_s: Positive | None = Field(
        default=None, description="the largest spacing joined by interpolation, a positive number"
    )
    shared_by: SharedOrSample | None = Field(
        default=None,
        description='what has one attitude error: "image", "pass", "session", "campaign" or "sample"',
    )
    correlation_time_s: Positive | None = Field(
        default=None,
        description="in place of shared_by the correlation time of the error, a positive number of seconds",
    )
    wander: WanderConfig | None = Field(
        default=None, description="a section with sigma_arcsec and correlation_time_s"
    )
    session_sigma_arcsec: SigmaOrEstimate | None = Field(
        default=None, description='a further error of each session, one number or three, or "estimate"'
    )

    @property
    def tracker(self) -> str:
        """The star tracker's name: the side that is not the Earth's."""
        return self.target if self.source in EARTH_FRAMES else self.source

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        yield from super().rules(given)
        ends = (given.get("from"), given.get("to"))
        if all(isinstance(end, str) for end in ends) and sum(end in EARTH_FRAMES for end in ends) != 1:
            yield (
                "from",
                f'found "{ends[0]}" to "{ends[1]}", wanted GCRF (or J2000), TEME, TOD, MOD or ITRF on exactly one side',
            )
        yield from sharing_rules(given)
        if "sigma_arcsec" in given and "covariance_arcsec2" in given:
            yield "covariance_arcsec2", "found beside sigma_arcsec, wanted only one of the two"


class TrackerConfig(AttitudeConfig):
    """[[trackers]]: the attitude by one star tracker, and its own mounting in the frame they have in common."""

    mounting: Rotation | None = Field(
        default=None, description="a section that joins the tracker and the frame of [fusion]"
    )


class FusionConfig(Section):
    """[fusion]: what becomes of several trackers."""

    frame: Text = Field(description="the name of the frame that [mounting] joins with the camera")
    method: Annotated[Literal["weighted", "mean"], choice("weighted", "mean")] = Field(
        default="weighted", description='"weighted" or "mean"'
    )


def ends(section: object) -> tuple[str, str] | None:
    """``from`` and ``to`` of a section, where both are there and text."""
    both = (section.get("from"), section.get("to")) if isinstance(section, dict) else (None, None)
    return (both[0], both[1]) if isinstance(both[0], str) and isinstance(both[1], str) else None


def tracker_of(attitude: tuple[str, str] | None) -> str | None:
    """The side of an attitude that is not the Earth's, where there is one."""
    trackers = [end for end in attitude or () if end not in EARTH_FRAMES]
    return trackers[0] if len(trackers) == 1 else None


def attitude_rules(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Complaints about the sections of a campaign that state attitude and mounting, as they depend on each other."""
    if "trackers" in given:
        yield from _fusion_rules(given)
    elif "attitude" not in given:
        yield (
            "attitude",
            "missing, wanted the section [attitude] with file, from, to and sigma_arcsec (or [[trackers]])",
        )
    elif "fusion" in given:
        yield "fusion", "found beside [attitude], wanted it with [[trackers]] only"
    frame, place = tracker_frame(given)
    key = "fusion.frame" if "trackers" in given else "attitude.to"
    if frame == CAMERA:
        yield key, f"found {show(CAMERA)}, wanted another name: it is the camera's own"
    elif frame:
        yield from _mounting_rules(given, frame, place)
    yield from _sigma_frame_rules(given)


def tracker_frame(given: Mapping[str, Any]) -> tuple[str | None, str]:
    """The frame in which the attitude is given, where it is stated, and where that is."""
    if "trackers" in given:
        return _frame(given), "the frame of [fusion]"
    return tracker_of(ends(given.get("attitude"))), "the star tracker's name in [attitude]"


def _mounting_rules(given: Mapping[str, Any], frame: str, place: str) -> Iterator[tuple[str, str]]:
    """[mounting], and nothing else, leads from the camera's frames to those of the attitude."""
    frames = all_frames(given)
    if frame in frames.joined(CAMERA):
        found = f"found {show(CAMERA)} and {show(frame)} joined by fixed rotations"
        yield "frames", f"{found}, wanted that left to [mounting], which is to be corrected"
    elif mounting := ends(given.get("mounting")):
        for end, text in joined_rules(frames, mounting, CAMERA, frame, place):
            yield f"mounting.{end}", text


def _sigma_frame_rules(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Axes in which sigmas hold must be joined with those of the attitude that they are of."""
    trackers, frames = given.get("trackers"), all_frames(given)
    sections = {
        f"trackers.{i}": each for i, each in enumerate(trackers if isinstance(trackers, list) else ())
    }
    for key, section in {"attitude": given.get("attitude"), **sections}.items():
        name = tracker_of(ends(section))
        axes = section.get("sigma_frame") if isinstance(section, dict) else None
        if name is not None and isinstance(axes, str) and axes not in frames.joined(name):
            others = ", ".join(sorted(map(show, frames.joined(name) - {name})))
            also = (
                f" or what [frames] joins with it ({others})" if others else ", or [frames] to join the two"
            )
            yield f"{key}.sigma_frame", f"found {show(axes)}, wanted {show(name)}{also}"


def all_frames(given: Mapping[str, Any]) -> Frames:
    """Who is joined with whom by [frames] and by the trackers' own mountings."""
    trackers = given.get("trackers")
    mounted = [each.get("mounting") for each in trackers or () if isinstance(each, dict)]
    return written_frames(given, *filter(None, map(ends, mounted)))


def _frame(given: Mapping[str, Any]) -> str | None:
    fusion = given.get("fusion")
    frame = fusion.get("frame") if isinstance(fusion, dict) else None
    return frame if isinstance(frame, str) else None


def _fusion_rules(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Each tracker has a name of its own, and a mounting that leads to the frame of [fusion]."""
    if "attitude" in given:
        yield "trackers", "found beside [attitude], wanted exactly one of the two"
    if "fusion" not in given:
        yield "fusion", "missing, wanted the section [fusion] with frame"
    trackers, frame = given["trackers"], _frame(given)
    if not isinstance(trackers, list) or not trackers:
        yield "trackers", f"found {show(trackers)}, wanted at least one table [[trackers]]"
        return
    for key in ("shared_by", "correlation_time_s"):
        shared = [tracker.get(key) for tracker in trackers if isinstance(tracker, dict)]
        for i, word in enumerate(shared):
            if word != shared[0]:
                yield (
                    f"trackers.{i}.{key}",
                    f"found {show(word)}, wanted {show(shared[0])} as for the first tracker",
                )
            elif word == "sample":
                yield f"trackers.{i}.shared_by", 'found "sample", wanted it for one attitude only, [attitude]'
    yield from _alike(trackers)
    names = [tracker_of(ends(tracker)) for tracker in trackers]
    for i, name in enumerate(names):
        if name is None or frame is None:
            continue
        if name in names[:i]:
            yield f"trackers.{i}.to", f"found the tracker {show(name)} again, wanted a name of its own"
        if name == CAMERA:
            yield f"trackers.{i}.to", f"found {show(CAMERA)}, wanted another name: it is the camera's own"
        yield from _mounted(i, given, name, frame)


def _alike(trackers: list[object]) -> Iterator[tuple[str, str]]:
    """Trackers wander with one correlation time, and the error of a session is estimated of all or of none."""
    tables = [tracker if isinstance(tracker, dict) else {} for tracker in trackers]
    wander = [table.get("wander") for table in tables]
    times = [each.get("correlation_time_s") if isinstance(each, dict) else None for each in wander]
    first = next((time for time in times if time is not None), None)
    for i, time in enumerate(times):
        if time is not None and time != first:
            key = f"trackers.{i}.wander.correlation_time_s"
            yield key, f"found {show(time)}, wanted {show(first)} as for the other trackers"
    asked = [table.get("session_sigma_arcsec") == ESTIMATE for table in tables]
    for i, one in enumerate(asked):
        if one != asked[0]:
            yield f"trackers.{i}.session_sigma_arcsec", f'wanted "{ESTIMATE}" for all trackers or for none'


def _mounted(i: int, given: Mapping[str, Any], name: str, frame: str) -> Iterator[tuple[str, str]]:
    """A tracker's frame is joined with that of [fusion] by [frames], or by its mounting, and in one way."""
    tracker, frames = given["trackers"][i], written_frames(given)
    key = f"trackers.{i}.mounting"
    if name in frames.joined(frame):
        why = "is itself the frame of [fusion]" if name == frame else "is joined with it by [frames]"
        if "mounting" in tracker:
            yield key, f"found a mounting, wanted none: {show(name)} {why}"
    elif "mounting" not in tracker:
        if name not in all_frames(given).joined(frame):
            missing = f"the rotation between {show(name)} and {show(frame)}, the frame of [fusion]"
            yield key, f"missing, wanted {missing}"
    elif between := ends(tracker["mounting"]):
        for end, text in joined_rules(frames, between, name, frame, "the frame of [fusion]"):
            yield f"{key}.{end}", text
        earlier = all_frames({**given, "trackers": given["trackers"][:i]})
        if between[1] in earlier.joined(between[0]):
            yield key, f"found a second way between {show(between[0])} and {show(between[1])}, wanted one"


def joined_rules(
    frames: Frames, found: tuple[str, str], own: str, frame: str, place: str
) -> Iterator[tuple[str, str]]:
    """A mounting must join ``own``, its device, and ``frame``, or what is fixed to them, in either direction."""
    keys, device, there = ("from", "to"), frames.joined(own), frames.joined(frame)
    at = next((i for i, name in enumerate(found) if name in device), None)
    if at is None:
        wrong = 1 if found[0] in there else 0
        text = f"found {show(found[wrong])}, wanted {show(own)} (the mounting joins it and {show(frame)})"
        yield keys[wrong], text
    elif found[1 - at] not in there:
        yield keys[1 - at], f"found {show(found[1 - at])}, wanted {show(frame)}, {place}"
