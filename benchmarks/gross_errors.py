"""Thousands of chips: how many of those accepted lie more than a pixel off, and how many wrong places are accepted?

    python benchmarks/gross_errors.py [CHIPS] [SEED] [CONDITION ...]

Set OPENBLAS_NUM_THREADS=1.  So many chips of 48 px under each difficulty of `matching.py`, cut from squares of drawn
ground: those tiles with more structure than two thirds of their square.  Windows and reference are interpolated from
one drawing a pixel apart, which is ten times quicker than that of `matching.py` and good to a hundredth of a pixel.
Each window is laid on its own ground, and on that of another tile, where every acceptance is wrong.
"""

from __future__ import annotations

import sys

import numpy as np
from matching import CHIP, CONDITIONS, MARGIN, PSF, square, whitened
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from starplumb.imagery.candidates import structure
from starplumb.imagery.chips import STEP_PX, looked_for, matched
from starplumb.imagery.drawn.ground import Ground, Look
from starplumb.imagery.drawn.sky import Sky
from starplumb.imagery.matching.orientation import RIM_PX
from starplumb.imagery.prediction import Piece

SIDE = 1000
PIXEL = 12.0**-0.5
"""Deviation of a pixel's own square."""
TILE = 80
"""Pixels from one chip to the next: neighbours share neither window nor search."""
PART = 1.0 / 3.0


def blurred(ground, look, width):
    at = np.arange(float(SIDE))
    return gaussian_filter(ground.draw(at, at, look), float(np.hypot(width, PIXEL)))


def area(rng, hard):
    """A square of ground as the camera sees it, and the spline (SIDE, SIDE) of its reference."""
    ground = Ground(int(rng.integers(1 << 30)), 1.0)
    look = Look(hard.season, hard.changed, hard.band, int(rng.integers(1 << 20)))
    seen = blurred(ground, look, float(np.hypot(PSF, hard.defocus)))
    reference = blurred(ground, Look(), hard.coarse * float(np.hypot(PSF, PIXEL)))
    return seen, spline_filter(reference + rng.normal(size=reference.shape) / 100.0, order=3)


def tiles(seen):
    """Middles (n, 2), columns and rows, of the tiles with most structure."""
    half = CHIP // 2
    at = np.arange(TILE, SIDE - TILE, TILE) + 0.5
    middle = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    first = (middle + 0.5 - half).astype(int)
    worth = np.array([structure(seen[r : r + CHIP, c : c + CHIP]) for c, r in first])
    return middle[np.argsort(-worth)[: int(PART * len(worth))]]


def window(rng, seen, middle, hard):
    size = CHIP + 2 * RIM_PX
    column, row = (middle + 0.5 - size // 2).astype(int)
    cut = seen[row : row + size, column : column + size]
    if hard.cloud:
        at = np.arange(float(size))
        cut = (
            Sky(hard.cloud, int(rng.integers(1 << 20)), 40.0, (9.0, 6.0)).over((size, size)).veil(cut, at, at)
        )
    return cut + rng.normal(size=cut.shape) / hard.snr


def piece(reference, middle, shape):
    x, y = np.meshgrid(*(square(2 * (CHIP + 2 * MARGIN) - 1, STEP_PX),) * 2)
    at = np.stack([x, y], axis=-1) @ shape.T + middle
    values = map_coordinates(reference, [at[..., 1], at[..., 0]], order=3, mode="mirror", prefilter=False)
    return Piece(values, STEP_PX, middle)


def chip(rng, square, middle, other, hard):
    """Error (2,) over a pixel and over sigma of a chip on its own ground, None where it is refused; and whether it is
    accepted on the ground of another tile."""
    seen, reference = square
    away, shape = rng.uniform(-0.5, 0.5, 2), np.eye(2) + rng.normal(0.0, 0.003, (2, 2))
    cut = window(rng, seen, middle, hard)
    error = None
    there = piece(reference, middle + away, shape)
    found, refused = matched(there, cut, looked_for(there, cut)[0])
    if refused is None:
        e = found.place_px - 0.5 * (CHIP - 1) - away - shape @ found.point_px
        error = e, whitened(found.covariance_px2, e)
    there = piece(reference, other + away, shape)
    _, refused = matched(there, cut, looked_for(there, cut)[0])
    return error, refused is None


def row(name, hard, count, rng):
    errors, tried, wrong = [], 0, 0
    while tried < count:
        square = area(rng, hard)
        middles = tiles(square[0])[: count - tried]
        for k, middle in enumerate(middles):
            error, accepted = chip(rng, square, middle, middles[k - 1], hard)
            tried, wrong = tried + 1, wrong + accepted
            if error is not None:
                errors.append(error)
    e, z = (np.abs(np.array(a)).max(axis=1) for a in zip(*errors, strict=True))
    gross, far = int(np.sum(e > 1.0)), int(np.sum(z > 5.0))
    print(f"| {name} | {tried} | {len(e)} | {gross} | {far} | {e.max():.2f} | {wrong} |", flush=True)
    return np.array([tried, len(e), gross, far, wrong])


if __name__ == "__main__":
    count, seed = (int(a) for a in (*sys.argv[1:3], *("100", "1")[len(sys.argv[1:3]) :]))
    print("| | chips | accepted | off by over 1 px | by over 5 sigmas | most px | other places accepted |")
    print("|---|---|---|---|---|---|---|")
    total = sum(
        row(name, hard, count, np.random.default_rng([seed, k]))
        for k, (name, hard) in enumerate(CONDITIONS.items())
        if name in sys.argv[3:] or not sys.argv[3:]
    )
    print(f"| all | {total[0]} | {total[1]} | {total[2]} | {total[3]} | | {total[4]} |")
