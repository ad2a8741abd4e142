"""Targets of an image measured: each place that stands out fitted, by a noise and a blur that the image may tell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..scene import Raw
from .finding import standing_out
from .fit import Fit, Noise, fitted
from .shape import Shape

Array = NDArray[np.float64]
Tell = Callable[[int], None]

FIRST_WIDTH_PX = 0.7
"""The blur from which fits begin."""
CERTAIN = 8.0
"""Strength over its sigma from which a target tells the blur itself; fainter ones have the median of those."""
MARGIN_PX = 5
"""Pixels around a form that tell its background and its blur."""
TELLING = 200
"""Targets by which an image tells its noise and blur, the most outstanding ones."""
MOST = 2000
"""Places of an image that are looked at, the most outstanding first."""
MOST_SIGMA_PX = 0.5
MOST_CHI2 = 3.0
"""Residuals so many times their variance are of something else."""
_LEAST_TARGETS = 5
"""Targets by which noise or blur can be told."""


@dataclass(frozen=True)
class Sought:
    """What is looked for: a shape, its metres east and north as pixels (2, 2) where the image shows it, the camera's
    noise, None for one that the image tells, whether it is brighter than its surroundings, the value of a full
    pixel."""

    shape: Shape
    px_from_m: Array
    noise: Noise | None
    bright: bool
    saturation_dn: float | None = None

    @property
    def offset_px(self) -> Array:
        return self.shape.place_m @ self.px_from_m.mT

    @property
    def half_px(self) -> int:
        reach = self.shape.reach_m * float(np.linalg.norm(self.px_from_m, 2))
        return int(np.ceil(reach)) + MARGIN_PX


@dataclass(frozen=True)
class Target:
    """Something that stands out at ``place`` (2,), its ``window`` (n, n) and its ``fit``; ``why`` says what it is not,
    where it is no target (``full`` of saturated pixels, or at the ``edge``)."""

    place: Array
    window: Array
    first: Array
    fit: Fit | None
    why: str = ""
    word: str = ""

    @property
    def pixel(self) -> Array:
        """Where it was found (2,)."""
        return self.place if self.fit is None else self.first + self.fit.place_px


def targets_of(raw: Raw, sought: Sought, tell: Tell = lambda done: None) -> tuple[list[Target], Noise, float]:
    """All that stands out in an image, the noise it was weighed with, and the blur, px."""
    size = max(FIRST_WIDTH_PX, 0.5 * sought.shape.reach_m * float(np.linalg.norm(sought.px_from_m, 2)))
    places = standing_out(raw, size, sought.bright)[:MOST]
    windows = [_window(raw, place, sought.half_px) for place in places]
    looked = list(zip(places, windows, strict=True))
    noise, first = sought.noise or _floor(windows), []
    for _ in range(1 if sought.noise else 3):
        first = [
            _fit(sought, place, *window, noise, FIRST_WIDTH_PX, True) for place, window in looked[:TELLING]
        ]
        noise = sought.noise or _told_by(first, noise)
    width = _width(first)
    found = []
    for k, (place, window) in enumerate(looked):
        one = _fit(sought, place, *window, noise, width, True)
        if one.fit is None or abs(one.fit.strength) < CERTAIN * one.fit.strength_sigma:
            one = _fit(sought, place, *window, noise, width, False)
        found.append(one)
        tell(k + 1)
    return found, noise, width


def _window(raw: Raw, place: Array, half: int) -> tuple[Array, Array]:
    first = np.rint(place).astype(int) - half
    side = 2 * half + 1
    return raw.window(int(first[0]), int(first[1]), side, side), first.astype(np.float64)


def _fit(
    sought: Sought, place: Array, window: Array, first: Array, noise: Noise, width: float, free: bool
) -> Target:
    """One target, or what it is in place of one."""
    if not np.all(np.isfinite(window)):
        return Target(place, window, first, None, "at the border of the data", "edge")
    if sought.saturation_dn is not None and np.any(window >= sought.saturation_dn):
        full = int(np.sum(window >= sought.saturation_dn))
        return Target(place, window, first, None, f"{full} of its pixels are full", "saturated")
    fit = fitted(window, place - first, sought.offset_px, sought.shape.part, noise, width, free)
    if fit is None:
        return Target(
            place, window, first, None, "no place where the fit of its form comes to rest", "no match"
        )
    sigma = float(np.sqrt(np.linalg.eigvalsh(fit.covariance_px2)[-1]))
    if fit.chi2 > MOST_CHI2:
        why = f"of another form: residuals {np.sqrt(fit.chi2):.1f} times the noise"
        return Target(place, window, first, fit, why, "no match")
    if sigma > MOST_SIGMA_PX or abs(fit.strength) < 3.0 * fit.strength_sigma:
        return Target(
            place, window, first, fit, f"too faint: its place has a sigma of {sigma:.2g} px", "no texture"
        )
    return Target(place, window, first, fit)


def _floor(windows: list[tuple[Array, Array]]) -> Noise:
    """The variance around targets: the median of those of the windows' borders."""
    borders = [np.concatenate([w[:2].ravel(), w[-2:].ravel()]) for w, _ in windows]
    spread = [float(np.var(b, ddof=1)) for b in borders if np.all(np.isfinite(b))]
    return Noise(max(float(np.median(spread)), 1e-6) if spread else 1.0)


def _told_by(targets: list[Target], noise: Noise) -> Noise:
    """The noise of an image by what its fits leave: how much it grows with the light, above the background."""
    fits = [(t.window, t.fit) for t in targets if t.fit is not None]
    if len(fits) < _LEAST_TARGETS:
        return noise
    light = np.concatenate([np.maximum(fit.model - fit.background, 0.0).ravel() for _, fit in fits])
    left = np.concatenate([fit.left.ravel() for _, fit in fits])
    square = np.concatenate([((window - fit.model) ** 2).ravel() for window, fit in fits]) / left
    level = float(np.median([fit.background for _, fit in fits]))
    floor, slope, good = noise.floor, 0.0, left > 0.2
    for _ in range(6):
        dark = good & (slope * light < 0.01 * floor)
        floor = float(np.average(square[dark], weights=left[dark])) if dark.any() else floor
        w = good * (left / (floor + slope * light)) ** 2
        slope = max(float(np.sum(w * light * (square - floor)) / max(np.sum(w * light**2), 1e-12)), 0.0)
        good = (left > 0.2) & (square < 20.0 * (floor + slope * light))
    return Noise(floor, slope, level)


def _width(targets: list[Target]) -> float:
    certain = [
        t.fit.width_px
        for t in targets
        if t.fit is not None and not t.why and abs(t.fit.strength) > CERTAIN * t.fit.strength_sigma
    ]
    return float(np.median(certain)) if certain else FIRST_WIDTH_PX
