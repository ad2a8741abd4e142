"""Names and ids of frames as SPICE takes them.

Source: NAIF, Frames Required Reading and NAIF Integer ID Codes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from ...physics.errors import InputError


def frame_name(name: str) -> str:
    """``name`` as SPICE takes it: capitals, digits and underscores, a letter first, at most 26 characters.

    SPICE compares names in capitals; FRAME_ and the name together must fit the 32 characters of a variable.
    """
    plain = re.sub(r"[^A-Z0-9_]", "_", name.upper())
    return (plain if plain[:1].isalpha() else f"F_{plain}")[:26]


_NAME = re.compile(r"[A-Z][A-Z0-9_]{0,25}", re.IGNORECASE)
_OF_SPICE = re.compile(
    r"J2000|B1950|FK4|GALACTIC|MARSIAU|ECLIP(J2000|B1950)|DE-\d+|EARTH_FIXED|ITRF93|IAU_\w+", re.IGNORECASE
)
"""Frames that SPICE knows without any kernel."""


def frame_name_fault(name: str) -> str | None:
    """What is wanted in place of a name that cannot be that of a new frame; None for one that can."""
    if not _NAME.fullmatch(name):
        return "letters, digits and underscores, a letter first, at most 26"
    return "another name: SPICE has a frame of that name" if _OF_SPICE.fullmatch(name) else None


def frame_id_fault(frame_id: int) -> str | None:
    """What is wanted in place of an ID that cannot be that of a new frame; None for one that can.

    NAIF leaves 1400000 .. 2000000 to everybody, and ``1000 id - n`` to the satellite with the negative ``id``.
    """
    if 1_400_000 <= frame_id <= 2_000_000 or -(2**31) <= frame_id <= -1000:
        return None
    return "1400000 to 2000000, or below -1000"


CAMERA_ID, TRACKER_ID = 1_400_001, 1_400_002
"""Where none are stated."""


@dataclass(frozen=True)
class FrameIds:
    """SPICE IDs of the camera's frame, the tracker's, and the spacecraft they belong to (negative).

    ``tracker`` None: the frame of the tracker is defined by another kernel of the mission.
    """

    camera: int = CAMERA_ID
    tracker: int | None = TRACKER_ID
    spacecraft: int = -999

    def __post_init__(self) -> None:
        for frame_id in (self.camera, self.tracker):
            if frame_id is not None and (fault := frame_id_fault(frame_id)):
                raise InputError(f"the SPICE frame ID is {frame_id}, wanted {fault}")
        if self.camera == self.tracker:
            raise InputError(f"both SPICE frames have the ID {self.camera}, wanted two different ones")


DEFAULT_IDS = FrameIds()
