"""The chips of a library in one image: found around where they are expected, and matched.

A chip knows only what is around it, and the image everything: here the chip is what is looked for, in the image.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..candidates import structure
from ..chips import Chip, Tell, chips
from ..matching.orientation import RIM_PX
from ..pointing import LEAST_CHIPS, pointed
from ..prediction import Piece, pieces
from ..scene import Scene
from ..search import SHARE, STANDS, TOLERANCE_PX, WINDOW_PX, Found, located
from ..verdicts import Brightness, Verdict
from .expected import Expected, expected, half_px, one_a_cell

Array = NDArray[np.float64]

PLACES = 5
"""Chips along each side of an image that are looked for to find it, at most."""


def refine_by_library(scene: Scene, C_EK: Array, image: int, cell_px: int, prior_K: Array) -> Found:
    """The rotation of an image that is known to a few of ``cell_px`` pixels, to a part of one."""
    there = expected(scene, C_EK, image, -float(RIM_PX))
    there = there.only(one_a_cell(there.pixel, np.zeros(len(there.pixel)), (PLACES, PLACES)))
    search = 3 * cell_px + 4
    reach = min(0.5 * WINDOW_PX, half_px(scene, C_EK, image)) + RIM_PX
    place = np.rint(there.pixel)
    pixel, p_J = [], []
    for at, piece in zip(place, pieces(scene, C_EK, image, place, reach, 1.0), strict=True):
        if piece is None:
            continue
        size = piece.samples.shape[0] + 2 * search
        first = at.astype(int) - size // 2
        window = scene.raws[image].window(int(first[0]), int(first[1]), size, size)
        best, _ = located(piece.samples, Piece(window, 1.0, piece.p_J), search)
        if best.height > STANDS:
            pixel.append(at + best.shift)
            p_J.append(piece.p_J)
    tried = len(place)
    if tried == 0:
        return Found(C_EK, 0, 0, "no chip of the library lies in it")
    found = np.array(pixel).reshape(-1, 2), np.array(p_J).reshape(-1, 3)
    fitted = pointed(scene.campaign, C_EK, image, *found, TOLERANCE_PX, prior_K)
    agree = int(fitted.agrees.sum())
    if agree < max(min(LEAST_CHIPS, tried), SHARE * tried):
        where = f"{agree} of {tried} chips of the library agree about where it lies"
        return Found(C_EK, agree, tried, f"{where}: cloud, water or changed ground, or another place")
    return Found(fitted.C_EK, agree, tried)


def library_chips(
    scene: Scene,
    C_EK: Array,
    image: int,
    chip_px: int,
    grid: tuple[int, int],
    brightness: Brightness,
    tell: Tell = lambda done: None,
) -> list[Chip]:
    """The library's chips that lie wholly in an image, in each cell of a grid the one of whose window can be told most:
    matched as :func:`chips` does, with the place of the surveyed centre."""
    there = expected(scene, C_EK, image, -0.5 * chip_px - RIM_PX)
    half = 0.5 * (chip_px - 1)
    place = np.rint(there.pixel - half) + half
    raw = scene.raws[image]
    first = np.rint(place - half).astype(int).tolist()
    worth = np.array([structure(raw.window(column, row, chip_px, chip_px)) for column, row in first])
    chosen = one_a_cell(there.pixel, worth, grid)
    done = chips(scene, C_EK, image, place[chosen], chip_px, brightness, tell)
    return [_surveyed(scene, chip, there.only(chosen), k) for k, chip in enumerate(done)]


def _surveyed(scene: Scene, chip: Chip, there: Expected, k: int) -> Chip:
    """A chip with its landmark: a window's middle lies between pixels, the centre anywhere beside it."""
    landmarks, which, c = scene.campaign.landmarks, int(there.landmark[k]), chip.candidate
    name = landmarks.ids[which]
    moved = {"place": there.pixel[k], "pixel": c.pixel + there.pixel[k] - c.place}
    c = replace(c, landmark=name, p_J=landmarks.r_J[which], **moved)
    if c.verdict == Verdict.NO_REFERENCE:
        reason = "the library's chip covers too little of the window: cut larger chips, or make measure.chip_px smaller"
        c = replace(c, reason=reason)
    picture = None if chip.picture is None else replace(chip.picture, landmark_id=name)
    return Chip(c, picture)
