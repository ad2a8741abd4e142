"""Chips matched under one difficulty after another: error beside the bound, error over stated sigma, refusals, time.

    python benchmarks/matching.py [TRIALS] [SEED] [CONDITION ...]

Set OPENBLAS_NUM_THREADS=1.  Chips of 48 px of drawn ground (`starplumb.imagery.drawn`), each of its own ground, where
of nine places of a cell there is most structure, as `measure` chooses them; the reference turned, with its own pixels'
phase and noise (SNR 100), and predicted with errors of shape of 0.3 % and up to half a pixel of place.  Nothing was
tuned on this ground.  The bound is Cramer-Rao's at the place that is told, for the window's white noise, with affine
and radiometry unknown as the match has them; under cloud, season or another band it cannot be reached.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from starplumb.imagery.candidates import TRIED, structure
from starplumb.imagery.chips import STEP_PX, looked_for, matched
from starplumb.imagery.drawn.ground import Ground, Look
from starplumb.imagery.drawn.render import picture
from starplumb.imagery.drawn.sky import Sky
from starplumb.imagery.matching.orientation import RIM_PX
from starplumb.imagery.matching.rounds import SHAPE
from starplumb.imagery.prediction import Piece

CHIP, MARGIN = 48, 14
PSF = 0.45


@dataclass(frozen=True)
class Hard:
    """What makes a chip difficult."""

    snr: float = 20.0
    cloud: float = 0.0
    season: float = 0.0
    changed: float = 0.0
    band: int = 0
    defocus: float = 0.0
    coarse: float = 1.0


CONDITIONS = {
    "SNR 5": Hard(snr=5.0),
    "SNR 10": Hard(snr=10.0),
    "SNR 20": Hard(),
    "SNR 50": Hard(snr=50.0),
    "defocus 0.9 px": Hard(defocus=0.9),
    "cloud 30 %": Hard(cloud=0.3),
    "season 0.3": Hard(season=0.3),
    "10 % changed": Hard(changed=0.1),
    "another band": Hard(band=1),
    "reference twice as coarse": Hard(coarse=2.0),
    "all of it, SNR 10": Hard(10.0, 0.3, 0.3, 0.1, 0, 0.5, 2.0),
}


def square(size, step=1.0):
    return (np.arange(size) - 0.5 * (size - 1)) * step


def affine(C, middle):
    """Places of pixels counted from a middle, turned and scaled."""

    def of(column, row):
        x, y = np.meshgrid(column, row)
        return middle[0] + C[0, 0] * x + C[0, 1] * y, middle[1] + C[1, 0] * x + C[1, 1] * y

    return of


class _Shifted:
    """A ground whose origin lies elsewhere, with one look."""

    def __init__(self, ground, look):
        self.ground, self.look, self.detail = ground, look, ground.detail

    def draw(self, x, y, look=None):
        return self.ground.draw(x, y, self.look)


def seen(ground, look, C, middle, size, psf):
    """Brightness (size, size) of pixels around a middle."""
    offset = 0.5 * (size - 1)
    place = affine(C, middle)
    return picture(
        _Shifted(ground, look), lambda column, row: place(column - offset, row - offset), (size, size), psf
    )


@dataclass(frozen=True)
class Drawn:
    """A window with its rim, the piece of the reference predicted for it, where its middle really lies from the
    window's, ``away`` (2,), and how it is distorted, ``shape`` (2, 2); the bound (6, 6) of place and shape."""

    window: np.ndarray
    piece: Piece
    away: np.ndarray
    shape: np.ndarray
    bound: np.ndarray

    def error(self, found):
        """How far a match (2,) lies from where its point is."""
        return found.place_px - 0.5 * (CHIP - 1) - self.away - self.shape @ found.point_px

    def least(self, found):
        """The bound (2, 2) at the place that is told."""
        x = found.place_px - 0.5 * (CHIP - 1)
        at = np.concatenate([np.eye(2), np.kron(np.eye(2), x)], axis=1)
        return at @ self.bound @ at.T


