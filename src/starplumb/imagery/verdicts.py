"""What became of a place at which a chip was looked for, in a word and a sentence."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


SKEWED = 1.5
"""How many times as far values of a clouded image reach above their median as below it."""
CLOUDED = 0.15
"""Part of a window that is bright where cloud is the reason."""


class Verdict(StrEnum):
    """``used``, or why not."""

    USED = "used"
    CLOUD = "cloud"
    WATER = "water"
    NO_TEXTURE = "no texture"
    CHANGED = "changed"
    NO_MATCH = "no match"
    EDGE = "edge"
    NO_REFERENCE = "no reference"
    SATURATED = "saturated"
    OUTLIER = "outlier"


@dataclass(frozen=True)
class Candidate:
    """A place at which a chip was looked for.

    ``place`` (2,) is where its ground point ``p_J`` (3,) was expected, ``pixel`` (2,) where it was found, both at the
    point of the window that is known best; where it was refused both are the window's middle.  ``covariance_px2``
    (2, 2) is of what matching does not know, None where refused; ``residual_px`` (2,) is what the image's own rotation
    leaves; ``landmark`` is the id of a target that has one.
    """

    image: int
    number: int
    place: Array
    pixel: Array
    verdict: Verdict
    reason: str = ""
    p_J: Array | None = None
    covariance_px2: Array | None = None
    peak: float = np.nan
    second: float = np.nan
    agreement: float = np.nan
    kept: float = np.nan
    gain: float = np.nan
    blur_px: float = np.nan
    residual_px: Array | None = None
    check: bool = False
    landmark: str = ""

    def landmark_id(self, image_id: str) -> str:
        """The id of its landmark, which no other ground has: of a chip its image, its number, and a digest of its place
        to the millimetre, for another campaign may give another image this name."""
        if self.landmark:
            return self.landmark
        name = f"{image_id}-{self.number:03d}"
        if self.p_J is None:
            return name
        return f"{name}-{sha256(np.rint(1e3 * self.p_J).astype('<i8').tobytes()).hexdigest()[:6]}"

    @property
    def covariance(self) -> Array:
        """That of the place (2, 2) px^2, NaN where it was refused."""
        return np.full((2, 2), np.nan) if self.covariance_px2 is None else self.covariance_px2


@dataclass(frozen=True)
class Brightness:
    """What an image's pixels are like: the level below which a twentieth of them lies, the median, and that above which
    a twentieth lies; and the texture of an average chip, the standard deviation of its values."""

    low: float
    median: float
    high: float
    texture: float

    @classmethod
    def of(cls, values: Array) -> Brightness:
        """Of an image (h, w), binned or not; NaN is no data."""
        known = values[np.isfinite(values)]
        if not known.size:
            return cls(np.nan, np.nan, np.nan, np.nan)
        low, median, high = np.quantile(known, (0.05, 0.5, 0.95))
        return cls(float(low), float(median), float(high), float(np.std(known)))

    def clouded(self, window: Array) -> bool:
        """Whether so much of a window is as bright as the clouds of its image that these may be why it was refused.

        An image has clouds where its values reach farther above the median than below it.
        """
        known = window[np.isfinite(window)]
        clouds = self.high - self.median > SKEWED * (self.median - self.low)
        return bool(clouds) and float(np.mean(known > 0.5 * (self.median + self.high))) > CLOUDED

    def bare(self, window: Array) -> tuple[Verdict, str]:
        """What a window without texture shows: it is told by its brightness among that of its image."""
        level = float(np.nanmean(window))
        if level >= 0.5 * (self.median + self.high) and self.high > self.median:
            return Verdict.CLOUD, f"bright (mean {level:.4g}) and without texture: cloud, snow or sand"
        if level <= 0.5 * (self.median + self.low) and self.low < self.median:
            return Verdict.WATER, f"dark (mean {level:.4g}) and without texture: water or deep shadow"
        return Verdict.NO_TEXTURE, f"without texture (mean {level:.4g}): nothing to find a place by"
