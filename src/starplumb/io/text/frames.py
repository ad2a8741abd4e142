"""The Earth's frames by the names that files give them."""

from __future__ import annotations

import re
from typing import Literal, cast

_EARTH_FIXED = re.compile(r"ITRF[ _-]?(\d\d|\d{4})?|WGS[ _-]?84")
_INERTIAL = re.compile(r"GCRF\d?|ICRF\d?|EME2000|J2000")
_OF_DATE = re.compile(r"(TEME|TOD|MOD)(_EARTH)?")

EarthFrame = Literal["ITRF", "GCRF", "TEME", "TOD", "MOD"]


def earth_frame(word: str) -> EarthFrame | None:
    """ITRF for any of its realisations and WGS 84 (they agree to centimetres), GCRF for it, ICRF, EME2000 and
    J2000 (they agree to 0.02 arcsec), the inertial frames of date TEME, TOD and MOD, None for any other frame."""
    name = word.strip().upper()
    if _EARTH_FIXED.fullmatch(name):
        return "ITRF"
    if of_date := _OF_DATE.fullmatch(name):
        return cast(EarthFrame, of_date[1])
    return "GCRF" if _INERTIAL.fullmatch(name) else None
