"""The published tables: scenes by hand, verdicts by hand, and the figures of the publications themselves."""

from __future__ import annotations

import json

import numpy as np
import pytest

from command import starplumb
from starplumb.physics import so3
from starplumb.physics.earth import geodetic_to_itrf, itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC, DEG
from starplumb.published import lebedev2012, lebedev_images, lebedev_projective, tkachenko2019
from starplumb.published.comparison import Recomputed, judge
from starplumb.published.lebedev_scene import C_JI, Nadir, orbital_axes
from starplumb.published.reproduce import TABLES, document, reproduce
from starplumb.published.tables import NAMES, published, scenario, source
from starplumb.published.tkachenko_rows import draws, errors_E
from starplumb.published.tkachenko_scene import C_EK_MODEL, draw, trackers
from starplumb.table.equation import residual_px
from starplumb.table.error_sources import Distribution
from starplumb.table.simulate import Errors, measure

PAPER = scenario("paper2019")
SLIDES = scenario("slides2012")


def rows(comparison):
    return {row.label: row for row in comparison.rows}


@pytest.fixture(scope="module")
def table1():
    return rows(tkachenko2019.residuals("table1", "two_images", 4000, np.random.default_rng(1)))


@pytest.fixture(scope="module")
def table2():
    return rows(tkachenko2019.residuals("table2", "one_image", 4000, np.random.default_rng(2)))


# scenes


def test_the_paper_s_scene_is_as_it_is_stated():
    scene = tkachenko2019.view(PAPER, "two_images")
    site = geodetic_to_itrf(44.45 * DEG, PAPER["scene"]["longitude_deg"] * DEG, 0.0)
    sight = site - scene.r_J
    # the middle of the straight line between the markers lies 0.96 m below the site: 3500^2 / (2 R)
    np.testing.assert_allclose(
        scene.range_m - np.linalg.norm(sight, axis=-1), 3500.0**2 / 2.0 / 6.378e6, atol=0.01
    )
    # seen 2.5 deg ahead, then 2.5 deg behind the vertical
    down = -scene.r_J / np.linalg.norm(scene.r_J, axis=-1, keepdims=True)
    angle = np.arccos(np.vecdot(sight, down) / np.linalg.norm(sight, axis=-1)) / DEG
    np.testing.assert_allclose(angle, 2.5, atol=0.3)
    flown = scene.r_J[1] - scene.r_J[0]
    assert sight[0] @ flown > 0 > sight[1] @ flown
    assert flown[2] < 0, "a descending pass"
    height = np.linalg.norm(scene.r_J, axis=-1) - np.linalg.norm(site)
    np.testing.assert_allclose(height, 670e3, atol=1e3)
    assert np.linalg.norm(scene.p_J[0] - scene.p_J[1]) == pytest.approx(7000.0, abs=2.0)
    np.testing.assert_allclose(itrf_to_geodetic(scene.p_J)[2], 0.0, atol=1e-3)


def test_three_trackers_averaged_against_drawing_each_of_them(rng):
    sigma, cone = np.array([5.0, 5.0, 12.0]), 25.0 * DEG
    total = np.zeros((200_000, 3))
    for azimuth in (0.0, 120.0, 240.0):
        # boresight on the cone; its error about its own axes, turned into E
        boresight = np.array(
            [np.sin(cone) * np.sin(azimuth * DEG), -np.sin(cone) * np.cos(azimuth * DEG), np.cos(cone)]
        )
        x = np.cross([0.0, 1.0, 0.0], boresight)
        x /= np.linalg.norm(x)
        total += (
            (sigma * rng.standard_normal(total.shape))
            @ np.array([x, np.cross(boresight, x), boresight])
            / 3.0
        )
    np.testing.assert_allclose(trackers(cone, sigma), np.cov(total.T), atol=0.3)


