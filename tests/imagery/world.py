"""A small world to photograph: rough ground whose brightness repeats after kilometres, over hills of known height."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter, map_coordinates, spline_filter

from starplumb.imagery.scene import Scene, geodetic
from starplumb.physics import so3
from starplumb.physics.camera import FrameCamera, LineScanCamera
from starplumb.plan.demo import demo

CELL_M = 1.4
EARTH_M = 6.371e6


def rough(rng, n, power):
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(n), np.fft.rfftfreq(n), indexing="ij"))
    f[0, 0] = 1.0
    z = np.fft.rfft2(rng.normal(size=(n, n))) * f ** (-power / 2)
    z[0, 0] = 0.0
    a = np.fft.irfft2(z, (n, n))
    return a / a.std()


@dataclass(frozen=True)
class Ground:
    """Brightness at places, as a reference has it: levels with edges and what is fine upon them."""

    cells: np.ndarray

    @classmethod
    @cache
    def draw(cls, seed, n=1024):
        rng = np.random.default_rng(seed)
        levels = np.floor(2.0 * rough(rng, n, 2.6)) / 2.0
        return cls(gaussian_filter(levels + 0.15 * rough(rng, n, 1.4), 0.7, mode="wrap"))

    @cached_property
    def _splines(self):
        return {0.0: spline_filter(self.cells, order=3, mode="grid-wrap")}

    def sample(self, latitude, longitude, spacing_m):
        blur = 0.45 * spacing_m / CELL_M if spacing_m > 1.5 * CELL_M else 0.0
        if blur not in self._splines:
            smooth = gaussian_filter(self.cells, blur, mode="wrap")
            self._splines[blur] = spline_filter(smooth, order=3, mode="grid-wrap")
        at = [latitude * EARTH_M / CELL_M, longitude * EARTH_M * np.cos(latitude) / CELL_M]
        return map_coordinates(self._splines[blur], at, order=3, mode="grid-wrap", prefilter=False)


def hills(latitude, longitude):
    return 250.0 + 60.0 * np.sin(latitude * EARTH_M / 900.0) * np.cos(longitude * EARTH_M / 700.0)


@dataclass(frozen=True)
class RawArray:
    values: np.ndarray

    @property
    def size_px(self):
        return self.values.shape[1], self.values.shape[0]

    def window(self, column, row, columns, rows):
        cut = np.full((rows, columns), np.nan)
        h, w = self.values.shape
        i, j = slice(max(row, 0), min(row + rows, h)), slice(max(column, 0), min(column + columns, w))
        if i.stop > i.start and j.stop > j.start:
            cut[i.start - row : i.stop - row, j.start - column : j.stop - column] = self.values[i, j]
        return cut


def photographed(scene, C_EK, image, size, rng, noise=0.05):
    """A raw image of the world: two by two samples a pixel, through lines of sight every few pixels."""
    fine = 2 * size
    at = (np.arange(fine) + 0.5) / 2.0 - 0.5
    nodes = np.linspace(-1.0, size, 31)
    grid = np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
    latitude, longitude = geodetic(scene.ground(C_EK, image, grid))
    place = [RectBivariateSpline(nodes, nodes, v.reshape(31, 31))(at, at) for v in (latitude, longitude)]
    bright = scene.reference.sample(*place, 0.0).reshape(size, 2, size, 2).mean(axis=(1, 3))
    bright = gaussian_filter(bright, 0.45)
    return 900.0 + 160.0 * (bright + noise * rng.normal(size=bright.shape))


def world(rng, kind="frame", images=2, size=240, off_px=(20.0, -15.0), attitude_px=3.0):
    """A scene whose mounting is off by some pixels, each image by some more; with the rotations of its images."""
    campaign, _ = demo(kind, images, 3)
    middle = 0.5 * (size - 1.0)
    camera = FrameCamera(2.2, 9e-6, (middle, middle), (size, size))
    if kind == "line-scan":
        camera = LineScanCamera.from_optics(2.2, 9e-6, (middle, 0.0), size, rows=size)
    campaign = replace(campaign, camera=camera)
    scene = Scene(campaign, (), Ground.draw(5), hills, 30.0)
    pixel = 9e-6 / 2.2
    raws, rotations = [], []
    for image in range(images):
        own = rng.normal(0.0, attitude_px, 2)
        turn = pixel * np.array([-(off_px[1] + own[1]), off_px[0] + own[0], 20.0 * rng.normal()])
        rotations.append(campaign.C_EK @ so3.exp(turn))
        raws.append(photographed(scene, rotations[-1], image, size, rng))
    return replace(scene, raws=tuple(map(RawArray, raws))), rotations
