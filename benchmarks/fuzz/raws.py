"""What ``starplumb measure`` reads: raw images, an orthoimage's tiles with their world files, heights, its sections."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from damage import BINARY, PLAIN, hashed, packed
from products import raster
from target import Target

CHIPS = b"""[reference]
kind = "chips"
files = ["."]
"""
COLUMNS, ROWS = 40, 30
STEP = 2e-5
WORLD = f"{STEP}\n0.0\n0.0\n-{STEP}\n9.0\n45.0\n"
PNG = (*BINARY, packed)


def png(values: Any) -> bytes:
    import io

    from PIL import Image

    sink = io.BytesIO()
    Image.fromarray(values).save(sink, "PNG")
    return sink.getvalue()


def _files() -> dict[str, bytes]:
    """A campaign of one image with everything that measuring reads."""
    from on_disk import SECTIONS

    from starplumb.io.campaign.write import write_campaign
    from starplumb.physics.camera import FrameCamera
    from starplumb.plan.demo import demo

    rng = np.random.default_rng(5)
    campaign, _ = demo("frame", 1, 3)
    camera = FrameCamera(2.2, 9e-6, (19.5, 14.5), (COLUMNS, ROWS))
    with TemporaryDirectory() as name:
        folder = Path(name)
        write_campaign(folder, replace(campaign, camera=camera, sigma_mounting=np.full(3, 1e-4)))
        files = {path.name: path.read_bytes() for path in folder.iterdir()}
    head = files["campaign.toml"].split(b"[landmarks]")[0]
    files = {name: files[name] for name in ("images.csv", "attitude.csv", "ephemeris.csv")}
    raw = rng.integers(0, 4096, (ROWS, COLUMNS)).astype(np.uint16)
    ortho = rng.integers(1, 256, (ROWS, COLUMNS)).astype(np.uint8)
    heights = "\n".join(" ".join(f"{i + j / 2}" for j in range(9)) for i in range(8))
    dem = "ncols 9\nnrows 8\nxllcenter 8.9999\nyllcenter 44.999\ncellsize 0.0003\nNODATA_value -9999\n"
    return files | {
        "campaign.toml": head + SECTIONS.replace("raw/", "raw_").encode(),
        f"raw_{campaign.images.ids[0]}.png": png(raw),
        "ortho_0.png": png(ortho),
        "ortho_0.pgw": WORLD.encode(),
        "dem.asc": f"{dem}{heights}\n".encode(),
    }


def _read(folder: Path) -> Any:
    """What measuring takes out of the files: the raw image, the reference and heights around some places."""
    from starplumb.io.campaign.read import load_images
    from starplumb.io.imagery.scene import open_scene
    from starplumb.physics.errors import InputError
    from starplumb.physics.units import DEG

    path = folder / "campaign.toml"
    loaded = load_images(path)
    config = loaded.config
    if config.imagery is None or config.reference is None:
        raise InputError(f"{path}: no imagery")
    scene = open_scene(str(path), loaded.campaign, loaded.folder, config.imagery, config.reference)
    row, column = np.meshgrid(np.arange(3.0, 25.0), np.arange(3.0, 35.0), indexing="ij")
    latitude, longitude = (45.0 - STEP * row) * DEG, (9.0 + STEP * column) * DEG
    return (
        scene.raws[0].window(-2, 3, 50, 20),
        scene.reference.sample(latitude, longitude, 2.0),
        scene.height_at(latitude.ravel(), longitude.ravel()),
    )


def _library(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """The same campaign with a chip of its orthoimage in place of it."""
    from starplumb.imagery.scene import Scene
    from starplumb.io.imagery.cutting import Cut, write_library
    from starplumb.io.imagery.ortho import Ortho, Tile
    from starplumb.io.imagery.rasters import open_pixels
    from starplumb.physics.earth import geodetic_to_itrf
    from starplumb.physics.units import DEG

    with TemporaryDirectory() as name:
        folder = Path(name)
        for each in ("ortho_0.png", "ortho_0.pgw"):
            (folder / each).write_bytes(files[each])
        tile = Tile.of(open_pixels(folder / "ortho_0.png", 1), "EPSG:4326", None)
        scene = Scene(None, (), Ortho([tile]), lambda latitude, longitude: 10.0 + 1e4 * latitude, 30.0)
        place = geodetic_to_itrf((45.0 - 15 * STEP) * DEG, (9.0 + 20 * STEP) * DEG, 7860.0)
        write_library(folder / "lib", scene, Cut(place[None], np.array([27.0]), (0.5, 0.5, 3.0), 300.0))
        cut = {path.name: path.read_bytes() for path in (folder / "lib").iterdir()}
    toml = files["campaign.toml"].split(b"[reference]")[0] + CHIPS
    kept = {each: data for each, data in files.items() if not each.startswith(("ortho_", "dem"))}
    return kept | cut | {"campaign.toml": toml}


def _read_library(folder: Path) -> Any:
    """What measuring takes out of a library: its landmarks, and brightness and heights around a place."""
    from starplumb.io.campaign.read import load_images
    from starplumb.physics.units import DEG
    from starplumb.session.imagery.library import open_library

    path = folder / "campaign.toml"
    loaded, scene = open_library(str(path), load_images(path))
    row, column = np.meshgrid(np.arange(8.0, 22.0), np.arange(12.0, 28.0), indexing="ij")
    latitude, longitude = (45.0 - STEP * row) * DEG, (9.0 + STEP * column) * DEG
    landmarks = loaded.campaign.landmarks
    return (
        landmarks.r_J,
        landmarks.covariance_J,
        scene.reference.sample(latitude, longitude, 2.0),
        scene.height_at(latitude.ravel(), longitude.ravel()),
    )


def _georeferenced(files: Mapping[str, bytes]) -> Iterator[Target]:
    """The same by GDAL."""
    import rasterio

    turn = rasterio.Affine(STEP, 0.0, 9.0, 0.0, -STEP, 45.0)
    rng = np.random.default_rng(6)
    ortho = raster(rng.integers(1, 256, (ROWS, COLUMNS)).astype(np.uint8), crs="EPSG:4326", transform=turn)
    raw = raster(rng.integers(0, 4096, (ROWS, COLUMNS)).astype(np.uint16))
    toml = files["campaign.toml"].replace(b"_{image_id}.png", b"_{image_id}.tif").replace(b"*.png", b"*.tif")
    image = next(name for name in files if name.startswith("raw_")).replace(".png", ".tif")
    kept = {name: data for name, data in files.items() if not name.endswith((".png", ".pgw"))}
    found = kept | {"campaign.toml": toml, image: raw, "ortho_0.tif": ortho}
    yield Target("measure, raw TIFF", found, (image,), _read, BINARY, ())
    yield Target("measure, ortho TIFF", found, ("ortho_0.tif",), _read, BINARY, ())


def raws() -> Iterator[Target]:
    """All of them."""
    files = _files()
    image = next(name for name in files if name.startswith("raw_"))
    texts = (
        ("measure, campaign.toml", "campaign.toml", (*PLAIN, hashed)),
        ("measure, world file", "ortho_0.pgw", PLAIN[:1]),
        ("measure, ASCII grid", "dem.asc", PLAIN[:1]),
    )
    for name, file, same in texts:
        yield Target(name, files, (file,), _read, same=same)
    yield Target("measure, raw PNG", files, (image,), _read, PNG, ())
    yield Target("measure, ortho PNG", files, ("ortho_0.png",), _read, PNG, ())
    cut = _library(files)
    yield Target("measure, chips.csv", cut, ("chips.csv",), _read_library)
    yield from _georeferenced(files)