def test_the_scene_s_measurements_fit_its_truth(rng):
    scene = tkachenko2019.view(PAPER, "two_images")
    runs = draw(scene, rng, 400)
    o = runs.observations
    np.testing.assert_allclose(o.with_geometry().e_E, o.e_E, atol=1e-14)
    theta_E = so3.log(C_EK_MODEL @ runs.C_EK_true.mT)
    np.testing.assert_allclose(theta_E.std(axis=0) / DEG, 1.0, rtol=4.0 / np.sqrt(2.0 * 400.0))
    # residuals about the truth: attitude 3.4", GPS 3 m, half a pixel, focal length
    z = residual_px(o, runs.C_EK_true) * scene.pixel / ARCSEC
    tracker = np.mean(np.sqrt(np.diag(trackers(25.0 * DEG, [5.0, 5.0, 12.0]))[:2]))
    focal = 0.0025 * 3500.0 / 673e3 / np.sqrt(2.0) / ARCSEC
    wanted = np.sqrt(tracker**2 + (3.0 / 673e3 / ARCSEC) ** 2 + (0.5 * 9e-6 / 2.2 / ARCSEC) ** 2 + focal**2)
    assert np.std(z) == pytest.approx(wanted, rel=0.05)


def test_runs_of_a_given_initial_error_all_have_it(rng):
    runs = draw(tkachenko2019.view(PAPER, "one_image"), rng, 3, theta_E=[0.01, -0.02, 0.03])
    wanted = np.broadcast_to(so3.exp(np.array([0.01, -0.02, 0.03])), (3, 3, 3))
    np.testing.assert_allclose(C_EK_MODEL @ runs.C_EK_true.mT, wanted, atol=1e-14)


@pytest.mark.parametrize("images", ["one_image", "two_images"])
def test_one_pass_over_the_rows_is_the_simulator_and_the_observer_on_the_same_draws(images, rng):
    """Each unit draw put by hand where the simulator takes it."""
    scene, observer = tkachenko2019.view(PAPER, images), tkachenko2019.observer(PAPER, 5)
    m, n, runs = len(scene.r_J), len(scene.p_J), 300
    Z = rng.standard_normal((draws(scene), runs))
    of_run, of_image = Z[:4].T, Z[4:].T.reshape(runs, m, 8 + 2 * n)
    C_EK_true = so3.exp(-scene.initial * of_run[:, :3]) @ C_EK_MODEL
    tilt = np.zeros((runs, m, 3))
    tilt[..., :2] = scene.aim / scene.range_m[:, None] * of_image[..., :2]
    truth = scene.truth(C_EK_true, so3.exp(tilt) @ scene.C_KJ)
    root_E = np.linalg.cholesky(scene.tracker_covariance)
    # the rows read the pixels with a focal length that is off; the simulator takes it to first order
    scale = 1.0 / (1.0 + scene.focal_length * of_run[:, None, 3:])
    errors = Errors(
        alpha_E=of_image[..., 2:5] @ root_E.T,
        rho_J=scene.gps * of_image[..., 5:8],
        pi_J=np.zeros((n, 3)),
        pixel=scale * scene.marker * of_image[..., 8:].reshape(runs, m * n, 2),
        tangent=(scale - 1.0) * truth.xy_K,
    )
    table = measure(truth, C_EK_true, errors)
    wanted = so3.log(observer(table, C_EK_MODEL).C_EK @ C_EK_true.mT)
    found = errors_E(scene, observer, Z)[-1].T
    assert np.median(np.linalg.norm(found - wanted, axis=-1)) < 1e-6 * ARCSEC
    assert np.median(np.linalg.norm(wanted, axis=-1)) > 50.0 * ARCSEC


def test_orbital_axes_are_the_published_block_of_sigma_beta():
    nadir = Nadir.over(SLIDES["orbit"], 680e3)
    assert nadir.u / DEG == pytest.approx(45.005, abs=1e-3)
    C = np.abs(orbital_axes(nadir.u, nadir.node, nadir.inclination))
    np.testing.assert_allclose(C.T, [[0.49, 0.70, 0.53], [0.81, 0.14, 0.57], [0.33, 0.70, 0.64]], atol=0.007)


