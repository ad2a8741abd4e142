"""The small world as files that need no extra: PNG, a world file, an Esri ASCII grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from PIL import Image
from world import hills, world

from starplumb.imagery.scene import geodetic
from starplumb.io.campaign.write import write_campaign
from starplumb.physics.units import ARCSEC, DEG

SECTIONS = """
[images]
file = "images.csv"
[imagery]
files = "raw/{image_id}.png"
saturation_dn = 4095

[reference]
files = ["ortho_*.png"]
crs = "EPSG:4326"
dem = "dem.asc"
heights = "ellipsoidal"
sigma_m = [0.1, 0.1, 0.5]
correlation_length_m = 300.0

[measure]
grid = [4, 4]
"""
STEP = 2.2 / 111_195.0


def place_of(scene, C_EK, image, size):
    """Latitudes and longitudes, deg, (2, 2) from least to most of the ground of an image with some around it."""
    corners = np.array(
        [[-90.0, -90.0], [size + 90.0, -90.0], [-90.0, size + 90.0], [size + 90.0, size + 90.0]]
    )
    if scene.campaign.camera.scans:
        corners = np.clip(corners, 0.0, size - 1.0)
    at = np.array(geodetic(scene.ground(C_EK, image, corners))) / DEG
    margin = 0.004 if scene.campaign.camera.scans else 0.001
    return np.stack([at.min(axis=1) - margin, at.max(axis=1) + margin], axis=-1)


def write_world(folder, rng, kind="frame", size=240):
    """A campaign of one image of the world with everything that measuring reads; the scene and its rotations."""
    scene, rotations = world(rng, kind, images=1, size=size, attitude_px=1.0)
    c = scene.campaign
    c = replace(
        c, sigma_mounting=np.full(3, 20.0 * 9e-6 / 2.2), cov_attitude_E=np.eye(3) * (2.0 * ARCSEC) ** 2
    )
    write_campaign(folder, c)
    (folder / "raw").mkdir()
    for name, raw in zip(c.images.ids, scene.raws, strict=True):
        values = np.clip(np.rint(raw.values), 0, 4095).astype(np.uint16)
        Image.fromarray(values).save(folder / "raw" / f"{name}.png")
    (south, north), (west, east) = place_of(scene, c.C_EK, 0, size)
    step_x = STEP / np.cos(south * DEG)
    latitude, longitude = np.arange(north, south, -STEP), np.arange(west, east, step_x)
    grid = np.meshgrid(latitude * DEG, longitude * DEG, indexing="ij")
    bright = scene.reference.sample(*grid, 0.0)
    ortho = np.clip(np.rint(120.0 + 40.0 * bright), 1, 255).astype(np.uint8)
    # two tiles that meet in the middle
    middle = longitude.size // 2
    for k, part in enumerate((slice(0, middle), slice(middle, None))):
        Image.fromarray(ortho[:, part]).save(folder / f"ortho_{k}.png")
        world_file = [step_x, 0.0, 0.0, -STEP, longitude[part][0], latitude[0]]
        (folder / f"ortho_{k}.pgw").write_text("".join(f"{x!r}\n" for x in map(float, world_file)))
    write_dem(folder / "dem.asc", (south, north), (west, east))
    text = (folder / "campaign.toml").read_text().split("[landmarks]")[0]
    (folder / "campaign.toml").write_text(text + SECTIONS)
    for name in ("landmarks.csv", "observations.csv"):
        (folder / name).unlink()
    return replace(scene, campaign=c), rotations


def write_dem(path, latitudes, longitudes, step=3e-4):
    rows = int(np.ceil((latitudes[1] - latitudes[0]) / step)) + 3
    columns = int(np.ceil((longitudes[1] - longitudes[0]) / step)) + 3
    south, west = float(latitudes[0]) - step, float(longitudes[0]) - step
    latitude = south + step * np.arange(rows)[::-1]
    longitude = west + step * np.arange(columns)
    height = hills(*np.meshgrid(latitude * DEG, longitude * DEG, indexing="ij"))
    head = f"ncols {columns}\nnrows {rows}\nxllcenter {west!r}\nyllcenter {south!r}\ncellsize {step!r}\n"
    head += "nodata_value -9999\n"
    body = "\n".join(" ".join(f"{h:.3f}" for h in row) for row in height)
    path.write_text(f"{head}{body}\n")
