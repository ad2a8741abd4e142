"""From raw images to sightings: images acquired together, refined one by one, their chips matched and compared."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..table.campaign import Campaign
from .acquisition import Acquisition, acquire
from .candidates import candidate_places
from .chips import Chip, Tell, chips
from .explanation import Explanation
from .library.chips import library_chips, refine_by_library
from .pointing import Pointing, pointed
from .scene import Scene, reduced
from .search import Found, refine
from .verdicts import Brightness, Candidate, Verdict

Array = NDArray[np.float64]
T = TypeVar("T")

TOLERANCE_PX = 0.75
"""Chips of an image agree within this before their sigmas are asked."""
OUTLIER = 4.5
"""Sigmas from its image's rotation beyond which a chip is left out."""
LEAST_CHIPS = 4
AGAIN_PX = 0.5
"""Chips that lie farther than this from where they were predicted are matched again where they lie."""
RIM_PX = 8
"""Pixels kept free at the border of an image."""
ACQUIRED = "acquired"
"""The name under which an acquisition is kept."""


@dataclass(frozen=True)
class Wanted:
    """How chips are asked for: their size, how many along each side of an image, the part kept for checking."""

    chip_px: int = 48
    grid: tuple[int, int] = (7, 7)
    check_share: float = 0.2


@dataclass(frozen=True)
class MeasuredImage:
    """An image with its chips: ``C_EK`` (3, 3) is its own rotation; ``reason`` says why it was left out, else empty.

    ``floor_px`` is what chips scatter beyond their own sigmas.
    """

    image: int
    C_EK: Array
    found: Found
    chips: tuple[Chip, ...]
    floor_px: float = 0.0
    reason: str = ""

    @property
    def used(self) -> list[Candidate]:
        return [chip.candidate for chip in self.chips if chip.candidate.verdict == Verdict.USED]


def sigma_in_camera(C_EK: Array, covariance_E: Array) -> Array:
    """Sigmas (3,) about K's axes of a mounting whose error has this covariance about E's."""
    return np.asarray(np.sqrt(np.diagonal(C_EK.mT @ covariance_E @ C_EK)))


class Memory(Protocol):
    """What is finished, so that a run that ends early loses little."""

    def recall(self, name: str) -> Any | None:
        """What was kept under a name, None where nothing was."""
        ...

    def keep(self, name: str, thing: object) -> None: ...


def measure_images(
    scene: Scene,
    covariance_E: Array,
    own_E: Array,
    wanted: Wanted,
    tell: Tell = lambda done: None,
    memory: Memory | None = None,
) -> Iterator[MeasuredImage]:
    """The images of a scene one after another, those that cannot be acquired without chips.

    What is searched are the errors of the mounting, ``covariance_E`` (3, 3) rad^2, and of each image's own attitude and
    position, ``own_E`` (3, 3) rad^2, about E's axes.  ``tell`` hears how many of all chips are done; what ``memory``
    recalls is not measured again.
    """
    mounting_K = sigma_in_camera(scene.campaign.C_EK, covariance_E)
    own_K = sigma_in_camera(scene.campaign.C_EK, own_E)
    acquired = None if memory is None else memory.recall(ACQUIRED)
    if acquired is None:
        acquired = acquire(scene, mounting_K, own_K)
        if memory is not None:
            memory.keep(ACQUIRED, acquired)
    explanation = Explanation(scene, acquired, mounting_K, own_K)
    each = wanted.grid[0] * wanted.grid[1]
    for image in range(len(scene.raws)):
        hears = partial(_told_of, tell, image * each)
        measured = remembered(memory, image, partial(_measured, scene, explanation, image, wanted, hears))
        tell((image + 1) * each)
        yield measured


def remembered(memory: Memory | None, image: int, made: Callable[[], T]) -> T:
    """What a memory recalls of an image, else what is made, which it then keeps."""
    name = f"image{image:05d}"
    found: T | None = None if memory is None else memory.recall(name)
    if found is None:
        found = made()
        if memory is not None:
            memory.keep(name, found)
    return found


def _told_of(tell: Tell, before: int, done: int) -> None:
    tell(before + done)


def _measured(
    scene: Scene, explanation: Explanation, image: int, wanted: Wanted, tell: Tell
) -> MeasuredImage:
    """One image; where it was not found, why."""
    sigma_K = np.hypot(explanation.sigma_K, explanation.own_K)
    measured = measure_image(scene, explanation.acquired, image, sigma_K, wanted, tell)
    if measured.reason and not measured.chips:
        return replace(measured, reason=explanation.of(image, measured.reason))
    return measured