def test_at_the_nadir_the_camera_looks_down_on_the_site():
    nadir = Nadir.over(SLIDES["orbit"], 680e3)
    r_J, C_EJ = nadir.at(0.0)
    np.testing.assert_allclose(r_J - nadir.site_J, 680e3 * nadir.C_JT[:, 2], atol=1e-6)
    np.testing.assert_allclose(C_EJ[2], nadir.C_JT[:, 2], atol=1e-12)
    # a second later it is a ground speed of 6.8 km/s and 0.06 deg farther
    later, C_later = nadir.at(1.0)
    assert np.linalg.norm(later - r_J) == pytest.approx(7.5e3, rel=0.08)
    assert np.linalg.norm(so3.log(C_later @ C_EJ.T)) / DEG == pytest.approx(0.06, rel=0.1)
    assert np.linalg.det(C_JI) == pytest.approx(1.0)


# the slides


@pytest.mark.slow
def test_sensitivities_of_28_within_3_percent():
    found = rows(lebedev2012.sensitivity(20_000, np.random.default_rng(4)))
    # exact where the printed digits allow 3 %; 2.47e6 is taken as a slip for 2.44e6
    wanted = {
        "sigma_P (arcsec/m)": (2, 7.88),
        "sigma_R (arcsec/m)": (3, 0.43),
        "sigma_K (arcsec/m)": (2, 2.44e6),
        "sigma_beta_1 (arcsec/arcsec)": (3, 1.0),
        "sigma_beta_2 (arcsec/arcsec)": (3, 1.0),
        "sigma_beta_3 (arcsec/arcsec)": (3, 1.0),
    }
    for label, (column, figure) in wanted.items():
        assert found[label].ours.value[column] == pytest.approx(figure, rel=0.03)
    assert all(row.verdict in (None, "agrees") for row in found.values())


@pytest.mark.slow
def test_totals_of_28_within_2_percent():
    found = rows(lebedev2012.totals(20_000, np.random.default_rng(5)))
    for label in ("algorithm 4 (cross products)", "algorithm 2 (ground plane)", "algorithm 3 (image plane)"):
        np.testing.assert_allclose(found[label].ours.value[:3], [6.09, 6.09, 8.36], rtol=0.02)
    bound = found["Cramer-Rao bound"].ours.value
    np.testing.assert_allclose(found["gls"].ours.value, bound, rtol=0.02)


@pytest.mark.slow
def test_most_rows_of_algorithm_1_agree_by_the_reading_found_afterwards():
    comparison = lebedev_projective.algorithm1(300, np.random.default_rng(6))
    found = rows(comparison)
    compared = {label: row for label, row in found.items() if row.verdict is not None}
    assert len(compared) == 32
    # the median of the printed cells over ours, for mu and for one coordinate of the position
    for radius in ("1 m", "5 m"):
        cells = [row for label, row in compared.items() if label.startswith("t =") and label.endswith(radius)]
        ratio = np.array([row.published / row.ours.value for row in cells])
        assert np.median(ratio[:, 0]) == pytest.approx(1.0, abs=0.25)
        assert np.median(ratio[:, 2]) == pytest.approx(1.0, abs=0.35)
        # the length of the position's error is shown, and compared with nothing
        assert np.all(np.isnan(ratio[:, 1]))
        assert sum(row.verdict == "agrees" for row in cells) >= 9
        assert found[f"mean over t, r_p = {radius}"].verdict == "agrees"
    assert any("chosen after the fact" in note for note in comparison.notes)
    exact = [row for label, row in compared.items() if label.endswith("r_p = 0 m")]
    assert {row.verdict for row in exact} == {"cannot be recovered"}
    assert all("heights is not stated" in row.why for row in exact)
    np.testing.assert_allclose([row.ours.value for row in exact], 0.0, atol=1e-5)


def test_a_disc_is_uniform_with_variance_1_along_each_axis(rng):
    """A uniform disc of radius R has the variance R^2/4 along an axis; half of its area lies within R / sqrt(2)."""
    xi = Distribution("disc").draw(rng, (100_000, 2))
    radius = np.linalg.norm(xi, axis=-1)
    assert radius.max() <= 2.0
    np.testing.assert_allclose(np.cov(xi.T), np.eye(2), atol=0.015)
    np.testing.assert_allclose(xi.mean(axis=0), 0.0, atol=0.015)
    assert np.mean(radius < np.sqrt(2.0)) == pytest.approx(0.5, abs=0.008)


