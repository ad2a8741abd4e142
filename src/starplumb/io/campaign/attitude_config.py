"""Sections of ``campaign.toml`` about attitude: rotations in any form, the attitude's file, several star trackers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from ..tables.read import TABLE_SUFFIXES
from ..text.files import show
from ..text.sections import Section
from ..text.values import (
    Matrix,
    Positive,
    Prior,
    Quaternion,
    Sigma,
    Text,
    Triple,
    axis_order,
    choice,
    file_name,
    frame_name,
    printable,
)

CAMERA = "camera"
"""The camera's side of the mounting."""
EARTH_FRAMES = ("GCRF", "J2000", "ITRF")
"""Frames an attitude may start from or lead to; J2000 is read as a synonym of GCRF."""

SUFFIXES = (*TABLE_SUFFIXES, ".aem", ".xml")
"""Endings of files of attitude."""

_ROTATIONS = ("quaternion_xyzw", "quaternion_wxyz", "matrix", "rotation_vector_deg", "euler_deg")


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


class Rotation(Section):
    """A rotation that takes coordinates in ``from`` to those in ``to``, written in one of several forms.

    ``euler_deg`` with ``euler_order`` reads as ``scipy.spatial.transform.Rotation.from_euler``: capital
    letters turn about the axes as turned so far, small ones about the fixed axes, in the order written.
    """

    source: Text = Field(alias="from", description="the name of a frame")
    target: Text = Field(alias="to", description="the name of a frame")
    quaternion_xyzw: Quaternion | None = Field(default=None, description="four numbers, scalar last")
    quaternion_wxyz: Quaternion | None = Field(default=None, description="four numbers, scalar first")
    matrix: Matrix | None = Field(default=None, description="three rows of three numbers")
    rotation_vector_deg: Triple | None = Field(default=None, description="three numbers")
    euler_deg: Triple | None = Field(default=None, description="three angles")
    euler_order: Annotated[str, BeforeValidator(axis_order)] | None = Field(
        default=None, description='three axes such as "ZYX" or "xyz"'
    )

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


class Mounting(Rotation):
    """[mounting]: the model alignment of the camera, and what is known of its error."""

    source: Text = Field(alias="from", description='"camera" or the star tracker\'s name')
    target: Text = Field(alias="to", description='the star tracker\'s name or "camera"')
    sigma_arcsec: Prior | None = Field(default=None, description="one positive number or three")


class AttitudeConfig(Section):
    """[attitude]: the quaternion takes ``from`` to ``to``; one of them is GCRF or ITRF."""

    file: Annotated[str, BeforeValidator(file_name(*SUFFIXES))] = Field(
        description="the name of the file of quaternions"
    )
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
    session_sigma_arcsec: Sigma | None = Field(
        default=None, description="a further error of each session, one number or three"
    )

    @property
    def tracker(self) -> str:
        """The star tracker's name: the side that is not the Earth's."""
        return self.target if self.source in EARTH_FRAMES else self.source

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        ends = (given.get("from"), given.get("to"))
        if all(isinstance(end, str) for end in ends) and sum(end in EARTH_FRAMES for end in ends) != 1:
            yield (
                "from",
                f'found "{ends[0]}" to "{ends[1]}", wanted GCRF (or J2000) or ITRF on exactly one side',
            )
        yield from sharing_rules(given)


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
    frame, key = tracker_of(ends(given.get("attitude"))), "attitude.to"
    place = "the star tracker's name in [attitude]"
    if "trackers" in given:
        frame, key, place = _frame(given), "fusion.frame", "the frame of [fusion]"
    if frame == CAMERA:
        yield key, f"found {show(CAMERA)}, wanted another name: it is the camera's own"
    elif frame and (mounting := ends(given.get("mounting"))):
        for end, text in _joined(mounting, CAMERA, frame, place):
            yield f"mounting.{end}", text


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
    for i, tracker in enumerate(trackers):
        if isinstance(tracker, dict) and "wander" in tracker:
            yield f"trackers.{i}.wander", "found it for one of several trackers, wanted it in [attitude] only"
    names = [tracker_of(ends(tracker)) for tracker in trackers]
    for i, (tracker, name) in enumerate(zip(trackers, names, strict=True)):
        if name is None or frame is None:
            continue
        if name in names[:i]:
            yield f"trackers.{i}.to", f"found the tracker {show(name)} again, wanted a name of its own"
        if name == CAMERA:
            yield f"trackers.{i}.to", f"found {show(CAMERA)}, wanted another name: it is the camera's own"
        yield from _mounted(i, tracker, name, frame)


def _mounted(i: int, tracker: dict[str, Any], name: str, frame: str) -> Iterator[tuple[str, str]]:
    key = f"trackers.{i}.mounting"
    if name == frame:
        if "mounting" in tracker:
            yield key, f"found a mounting, wanted none: {show(name)} is itself the frame of [fusion]"
        return
    if "mounting" not in tracker:
        yield (
            key,
            f"missing, wanted the rotation between {show(name)} and {show(frame)}, the frame of [fusion]",
        )
    if between := ends(tracker.get("mounting")):
        for end, text in _joined(between, name, frame, "the frame of [fusion]"):
            yield f"{key}.{end}", text


def _joined(found: tuple[str, str], own: str, frame: str, place: str) -> Iterator[tuple[str, str]]:
    """A mounting must join ``own``, its device, and ``frame``, in either direction."""
    keys = ("from", "to")
    at = next((i for i, name in enumerate(found) if name == own), None)
    if at is None:
        wrong = 1 if found[0] == frame else 0
        text = f"found {show(found[wrong])}, wanted {show(own)} (the mounting joins it and {show(frame)})"
        yield keys[wrong], text
    elif found[1 - at] != frame:
        yield keys[1 - at], f"found {show(found[1 - at])}, wanted {show(frame)}, {place}"