def measure_image(
    scene: Scene,
    acquired: Acquisition,
    image: int,
    sigma_K: Array,
    wanted: Wanted,
    tell: Tell = lambda done: None,
) -> MeasuredImage:
    """One image of those that were acquired together; ``tell`` hears how many of its chips are done."""
    start = acquired.C_EK[image]
    if unfit := acquired.unfit[image]:
        return MeasuredImage(image, start, Found(start, 0, 0, unfit), (), reason=unfit)
    if not acquired.clear:
        tall = f"{acquired.together.height:.1f} sigma, and the next {acquired.together.second:.1f}"
        reason = f"no place of the search stands out (the best by {tall}): wrong reference, band or prior, or cloud"
        return MeasuredImage(image, start, Found(start, 0, 0, reason), (), reason=reason)
    finer = refine if scene.chip_half_m is None else refine_by_library
    found = finer(scene, acquired.C_EK[image], image, acquired.cell_px, sigma_K)
    if found.reason:
        return MeasuredImage(image, found.C_EK, found, (), reason=found.reason)
    raw = scene.raws[image]
    brightness = Brightness.of(reduced(raw, max(1, max(raw.size_px) // 256)))
    if scene.chip_half_m is None:
        places = candidate_places(raw, wanted.grid, wanted.chip_px, RIM_PX)
        matched = partial(chips, places=places, chip_px=wanted.chip_px)
    else:
        matched = partial(library_chips, chip_px=wanted.chip_px, grid=wanted.grid)
    done = matched(scene, found.C_EK, image, brightness=brightness, tell=tell)
    fitted = _fitted(scene.campaign, found.C_EK, image, done, sigma_K)
    if fitted is not None and np.abs(_moved(done)).max() > AGAIN_PX:
        # far from where they were predicted the chips' affine tells their place less well
        done = matched(scene, fitted.C_EK, image, brightness=brightness)
        fitted = _fitted(scene.campaign, fitted.C_EK, image, done, sigma_K)
    if not done:
        return MeasuredImage(image, found.C_EK, found, (), reason=_no_room(scene, image, wanted))
    return _too_few(image, found, done) if fitted is None else _told(image, found, done, fitted, wanted)


def _moved(done: list[Chip]) -> Array:
    """How far chips (n, 2) that matched were found from where they were predicted, their median."""
    used = [chip.candidate for chip in done if chip.candidate.verdict == Verdict.USED]
    return np.asarray(np.median([c.pixel - c.place for c in used], axis=0))


def _no_room(scene: Scene, image: int, wanted: Wanted) -> str:
    """Why an image has no chips at all."""
    if scene.chip_half_m is not None:
        return (
            f"no chip of the library lies in it with {wanted.chip_px} px (measure.chip_px) around its centre"
        )
    columns, rows = scene.raws[image].size_px
    return f"its {columns} x {rows} pixels have no room for chips of {wanted.chip_px} px (measure.chip_px)"


def _too_few(image: int, found: Found, done: list[Chip]) -> MeasuredImage:
    used = sum(chip.candidate.verdict == Verdict.USED for chip in done)
    reason = f"{used} of {len(done)} chips match, too few that agree about where it looked"
    return MeasuredImage(image, found.C_EK, found, tuple(done), reason=reason)


def _fitted(
    campaign: Campaign, C_EK: Array, image: int, done: Sequence[Chip], sigma_K: Array
) -> Pointing | None:
    """The rotation by the chips that matched; None where fewer than four agree."""
    used = [chip.candidate for chip in done if chip.candidate.verdict == Verdict.USED]
    if len(used) < LEAST_CHIPS:
        return None
    pixel, p_J = np.array([c.pixel for c in used]), np.array([c.p_J for c in used])
    fitted = pointed(campaign, C_EK, image, pixel, p_J, TOLERANCE_PX, sigma_K)
    return fitted if fitted.agrees.sum() >= LEAST_CHIPS else None


def told(
    campaign: Campaign, image: int, found: Found, done: Sequence[Chip], sigma_K: Array, wanted: Wanted
) -> MeasuredImage:
    """An image by chips whose ground is known: with their residuals, where enough of them agree; without a floor."""
    fitted = _fitted(campaign, found.C_EK, image, done, sigma_K)
    if fitted is None:
        return MeasuredImage(image, found.C_EK, found, tuple(done))
    return replace(_told(image, found, list(done), fitted, wanted), floor_px=0.0)


def _told(image: int, found: Found, done: list[Chip], fitted: Pointing, wanted: Wanted) -> MeasuredImage:
    """The chips with their residuals; those that contradict the others are left out."""
    used = [k for k, chip in enumerate(done) if chip.candidate.verdict == Verdict.USED]
    variance = np.array([np.diagonal(done[k].candidate.covariance) for k in used]).reshape(-1, 2)
    floor = floor_of(fitted.residual_px[fitted.agrees], variance[fitted.agrees])
    told, order = list(done), 0
    every = round(1.0 / wanted.check_share) if wanted.check_share > 0.0 else 0
    for k, left, own in zip(used, fitted.residual_px, variance, strict=True):
        candidate = replace(done[k].candidate, residual_px=left)
        off = np.abs(left) / np.sqrt(own + floor**2)
        if off.max() > OUTLIER:
            reason = f"{np.hypot(*left):.2f} px ({off.max():.1f} sigma) from where the other chips of its image put it"
            candidate = replace(candidate, verdict=Verdict.OUTLIER, reason=reason)
        else:
            order += 1
            candidate = replace(candidate, check=every > 0 and order % every == 0)
        told[k] = replace(done[k], candidate=candidate)
    return MeasuredImage(image, fitted.C_EK, found, tuple(told), floor)


def floor_of(residual: Array, variance: Array, parameters: int = 3) -> float:
    """What residuals (n, 2) scatter beyond their own variances (n, 2): the s for which the median of
    ``|r| / sqrt(v + s^2)`` is that of a normal law, with the freedom that ``parameters`` fitted ones take."""
    n = residual.size
    if n <= 2 * parameters:
        return 0.0
    wanted = 0.6745 * float(np.sqrt(1.0 - parameters / n))

    def over(s: float) -> bool:
        return float(np.median(np.abs(residual) / np.sqrt(variance + s**2))) > wanted

    if not over(0.0):
        return 0.0
    low, high = 0.0, float(np.abs(residual).max()) / wanted + 1e-9
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if over(middle) else (low, middle)
    return high
