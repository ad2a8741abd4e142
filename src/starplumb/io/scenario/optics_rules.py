"""What the cameras of a scenario and their mountings must be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ..campaign.attitude_config import ends
from ..campaign.cameras.config import camera_rules, own_ends
from ..campaign.fixed_frames import CAMERA
from ..text.files import show


def optics_rules(given: Mapping[str, Any], wanted: str | None) -> Iterator[tuple[str, str]]:
    """Complaints about one camera or several; ``wanted`` says what [camera] is."""
    yield from camera_rules(given, {"camera": wanted})
    yield from _mounting_rules(given)
    yield from _cameras_rules(given)


def _mounting_rules(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    sides = ends(given.get("mounting"))
    if sides and sides.count(CAMERA) != 1:
        found = f"found {show(sides[0])} to {show(sides[1])}"
        yield (
            "mounting.from",
            f"{found}, wanted {show(CAMERA)} on one side, and the tracker's frame on the other",
        )


def _cameras_rules(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """The mountings of several cameras lead from their own frames to that of one tracker."""
    listed = given.get("cameras")
    cameras = [c for c in listed if isinstance(c, dict)] if isinstance(listed, list) else []
    if cameras and "mounting" in given:
        yield (
            "mounting",
            "found beside [[cameras]], wanted only one of the two (mounting is a key of each camera)",
        )
    tracker = None
    for i, camera in enumerate(cameras):
        both = ends(camera.get("mounting"))
        if both is None:
            continue
        other = [end for end in own_ends(both, str(camera.get("name"))) if end != camera.get("name")]
        tracker = other[0] if tracker is None and other else tracker
        if other != [tracker]:
            wanted = (
                f"{show(camera.get('name'))} on one side, and {show(tracker or 'the tracker')} on the other"
            )
            yield f"cameras.{i}.mounting.from", f"found {show(both[0])} to {show(both[1])}, wanted {wanted}"
