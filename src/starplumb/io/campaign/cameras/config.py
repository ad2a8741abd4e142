"""Sections of ``campaign.toml`` about cameras: the only one, or several by name."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from ...formats.spice_names import frame_name, frame_name_fault
from ...text.files import show
from ...text.frames import earth_frame
from ...text.sections import Section, wrong
from ...text.values import Pair, Positive, Text, Triple, WholePair, Window, choice
from ..attitude_config import Mounting, all_frames, ends, joined_rules, tracker_frame
from ..fixed_frames import CAMERA
from ..spice_config import SpiceFrame


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


_NAME = re.compile(r"[A-Za-z0-9_-]{1,40}")


def _name(value: object) -> object:
    """A name that may stand in the names of parameters and frames."""
    if not isinstance(value, str) or not _NAME.fullmatch(value):
        raise wrong(value, "a name of letters, digits, _ and -, 40 at most")
    return value


class NamedCamera(CameraConfig):
    """[[cameras]]: one of several cameras on the satellite, with a name and a mounting of its own."""

    name: Annotated[str, BeforeValidator(_name)] = Field(
        description="the camera's name, which the column camera of the images repeats"
    )
    mounting: Mounting = Field(description="a section with from (the camera's name), to and a rotation")
    spice: SpiceFrame = Field(
        default_factory=lambda: SpiceFrame(),
        description="a section with name and id of its frame in mounting.tf",
    )


def camera_rules(given: Mapping[str, Any], wanted: Mapping[str, str | None]) -> Iterator[tuple[str, str]]:
    """Complaints about one camera or several; ``wanted`` says what [camera] and [mounting] are."""
    if "cameras" not in given:
        for key, description in wanted.items():
            if key not in given:
                yield key, f"missing, wanted {description}"
        return
    for key in wanted:
        if key in given:
            yield key, f"found beside [[cameras]], wanted only one of the two ({key} is a key of each camera)"
    cameras = given["cameras"]
    if not isinstance(cameras, list) or not cameras:
        yield "cameras", f"found {show(cameras)}, wanted at least one table [[cameras]]"
        return
    tables = [each if isinstance(each, dict) else {} for each in cameras]
    yield from _alike(tables)
    yield from _mountings(given, tables)
    yield from _frames_of_spice(given, tables)


def _alike(cameras: list[dict[str, Any]]) -> Iterator[tuple[str, str]]:
    """Names differ; all are of one kind and count pixels from one place."""
    for i, camera in enumerate(cameras):
        name, before = camera.get("name"), [each.get("name") for each in cameras[:i]]
        if isinstance(name, str) and name in before:
            yield f"cameras.{i}.name", f"found the camera {show(name)} again, wanted a name of its own"
        if isinstance(name, str) and earth_frame(name) is not None:
            yield f"cameras.{i}.name", f"found {show(name)}, a frame of the Earth, wanted another name"
        for key, usual in (("model", None), ("pixel_origin", "center")):
            found, first = camera.get(key, usual), cameras[0].get(key, usual)
            if found != first and None not in (found, first):
                yield (
                    f"cameras.{i}.{key}",
                    f"found {show(found)}, wanted {show(first)} as for the first camera",
                )


def _mountings(given: Mapping[str, Any], cameras: list[dict[str, Any]]) -> Iterator[tuple[str, str]]:
    """Each mounting leads from the camera's own frame to those of the attitude; what is known beforehand is known of
    the first."""
    frame, place = tracker_frame(given)
    frames = all_frames(given)
    for i, camera in enumerate(cameras):
        name, mounting, key = camera.get("name"), camera.get("mounting"), f"cameras.{i}.mounting"
        both = ends(mounting)
        if i and isinstance(mounting, dict) and "sigma_arcsec" in mounting:
            found = "found it, wanted it for the first camera only: the others are estimated against that"
            yield f"{key}.sigma_arcsec", found
        if both is None or not isinstance(name, str) or frame is None:
            continue
        if name == frame:
            yield f"cameras.{i}.name", f"found {show(name)}, the star tracker's name, wanted another"
        else:
            for end, text in joined_rules(frames, own_ends(both, name), name, frame, place):
                yield f"{key}.{end}", text


def _frames_of_spice(given: Mapping[str, Any], cameras: list[dict[str, Any]]) -> Iterator[tuple[str, str]]:
    """Frames of mounting.tf have names and ids of their own."""
    spice = given.get("spice")
    if isinstance(spice, dict) and "camera" in spice:
        yield "spice.camera", "found beside [[cameras]], wanted the key spice of each camera"
    tracker = spice.get("tracker") if isinstance(spice, dict) else None
    others = [tracker if isinstance(tracker, dict) else {}]
    names = [str(others[0].get("name") or tracker_frame(given)[0] or "")]
    for i, camera in enumerate(cameras):
        stated = camera.get("spice")
        stated = stated if isinstance(stated, dict) else {}
        name = frame_name(str(stated.get("name") or camera.get("name")))
        if fault := frame_name_fault(name):
            yield f"cameras.{i}.spice.name", f"found the frame {name} in mounting.tf, wanted {fault}"
        elif name in map(frame_name, names):
            yield (
                f"cameras.{i}.spice.name",
                f"found the frame {name} again, wanted a name of its own in mounting.tf",
            )
        if stated.get("id") is not None and stated["id"] in [other.get("id") for other in others]:
            yield f"cameras.{i}.spice.id", f"found {show(stated['id'])} again, wanted an id of its own"
        names.append(name)
        others.append(stated)


def own_ends(both: tuple[str, str], name: str) -> tuple[str, str]:
    """``from`` and ``to`` of a camera's mounting, "camera" standing for its name."""
    source, target = (name if end == CAMERA else end for end in both)
    return source, target


def several_rules(given: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """What of a campaign works with one camera only."""
    cameras = given.get("cameras")
    if not isinstance(cameras, list) or len(cameras) < 2:
        return
    one = "wanted a campaign of one camera for that"
    for key in ("detections", "imagery"):
        if key in given:
            yield key, f"found beside several [[cameras]], {one}"
    images = given.get("images")
    if isinstance(images, dict) and "file" not in images:
        yield "images.file", "missing, wanted a table with the column camera for several [[cameras]]"
