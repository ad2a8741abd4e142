"""One image of 12 000 x 12 000 pixels with 144 chips: CPU seconds and the most memory that `measure` takes.

    python benchmarks/large_image.py [FOLDER] [SIDE_PX]

Needs the extra `gis`; set OPENBLAS_NUM_THREADS=1.  The folder gets a campaign of one frame image of 1 m pixels, a tiled
GeoTIFF of 16 bit written strip by strip, over hills, with an orthoimage of the same ground (drawn on 2 km, mirrored
beyond) as a GeoTIFF; what is there already is taken again.  The command runs in a process of its own.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import rasterio
from rasterio.transform import Affine
from rasterio.windows import Window
from scipy.ndimage import gaussian_filter, map_coordinates

from starplumb.imagery.drawn import render
from starplumb.imagery.drawn.ground import Ground, Look
from starplumb.imagery.drawn.relief import relief
from starplumb.io.drawn.write import OrthoPicture, write_imagery
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import drawn_demo, scene

TILE, STRIP = 2048, 400
PRIOR = np.array([30.0, 30.0, 60.0]) * ARCSEC
TILED = {
    "driver": "GTiff",
    "count": 1,
    "tiled": True,
    "blockxsize": 256,
    "blockysize": 256,
}


def strips(path, shape, dtype, values, **options):
    """A raster (r, c) whose strips are made one after another."""
    with rasterio.open(path, "w", height=shape[0], width=shape[1], dtype=dtype, **TILED, **options) as file:
        for row in range(0, shape[0], STRIP):
            part = values(row, min(row + STRIP, shape[0]))
            file.write(part.astype(dtype), 1, window=Window(0, row, shape[1], len(part)))


def seen(tile, x, y):
    return gaussian_filter(map_coordinates(tile, [y, x], order=1, mode="mirror"), 0.5)


def mirrored(k):
    """The sample of a tile that stands at an index beyond it."""
    k = np.mod(k, 2 * (TILE - 1))
    return np.where(k < TILE, k, 2 * (TILE - 1) - k)


def draw(folder, side):
    """Write the campaign."""
    drawn_demo.SIZE_PX, drawn_demo.PIXEL_M, drawn_demo.TIMES_S = side, 1.0, np.array([7.0])
    drawn_demo.FOCAL_M *= 14.0
    render.NODES_PX = 400.0
    rng = np.random.default_rng(1)
    truth, plane = drawn_demo.flown(0.0)
    half = 0.75 * side + 300.0
    terrain = relief(
        1,
        plane,
        (-2.0 * half - 9e3, 2.0 * half + 9e3),
        (-2.0 * half - 9e3, 2.0 * half + 9e3),
        90.0,
        150.0,
        120.0,
    )
    at = np.arange(float(TILE))
    now, before = (
        Ground(1, 1.2).draw(at, at, look) for look in (Look(season=0.2, changed=0.06, seed=1), Look())
    )
    places = render.View(truth, truth.C_EK, terrain, plane, Ground(1, 1.2)).places(0)
    model = so3.exp(rng.normal(0.0, PRIOR)) @ truth.C_EK
    campaign = scene.measured(truth, drawn_demo.Errors.draw(drawn_demo.observe(truth), rng), model)
    corner = tuple(float(v[0]) / DEG for v in plane.geodetic(np.array([-half]), np.array([half]))[::-1])
    step = tuple(1.0 / radius / DEG for radius in plane.radii)
    ortho = OrthoPicture(np.ones((8, 8), np.uint8), corner, step, [0.3, 0.3, 1.0], 500.0)
    path = write_imagery(
        folder,
        drawn_demo.replace(campaign, sigma_mounting=PRIOR),
        [np.ones((8, 8), np.uint16)],
        ortho,
        terrain,
        4095,
        C_EK_true=truth.C_EK,
    )
    columns = np.arange(float(side))

    def raw(first, last):
        x, y = places(columns, np.arange(float(first), float(last)))
        bright = seen(now, x, y)
        return np.clip(900.0 + 160.0 * (bright + rng.normal(size=bright.shape) / 40.0), 0, 4095)

    laid = np.clip(110.0 + 36.0 * gaussian_filter(before, 0.5, mode="mirror"), 1, 255).astype(np.uint8)

    def grey(first, last):
        x = np.arange(2 * int(half)) - int(half)
        return laid[np.ix_(mirrored(int(half) - np.arange(first, last)), mirrored(x))]

    strips(folder / "raw_image01.tif", (side, side), "uint16", raw)
    lie = Affine(step[0], 0.0, corner[0] - 0.5 * step[0], 0.0, -step[1], corner[1] + 0.5 * step[1])
    strips(folder / "ortho.tif", (int(2 * half),) * 2, "uint8", grey, crs="EPSG:4326", transform=lie)
    text = (
        path.read_text()
        .replace('"raw_{image_id}.png"', '"raw_{image_id}.tif"')
        .replace('"ortho.png"', '"ortho.tif"')
    )
    path.write_text(text + "\n[measure]\ngrid = [12, 12]\n")


COMMAND = """
import sys, time
from starplumb.cli import main
try:
    main()
finally:
    high = next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]
    print(time.process_time(), int(high) / 1024.0, file=sys.stderr)
"""
"""The memory that Linux notes for a child counts its parent's before it began; this counts its own."""


def measured(path):
    """CPU s, the most memory in MB, and what the command says."""
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, "measure", str(path)], capture_output=True, text=True
    )
    *_, last = done.stderr.splitlines()
    cpu, memory = (float(value) for value in last.split())
    return cpu, memory, done.stdout + done.stderr.removesuffix(last + "\n")


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
    side = int(sys.argv[2]) if len(sys.argv) > 2 else 12000
    if not (folder / "ortho.tif").exists():
        draw(folder, side)
    cpu, memory, said = measured(folder / "campaign.toml")
    print(said)
    print("| side px | CPU s | most memory, MB |\n|---|---|---|")
    print(f"| {side} | {cpu:.1f} | {memory:.0f} |")
