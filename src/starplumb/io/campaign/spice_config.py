"""[spice]: names and ids of the frames in ``mounting.tf``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from ..formats.spice_names import (
    CAMERA_ID,
    DEFAULT_IDS,
    TRACKER_ID,
    FrameIds,
    frame_id_fault,
    frame_name,
    frame_name_fault,
)
from ..text.files import show
from ..text.sections import Section, wrong
from .fixed_frames import CAMERA

_SECTION = "a section with name and id"


def _name(value: object) -> object:
    if isinstance(value, str) and (fault := frame_name_fault(value)):
        raise wrong(value, fault)
    return value


def _id(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, int) or frame_id_fault(value):
        raise wrong(
            value,
            "a whole number, 1400000 to 2000000 or the satellite's negative id followed by three digits",
        )
    return value


def _spacecraft(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, int) or not -(2**31) // 1000 < value < 0:
        raise wrong(value, "the satellite's SPICE id, a negative whole number")
    return value


FrameId = Annotated[int, BeforeValidator(_id)]


class SpiceFrame(Section):
    """spice.camera or spice.tracker."""

    name: Annotated[str, BeforeValidator(_name)] | None = Field(
        default=None, description="the frame's name in SPICE"
    )
    id: FrameId | None = Field(default=None, description="the frame's id in SPICE, a whole number")


class SpiceConfig(Section):
    """[spice]; what is left out comes from the names of [mounting]."""

    camera: SpiceFrame = Field(default_factory=lambda: SpiceFrame(), description=_SECTION)
    tracker: SpiceFrame = Field(default_factory=lambda: SpiceFrame(), description=_SECTION)
    spacecraft_id: Annotated[int, BeforeValidator(_spacecraft)] | None = Field(
        default=None, description="the satellite's SPICE id, a negative whole number"
    )

    @classmethod
    def rules(cls, given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        craft = given.get("spacecraft_id")
        for key in ("camera", "tracker"):
            frame = given.get(key)
            number = frame.get("id") if isinstance(frame, dict) else None
            if (
                isinstance(number, int)
                and isinstance(craft, int)
                and number < 0
                and craft != spacecraft_of(number)
            ):
                yield (
                    f"{key}.id",
                    f"found {number}, which in SPICE belongs to the satellite {spacecraft_of(number)}, "
                    f"wanted one of {craft} as spice.spacecraft_id says ({craft * 1000 - 1}, for example)",
                )


def spacecraft_of(frame_id: int) -> int:
    """The satellite that a negative frame id belongs to: NAIF numbers its frames ``1000 id - n``."""
    return -(-frame_id // 1000)


def camera_frames(stated: Mapping[str, SpiceFrame], tracker_id: int) -> dict[str, tuple[str, int]]:
    """SPICE's names and ids of cameras by theirs; ids that are not stated follow the first one's, outwards from 0."""
    taken = {tracker_id, *(frame.id for frame in stated.values() if frame.id is not None)}
    found: dict[str, tuple[str, int]] = {}
    number = CAMERA_ID
    for name, frame in stated.items():
        if frame.id is not None:
            number = frame.id
        elif found or number in taken:
            step = 1 if number > 0 else -1
            while number in taken:
                number += step
        taken.add(number)
        found[name] = (frame_name(frame.name or name), number)
    return found


def kernel_frames(
    spice: SpiceConfig, own_tracker: str, first: tuple[str, int] | None = None
) -> tuple[str, str, FrameIds]:
    """SPICE's names of K and E, and the ids; ``own_tracker`` is the campaign's name of E, ``first`` name and id of the
    first of several cameras."""
    camera, tracker = spice.camera.id or CAMERA_ID, spice.tracker.id or TRACKER_ID
    if first is not None:
        camera = first[1]
    numbered = (spacecraft_of(each) for each in (camera, tracker) if each < 0)
    craft = spice.spacecraft_id or next(numbered, DEFAULT_IDS.spacecraft)
    own = frame_name(spice.camera.name or CAMERA) if first is None else first[0]
    names = own, frame_name(spice.tracker.name or own_tracker)
    return *names, FrameIds(camera, tracker, craft)


def spice_rules(spice: SpiceConfig, own_tracker: str, flown: str | None) -> Iterator[tuple[str, str]]:
    """Complaints about names and ids that mean something else already; ``flown`` is the satellite that the campaign
    takes from a SPICE kernel, where it names one."""
    craft = spice.spacecraft_id
    stated = {"camera": (spice.camera.name, CAMERA), "tracker": (spice.tracker.name, own_tracker)}
    written = {key: frame_name(name or own) for key, (name, own) in stated.items()}
    for key, (name, own) in stated.items():
        if name is None and frame_name_fault(written[key]):
            found = f"missing, and SPICE has a frame {written[key]} of its own"
            yield f"spice.{key}.name", f"{found}, wanted another name for {show(own)} in mounting.tf"
    if written["camera"] == written["tracker"]:
        found = f"found {written['tracker']} for the camera and the star tracker"
        yield "spice.tracker.name", f"{found}, wanted two names that differ in capitals, as SPICE reads them"
    ids = spice.camera.id or CAMERA_ID, spice.tracker.id or TRACKER_ID
    if ids[0] == ids[1]:
        yield "spice.tracker.id", f"found {ids[1]} for the camera and the star tracker, wanted two ids"
    if craft is not None and flown is not None and flown.strip() != str(craft):
        found = f"found {craft} beside ephemeris.object = {show(flown)}"
        yield "spice.spacecraft_id", f"{found}, wanted the satellite of that kernel"
