"""Direct location of a whole line-scan image: million pixels per CPU second, on the ellipsoid and on a terrain.

    python benchmarks/locate.py

Set OPENBLAS_NUM_THREADS=1.  12000 columns, blocks of 64 rows; the terrain is an array of 30 m posts, hills of 1500 m.
The heights that single pixels see on a DEM, 4000 of them over the image, are found together and, as one by one before,
by halving: a look-up of the DEM is here an array's, so that a file's own cost is not in the figure.
Pixel by pixel is what :func:`starplumb.table.geometry.locate` does, for the comparison in the same run.
"""

from __future__ import annotations

import time

import numpy as np
from scenes import C_EK_TRUE, photographed

from starplumb.ground.grid import Terrain, geodetic_rows, locate_on_terrain, locate_rows
from starplumb.ground.terrain import HIGHEST, LOWEST, HeightAt, ground_heights
from starplumb.physics.camera import LineScanCamera
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.units import DEG
from starplumb.table.geometry import locate

CAMERA = LineScanCamera.from_optics(2.2, 9e-6, (5999.5, 40.0), 12000, rows=12000)
ROWS, BLOCKS = 64, 12


def terrain(campaign: object, column: np.ndarray) -> Terrain:
    """Hills of 1500 m, tens of kilometres long with roughness on top, over the whole image."""
    corners = geodetic_rows(campaign, C_EK_TRUE, 0, np.array([0.0, ROWS * BLOCKS]), column)
    low, high = corners.min(axis=(0, 1)) - 0.05 * DEG, corners.max(axis=(0, 1)) + 0.05 * DEG
    step = 30.0 / 6.37e6
    latitude, longitude = (np.arange(low[i], high[i], step) for i in range(2))
    x, y = latitude[:, None] * 6.37e6, longitude[None, :] * 6.37e6
    height = (
        750.0 + 700.0 * np.sin(x / 4000.0) * np.cos(y / 5000.0) + 40.0 * np.sin(x / 300.0) * np.sin(y / 400.0)
    )
    return Terrain(height, float(low[0]), float(low[1]), (step, step))


def by_halving(campaign: object, pixel: np.ndarray, height_at: HeightAt, step_m: float) -> float:
    """The height that one pixel sees, by a plain walk and 40 halvings."""

    def above(height: np.ndarray) -> np.ndarray:
        index = np.zeros(height.size, dtype=np.int64)
        column, row = np.broadcast_to(pixel[:, None], (2, height.size))
        p_J = locate(campaign, C_EK_TRUE, index, column, row, height)
        latitude, longitude, _ = itrf_to_geodetic(p_J)
        return height - height_at(latitude, longitude)

    rough = np.linspace(HIGHEST, LOWEST, 96)
    ground = rough - above(rough)
    margin = rough[0] - rough[1]
    top, bottom = np.nanmax(ground) + margin, np.nanmin(ground) - margin
    ends = [
        locate(campaign, C_EK_TRUE, np.zeros(1, int), pixel[:1], pixel[1:], at)[0] for at in (top, bottom)
    ]
    heights = np.linspace(top, bottom, int(np.ceil(np.linalg.norm(ends[0] - ends[1]) / step_m)) + 1)
    gap = above(heights)
    first = np.flatnonzero((gap[:-1] > 0.0) & (gap[1:] <= 0.0))[0]
    high, low = heights[first], heights[first + 1]
    for _ in range(40):
        middle = 0.5 * (high + low)
        high, low = (middle, low) if above(np.array([middle]))[0] > 0.0 else (high, middle)
    return 0.5 * (high + low)


def on_a_dem(campaign: object, ground: Terrain) -> str:
    """A row of the table: heights that single pixels see, together and one by one."""
    rng = np.random.default_rng(0)
    pixels = np.stack([rng.uniform(0.0, 11999.0, 4000), rng.uniform(0.0, ROWS * BLOCKS - 1.0, 4000)], axis=-1)
    start = time.process_time()
    found = ground_heights(campaign, C_EK_TRUE, np.zeros(4000, int), pixels, ground.at, 30.0)
    together = time.process_time() - start
    few = 200
    start = time.process_time()
    one_by_one = [by_halving(campaign, pixel, ground.at, 30.0) for pixel in pixels[:few]]
    single = (time.process_time() - start) * 4000 / few
    off = np.abs(found[:few] - one_by_one).max()
    return (
        f"heights of 4000 single pixels on a DEM: {1e6 * together / 4000:.0f} us each together, "
        f"{1e6 * single / 4000:.0f} one by one by halving, {single / together:.0f} times; "
        f"largest difference {off:.1e} m"
    )


def rate(pixels: int, seconds: float) -> str:
    return f"{1e-6 * pixels / seconds:.1f}"


def main() -> None:
    campaign = photographed(1, camera=CAMERA)
    column = np.arange(12000.0)
    blocks = [np.arange(ROWS) + float(ROWS * i) for i in range(BLOCKS)]
    ground = terrain(campaign, column)
    start = time.process_time()
    for rows in blocks:
        p_J = locate_rows(campaign, C_EK_TRUE, 0, rows, column)
    ellipsoid = time.process_time() - start
    start = time.process_time()
    for rows in blocks:
        locate_on_terrain(campaign, C_EK_TRUE, 0, rows, column, ground)
    on_terrain = time.process_time() - start
    pixel = np.meshgrid(blocks[-1], column, indexing="ij")
    start = time.process_time()
    one_by_one = locate(campaign, C_EK_TRUE, np.zeros(pixel[0].size, int), pixel[1].ravel(), pixel[0].ravel())
    single = time.process_time() - start
    n = ROWS * BLOCKS * 12000
    print("| | Mpx per CPU s |\n|---|---|")
    print(f"| ellipsoid | {rate(n, ellipsoid)} |")
    print(f"| terrain | {rate(n, on_terrain)} |")
    print(f"| ellipsoid, pixel by pixel | {rate(pixel[0].size, single)} |")
    print(f"largest difference of the two: {np.abs(p_J.reshape(-1, 3) - one_by_one).max():.1e} m")
    print(on_a_dem(campaign, ground))


if __name__ == "__main__":
    main()
