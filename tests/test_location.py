"""A place on the ground: whose mounting it is located with, and its covariance on ground that slopes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import erfa
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import starplumb as sp
from command import starplumb
from helpers import ATTITUDE, CAMPAIGN, write_good_campaign
from starplumb.ground.terrain import slopes
from starplumb.physics.units import ARCSEC
from starplumb.session.ground.location import place, view_of

SHARED = CAMPAIGN.replace("sigma_m = 3.0", 'sigma_m = 3.0\nshared_by = "image"').replace(
    "sigma_arcsec = [5.0, 5.0, 12.0]", 'sigma_arcsec = [5.0, 5.0, 12.0]\nshared_by = "image"'
)
AT = {"image": "I1", "column": 6000, "row": 2000}


@pytest.fixture
def calibrated(tmp_path: Path) -> Path:
    """The folder of a campaign with the result that ``calibrate`` leaves beside it."""
    path = write_good_campaign(tmp_path, campaign=SHARED)
    result = sp.calibrate(sp.read_campaign(path), method="gls")
    assert result.status == "ok", result.message
    result.save(tmp_path / "result", report=False)
    return tmp_path


def edit(folder: Path, change) -> None:
    """The result beside the campaign with ``change`` made to its document."""
    path = folder / "result" / "result.json"
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


def located(folder: Path, result=None):
    return sp.locate(sp.read_campaign(folder / "campaign.toml"), result, **AT)


# Whose mounting ------------------------------------------------------------------------------------------------


def test_the_result_beside_the_campaign_is_used(calibrated):
    named = located(calibrated, calibrated / "result" / "result.json")
    assert located(calibrated).document == named.document
    assert named.document["mounting"] == "result.json, gls"
    model = located(calibrated, "model")
    assert model.document["mounting"].startswith("model")
    # the correction is 2 arcsec about the boresight, at 4000 px of 2.8 m
    assert 0.05 < np.linalg.norm(np.subtract(model.document["itrf_m"], named.document["itrf_m"])) < 5.0


def test_the_model_is_used_where_there_is_no_result(tmp_path):
    write_good_campaign(tmp_path)
    place = located(tmp_path)
    assert place.document == located(tmp_path, "model").document
    assert place.notices == ()
    assert place.covariance_east_north_up_m2 is None
    assert "sigma not stated: the error of the model mounting is not stated" in repr(place)
    stated = CAMPAIGN.replace('to = "star_tracker"\nq', 'to = "star_tracker"\nsigma_arcsec = 100.0\nq')
    write_good_campaign(tmp_path, campaign=stated)
    # 100 arcsec about x and y at 680 km
    sigma = located(tmp_path).document["sigma_east_north_up_m"]
    assert sigma[:2] == pytest.approx([100 * ARCSEC * 680e3] * 2, rel=0.02)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            lambda d: d.update(status="refuted"),
            "status: found 'refuted', wanted a result whose mounting may be used",
        ),
        (lambda d: d.update(status="singular"), "status: found 'singular'"),
        (lambda d: d.update(covariance_arcsec2=None, sigma_arcsec=None), "covariance_arcsec2: found null"),
        (lambda d: d.update(schema="other"), 'schema: found "other"'),
        (
            lambda d: d["mounting"].update({"to": "body"}),
            "mounting: found camera to body, wanted",
        ),
        (lambda d: d["mounting"].update(matrix="none"), "mounting.matrix"),
    ],
)
def test_what_must_not_be_used_is_not_and_refused_where_it_is_named(calibrated, change, says):
    edit(calibrated, change)
    used = located(calibrated)
    assert used.document["mounting"].startswith("model")
    assert len(used.notices) == 1
    assert says in used.notices[0]
    assert used.notices[0].endswith("it is not used, the mounting is the model's")
    with pytest.raises(sp.InputError) as refused:
        located(calibrated, calibrated / "result" / "result.json")
    assert says in str(refused.value)


def test_a_result_of_other_inputs_is_stale(calibrated):
    images = calibrated / "images.csv"
    images.write_text(images.read_text() + "I3,2020-01-01T00:00:02.700\n")
    used = located(calibrated)
    assert used.document["mounting"].startswith("model")
    assert (
        "result.json: not used, because images.csv changed since; the mounting is the model's"
        in used.notices[0]
    )
    named = located(calibrated, calibrated / "result" / "result.json")
    assert named.document["mounting"] == "result.json, gls"
    assert (
        "made from other inputs than this campaign's (images.csv differ), used as asked" in named.notices[0]
    )
    told = starplumb("locate", calibrated / "campaign.toml", 6000, 2000, "--image", "I3")
    assert (told.status, told.err.count("result.json")) == (0, 1)
    assert "images.csv changed since" in told.err
    assert "(mounting: model, its own error not stated)" in told.out


def test_a_result_in_hand_is_held_against_the_campaign_too(calibrated):
    campaign = sp.read_campaign(calibrated / "campaign.toml")
    result = sp.calibrate(campaign, method="gls")
    assert sp.locate(campaign, result, **AT).notices == ()
    (calibrated / "images.csv").write_text(
        (calibrated / "images.csv").read_text() + "I3,2020-01-01T00:00:02.700\n"
    )
    assert "the result: made from other inputs" in located(calibrated, result).notices[0]
    silent = sp.calibrate(campaign, method="wahba")
    with pytest.raises(
        sp.InputError, match="the result: covariance_arcsec2: found null, wanted a result that states"
    ):
        sp.locate(campaign, silent, **AT)


def test_a_weak_answer_is_as_good_as_its_interval(calibrated):
    """An interval of three times 1.96 sigma about every axis: nine times the mounting's share of the covariance."""
    named = calibrated / "result" / "result.json"
    ok, model = located(calibrated, named), json.loads(named.read_text())
    sigma = np.array(model["sigma_arcsec"])
    edit(
        calibrated,
        lambda d: d.update(covariance_arcsec2=(1e-12 * np.eye(3)).tolist(), sigma_arcsec=[1e-6] * 3),
    )
    alone = located(calibrated, named)
    edit(
        calibrated,
        lambda d: d.update(model, status="weak", interval_95_arcsec=(3 * 1.959964 * sigma).tolist()),
    )
    weak = located(calibrated, named)
    share = ok.covariance_east_north_up_m2 - alone.covariance_east_north_up_m2
    wanted = alone.covariance_east_north_up_m2 + 9.0 * share
    np.testing.assert_allclose(weak.covariance_east_north_up_m2, wanted, rtol=1e-4, atol=1e-6)
    assert "weak: its sigma widened as its 95 % interval" in weak.document["mounting"]


