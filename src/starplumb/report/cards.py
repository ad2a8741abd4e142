"""Cards of a page: small pictures beside one another with a sentence, each picture a PNG within the page."""

from __future__ import annotations

import base64
import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.float32]

SHADES = (2.0, 98.0)
"""Percentiles of a picture's values that become black and white."""
RED, BLUE = np.array([178.0, 24.0, 43.0]), np.array([33.0, 102.0, 172.0])
ENLARGED = 0.3
"""Part of a picture's side that the longer half axis of an ellipse takes."""


@dataclass(frozen=True)
class Ellipse:
    """An ellipse about a place of a picture, in parts of its side: half axes, and the angle of the first, degrees from
    the columns towards the rows."""

    x: float
    y: float
    half: tuple[float, float]
    angle: float

    @classmethod
    def enlarged(cls, x: float, y: float, covariance: NDArray[np.float64]) -> Ellipse:
        """That of a covariance (2, 2) of column and row, drawn in its form and direction only."""
        variance, axes = np.linalg.eigh(covariance)
        longer, shorter = np.sqrt(np.maximum(variance[::-1], 0.0)).tolist()
        angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
        return cls(x, y, (ENLARGED, ENLARGED * shorter / longer), angle)


@dataclass(frozen=True)
class Panel:
    """One picture, or two that blink, as the data of PNG files, with what it shows; ``mark`` (x, y), in parts of its
    side, and ``ellipse`` are drawn over it."""

    caption: str
    alt: str
    pictures: tuple[str, ...]
    mark: tuple[float, float] | None = None
    ellipse: Ellipse | None = None


@dataclass(frozen=True)
class Card:
    """Pictures of one thing with its name, a word of what became of it and a sentence; ``bad`` ones are set apart."""

    title: str
    word: str
    sentence: str
    panels: tuple[Panel, ...]
    bad: bool = False


def shades(values: Image) -> str:
    """A picture (r, c) in greys from its dark to its bright values."""
    low, high = _range(values, SHADES)
    grey = np.clip((values - low) / (high - low), 0.0, 1.0) * 255.0
    return _png(np.broadcast_to(grey[..., None], (*values.shape, 3)), np.isfinite(values))


def signed(values: Image, weight: Image | None = None, full: float | None = None) -> str:
    """A picture (r, c) of differences: red above, blue below, white at zero, and clear where the weight is none.

    ``full`` is the difference of full colour, by default three of their median sizes.
    """
    known = np.isfinite(values)
    if full is None:
        full = 3.0 * 1.4826 * float(np.median(np.abs(values[known]))) if known.any() else 1.0
    part = np.clip(np.where(known, values, 0.0) / (full or 1.0), -1.0, 1.0)[..., None]
    colour = np.where(part > 0.0, RED, BLUE)
    seen = known if weight is None else np.where(known, np.nan_to_num(weight), 0.0)
    return _png(255.0 + np.abs(part) * (colour - 255.0), seen)


def _range(values: Image, percent: tuple[float, float]) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    if not known.size:
        return 0.0, 1.0
    low, high = np.percentile(known, percent).tolist()
    return low, max(high, low + 1e-6 * max(abs(low), 1e-6))


def _png(colour: NDArray[np.floating], alpha: NDArray[np.generic]) -> str:
    """Colours (r, c, 3) from 0 to 255 that are seen by parts ``alpha`` (r, c), as a data address."""
    from PIL import Image as Picture

    rgba = np.concatenate([np.nan_to_num(colour), 255.0 * alpha[..., None].astype(np.float64)], axis=-1)
    file = io.BytesIO()
    Picture.fromarray(np.rint(rgba).astype(np.uint8)).save(file, format="png", optimize=False)
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode('ascii')}"