def test_more_images_by_our_reading_and_by_a_proper_treatment():
    found = rows(lebedev_images.images_sigma(4000, np.random.default_rng(7)))
    published_rows = [row for label, row in found.items() if row.published is not None]
    assert len(published_rows) == 7
    assert all(row.verdict in ("agrees", "same order") for row in published_rows)
    # as published it gets worse after 4 images; told of the shared error gls does not
    assert found["20 images"].ours.value[0] > 2.0 * found["4 images"].ours.value[0]
    told = [found[f"gls, shared error stated, {n} images"].ours.value[0] for n in (4, 8, 20)]
    np.testing.assert_allclose(told, told[0], rtol=0.15)


# the paper


@pytest.mark.slow
@pytest.mark.parametrize(("table", "name"), [("table1", "table1"), ("table2", "table2")])
def test_observer_within_25_and_30_percent_at_saturation(table, name, request):
    found = request.getfixturevalue(table)
    for row in published(name):
        if row["cycles"] != "mnk" and int(row["cycles"]) >= 10:
            ours = found[f"observer, {row['cycles']} cycles"].ours.value[3:]
            figures = [float(row[f"s{i}"]) for i in (1, 2, 3)]
            assert np.all(np.abs(ours / figures - 1.0) < [0.25, 0.25, 0.30])


@pytest.mark.parametrize("table", ["table1", "table2"])
def test_trend_over_the_cycles_is_the_published_one(table, request):
    found = request.getfixturevalue(table)
    sigma = np.array([found[f"observer, {cycles} cycles"].ours.value[3:] for cycles in (1, 2, 5, 10, 20, 40)])
    assert np.all(np.diff(sigma, axis=0) < 0.05 * sigma[:-1]), "it falls, then stays"
    figures = np.array(
        [[float(r[f"s{i}"]) for i in (1, 2, 3)] for r in published(table) if r["cycles"] != "mnk"]
    )
    # one cycle too: within its heavy tails
    assert np.all(np.abs(np.log(sigma / figures)) < np.log(1.6))


@pytest.mark.parametrize("table", ["table1", "table2"])
def test_least_squares_rows_within_the_sampling_error_of_100_runs(table, request):
    found = request.getfixturevalue(table)["least squares, 2 passes (own trackers)"]
    assert found.verdict == "agrees"
    # a sigma from 100 runs carries 7 %
    np.testing.assert_allclose(found.ours.value[3:], found.published[3:], rtol=3.0 * 0.071)


def test_gls_reaches_the_bound_where_the_observer_does_not(table1):
    bound, gls = table1["Cramer-Rao bound"].ours.value[3:], table1["gls"].ours.value[3:]
    np.testing.assert_allclose(gls, bound, rtol=0.08)
    assert table1["observer, 40 cycles"].ours.value[5] > 1.5 * bound[2]


def test_table_3_first_two_digits_of_theta_1_and_theta_2():
    found = rows(tkachenko2019.first_correction(400, np.random.default_rng(8)))
    for row in published("table3"):
        theta = np.array([float(row["theta1"]), float(row["theta2"])])
        (label,) = [label for label in found if label.startswith(f"variant {row['variant']}:")]
        assert found[label].verdict == "agrees"
        np.testing.assert_allclose(found[label].ours.value[:2], theta, atol=0.02 * np.max(np.abs(theta)))
        (third,) = [label for label in found if label.startswith(f"variant {row['variant']}, theta_3")]
        assert found[third].verdict in ("same order", "cannot be recovered")


def test_table_4_kappa_3_within_30_percent_and_what_is_off_is_said():
    found = rows(tkachenko2019.changes(4000, np.random.default_rng(9)))
    for row in published("table4"):
        ours = found[f"cycle {row['cycle_previous']} to {row['cycle_last']}"]
        assert ours.ours.value[5] == pytest.approx(float(row["k3"]), rel=0.30)
    late = found["cycle 39 to 40"]
    assert late.verdict == "cannot be recovered"
    assert "k1 0.0" in late.why
    assert "k3" not in late.why.split(";")[0]


