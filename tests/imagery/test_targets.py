"""Lights, discs and crosses: against quadrature, the Cramer-Rao bound and campaigns whose truth is known."""

from __future__ import annotations

import json

import numpy as np
import pytest
from lights import DARK, GAIN, READ, exposed, light, photographed, write_lights
from PIL import Image
from scipy.integrate import dblquad
from world import RawArray

import starplumb as sp
from command import starplumb
from starplumb.imagery.targets.fit import Noise, fitted
from starplumb.imagery.targets.measuring import Sought, targets_of
from starplumb.imagery.targets.profile import picture
from starplumb.imagery.targets.shape import Shape
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC

LIGHT = Shape.light()
TURNED = np.array([[0.8, -0.3], [0.2, 0.9]])
"""Pixels a metre, as a tilted camera has them."""


def test_a_light_is_the_integral_of_its_blur_over_each_pixel():
    at, width = np.array([4.3, 3.8]), 0.6
    ours, _ = picture(at, np.zeros((1, 2)), np.ones(1), width, 9)
    for row, column in ((4, 4), (3, 5), (6, 4), (0, 0)):
        exact, _ = dblquad(
            lambda y, x: (
                np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / (2 * width**2)) / (2 * np.pi * width**2)
            ),
            *(column - 0.5, column + 0.5, row - 0.5, row + 0.5),
        )
        assert ours[row, column] == pytest.approx(exact, abs=1e-9)
    assert ours.sum() == pytest.approx(1.0, abs=1e-6)


def within(shape, length, width):
    """Places (n, 2) spread evenly over a disc or a cross, by a fine lattice."""
    step = length / 400.0
    at = np.arange(-0.5 * length + 0.5 * step, 0.5 * length, step)
    x, y = np.meshgrid(at, at)
    bars = (np.abs(x) < 0.5 * width) | (np.abs(y) < 0.5 * width)
    inside = np.hypot(x, y) < 0.5 * length if shape == "disc" else bars
    return np.stack([x[inside], y[inside]], axis=-1)


@pytest.mark.parametrize(
    ("shape", "length", "width", "blur"),
    [("disc", 2.0, 0.0, 0.5), ("disc", 6.0, 0.0, 0.6), ("cross", 6.0, 1.2, 0.5), ("cross", 3.0, 1.0, 0.7)],
)
def test_a_form_is_the_sum_of_its_places(shape, length, width, blur):
    form = Shape.disc(length) if shape == "disc" else Shape.cross(length, width)
    assert form.part.sum() == pytest.approx(1.0)
    at = np.array([7.2, 6.7])
    ours, _ = picture(at, form.place_m @ TURNED.T, form.part, blur, 15)
    places = at + within(shape, length, width) @ TURNED.T
    edge = (np.arange(16) - 0.5)[:, None]
    from scipy.special import ndtr

    gx, gy = (np.diff(ndtr((edge - places[:, k]) / blur), axis=0) for k in (0, 1))
    exact = gy @ gx.T / len(places)
    np.testing.assert_allclose(ours, exact, atol=2e-3 * exact.max())


def test_derivatives_are_those_of_differences():
    form, at, width, h = Shape.cross(4.0, 1.0), np.array([5.2, 4.9]), 0.7, 1e-5
    offset = form.place_m @ TURNED.T
    _, by = picture(at, offset, form.part, width, 11)
    for k, (dx, dy, dw) in enumerate(h * np.eye(3)):
        there, back = (
            picture(at + s * np.array([dx, dy]), offset, form.part, width + s * dw, 11)[0] for s in (1, -1)
        )
        np.testing.assert_allclose(by[k], (there - back) / (2 * h), atol=1e-8)