@pytest.mark.parametrize("text", ['{"schema": 1, "schema": 1}', '{"mounting": {"to": 1, "to": 1}}'])
def test_a_key_that_stands_twice_is_refused(calibrated, text):
    path = calibrated / "other.json"
    path.write_text(text)
    with pytest.raises(sp.InputError, match=r'the key "(schema|to)" stands twice in one object'):
        located(calibrated, path)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda d: d.pop("software"), "software: missing"),
        (lambda d: d["mounting"].pop("quaternion_xyzw"), "mounting.quaternion_xyzw: missing"),
        (lambda d: d["fit"].pop("chi2_p"), "fit.chi2_p: missing"),
        (lambda d: d["fit"].update(images="3"), 'fit.images: found "3"'),
        (lambda d: d["sigma_arcsec"].__setitem__(0, "1.0"), 'sigma_arcsec.0: found "1.0"'),
        (lambda d: d["mounting"]["matrix"][0].__setitem__(0, True), "mounting.matrix.0.0: found true"),
    ],
)
def test_keys_of_the_contract_and_their_types_are_wanted(calibrated, change, says):
    edit(calibrated, change)
    with pytest.raises(sp.InputError) as refused:
        located(calibrated, calibrated / "result" / "result.json")
    assert says in str(refused.value)


# Ground that slopes --------------------------------------------------------------------------------------------

TILT = Rotation.from_rotvec([np.deg2rad(-25.0), 0.0, 0.0])
"""About E's x: the camera of the campaign by hand looks 25 deg away from the nadir, to the north or the south."""
TILTED = (TILT * Rotation.from_quat([0.5, 0.5, -0.5, 0.5])).as_quat()
EAST, NORTH = 0.15, -0.25
"""How the plane rises, m per m."""
RADIUS = 6378137.0
NO_LIGHT = "\n[corrections]\nlight_time = false\naberration = false\n"


def plane(middle):
    """Heights of a plane through a place (rad) that rises by EAST and NORTH, in metres of the equator's sphere."""

    def height(latitude, longitude):
        north = (
            (latitude - middle[0]) * RADIUS * (1 - 1 / 298.257223563) ** 2
        )  # radius of the meridian at the equator
        east = (longitude - middle[1]) * RADIUS
        return 300.0 + EAST * east + NORTH * north

    return SimpleNamespace(dem=SimpleNamespace(path="dem.tif", step_m=30.0), at=height)


def tilted_view(folder: Path):
    row = ",".join(map(repr, TILTED.tolist()))
    attitude = ATTITUDE.replace("0.5,0.5,-0.5,0.5", row)
    toml = CAMPAIGN.replace(
        'to = "star_tracker"\nq', 'to = "star_tracker"\nsigma_arcsec = [3.0, 4.0, 20.0]\nq'
    )
    campaign = sp.read_campaign(write_good_campaign(folder, campaign=toml + NO_LIGHT, attitude=attitude))
    return view_of(campaign, None, "I1")


