"""The chips of one image, whose place is known to about a pixel: matched by least squares, or refused in words."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .acquisition import Peak
from .candidates import structure
from .matching.least_squares import Match, match
from .matching.orientation import RIM_PX, agreement, orientation
from .matching.rounds import REACH_PX
from .matching.template import Template
from .pictures import Picture
from .prediction import Piece, pieces
from .scene import Scene
from .search import STANDS, located
from .verdicts import Brightness, Candidate, Verdict

Array = NDArray[np.float64]
Tell = Callable[[int], None]
Refusal = tuple[Verdict, str]
Tried = tuple[Match | None, Refusal | None]

STEP_PX = 0.5
"""Spacing of a template's samples: at a whole pixel errors and sigmas double."""
SEARCH_PX = 5
"""A chip is first looked for so many pixels around, to see that its place is the best there is."""
MARGIN_PX = 6
AGREES = 0.25
"""Pixels around which window and template agree less than this are left out of the match."""
AGREES_SOMEWHAT, AGREES_WELL = 0.1, 0.4
"""The same where that is refused: in pixels that are not bright, and in all."""
DARKER = 0.05, 0.25
CLOUD_ABOVE = 1.5
"""Two levels of the darker half of a window, as parts of its pixels, and how many times as far above the upper one
cloud begins."""
LEAST_AGREEING = 0.15
LEAST_KEPT = 0.15
"""Parts of a chip's pixels that must agree at first, and bear weight in the end."""
LEAST_AGREEMENT, LEAST_AGREEMENT_ALONE = 0.4, 0.5
"""Weighted correlation of window and template that a match must have, and where no orientation correlation that stands
out speaks for it."""
LEAST_TOLD = 0.05
"""Part of the window's power, its pixels without weight included, that the template must explain."""
MOST_APART_PX, MOST_APART_IN_PART_PX = 1.0, 0.6
"""How far a match may lie from where the correlation stands out, and, where it does not, from the best place of the
pixels that bear weight: what is left between clouds comes to rest in fields nearly without texture, too."""
MOST_SIGMA_PX = 0.25
FULL = 0.1
"""Part of a chip's pixels that may be saturated."""
MISSING = 0.3
"""Part that may lack data, in the window or in the reference."""
_FLAT = 0.05
"""A chip has no texture where its structure is this part of the median chip's."""


@dataclass(frozen=True)
class Chip:
    """A candidate and what is kept of it for the eye."""

    candidate: Candidate
    picture: Picture | None


def chips(
    scene: Scene,
    C_EK: Array,
    image: int,
    places: Array,
    chip_px: int,
    brightness: Brightness,
    tell: Tell = lambda done: None,
) -> list[Chip]:
    """A chip for each place (n, 2) of an image whose rotation puts it on its ground to a pixel or two; ``tell`` hears
    how many are done."""
    reach = 0.5 * chip_px + SEARCH_PX + RIM_PX + MARGIN_PX
    below = pieces(scene, C_EK, image, places, reach, STEP_PX)
    rim = RIM_PX
    size = chip_px + 2 * rim
    first = np.rint(places - 0.5 * (size - 1)).astype(int).tolist()
    windows = [scene.raws[image].window(column, row, size, size) for column, row in first]
    flat = _FLAT * float(np.median([structure(w) for w in windows])) if windows else 0.0
    found = []
    for number, (place, piece, window) in enumerate(zip(places, below, windows, strict=True)):
        candidate = Candidate(image, number, place, place, Verdict.NO_MATCH)
        chip = _chip(scene, candidate, piece, window, brightness, flat)
        found.append(_named(chip, scene.campaign.images.ids[image]))
        tell(number + 1)
    return found


def _named(chip: Chip, image_id: str) -> Chip:
    """A chip whose picture has the name of its landmark."""
    if chip.picture is None:
        return chip
    label = chip.candidate.landmark_id(image_id)
    return replace(chip, picture=replace(chip.picture, image_id=image_id, landmark_id=label))