# verdicts


@pytest.mark.parametrize(
    ("figure", "verdict"),
    [
        (10.0, "agrees"),
        (10.9, "agrees"),  # within the allowance of 1
        (12.0, "agrees"),  # within the publication's own sampling
        (12.1, "same order"),
        (29.0, "same order"),
        (31.0, "cannot be recovered"),
        (-10.0, "cannot be recovered"),
        (np.nan, "agrees"),
    ],
)
def test_verdict_of_one_figure(figure, verdict):
    ours = Recomputed(np.array([10.0]), np.array([0.1]), np.array([9.0]), np.array([12.0]))
    row = judge("row", ["x"], [figure], ours, [1.0], "because")
    assert row.verdict == verdict
    assert ("because" in row.why) == (verdict != "agrees")


def test_verdict_is_that_of_the_worst_figure_which_is_named():
    row = judge("row", ["a", "b", "c"], [1.0, 2.0, 100.0], Recomputed.exact([1.0, 1.0, 1.0]), [0.0, 0.0, 0.0])
    assert row.verdict == "cannot be recovered"
    assert row.why == "published/ours: b 2, c 1e+02"


def test_median_of_series_and_its_sampling_error(rng):
    found = Recomputed.of_series(rng.normal(5.0, 2.0, (4000, 1)))
    assert found.value[0] == pytest.approx(5.0, abs=4.0 * 2.0 * np.sqrt(np.pi / 2.0 / 4000.0))
    assert found.sampling[0] == pytest.approx(2.0 * np.sqrt(np.pi / 2.0 / 4000.0), rel=0.1)
    # central 99 % of a normal distribution: +-2.576 sigma
    assert found.high[0] - found.low[0] == pytest.approx(2.0 * 2.576 * 2.0, rel=0.1)


# the whole


def test_every_published_table_is_there_with_its_source():
    assert list(TABLES) == list(NAMES)
    for name in NAMES:
        assert published(name)
        assert "20" in source(name)


def test_a_table_is_the_same_alone_and_among_others():
    (alone,) = reproduce(["totals"], 300, 5)
    _, among = reproduce(["table4", "totals"], 300, 5)
    assert alone.document() == among.document()
    (other,) = reproduce(["totals"], 300, 6)
    assert alone.document() != other.document()


@pytest.mark.slow
def test_the_document_is_json_without_nan():
    result = document(reproduce(["table1", "algorithm1"], 200, 1), 200, 1)
    text = json.dumps(result, allow_nan=False)
    assert json.loads(text)["schema"] == "starplumb-reproduce/1"
    assert sum(result["verdicts"].values()) == 7 + 32


@pytest.mark.parametrize(
    ("names", "trials", "complaint"),
    [
        (["table9"], 1000, "found the table 'table9', wanted one of table1, "),
        ([], 10, "found 10, wanted 200 or more"),
    ],
)
def test_a_wrong_request_is_one_sentence(names, trials, complaint):
    with pytest.raises(InputError, match=complaint):
        list(reproduce(names, trials, 1))


def test_the_command_prints_the_table_and_writes_the_same_document(tmp_path):
    table = starplumb("reproduce", "totals", "--trials", "300", "--seed", "4", "--out", tmp_path)
    assert table.status == 0
    assert "algorithm 4 (cross products)" in table.out
    assert "(6.09)" in table.out
    assert "Rows: " in table.out
    written = json.loads((tmp_path / "reproduce.json").read_text())
    assert list(tmp_path.iterdir()) == [tmp_path / "reproduce.json"]
    printed = starplumb("reproduce", "totals", "--trials", "300", "--seed", "4", "--json")
    assert json.loads(printed.out) == written
    assert written["tables"][0]["rows"][0]["published"] == [6.09, 6.09, 8.36, 11.98]


def test_the_command_refuses_a_table_that_does_not_exist():
    refused = starplumb("reproduce", "table7")
    assert refused.status == 2
    assert refused.err.count("\n") == 1
    assert "'table7'" in refused.err