def bound(at, strength, width, size=17):
    """Cramer-Rao bound (2, 2) of a light's place: derivatives by differences of the error function's light."""
    h = 1e-5

    def seen(p):
        return p[3] + p[2] * light(size, p[:2], p[4])

    p = np.array([*at, strength, DARK, width])
    J = np.stack([(seen(p + h * e) - seen(p - h * e)).ravel() / (2 * h) for e in np.eye(5)], axis=-1)
    information = J.T @ (J / (READ**2 + 1.0 / 12.0 + GAIN * seen(p)).ravel()[:, None])
    return np.linalg.inv(information)[:2, :2]


@pytest.mark.slow
@pytest.mark.parametrize(("strength", "stated"), [(300.0, True), (3000.0, False)])
def test_places_of_lights_err_by_the_bound_and_their_sigmas_say_so(rng, strength, stated):
    lattice = np.arange(20.0, 360.0, 24.0)
    true = np.stack(np.meshgrid(lattice, lattice), axis=-1).reshape(-1, 2)
    true += rng.uniform(-0.5, 0.5, true.shape)
    raw = RawArray(photographed(rng, (370, 370), true, strength))
    noise = Noise(READ**2 + 1.0 / 12.0, GAIN) if stated else None
    found, told, width = targets_of(raw, Sought(LIGHT, np.eye(2), noise, True, 65535.0))
    good = [target for target in found if not target.why]
    e, z, best = [], [], []
    for target in good:
        off = target.pixel - true
        k = int(np.argmin(np.linalg.norm(off, axis=-1)))
        assert np.abs(off[k]).max() < 0.6
        e.append(off[k])
        z.append(np.linalg.solve(np.linalg.cholesky(target.fit.covariance_px2), off[k]))
        best.append(
            np.linalg.solve(
                np.linalg.cholesky(bound(true[k] - np.rint(true[k]) + 8.0, strength, 0.6)), off[k]
            )
        )
    assert len(good) > 0.97 * len(true)
    # 450 numbers: their rms is known to 3 %
    assert np.sqrt(np.mean(np.square(z))) == pytest.approx(1.0, abs=0.1)
    assert np.sqrt(np.mean(np.square(best))) < 1.12
    if not stated:
        assert told.dn_per_electron == pytest.approx(GAIN, rel=0.25)
        assert told.floor == pytest.approx(READ**2 + GAIN * DARK, rel=0.1)
        assert width == pytest.approx(0.6, abs=0.02)


def test_what_is_no_target_is_told(rng):
    seen = np.full((120, 120), DARK)
    for at in ((30, 30), (30, 80)):
        seen[at[0] - 8 : at[0] + 9, at[1] - 8 : at[1] + 9] += 3000.0 * light(17, np.array([8.1, 7.9]), 0.6)
    seen[80, 20:32] += 900.0  # a streak
    seen[76:93, 72:89] += 90_000.0 * light(17, np.array([8.1, 7.9]), 0.6)
    seen[55:72, 0:12] += 3000.0 * light(17, np.array([13.0, 8.0]), 0.6)[:, 5:]
    raw = RawArray(np.minimum(exposed(rng, seen), 4095.0))
    raw.values[28:33, 85:87] = np.nan
    found, _, _ = targets_of(raw, Sought(LIGHT, np.eye(2), Noise(READ**2, GAIN), True, 4095.0))
    words = {}
    for target in found:
        words.setdefault(target.word, []).append(target.pixel)
    assert len(words[""]) == 2  # that at (30, 30), and that at the border as far as it is inside
    assert pytest.approx(list(min(words[""], key=lambda p: abs(p[0] - 30.0))), abs=0.05) == [30.1, 29.9]
    assert any(abs(p - [80.0, 30.0]).max() < 1.0 for p in words["edge"])
    assert any(abs(p - [80.0, 84.0]).max() < 2.0 for p in words["saturated"])
    assert any(abs(p[1] - 80.0) < 2.0 for p in words["no match"])


def test_a_fit_that_leaves_its_place_is_none(rng):
    window = exposed(rng, np.full((13, 13), DARK) + 5000.0 * light(13, np.array([9.5, 6.0]), 0.6))
    start, noise = np.array([6.0, 6.0]), Noise(READ**2, GAIN)
    assert fitted(window, start, np.zeros((1, 2)), np.ones(1), noise, 0.7) is None


