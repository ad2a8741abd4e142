"""The Earth's frames by the names that files give them."""

from __future__ import annotations

import re
from typing import Literal

_EARTH_FIXED = re.compile(r"ITRF[ _-]?(\d\d|\d{4})?|WGS[ _-]?84")
_INERTIAL = re.compile(r"GCRF\d?|ICRF\d?|EME2000|J2000")

EarthFrame = Literal["ITRF", "GCRF"]


def earth_frame(word: str) -> EarthFrame | None:
    """ITRF for any of its realisations and WGS 84 (they agree to centimetres), GCRF for it, ICRF, EME2000 and
    J2000 (they agree to 0.02 arcsec), None for any other frame."""
    if _EARTH_FIXED.fullmatch(word.strip().upper()):
        return "ITRF"
    return "GCRF" if _INERTIAL.fullmatch(word.strip().upper()) else None