def _chip(
    scene: Scene,
    candidate: Candidate,
    piece: Piece | None,
    window: Array,
    brightness: Brightness,
    flat: float,
) -> Chip:
    inner = window[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX]
    if piece is None or piece.known < 1.0 - MISSING:
        reason = "the reference or the heights do not cover its ground"
        return Chip(replace(candidate, verdict=Verdict.NO_REFERENCE, reason=reason), None)
    candidate = replace(candidate, p_J=piece.p_J)
    seen = _sampled(piece, inner.shape[0], np.zeros(2))
    picture = Picture("", "", seen.astype(np.float32), inner.astype(np.float32))
    if (refused := _unfit(scene, inner, window, brightness, flat)) is not None:
        return Chip(replace(candidate, verdict=refused[0], reason=refused[1]), picture)
    best, surface = looked_for(piece, window)
    away = tuple(float(x) for x in best.shift)
    picture = replace(picture, surface=surface.astype(np.float32), peak=(away[0], away[1]))
    candidate = replace(candidate, peak=best.height, second=best.second)
    found, refused = matched(piece, window, best)
    if found is not None:
        picture, candidate = _shown(picture, found), _measured(candidate, found)
        if refused is None:
            return Chip(_placed(scene, candidate, piece, found), picture)
    verdict, reason = refused or _NOWHERE
    if verdict != Verdict.NO_TEXTURE and brightness.clouded(inner):
        verdict, reason = Verdict.CLOUD, f"partly as bright as cloud, and {reason}"
    return Chip(replace(candidate, verdict=verdict, reason=reason), picture)


def _placed(scene: Scene, candidate: Candidate, piece: Piece, found: Match) -> Candidate:
    """A candidate moved to the point of its chip that is known best."""
    middle = candidate.place
    return replace(
        candidate,
        verdict=Verdict.USED,
        place=middle + found.point_px,
        pixel=middle + found.place_px - _middle(found),
        p_J=piece.ground(scene, found.point_px),
        covariance_px2=found.covariance_px2,
    )


def _middle(found: Match) -> Array:
    """The middle (2,) of a match's window, from its first pixel."""
    return 0.5 * (np.array(found.residual.shape[::-1]) - 1.0)


def looked_for(piece: Piece, window: Array, use: NDArray[np.bool_] | None = None) -> tuple[Peak, Array]:
    """Where a window with a rim lies around the middle of a piece, by orientation correlation of the pixels in ``use``,
    and the surface."""
    return located(window, replace(piece, samples=piece.samples[::2, ::2], step_px=1.0), SEARCH_PX, use)


_UNLIKE = (
    Verdict.CHANGED,
    "unlike the reference in nearly all of its pixels: changed ground, another season or cloud",
)
_NOWHERE = Verdict.NO_MATCH, "no place within a few pixels where the match comes to rest"


def _unfit(scene: Scene, inner: Array, window: Array, brightness: Brightness, flat: float) -> Refusal | None:
    """Why a window is not worth matching."""
    known = np.isfinite(inner)
    if np.mean(known) < 1.0 - MISSING:
        return Verdict.EDGE, f"{100.0 * (1.0 - np.mean(known)):.0f} % of its pixels have no data"
    if scene.saturation_dn is not None:
        full = float(np.mean(inner[known] >= scene.saturation_dn))
        if full > FULL:
            return Verdict.SATURATED, f"{100.0 * full:.0f} % of its pixels are saturated"
    if not structure(window) > flat:
        return brightness.bare(inner)
    return None


def _sampled(piece: Piece, size: int, shift: Array) -> Array:
    """The piece at the pixels (n, n) of the window, as it was predicted and then shifted."""
    at = 0.5 * (piece.samples.shape[0] - 1.0) + (np.arange(size) - 0.5 * (size - 1.0)) / STEP_PX
    rows, columns = (np.rint(at + s / STEP_PX).astype(int) for s in shift[::-1])
    return piece.samples[np.ix_(rows, columns)]


def matched(piece: Piece, window: Array, peak: Peak) -> Tried:
    """The match of a window with a rim with a piece, sought from where their correlation stands out, else from the
    middle; and why it is not to be believed, None where it is.  Its place counts from the first pixel inside the rim.

    It is sought in the pixels whose orientations agree; where it is refused so, in those of the other masks.
    """
    size, shift = window.shape[0], peak.shift if peak.height > STANDS else np.zeros(2)
    there = _sampled(piece, size, shift)
    start = 0.5 * (size - 2.0 * RIM_PX - 1.0) - shift
    inside = slice(RIM_PX, size - RIM_PX)
    known = np.isfinite(window) & np.isfinite(there)
    template, first = _template(piece, size), None
    for use in _masks(window, agreement(orientation(window), orientation(there))):
        use = (use & known)[inside, inside]
        if np.mean(use) < LEAST_AGREEING:
            tried: Tried = None, _UNLIKE
        elif (found := match(template, window[inside, inside], start, use)) is None:
            tried = None, _NOWHERE
        else:
            tried = found, unlikely(found, peak) or _elsewhere(found, piece, window, peak)
        if tried[1] is None:
            return tried
        first = first or tried
    return first or (None, _UNLIKE)