def test_on_a_tilted_plane_the_covariance_is_that_of_rays_met_with_it(tmp_path, rng):
    """Rays with drawn errors, met with the plane by Newton's method on ERFA's geodetic heights."""
    view, pixel = tilted_view(tmp_path), (9000.0, 2000.0)
    level = place(view, pixel, 0.0, 0.0)
    ground = plane(np.deg2rad([level.latitude_deg, level.longitude_deg]))
    found = place(replace(view, surface=ground), pixel, 0.5, 4.0)
    n = 40_000
    e_K = np.array([(9000.0 - 5999.5) * 9e-6 / 2.2, (2000.0 - 5999.5) * 9e-6 / 2.2, 1.0])
    e_K = e_K + rng.standard_normal((n, 3)) * [0.5 * 9e-6 / 2.2, 0.5 * 9e-6 / 2.2, 0.0]
    turned = Rotation.from_rotvec(rng.standard_normal((n, 3)) * np.array([3.0, 4.0, 20.0]) * ARCSEC)
    attitude = Rotation.from_rotvec(rng.standard_normal((n, 3)) * np.array([5.0, 5.0, 12.0]) * ARCSEC)
    u = Rotation.from_quat(TILTED).inv().apply(attitude.apply(turned.apply(e_K)))
    r = np.array([7058137.0, 0.0, -3750.0]) + 3.0 * rng.standard_normal((n, 3))
    off = 4.0 * rng.standard_normal(n)

    def above(s):
        longitude, latitude, height = erfa.gc2gd(1, r + s[:, None] * u)
        return height - ground.at(latitude, longitude) - off

    s = np.full(n, np.linalg.norm(np.array(found.document["itrf_m"]) - [7058137.0, 0.0, -3750.0]))
    for _ in range(6):
        s = s - above(s) / ((above(s + 1.0) - above(s - 1.0)) / 2.0)
    p = r + s[:, None] * u
    latitude, longitude = np.deg2rad([found.latitude_deg, found.longitude_deg])
    up = np.array(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    )
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    local = (p - np.array(found.document["itrf_m"])) @ np.stack([east, np.cross(up, east), up], axis=1)
    assert np.all(np.abs(np.mean(local, axis=0)) < 0.5)
    sample = np.cov(local.T)
    sigma = np.sqrt(np.diagonal(sample))
    off_by = (found.covariance_east_north_up_m2 - sample) / np.outer(sigma, sigma)
    assert np.max(np.abs(off_by)) < 5.0 * np.sqrt(2.0 / n)
    # level ground under the same pixel has no error upwards but that of its height
    flat = place(replace(view, height_m=300.0), pixel, 0.5, 4.0)
    assert flat.document["sigma_east_north_up_m"][2] == pytest.approx(4.0, abs=1e-6)
    assert found.document["sigma_east_north_up_m"][2] > 6.0


def test_a_line_of_sight_that_grazes_the_slope_leaves_no_sigma(tmp_path):
    """The ground falls away along the line of sight by a little less than that does."""
    view, pixel = tilted_view(tmp_path), (6000.0, 6000.0)
    level = place(view, pixel, 0.0, 0.0)
    middle = np.deg2rad([level.latitude_deg, level.longitude_deg])
    down = np.sign(level.latitude_deg)  # away from the satellite over the equator
    steep = np.tan(
        np.deg2rad(60.5)
    )  # the ray falls at 62.1 deg: asin(7058 / 6378 sin 25 deg) from the vertical

    def height(latitude, longitude):
        return -down * steep * (latitude - middle[0]) * RADIUS

    ground = SimpleNamespace(dem=SimpleNamespace(path="dem.tif", step_m=30.0), at=height)
    found = place(replace(view, surface=ground), pixel, 0.0, 0.0)
    assert found.covariance_east_north_up_m2 is None
    assert "sigma not stated: the line of sight grazes the slope" in repr(found)


def test_slopes_at_the_edge_of_what_is_known():
    p_J = np.array([[RADIUS, 0.0, 0.0]])

    def ramp(latitude, longitude):
        east, north = longitude * RADIUS, latitude * RADIUS * (1 - 1 / 298.257223563) ** 2
        return np.where(east > 1.0, np.nan, 0.2 * east - 0.1 * north)

    np.testing.assert_allclose(slopes(ramp, p_J, 30.0), [[0.2, -0.1]], atol=1e-5)
    nowhere = slopes(lambda latitude, longitude: np.where(latitude == 0.0, 5.0, np.nan), p_J, 30.0)
    assert np.isnan(nowhere[0, 1])