def chip(rng, hard):
    """A chip of its own ground."""
    ground = Ground(int(rng.integers(1 << 30)), 1.0)
    look = Look(hard.season, hard.changed, hard.band, int(rng.integers(1 << 20)))
    size = CHIP + 2 * RIM_PX
    middle = chosen(rng, ground, look)
    psf = float(np.hypot(PSF, hard.defocus))
    clean = seen(ground, look, np.eye(2), middle, size + 2, psf)
    inner, e = clean[1:-1, 1:-1], RIM_PX
    window = inner
    if hard.cloud:
        at = np.arange(float(size))
        sky = Sky(hard.cloud, int(rng.integers(1 << 20)), 40.0, (9.0, 6.0))
        window = sky.over((size, size)).veil(inner, at, at)
    window = window + rng.normal(size=window.shape) / hard.snr
    away = rng.uniform(-0.5, 0.5, 2)
    gx = 0.5 * (clean[1:-1, 2:] - clean[1:-1, :-2])[e:-e, e:-e]
    gy = 0.5 * (clean[2:, 1:-1] - clean[:-2, 1:-1])[e:-e, e:-e]
    predicted, shape = piece(rng, ground, hard, middle + away)
    return Drawn(window, predicted, away, shape, bound(inner[e:-e, e:-e], gx, gy, hard.snr))


def chosen(rng, ground, look):
    """The middle of a chip as `measure` chooses it: of nine places of a cell the one with most structure."""
    x, y = (rng.uniform(0.0, 4000.0) + np.arange(TRIED * CHIP) for _ in range(2))
    cell = ground.draw(x, y, look)
    tried = [(i * CHIP, j * CHIP) for i in range(TRIED) for j in range(TRIED)]
    worth = [structure(cell[i : i + CHIP, j : j + CHIP]) for i, j in tried]
    i, j = tried[int(np.argmax(worth))]
    return np.array([x[0] + j, y[0] + i]) + 0.5 * (CHIP - 1.0)


def piece(rng, ground, hard, centre):
    """The reference around a place, from an orthoimage with pixels of its own, and its error of shape (2, 2)."""
    turn = rng.uniform(0.0, 2.0 * np.pi)
    C = hard.coarse * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    reach = CHIP + 2 * MARGIN
    size = int(1.45 * reach / hard.coarse) + 8
    phase = rng.uniform(-0.5, 0.5, 2)
    ortho = seen(ground, Look(), C, centre + C @ phase, size, PSF)
    ortho += rng.normal(size=ortho.shape) / 100.0
    shape = np.eye(2) + rng.normal(0.0, 0.003, (2, 2))
    x, y = np.meshgrid(square(2 * reach - 1, STEP_PX), square(2 * reach - 1, STEP_PX))
    at = np.stack([x, y], axis=-1) @ shape.T @ np.linalg.inv(C).T - phase + 0.5 * (size - 1)
    return Piece(
        map_coordinates(ortho, [at[..., 1], at[..., 0]], order=3, mode="mirror"), STEP_PX, centre
    ), shape


def bound(T, gx, gy, snr):
    x, y = np.meshgrid(square(CHIP), square(CHIP))
    J = np.stack([gx, gy, gx * x, gx * y, gy * x, gy * y, T - T.mean(), np.ones_like(T)], axis=-1)
    prior = np.diag([0.0, 0.0, *[SHAPE**-2] * 4, 0.0, 0.0])
    J = J.reshape(-1, 8)
    return np.linalg.inv(snr**2 * J.T @ J + prior)[:6, :6]


def whitened(covariance, error):
    return np.linalg.solve(np.linalg.cholesky(covariance), error)


def row(name, hard, trials, rng):
    errors, over_bound, over_sigma, spent = [], [], [], 0.0
    for _ in range(trials):
        drawn = chip(rng, hard)
        began = time.process_time()
        peak, _ = looked_for(drawn.piece, drawn.window)
        found, refused = matched(drawn.piece, drawn.window, peak)
        spent += time.process_time() - began
        if found is None or refused is not None:
            continue
        error = drawn.error(found)
        errors.append(error)
        over_bound.append(whitened(drawn.least(found), error))
        over_sigma.append(whitened(found.covariance_px2, error))
    e = np.array(errors)
    robust, rms = (lambda a: 1.4826 * np.median(np.abs(a))), (lambda a: np.sqrt(np.mean(np.square(a))))
    gross = int(np.sum(np.abs(e).max(axis=1) > 1.0))
    print(
        f"| {name} | {robust(e):.4f} | {robust(over_bound):.2f} | {100 * (1 - len(e) / trials):.0f} % | "
        f"{robust(over_sigma):.2f} | {rms(over_sigma):.2f} | {gross} | {1e3 * spent / trials:.0f} |",
        flush=True,
    )


if __name__ == "__main__":
    trials, seed = (int(a) for a in (*sys.argv[1:3], *("100", "1")[len(sys.argv[1:3]) :]))
    print("| | error px | over bound | refused | error/sigma | its rms | off by over 1 px | CPU ms |")
    print("|---|---|---|---|---|---|---|---|")
    for k, (name, hard) in enumerate(CONDITIONS.items()):
        if name in sys.argv[3:] or not sys.argv[3:]:
            row(name, hard, trials, np.random.default_rng([seed, k]))
