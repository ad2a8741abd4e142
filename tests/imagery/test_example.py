"""The example of ``starplumb init --imagery``: its files lie where its truth says, and it is what its parts are."""

from __future__ import annotations

import numpy as np
import pytest

from command import starplumb
from starplumb.ground.grid import Terrain
from starplumb.imagery.drawn.ground import Ground, Look
from starplumb.imagery.drawn.sheet import Sheet
from starplumb.imagery.scene import geodetic
from starplumb.io.campaign.read import load_images
from starplumb.io.drawn.write import ascii_grid
from starplumb.io.imagery.relief import read_ascii_grid
from starplumb.io.imagery.scene import open_scene
from starplumb.physics import so3
from starplumb.plan import drawn_demo
from starplumb.session.imagery.example import write_drawn_example

SIZE = 150


@pytest.fixture
def small(monkeypatch):
    """The example with images a third as wide."""
    monkeypatch.setattr(drawn_demo, "SIZE_PX", SIZE)
    monkeypatch.setattr(drawn_demo, "REACH_M", 1900.0)
    monkeypatch.setattr(drawn_demo, "EDGE_M", 4000.0)
    monkeypatch.setattr(drawn_demo, "CLOUD", (0.0, 0.0, 0.0, 0.3))


def alike(scene, C_EK, image):
    """Correlation of a raw image with the orthoimage at the ground that its pixels see."""
    at = np.arange(4.0, SIZE - 4.0, 4.0)
    pixel = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    p_J = scene.ground(C_EK, image, pixel)
    seen = scene.reference.sample(*(v.reshape(at.size, -1) for v in geodetic(p_J)), drawn_demo.PIXEL_M)
    raw = scene.raws[image].window(0, 0, SIZE, SIZE)[4:-4:4, 4:-4:4]
    known = np.isfinite(seen)
    assert known.mean() > 0.9
    return np.corrcoef(seen[known], raw[known])[0, 1]


@pytest.mark.slow
def test_the_raw_images_show_the_reference_through_the_true_mounting(small, tmp_path):
    path, count = write_drawn_example(tmp_path / "photos", 3)
    loaded = load_images(path)
    config = loaded.config
    scene = open_scene(str(path), loaded.campaign, loaded.folder, config.imagery, config.reference)
    quaternion = np.array(config.truth.quaternion_xyzw)
    C_EK_true = so3.from_quaternion(quaternion)
    assert count == len(scene.raws) == 4
    true, model = ([alike(scene, C, k) for k in range(2)] for C in (C_EK_true, loaded.campaign.C_EK))
    assert min(true) > 0.75
    assert max(model) < 0.5
    # the wrong way round, the truth would be no better than the model
    off = so3.log(loaded.campaign.C_EK @ C_EK_true.T)
    assert alike(scene, so3.exp(off) @ loaded.campaign.C_EK, 0) < 0.5
    # so many sigmas, of three, a normal law exceeds once in ten thousand
    assert np.abs(off / drawn_demo.SIGMA_MOUNTING).max() < 4.0
    cloudy = scene.raws[3].window(0, 0, SIZE, SIZE)
    assert np.mean(cloudy > 1400.0) == pytest.approx(0.3, abs=0.06)
    assert sum(file.stat().st_size for file in path.parent.iterdir()) < 15e6


@pytest.mark.parametrize("other", [["--camera", "line-scan"], ["--images", "3"], ["--template"]])
def test_the_example_of_images_has_no_other_options(tmp_path, other):
    done = starplumb("init", tmp_path / "photos", "--imagery", *other)
    assert done.status == 2
    assert f"--imagery: found {other[0]} beside it" in done.err
    assert not (tmp_path / "photos").exists()


def test_a_sheet_is_the_ground_as_far_as_it_reaches():
    ground, look = Ground(5, 2.0), Look(season=0.3, changed=0.1, seed=2)
    sheet = Sheet.of(ground, 90.0, look, 1.0)
    x, y = 2.0 * np.arange(-31.0, 12.0), 2.0 * np.arange(-3.0, 44.0)
    np.testing.assert_array_equal(sheet.draw(x, y), ground.draw(x, y, look))
    with pytest.raises(ValueError, match="reach"):
        sheet.draw(x - 40.0, y)
    with pytest.raises(ValueError, match="reach"):
        sheet.draw(x, y + 10.0)


def test_heights_as_an_ascii_grid_lie_where_they_did(tmp_path, rng):
    height = rng.uniform(-50.0, 3000.0, (5, 7))
    height[2, 3] = np.nan
    terrain = Terrain(height, 0.4, -0.2, (-3e-6, 5e-6))
    place = tmp_path / "dem.asc"
    place.write_text(ascii_grid(terrain))
    again = read_ascii_grid(place)
    np.testing.assert_allclose(again.height, height, atol=0.005)
    np.testing.assert_allclose([again.latitude, again.longitude, *again.step], [0.4, -0.2, -3e-6, 5e-6])
    rasterio = pytest.importorskip("rasterio")
    with rasterio.open(place) as raster:
        t = raster.transform
        middle = (t.c + t.a / 2.0, t.f + t.e / 2.0)  # of the first pixel
        assert middle == pytest.approx((np.rad2deg(-0.2), np.rad2deg(0.4)), abs=1e-9)
        assert raster.read(1)[2, 3] == -9999.0