def _masks(window: Array, alike: Array) -> Iterator[NDArray[np.bool_]]:
    """The pixels (n, n) of a window that are tried one after the other, by how alike (n, n) the reference they are."""
    yield alike > AGREES
    below = _below_cloud(window)
    yield below
    yield below & (alike > AGREES_SOMEWHAT)
    yield alike > AGREES_WELL


def _below_cloud(window: Array) -> NDArray[np.bool_]:
    """Pixels (n, n) that are not far brighter than the darker half of a window is spread."""
    from scipy.ndimage import gaussian_filter

    known = np.isfinite(window)
    if not known.any():
        return known
    dark, middle = np.quantile(window[known], DARKER)
    smooth = gaussian_filter(np.where(known, window, middle), 1.0)
    return np.asarray(smooth < middle + CLOUD_ABOVE * (middle - dark))


def _template(piece: Piece, size: int) -> Template:
    """The piece as far as a window of this size with its rim may reach, what is unknown as bright as the rest."""
    spare = max((piece.samples.shape[0] - int((size + 2.0 * REACH_PX) / STEP_PX)) // 2, 0)
    samples = piece.samples[spare : piece.samples.shape[0] - spare, spare : piece.samples.shape[1] - spare]
    known = np.isfinite(samples)
    return Template(np.where(known, samples, np.mean(samples[known])), STEP_PX)


def _elsewhere(found: Match, piece: Piece, window: Array, peak: Peak) -> Refusal | None:
    """Why a match is not to be believed by orientations in its pixels with weight, where those of all do not tell."""
    from scipy.ndimage import binary_closing

    if peak.height > STANDS:
        return None
    best, _ = looked_for(piece, window, binary_closing(found.weight > 0.0, iterations=2))
    apart = _apart(found, best)
    if apart > MOST_APART_IN_PART_PX:
        return (
            Verdict.NO_MATCH,
            f"its match lies {apart:.1f} px from where the part that is seen is most alike",
        )
    return None


def _apart(found: Match, peak: Peak) -> float:
    return float(np.hypot(*(found.place_px - found.point_px - _middle(found) + peak.shift)))


def unlikely(found: Match, peak: Peak) -> Refusal | None:
    """Why a match is not to be believed by what it says of itself; None where it is."""
    sigma = float(np.sqrt(np.linalg.eigvalsh(found.covariance_px2)[-1]))
    agreement = abs(found.agreement)
    if agreement < (LEAST_AGREEMENT if peak.height > STANDS else LEAST_AGREEMENT_ALONE):
        return Verdict.NO_MATCH, f"like the reference to {agreement:.2f} only"
    if found.kept < LEAST_KEPT or agreement**2 * found.kept < LEAST_TOLD:
        return Verdict.CHANGED, f"like the reference in {100.0 * found.kept:.0f} % of its pixels only"
    if sigma > MOST_SIGMA_PX:
        return Verdict.NO_TEXTURE, f"its place has a sigma of {sigma:.2g} px along one direction"
    apart = _apart(found, peak)
    if peak.height > STANDS and apart > MOST_APART_PX:
        return Verdict.NO_MATCH, f"its match lies {apart:.1f} px from where its correlation stands out"
    return None


def _shown(picture: Picture, found: Match) -> Picture:
    return replace(
        picture,
        residual=found.residual.astype(np.float32),
        weight=found.weight.astype(np.float32),
        covariance_px2=_pairs(found.covariance_px2),
    )


def _measured(candidate: Candidate, found: Match) -> Candidate:
    return replace(
        candidate,
        agreement=found.agreement,
        kept=found.kept,
        gain=found.gain,
        blur_px=found.blur_px,
    )


def _pairs(covariance: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    a, b, c, d = (float(x) for x in covariance.ravel())
    return (a, b), (c, d)
