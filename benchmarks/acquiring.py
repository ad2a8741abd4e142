"""Sets of four images of a mounting that nobody has measured: how many are found on the reference?

    python benchmarks/acquiring.py [SETS] [SEED] [PRIOR_DEG] [CLOUD]

Set OPENBLAS_NUM_THREADS=1.  The campaign of `starplumb init --imagery`: four frame images of 480 px of 14 m from one
pass, each under its own clouds over 40 % of it, 6 % of the ground changed and another season since the reference was
made; the mounting errs by 0.5 deg (one sigma, about each axis), 430 px.  Each set lies elsewhere on one drawn ground
of 64 km with details of 17 m, and hills.  A set is found where the search says so and each of its images lies within
two cells of the search from where it is; a false one is said to be found, and is not.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter, map_coordinates

from starplumb.imagery.acquisition import acquire
from starplumb.imagery.drawn.ground import NOW, Ground, Look
from starplumb.imagery.drawn.sky import Sky
from starplumb.imagery.scene import Scene, binned, geodetic
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import drawn_demo
from starplumb.table.geometry import locate, project

DETAIL_M, HALF_M, AROUND_M = 16.8, 32e3, 6.5e3
BIN = 3
"""The reference is kept in cells of so many details: the search is coarser still."""
OWN_ARCSEC = np.array([3.0, 3.0, 12.0])
NEAR_CELLS = 2.0
SNR = 20.0


@dataclass(frozen=True)
class Square:
    """Brightness on a square of a plane whose samples lie ``step`` m apart, from ``first`` (2,), x and y, on."""

    values: np.ndarray
    step: float
    first: np.ndarray

    @classmethod
    def drawn(cls, ground, middle, half, look=NOW, keep=1):
        count = int(half / DETAIL_M / keep) * keep
        x, y = (c + DETAIL_M * np.arange(-count, count) for c in middle)
        strips = [
            binned(ground.draw(x, y[k : k + 64 * keep], look), keep) for k in range(0, len(y), 64 * keep)
        ]
        first = np.array([x[:keep].mean(), y[:keep].mean()])
        return cls(np.concatenate(strips), keep * DETAIL_M, first)

    def at(self, x, y, blur_m=0.0):
        values = gaussian_filter(self.values, blur_m / self.step) if blur_m > self.step else self.values
        place = [(y - self.first[1]) / self.step, (x - self.first[0]) / self.step]
        return map_coordinates(values, place, order=1, mode="constant", cval=np.nan)


@dataclass(frozen=True)
class Reference:
    """The square as an orthoimage of the campaign's own place, which lies ``away`` (2,) m from its middle."""

    square: Square
    plane: object
    away: np.ndarray

    def sample(self, latitude, longitude, spacing_m):
        x, y = self.plane.metres(latitude, longitude)
        return self.square.at(x + self.away[0], y + self.away[1], 0.4 * spacing_m)


@dataclass(frozen=True)
class Raw:
    values: np.ndarray

    @property
    def size_px(self):
        return self.values.shape[1], self.values.shape[0]

    def window(self, column, row, columns, rows):
        return self.values[row : row + rows, column : column + columns]


def hills(latitude, longitude):
    return 250.0 + 150.0 * np.sin(latitude * 6.4e6 / 1900.0) * np.cos(longitude * 6.4e6 / 2600.0)


def raw(scene, plane, image, square, away, cloud, seed, rng):
    """An image through the true camera: lines of sight every 16 px, one sample a pixel."""
    size = drawn_demo.SIZE_PX
    nodes, at = np.linspace(0.0, size - 1.0, 31), np.arange(float(size))
    pixel = np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
    place = plane.metres(*geodetic(scene.ground(scene.campaign.C_EK, image, pixel)))
    x, y = (RectBivariateSpline(nodes, nodes, v.reshape(31, 31))(at, at) for v in place)
    bright = gaussian_filter(square.at(x + away[0], y + away[1]), 0.5)
    veiled = Sky(cloud, seed, 128.0, (24.0, 18.0)).over((size, size)).veil(bright, at, at)
    return Raw(veiled + rng.normal(size=veiled.shape) / SNR)


def moved_px(campaign, wrong, right, image):
    """How far the middle of an image lies from where another rotation has it."""
    middle = np.full(1, 0.5 * (drawn_demo.SIZE_PX - 1.0))
    p_J = locate(campaign, right, np.array([image]), middle, middle, 250.0)
    return float(np.hypot(*(project(campaign, wrong, np.array([image]), p_J, None)[0] - middle[0])))


def found(truth, plane, ground, wide, prior_deg, cloud, seed, rng):
    """Whether a set is said to be found, whether it is, the height of its peak beside the next, and CPU s."""
    away = rng.uniform(-4e3, 4e3, 2)
    square = Square.drawn(ground, away, AROUND_M, Look(season=0.2, changed=0.06, seed=seed))
    scene = Scene(truth, (), Reference(wide, plane, away), hills, 90.0)
    raws = []
    for image in range(len(truth.images.ids)):
        own = so3.exp(rng.normal(0.0, OWN_ARCSEC * ARCSEC))
        looks = replace(scene, campaign=replace(truth, C_EK=truth.C_EK @ own))
        raws.append(raw(looks, plane, image, square, away, cloud, 100 * seed + image, rng))
    model = so3.exp(rng.normal(0.0, prior_deg * DEG, 3)) @ truth.C_EK
    blind = replace(scene, campaign=replace(truth, C_EK=model), raws=tuple(raws))
    began = time.process_time()
    acquired = acquire(blind, np.full(3, prior_deg * DEG), OWN_ARCSEC * ARCSEC)
    spent = time.process_time() - began
    off = [moved_px(truth, acquired.C_EK[k], truth.C_EK, k) for k in range(len(raws))]
    peak = acquired.together
    return acquired.clear, max(off) < NEAR_CELLS * acquired.cell_px, peak.height, peak.second, spent


if __name__ == "__main__":
    sets, seed, prior, cloud = (*sys.argv[1:5], *("100", "1", "0.5", "0.4")[len(sys.argv[1:5]) :])
    sets, seed = int(sets), int(seed)
    truth, plane = drawn_demo.flown(0.0)
    ground = Ground(seed, DETAIL_M)
    wide = Square.drawn(ground, np.zeros(2), HALF_M, keep=BIN)
    rows = []
    for k in range(sets):
        rng = np.random.default_rng([seed, k])
        rows.append(found(truth, plane, ground, wide, float(prior), float(cloud), k + 1, rng))
        print(k, rows[-1], flush=True, file=sys.stderr)
    said, right, height, second, spent = np.array(rows, dtype=float).T
    print("| sets | found | false | least peak, sigma | least over the next | CPU s each |")
    print("|---|---|---|---|---|---|")
    print(
        f"| {sets} | {int(np.sum(said * right))} | {int(np.sum(said * (1 - right)))} | {height.min():.1f} | "
        f"{(height / second).min():.2f} | {spent.mean():.2f} |"
    )