def off_by_sigmas(folder, C_EK_true):
    result = json.loads((folder / "result.json").read_text())
    off = so3.log(np.array(result["mounting"]["matrix"]) @ C_EK_true.T) / ARCSEC
    return off @ np.linalg.solve(np.array(result["covariance_arcsec2"]), off)


@pytest.mark.slow
@pytest.mark.parametrize(("apart", "prior", "table"), [(85, 3.0, "observations"), (45, 25.0, "detections")])
def test_a_campaign_of_lights_is_calibrated(tmp_path, rng, apart, prior, table):
    """Where lights stand closer than the prior tells, they are detections, which calibrate names."""
    C_EK_true = write_lights(tmp_path, rng, apart, prior, images=2, size=230)
    if table == "observations":
        (tmp_path / "image02.png").write_bytes(b"\x89PNG\r\n\x1a\n broken")
    out = tmp_path / "measured"
    done = starplumb("measure", tmp_path / "campaign.toml", "--calibrate", "--no-report")
    assert done.status == 0, done.err
    assert "noise as the images tell it" in done.out
    assert {path.name for path in out.glob("*.csv")} >= {f"{table}.csv", "landmarks.csv"}
    assert off_by_sigmas(out, C_EK_true) < 13.8  # so much by chance once in 300
    document = json.loads((out / "measure.json").read_text())
    used = [c for c in document["candidates"] if c["verdict"] == "used"]
    if table == "observations":
        assert [image["status"] for image in document["images"]] == ["measured", "left out"]
        assert "not a whole PNG" in document["images"][1]["reason"]
        assert {c["landmark_id"][:2] for c in used} == {"L0"}
        assert len(used) >= 6
    else:
        assert len(used) >= 40
        assert used[0]["landmark_id"].startswith("image0")


@pytest.mark.slow
def test_the_page_shows_targets_with_their_names(tmp_path, rng):
    write_lights(tmp_path, rng, 60, 3.0, images=1, size=70)
    page = sp.measure(tmp_path / "campaign.toml").report()
    assert "L0-0" in page
    assert "the reference as it was predicted" in page


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            'kind = "points"',
            'kind = "points"\nshape = "disc"',
            "size_m: found no numbers, wanted the diameter",
        ),
        (
            'kind = "points"',
            'kind = "points"\nsize_m = 3.0',
            "size_m: found 1 numbers, wanted no size of a light",
        ),
        ('kind = "points"', 'kind = "points"\nshape = "cross"\nsize_m = [1.0, 2.0]', "longer than wide"),
        ('["lights.csv"]', '["lights.csv", "more.csv"]', "found 2 files, wanted one table"),
        ('["lights.csv"]', '["none.csv"]', "none.csv"),
        ("saturation_dn", "read_noise_dn = 4.0\nsaturation_dn", "imagery.dn_per_electron: missing"),
        ("sigma_m = 0.3", "", "sigma"),
    ],
)
def test_what_is_wrong_with_targets_is_one_sentence(tmp_path_factory, rng, old, new, said):
    folder = tmp_path_factory.mktemp("lights")
    write_lights(folder, rng, 60, 3.0, images=1, size=70)
    path = folder / "campaign.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    done = starplumb("measure", path)
    assert done.status == 2
    assert said in done.err, done.err
    assert len(done.err.strip().splitlines()) == 1
    assert not (folder / "measured").exists()


@pytest.mark.slow
def test_an_image_without_targets_is_left_out(tmp_path, rng):
    write_lights(tmp_path, rng, 60, 3.0, images=1, size=70)
    Image.fromarray(exposed(rng, np.full((70, 70), DARK)).astype(np.uint16)).save(tmp_path / "image01.png")
    done = starplumb("measure", tmp_path / "campaign.toml")
    assert done.status == 3
    assert "no target is found in it" in done.err
