"""Images that cannot be measured: what is said of each, and that the others go on."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from world import RawArray, world

from starplumb.imagery.chain import Wanted, measure_images
from starplumb.imagery.coarse import coarse_images
from starplumb.io.imagery import scene
from starplumb.io.imagery.config import ImageryConfig
from starplumb.io.imagery.ortho import Tile
from starplumb.io.imagery.overlaps import require_agreement
from starplumb.io.imagery.rasters import open_pixels
from starplumb.io.imagery.scene import Unread, _raws
from starplumb.physics.camera import FrameCamera
from starplumb.physics.errors import InputError
from starplumb.plan.demo import demo

PIXEL = 9e-6 / 2.2
SMALL = Wanted(grid=(2, 2))
PRIOR = np.diag((PIXEL * np.array([12.0, 12.0, 30.0])) ** 2)
OWN = np.diag((PIXEL * np.array([2.0, 2.0, 4.0])) ** 2)


def small_world(rng, images=1):
    return world(rng, images=images, size=150, attitude_px=1.0)[0]


def reasons(scene):
    return [image.reason for image in measure_images(scene, PRIOR, OWN, SMALL)]


@dataclass(frozen=True)
class Broken:
    """A raw image whose file breaks off."""

    size_px: tuple[int, int]

    def window(self, column, row, columns, rows):
        raise InputError("raw/b.tif: found pixels that cannot be read, wanted a whole file (copy it anew)")


@pytest.mark.slow
def test_a_file_that_breaks_off_leaves_its_image_out_and_no_other(rng):
    scene = small_world(rng, 2)
    alone, _ = measure_images(scene, PRIOR, OWN, SMALL)
    one, other = measure_images(replace(scene, raws=(scene.raws[0], Broken((150, 150)))), PRIOR, OWN, SMALL)
    assert "raw/b.tif: found pixels that cannot be read" in other.reason
    assert not one.reason
    assert len(one.used) == len(alone.used) >= 2


@pytest.mark.slow
def test_an_image_smaller_than_a_chip_is_told(rng):
    (image,) = measure_images(small_world(rng), PRIOR, OWN, Wanted(chip_px=140))
    assert image.reason == "its 150 x 150 pixels have no room for chips of 140 px (measure.chip_px)"


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda a: np.where(np.arange(150) < 140, np.nan, a), "93 % of its pixels have no data"),
        (lambda a: 0.0 * a + 7.0, "all of its pixels have the value 7"),
        (lambda a: np.where(np.arange(150) < 140, 4095.0, a), "93 % of its pixels are full"),
        (lambda a: a, ""),
    ],
)
def test_an_image_that_shows_nothing_is_told_before_it_is_looked_for(rng, spoil, said):
    scene = replace(small_world(rng), saturation_dn=4095.0)
    scene = replace(scene, raws=(RawArray(spoil(scene.raws[0].values)),))
    (found,) = coarse_images(scene, 2)
    assert found.unfit.startswith(said)
    assert bool(found.unfit) == bool(said)
    assert np.any(found.orientation) == (not said)


ORDERS = {
    "mirrored left to right": lambda a: a[:, ::-1],
    "mirrored top to bottom": lambda a: a[::-1],
    "turned by -90 deg": lambda a: np.rot90(a),
}
"""What it is to a reader who looks for what undoes it."""


@pytest.mark.slow
@pytest.mark.parametrize("order", ORDERS)
def test_pixels_in_another_order_are_told(rng, order):
    scene = small_world(rng)
    turned = np.ascontiguousarray(ORDERS[order](scene.raws[0].values))
    (said,) = reasons(replace(scene, raws=(RawArray(turned),)))
    assert said.startswith(f"{order} it is found")


@pytest.mark.slow
def test_ground_without_heights_or_without_reference_is_told(rng):
    scene = small_world(rng)

    class Nothing:
        def sample(self, latitude, longitude, spacing_m):
            return np.full(latitude.shape, np.nan)

    (said,) = reasons(replace(scene, reference=Nothing()))
    assert "the orthoimage (reference.files) covers none of the ground where it looks" in said
    (said,) = reasons(replace(scene, height_at=lambda latitude, _: np.full(latitude.shape, np.nan)))
    assert "the heights (reference.dem) cover none of the ground where it looks" in said


def test_a_raw_image_that_cannot_be_used_is_kept_among_others_and_refused_alone(tmp_path, rng):
    campaign = replace(demo("frame", 2, 3)[0], camera=FrameCamera(2.2, 9e-6, (19.5, 14.5), (40, 30)))
    one, other = tmp_path / "a.png", tmp_path / "b.png"
    Image.fromarray(rng.integers(0, 255, (30, 40)).astype(np.uint8)).save(one)
    config = ImageryConfig(files="{image_id}.png")
    for spoil, said in (
        (lambda: other.write_bytes(one.read_bytes()[:200]), "not a whole PNG"),
        (lambda: Image.fromarray(np.zeros((40, 30), np.uint8)).save(other), "is it transposed?"),
        (lambda: (other.write_bytes(one.read_bytes()), _world(other)), "georeferenced"),
    ):
        spoil()
        good, bad = _raws("c.toml", [one, other], campaign, config)
        assert good.size_px == (40, 30)
        assert isinstance(bad, Unread)
        assert said in bad.why
        assert str(other) in bad.why
        with pytest.raises(InputError, match=r"^c\.toml: imagery\.files: .*b\.png"):
            _raws("c.toml", [other, other], campaign, config)


def _world(path, west=12.0):
    numbers = (3e-5, 0.0, 0.0, -2e-5, west, 50.0)
    path.with_suffix(".pgw").write_text("".join(f"{x!r}\n" for x in numbers))


def test_tiles_that_overlap_must_show_the_same_ground(tmp_path, rng):
    ground = rng.integers(60, 200, (200, 260)).astype(np.uint8)

    def tile(name, values, west):
        path = tmp_path / name
        Image.fromarray(values).save(path)
        _world(path, west)
        return Tile.of(open_pixels(path, 1), "EPSG:4326", None)

    one = tile("one.png", ground[:, :160], 12.0)
    dull = np.rint(20.0 + 0.6 * ground[:, 60:]).astype(np.uint8)
    require_agreement([one, tile("two.png", dull, 12.0 + 60 * 3e-5)])
    apart = tile("three.png", ground[::-1], 12.0 + 160 * 3e-5)
    require_agreement([one, apart])
    wrong = tile("four.png", ground[:, 60:], 12.0 + 57 * 3e-5)
    with pytest.raises(InputError, match=r"four\.png: found other ground than .*one\.png shows"):
        require_agreement([one, apart, wrong])


@pytest.mark.slow
def test_tiles_in_several_reference_systems_are_one_orthoimage(tmp_path, rng):
    """The same ground in two zones: each where pyproj has it, and they agree where they overlap."""
    rasterio = pytest.importorskip("rasterio")
    pyproj = pytest.importorskip("pyproj")
    from scipy.ndimage import gaussian_filter, map_coordinates

    def bright(longitude, latitude):
        return map_coordinates(cells, [(latitude - 49.99) / 4e-5, (longitude - 11.99) / 6e-5], order=1)

    cells = 120.0 + 200.0 * gaussian_filter(rng.normal(size=(600, 600)), 3.0)
    tiles = []
    for zone, west in ((32632, -400.0), (32633, -100.0)):
        way = pyproj.Transformer.from_crs("EPSG:4326", f"EPSG:{zone}", always_xy=True)
        x0, y0 = way.transform(12.0, 50.0)
        x, y = x0 + west + 5.0 * np.arange(100), y0 + 250.0 - 5.0 * np.arange(100)
        longitude, latitude = way.transform(*np.meshgrid(x, y), direction="INVERSE")
        transform = rasterio.Affine(5.0, 0.0, x[0] - 2.5, 0.0, -5.0, y[0] + 2.5)
        profile = {"driver": "GTiff", "width": 100, "height": 100, "count": 1, "dtype": "float32"}
        path = tmp_path / f"{zone}.tif"
        with rasterio.open(path, "w", transform=transform, crs=f"EPSG:{zone}", **profile) as file:
            file.write(bright(longitude, latitude).astype(np.float32), 1)
        tiles.append(Tile.of(open_pixels(path, 1), None, None))
    require_agreement(tiles)
    at = np.meshgrid(50.0 + 3e-5 * np.arange(-20, 20), 12.0 + 5e-5 * np.arange(-15, 15), indexing="ij")
    for tile in tiles:
        sampled = tile.sample(*np.deg2rad(at), 5.0)
        assert np.nanmax(np.abs(sampled - bright(at[1], at[0]))) < 3.0
        assert np.isfinite(sampled).mean() > 0.3


def test_orthoimages_of_pngs_that_would_fill_the_memory_are_refused(tmp_path, monkeypatch):
    """They are held whole, all of them."""
    for name in "ab":
        Image.fromarray(np.ones((40, 50), dtype=np.uint8)).save(tmp_path / f"{name}.png")
        (tmp_path / f"{name}.pgw").write_text("1e-5\n0\n0\n-1e-5\n9\n45\n")
    reference = SimpleNamespace(files=("*.png",), band=1, crs="EPSG:4326", nodata=None)
    paths = scene.reference_paths("c.toml", tmp_path, reference)
    monkeypatch.setattr(scene, "MOST_PNG", 2 * 4000)
    assert len(list(scene._tiles("c.toml", paths, reference))) == 2
    monkeypatch.setattr(scene, "MOST_PNG", 2 * 3999)
    with pytest.raises(InputError, match=r"c\.toml: reference\.files: found PNGs of more than 3,999 pixels"):
        list(scene._tiles("c.toml", paths, reference))


def test_a_pattern_that_is_looked_for_along_every_way_is_refused(tmp_path):
    reference = SimpleNamespace(files=("**/**/*.png",))
    with pytest.raises(
        InputError, match=r'reference\.files: found "\*\*/\*\*/\*\.png", wanted \*\* once at most'
    ):
        scene.reference_paths("c.toml", tmp_path, reference)
