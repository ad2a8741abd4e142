"""A mounting that moves: its phases, the equations of its motion, the tests, what they would find, and the average."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest

import starplumb as sp
from command import demo as written_demo
from command import starplumb
from problems import C_EK_TRUE, FRAME, UniformEarth, truth
from starplumb.documents.from_calibration import result_document
from starplumb.documents.normals import NormalsDocument, joined, normals_document
from starplumb.documents.prediction import PredictionDocument, predicted
from starplumb.documents.result import ResultDocument
from starplumb.estimators.gls import Gls
from starplumb.io.campaign.marks.images import read_images
from starplumb.io.formats.spice import tdb_seconds
from starplumb.io.tables.declared import Declared
from starplumb.judge.calibrate import calibrate
from starplumb.judge.motion.asked import columns_asked
from starplumb.judge.motion.averaging import Motion, averaged, structures
from starplumb.judge.motion.directed import FOUND_P, _weights, directed_tests
from starplumb.judge.motion.estimated import _answer, calibrate_moving
from starplumb.judge.motion.found import reach, surest
from starplumb.judge.motion.regressors import Scales, When, families, harmonics, told_apart
from starplumb.judge.motion.sums import ImageSums, image_sums
from starplumb.judge.snooping import fit_at
from starplumb.physics import so3
from starplumb.physics.earth import itrf_to_geodetic
from starplumb.physics.errors import ArgumentError, InputError
from starplumb.physics.orbit import KeplerOrbit
from starplumb.physics.timescales import format_iso, parse
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan import scene
from starplumb.table.geometry import observe
from starplumb.table.parameter_names import parameters
from starplumb.table.phases import OrbitPhase, even_motion, latitude_argument, mean_rate, sun_beta
from starplumb.table.simulate import Errors

PERIOD_S = 5830.0
ORBIT = OrbitPhase(0, 2.0 * np.pi / PERIOD_S)
FINE = np.array([1.0, 1.0, 2.0])


def images(rng, m=30):
    """Times of three images a date, a date every eight orbits, at any phase, and the scales of their columns."""
    t = np.sort((np.arange(m) // 3 * 8 + rng.uniform(0.0, 1.0, m)) * PERIOD_S)
    when = When(np.rint(1e9 * t).astype(np.int64), 2.0 * np.pi * t / PERIOD_S)
    return when, Scales.of(when, ORBIT)


def sums_of(d, sigma=FINE):
    """Equations of images that make rotations d (m, 3), known to sigma each."""
    m = len(d)
    N = np.broadcast_to(np.diag(sigma**-2.0), (m, 3, 3))
    b = -(N @ d[..., None])[..., 0]
    return ImageSums(np.arange(m), N, b, np.zeros((m, 0, 3)), np.zeros(0), np.zeros((3, 3)), np.zeros(3))


def tried(d, when, scales):
    return directed_tests(sums_of(d), when, scales, families(when, scales))


# The orbit ----------------------------------------------------------------------------------------------------


def test_the_argument_of_latitude_of_a_circle_is_its_anomaly():
    """A circle at 1000 km about an Earth that turns: the satellite is u past the node when it was started u past it."""
    orbit = KeplerOrbit(7378e3, 0.0, 63 * DEG, 0.4, 0.0, 0.0, j2=0.0)
    time = np.array([0.0, 700.0, 2500.0, 5000.0])
    r_J, v_J = scene.fly(orbit, UniformEarth(), 0, time)
    n = np.sqrt(3.986004418e14 / 7378e3**3)
    np.testing.assert_allclose(
        np.angle(np.exp(1j * (latitude_argument(r_J, v_J) - n * time))), 0.0, atol=1e-9
    )


def test_an_even_motion_is_found_across_months_without_an_image(rng):
    """Forty images of ten dates, a fortnight apart and more: thousands of turns counted without a slip."""
    orbit = KeplerOrbit(6950e3, 0.001, 97.6 * DEG, 0.4, 0.9, 2.0)
    time = np.sort(rng.uniform(0.0, 6e3, 40) + 86400.0 * np.repeat(np.sort(rng.uniform(0.0, 200.0, 10)), 4))
    r_J, v_J = scene.fly(orbit, UniformEarth(), 0, time)
    u, t_ns = latitude_argument(r_J, v_J), scene.epochs_ns(0, time)
    found = even_motion(t_ns, u, float(np.median(mean_rate(r_J, v_J))))
    later = 250.0 * 86400.0 + np.linspace(0.0, 6e3, 9)
    wanted = latitude_argument(*scene.fly(orbit, UniformEarth(), 0, later))
    off = np.angle(np.exp(1j * (found.at(scene.epochs_ns(0, later)) - wanted)))
    assert np.max(np.abs(off)) < 0.5 * DEG  # the centre's equation is 2 e = 0.1 deg


def test_phases_at_random_have_no_even_motion(rng):
    t_ns = np.sort(rng.integers(0, 10**15, 30))
    assert even_motion(t_ns, rng.uniform(-np.pi, np.pi, 30), 1.1e-3) is None


def test_the_sun_stands_over_an_orbit_whose_normal_points_at_it():
    """At the equinox of March the Sun's right ascension and declination are 0: an equatorial orbit has beta 0, and at
    the solstice of June 23.44 deg; a polar one over the meridian of the Sun's place 6 h off has 90 deg."""
    t_ns = parse(["2026-03-20T14:46:00", "2026-06-21T08:25:00"], "UTC")
    r_J, v_J = np.array([[7e6, 0.0, 0.0]] * 2), np.array([[0.0, 7.0e3, 0.0]] * 2)
    np.testing.assert_allclose(sun_beta(t_ns, r_J, v_J) / DEG, [0.0, 23.44], atol=0.02)
    # Greenwich sees the Sun at 12h + equation of time (-7.4 min in March): turn the orbit's normal that way
    noon = parse(["2026-03-20T12:07:24"], "UTC")
    polar = sun_beta(noon, np.array([[0.0, 0.0, 7e6]]), np.array([[0.0, -7.5e3, 0.0]]))
    assert abs(polar[0] / DEG - 90.0) < 0.2


# The equations ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("site", [False, True], ids=["markers of their own", "one site"])
@pytest.mark.parametrize("names", [(), ("time_offset=10ms",)], ids=["alone", "with a clock"])
def test_the_equations_of_a_constant_are_those_of_the_adjustment(rng, site, names):
    """Errors in common, a clock and landmarks seen again are eliminated as the whole adjustment eliminates them."""
    true = truth(FRAME, 6, 9, tilt_deg=15.0, yaw_deg=60.0, shared_site=site)
    campaign = scene.measured(true, Errors.draw(observe(true), rng), C_EK_TRUE)
    found = calibrate(campaign, Gls(parameters(list(names), campaign)))
    fit = fit_at(
        found.estimate.unknowns, found.observations, campaign.C_EK, found.estimate, found.residuals.used
    )
    M, v = image_sums(fit).equations(np.ones((6, 1)))
    scale = np.outer(found.sigma_E, found.sigma_E)
    np.testing.assert_allclose(np.linalg.inv(M) / scale, found.covariance_E / scale, atol=1e-5)
    assert np.max(np.abs(np.linalg.solve(M, v)) / found.sigma_E) < 1e-3


def test_a_sine_of_the_mounting_comes_back_from_pixels(rng):
    """Twenty images on most of an orbit, the mounting turning by 40 arcsec about x: by exact pixels, exactly."""
    true = truth(FRAME, 20, 8, tilt_deg=15.0, yaw_deg=60.0)
    o = observe(true)
    u = np.linspace(0.0, 5.5, 20)
    nothing = Errors(*(0.0 * x for x in vars(Errors.draw(o, rng)).values() if x is not None))
    turn = 40.0 * ARCSEC * np.cos(u)[:, None] * np.array([1.0, 0.0, 0.0])
    campaign = scene.measured(true, replace(nothing, alpha_E=turn), C_EK_TRUE)
    found = calibrate(campaign, Gls())
    fit = fit_at(
        found.estimate.unknowns, found.observations, campaign.C_EK, found.estimate, found.residuals.used
    )
    F = np.stack([np.ones(20), np.cos(u), np.sin(u)], axis=-1)
    M, v = image_sums(fit).equations(F)
    c = -np.linalg.solve(M, v).reshape(3, 3) / ARCSEC
    # an attitude that is off by alpha asks for a mounting that is off by as much
    np.testing.assert_allclose(c[1], [40.0, 0.0, 0.0], atol=0.01)
    np.testing.assert_allclose(c[2], 0.0, atol=0.01)


# The tests ----------------------------------------------------------------------------------------------------


def alarms(rng, runs, m, grown):
    found = []
    for _ in range(runs):
        when, scales = images(rng, m)
        found.append(tried(grown * FINE * rng.normal(size=(m, 3)), when, scales)[0].p)
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("grown", [1.0, 2.0], ids=["as stated", "twice as stated"])
@pytest.mark.parametrize("m", [6, 30])
def test_a_mounting_that_rests_raises_few_alarms_whatever_the_sigmas(rng, m, grown):
    p = alarms(rng, 200, m, grown)
    assert binomtest(int(np.sum(p < FOUND_P)), p.size, 0.02, alternative="greater").pvalue > 1e-3


def moved(name, rng, when, scales):
    """A motion of amplitude 1 about each axis, (m, 3)."""
    sign = rng.choice([-1.0, 1.0], 3)
    if name == "orbit:1":
        return np.cos(when.u[:, None] - rng.uniform(0.0, 2.0 * np.pi, 3))
    if name == "linear":
        return scales.column("linear", when)[:, None] * sign
    return np.where(np.arange(30) < 15, -0.5, 0.5)[:, None] * sign


@pytest.mark.slow
@pytest.mark.parametrize("name", ["orbit:1", "linear", "step"])
def test_the_detectable_amplitude_is_found_in_nine_of_ten(rng, name):
    shares = {}
    for factor in (0.8, 1.2):
        hits = []
        for _ in range(60):
            when, scales = images(rng)
            rests = {test.name: test for test in tried(FINE * rng.normal(size=(30, 3)), when, scales)}
            size = factor * rests[name].detectable
            tests = tried(
                FINE * rng.normal(size=(30, 3)) + size * moved(name, rng, when, scales), when, scales
            )
            hits.append(any(test.p < FOUND_P for test in tests if test.name == name))
        shares[factor] = np.mean(hits)
    # 90 % at the amplitude itself; the share of detections grows by a quarter within 20 % of it
    assert shares[0.8] < 0.9 < shares[1.2] + 0.03


def test_each_motion_is_found_by_its_name(rng):
    when, scales = images(rng)
    noise = FINE * rng.normal(size=(30, 3))
    u, t = when.u[:, None], scales.column("linear", when)[:, None]
    for move, name in (
        (5.0 * np.cos(u - 1.0), "orbit:1"),
        (9.0 * t, "linear"),
        (np.where(np.arange(30) < 12, 0.0, 6.0)[:, None], "step"),
    ):
        assert tried(noise + move * np.ones(3), when, scales)[0].name == name


def test_images_on_a_short_arc_test_no_harmonic(rng):
    """In 60 degrees of an orbit a sine is a parabola: a motion with the orbit is not told."""
    u = np.linspace(0.0, 60.0 * DEG, 20)
    when = When(np.rint(1e9 * u / ORBIT.rate).astype(np.int64), u)
    assert set(families(when, Scales.of(when, ORBIT))) == {"linear", "step"}
    F = np.stack([np.ones(20), np.cos(4.0 * u), np.sin(4.0 * u)], axis=-1)
    assert told_apart(F)


# The average --------------------------------------------------------------------------------------------------


def test_the_average_of_one_model_is_least_squares(rng):
    """With images that say much, what is known of coefficients beforehand does nothing."""
    when, scales = images(rng)
    d = 1e-3 * FINE * rng.normal(size=(30, 3)) + 0.05 * np.cos(when.u)[:, None]
    motion = averaged(sums_of(d, 1e-3 * FINE), when, scales, {"orbit:1": (harmonics(1),)})
    F = np.stack([np.ones(30), np.cos(when.u), np.sin(when.u)], axis=-1)
    np.testing.assert_allclose(motion.coefficients, np.linalg.lstsq(F, d)[0], atol=2e-5)
    np.testing.assert_allclose(
        motion.covariance[:3, :3],
        np.linalg.inv(F.T @ F)[0, 0] * np.diag((1e-3 * FINE) ** 2),
        rtol=1e-2,
        atol=1e-12,
    )


@pytest.mark.slow
def test_few_images_of_one_date_lose_nothing_by_the_average(rng):
    """Eight images within seven minutes, mountings that rest: as good as the constant."""
    plain, average = [], []
    for _ in range(120):
        t = np.sort(rng.uniform(0.0, 400.0, 8))
        when = When(np.rint(1e9 * t).astype(np.int64), 2.0 * np.pi * t / PERIOD_S)
        scales = Scales.of(when, ORBIT)
        d = FINE * rng.normal(size=(8, 3))
        motion = averaged(sums_of(d), when, scales, structures(families(when, scales)))
        plain.append(np.mean(d, axis=0) / FINE)
        average.append(motion.mean / FINE)
    assert np.sqrt(np.mean(np.square(average))) < 1.04 * np.sqrt(np.mean(np.square(plain)))


# The judgement ------------------------------------------------------------------------------------------------


def moving(rng, size_arcsec):
    """Thirty images over a quarter of an hour, the mounting drifting by so much over them."""
    true = truth(FRAME, 30, 10, tilt_deg=15.0, yaw_deg=60.0)
    e = Errors.draw(observe(true), rng)
    drift = size_arcsec * ARCSEC * np.linspace(-0.5, 0.5, 30)[:, None] * np.ones(3)
    return scene.measured(true, replace(e, alpha_E=e.alpha_E + drift), C_EK_TRUE)


@pytest.mark.slow
def test_a_motion_weakens_and_the_interval_holds_all_of_it(rng):
    held = []
    for _ in range(5):
        found = calibrate(moving(rng, 40.0), Gls())
        assert found.status.name == "WEAK"
        assert "the mounting moves" in found.message
        assert "--drift auto" in found.message
        for end in (-20.0, 20.0):
            away = so3.log(so3.exp(end * ARCSEC * np.ones(3)) @ C_EK_TRUE @ found.C_EK.mT)
            held.append(np.abs(away) < found.interval_95_E)
    assert binomtest(int(np.sum(held)), np.size(held), 0.95, alternative="less").pvalue > 1e-3


def test_a_mounting_that_rests_is_said_to_within_what_would_be_found(rng):
    found = calibrate(moving(rng, 0.0), Gls())
    assert found.status.name == "OK"
    assert re.search(
        r"no motion of the mounting is found; one of \d+ arcsec or more over the span would be", found.message
    )
    assert [test.name for test in found.moves.tests if test.p < FOUND_P] == []


# A motion that is estimated -------------------------------------------------------------------------------------


def document_of(calibration):
    """``result.json`` of a calibration, read back."""
    written = result_document(calibration, "gls", ("camera", "tracker"), {}, {})
    return ResultDocument.from_json(ResultDocument.of(written).to_json(), "result.json")


def test_an_estimated_drift_is_predicted_at_any_time_of_the_span(rng):
    """40 arcsec in 15 minutes: at the ends and between the prediction is right, and 20 arcsec of a constant are not."""
    campaign = moving(rng, 40.0)
    found = calibrate_moving(campaign, Gls(), "auto")
    assert found.status.name == "OK"
    document = document_of(found)
    assert document.motion.model.weights["linear"] > 0.9
    for i, share in ((0, -0.5), (10, 10 / 29 - 0.5), (29, 0.5)):
        at = predicted(document, int(campaign.images.t_ns[i]))
        true = so3.exp(share * 40.0 * ARCSEC * np.ones(3)) @ C_EK_TRUE
        error = so3.log(at.C_EK @ true.mT)
        assert error @ np.linalg.solve(at.covariance_E, error) < 16.3  # 0.1 % of chi-square of three
        assert np.all(np.abs(error) < 8.0 * ARCSEC)
        assert at.outside_s == 0.0
        assert at.notices == ()


@pytest.mark.parametrize("drift", ["auto", "linear"])
def test_the_sentence_names_the_axis_that_moves_farthest_and_how_far(rng, drift):
    """40 arcsec about y over the span, 10 about x and z: 20 from the mean, and what is not known of it."""
    true = truth(FRAME, 30, 10, tilt_deg=15.0, yaw_deg=60.0)
    e = Errors.draw(observe(true), rng)
    moved = ARCSEC * np.linspace(-0.5, 0.5, 30)[:, None] * np.array([10.0, 40.0, 10.0])
    campaign = scene.measured(true, replace(e, alpha_E=e.alpha_E + moved), C_EK_TRUE)
    said = calibrate_moving(campaign, Gls(), drift).sentences
    (size,) = (re.search(r"up to (\d+) arcsec about y", s) for s in said if "probability" in s)
    assert 18 < int(size[1]) < 32


def test_what_is_named_of_a_motion_is_its_surest_axis_not_the_worst_known_one():
    """A drift of 4 arcsec about x, known to 0.2, and of nothing about z, known to 6: at the last image half of each."""
    at = When(np.array([0, 10]), np.zeros(2), {})
    spread = np.diag(np.square([0.01, 0.01, 0.01, 0.2, 0.2, 6.0])) * ARCSEC**2
    drift = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]]) * ARCSEC
    motion = Motion(("mean", "linear"), drift, spread, Scales(0, 10, None, {}), {})
    size, sigma, axis = surest(motion, at)
    assert (axis, size / ARCSEC) == (0, pytest.approx(2.0))
    assert sigma / ARCSEC == pytest.approx(np.hypot(0.01, 0.1))
    assert int(np.argmax(reach(motion, at))) == 2


def test_the_error_of_a_prediction_grows_outside_the_span_and_is_said(rng):
    """By hand: images evenly over the span leave of a steady change twelve times the variance of their mean, so that
    one span later the variance is 1 + 12 times as large; a motion that is estimated grows by itself."""
    campaign = moving(rng, 0.0)
    rests = document_of(calibrate(campaign, Gls()))
    first, last = int(campaign.images.t_ns[0]), int(campaign.images.t_ns[-1])
    orbit_ns = 5700 * 10**9  # a span is at least an orbit
    inside, outside = predicted(rests, first), predicted(rests, last + orbit_ns)
    np.testing.assert_allclose(inside.covariance_E, ARCSEC**2 * np.array(rests.covariance_arcsec2))
    ratio = np.diagonal(outside.covariance_E) / np.diagonal(inside.covariance_E)
    np.testing.assert_allclose(ratio, 13.0, rtol=0.1)
    assert "outside the span" in outside.notices[0]
    assert "taken to stay" not in outside.notices[0]
    # years later it is no farther than the motion that would have been found, or what one span leaves possible
    later, unseen = predicted(rests, last + 10_000 * orbit_ns), np.array(rests.motion.unseen_drift_arcsec2)
    limit = np.maximum(rests.motion.detectable_arcsec, np.sqrt(np.diagonal(unseen))) * ARCSEC
    grown = np.diagonal(later.covariance_E - inside.covariance_E)
    np.testing.assert_allclose(np.sqrt(grown), limit, rtol=1e-6)
    assert "taken to stay" in later.notices[0]
    drifts = document_of(calibrate_moving(campaign, Gls(), "linear"))
    sigma = [np.sqrt(np.diagonal(predicted(drifts, t).covariance_E)) for t in (last, last + orbit_ns)]
    assert np.all(sigma[1] > 3.0 * sigma[0])


def test_a_temperature_is_found_by_its_name_and_predicted_from_it(rng):
    """Thirty images whose mounting turns by 80 arcsec about y between 10 and 20 degrees."""
    true = truth(FRAME, 30, 10, tilt_deg=15.0, yaw_deg=60.0)
    lens = np.concatenate([[10.0, 20.0], rng.uniform(10.0, 20.0, 28)])
    away = 40.0 * ARCSEC * (lens[:, None] - 15.0) / 5.0 * np.array([0.0, 1.0, 0.0])
    e = Errors.draw(observe(true), rng)
    measured = scene.measured(true, replace(e, alpha_E=e.alpha_E + away), C_EK_TRUE)
    measured = replace(measured, images=replace(measured.images, temperatures={"lens": lens}))
    found = calibrate_moving(measured, Gls(), "temperature:lens")
    assert found.moves.tests[0].name == "temperature:lens"
    document = document_of(found)
    t_ns = int(measured.images.t_ns[7])
    hot, cold = (predicted(document, t_ns, None, {"lens": c}) for c in (20.0, 10.0))
    swing = so3.log(hot.C_EK @ cold.C_EK.mT) / ARCSEC
    sigma = 2.0 * np.sqrt(np.diagonal(found.moves.motion.covariance)[3:6]) / ARCSEC
    assert np.all(np.abs(swing - [0.0, 80.0, 0.0]) < 3.5 * sigma)
    unknown = predicted(document, t_ns)
    assert "the temperature lens is not given" in unknown.notices[0]
    # uniform over 80 arcsec it would have 23 arcsec
    assert 18.0 < np.sqrt(unknown.covariance_E[1, 1]) / ARCSEC < 28.0


def test_temperatures_of_images_are_columns_by_name(tmp_path):
    (tmp_path / "images.csv").write_text(
        "image_id,time,temperature_lens_c,t2,humidity\na,2026-01-01T00:00:00,21.5,3,1\nb,2026-01-01T00:01:00,-4,4,2\n"
    )
    notices = []
    declared = Declared("images", columns={"temperature_bench_c": "t2"})
    images = read_images(tmp_path / "images.csv", "UTC", False, notices, declared)
    assert {name: x.tolist() for name, x in images.temperatures.items()} == {
        "lens": [21.5, -4.0],
        "bench": [3.0, 4.0],
    }
    assert "ignored the column humidity" in notices[0]
    (tmp_path / "images.csv").write_text("image_id,time,temperature_lens_c\na,2026-01-01T00:00:00,-300\n")
    with pytest.raises(InputError, match="temperature_lens_c: found -300"):
        read_images(tmp_path / "images.csv", "UTC", False, notices)


def test_a_budget_states_what_motion_would_be_found():
    """Of one pass no harmonic is told: a drift over the span leads, in the document and in words."""
    scenario = sp.scenario("vhr-0.3m")
    found = sp.budget(scenario).document["motion"]
    assert found["tests"]["linear"] == found["detectable_arcsec"]
    assert (
        found["in_words"] == f"one of {found['detectable_arcsec']:.2g} arcsec or more over the span would be"
    )


def test_spice_turns_the_camera_as_predict_does(rng, tmp_path):
    """The C-kernel at times between its samples, by SPICE itself; a table with the covariance stands beside it."""
    spice = pytest.importorskip("spiceypy")
    campaign = sp.demo(images=30, seed=3)
    result = sp.calibrate(campaign, method="gls", drift="linear,step:2025-06-21T10:36:00")
    result.save(tmp_path, report=False)
    names = ("mounting.tf", "mounting.tsc", "mounting.bc")
    span = result.document["span"]
    first, last = parse([span["first"], span["last"]], "UTC")
    try:
        for name in names:
            spice.furnsh(str(tmp_path / name))
        for share in (0.01, 0.3, 0.77, 0.99):
            t_ns = int(first + share * (last - first))
            found = sp.predict(result, format_iso([t_ns], "UTC", 9)[0])
            C = spice.pxform("CAMERA", "STAR_TRACKER", float(tdb_seconds(t_ns)))
            assert np.linalg.norm(so3.log(C @ found.C_EK.T)) < 0.002 * ARCSEC
            assert np.max(np.abs(found.document["correction_arcsec"])) > 0.01
    finally:
        spice.kclear()
    rows = (tmp_path / "mounting.csv").read_text().splitlines()
    assert rows[0].startswith("time,qx,qy,qz,qw,covariance_xx_arcsec2")
    at_first = sp.predict(result, span["first"]).covariance_arcsec2
    assert float(rows[1].split(",")[5]) == pytest.approx(at_first[0, 0], rel=1e-4)
    sp.calibrate(campaign, method="gls").save(tmp_path, report=False)
    assert not (tmp_path / "mounting.bc").exists()
    assert "CLASS = 4" in (tmp_path / "mounting.tf").read_text()


def test_normal_equations_of_a_moving_mounting_are_those_of_its_data(rng):
    """What an archive sums must not know of a motion that was taken out: the same equations as without."""
    campaign = moving(rng, 40.0)
    plain, drifting = (calibrate_moving(campaign, Gls(), drift) for drift in ("none", "linear"))
    answers = [joined([NormalsDocument.of(normals_document(c))]) for c in (plain, drifting)]
    away = so3.log(answers[0].C_EK @ answers[1].C_EK.T) / plain.sigma_E
    assert np.all(np.abs(away) < 1e-2)
    assert answers[0].chi2 == pytest.approx(answers[1].chi2, rel=1e-3)


def test_what_drift_takes_is_checked_before_the_work():
    assert columns_asked("orbit:1, linear") == ("orbit:1 cos", "orbit:1 sin", "linear")
    assert columns_asked("auto") == ()
    for wrong in (
        "orbit",
        "orbit:0",
        "spline",
        "linear:2",
        "step:noon",
        "temperature:",
        "orbit:٣",
        "orbit:9",
        "linear,linear",
    ):
        with pytest.raises(ArgumentError, match="drift: "):
            columns_asked(wrong)


def test_a_model_that_images_do_not_tell_is_refused(rng):
    with pytest.raises(ArgumentError, match="30 images at these times do not tell that"):
        calibrate_moving(moving(rng, 0.0), Gls(), "orbit:1")  # a quarter of an hour


def test_the_turn_of_a_campaign_is_that_of_its_mounting(rng):
    """A mounting turned in every image by the same rotation is a mounting turned by it."""
    campaign = moving(rng, 0.0)
    turn = np.array([30.0, -20.0, 50.0]) * ARCSEC
    turned = calibrate(replace(campaign, turn_E=np.tile(turn, (30, 1))), Gls())
    straight = calibrate(campaign, Gls())
    np.testing.assert_allclose(so3.exp(turn) @ turned.C_EK, straight.C_EK, atol=1e-9)


def test_predict_on_the_command_line(tmp_path):
    """The JSON of a time within the span is the result itself; a day later its sigma is larger, and that is said."""
    path = written_demo(tmp_path / "demo", "--images", 6)
    assert starplumb("calibrate", path, "--method", "gls", "--no-report").status == 0
    result = json.loads((path.parent / "result" / "result.json").read_text())
    within = starplumb("predict", path.parent / "result", "--at", result["span"]["last"], "--json")
    found = json.loads(within.out)
    PredictionDocument.of(found)
    assert found["matrix"] == result["mounting"]["matrix"]
    np.testing.assert_allclose(found["covariance_arcsec2"], result["covariance_arcsec2"])
    later = starplumb("predict", path.parent / "result", "--at", "2025-07-01T00:00:00", "--json")
    assert json.loads(later.out)["sigma_arcsec"][0] > found["sigma_arcsec"][0]
    assert "outside the span of the images" in later.err
    shown = starplumb("predict", path.parent / "result" / "result.json", "--at", result["span"]["last"])
    assert "quaternion x y z w: " in shown.out
    wrong = starplumb("predict", path.parent / "result", "--at", "noon")
    assert wrong.status == 2
    assert "--at: found 'noon'" in wrong.err


def test_locate_uses_the_mounting_at_the_time_of_the_image(rng):
    """A mounting that drifts by 400 arcsec: the first and the last image look elsewhere than the mean one, by hundreds
    of metres; where the drift was estimated, each finds its own marker."""
    campaign = sp.demo(images=12, seed=5)
    data = campaign.loaded.campaign
    turn = 400.0 * ARCSEC * np.linspace(-0.5, 0.5, 12)[:, None] * np.array([1.0, 0.0, 0.0])
    attitude = data.one_attitude
    nearest = np.argmin(np.abs(attitude.t_ns[:, None] - data.images.t_ns), axis=1)
    C_EF = so3.exp(turn[nearest]) @ so3.from_quaternion(attitude.q_EF)
    drifting = data.with_attitude(lambda a: replace(a, q_EF=so3.to_quaternion(C_EF)))
    moved = replace(campaign, loaded=replace(campaign.loaded, campaign=drifting))
    result = sp.calibrate(moved, method="gls", drift="linear")
    for i in (0, 11):
        row = int(np.flatnonzero(data.sightings.image == i)[0])
        marker = data.landmarks.r_J[data.sightings.landmark[row]]
        _, _, height = itrf_to_geodetic(marker)
        pixel = {"column": float(data.sightings.column_px[row]), "row": float(data.sightings.row_px[row])}
        place = sp.locate(moved, result, image=campaign.images[i], height_m=float(height), **pixel)
        off = np.linalg.norm(np.array(place.document["itrf_m"]) - marker)
        assert off < 5.0 * np.max(place.document["sigma_east_north_up_m"])
        mean = replace(moved.loaded, campaign=replace(drifting, C_EK=result.C_EK))
        rests = sp.locate(
            replace(moved, loaded=mean), "model", image=campaign.images[i], height_m=float(height), **pixel
        )
        assert np.linalg.norm(np.array(rests.document["itrf_m"]) - marker) > 300.0


def test_a_kind_of_motion_may_be_alarmed_by_as_often_as_another():
    """Drift, step and orbit have a third each: two places of a step a sixth, of three harmonics the first a half."""
    families = {
        "linear": (("linear",),),
        "step": (("step:1",), ("step:2",)),
        "orbit:1": ((),),
        "orbit:2": ((),),
        "orbit:3": ((),),
    }
    shares = _weights(families)
    assert shares == pytest.approx(
        {"linear": 1 / 3, "step": 1 / 6, "orbit:1": 1 / 6, "orbit:2": 1 / 12, "orbit:3": 1 / 12}
    )
    assert _weights({"orbit:1": ((),)}) == {"orbit:1": 1.0}


def test_a_harmonic_is_combined_with_what_else_the_images_can_tell():
    steps = (("step:1",), ("step:2",))
    found = structures({"orbit:1": (harmonics(1),), "step": steps, "temperature:a": (("temperature:a",),)})
    assert list(found) == ["constant", "orbit:1", "step", "temperature:a", "orbit:1+step"]
    assert found["orbit:1+step"] == tuple((*harmonics(1), *names) for names in steps)


def test_what_an_estimated_motion_adds_widens_the_interval(rng):
    """As independent errors add: the squares of the half-widths."""
    still = calibrate(moving(rng, 0.0), Gls())
    moves = calibrate_moving(moving(rng, 400.0), Gls(), "linear").moves
    wide = replace(moves.motion, covariance=100.0 * moves.motion.covariance)
    found = _answer(still, replace(moves, motion=wide), "linear")
    further = np.diagonal(found.moves.further_E)
    assert np.all(np.sqrt(further) > still.sigma_E)
    np.testing.assert_allclose(found.interval_95_E**2, still.interval_95_E**2 + 1.96**2 * further, rtol=1e-6)
    np.testing.assert_allclose(found.sigma_E**2, still.sigma_E**2 + further, rtol=1e-9)


def test_a_result_of_an_older_version_is_predicted_as_a_constant(rng):
    campaign = moving(rng, 0.0)
    found = calibrate(campaign, Gls())
    older = result_document(found, "gls", ("camera", "tracker"), {}, {})
    for key in ("motion", "orbit", "span"):
        older[key] = None
    document = ResultDocument.from_json(json.dumps(older), "result.json")
    at = predicted(document, int(campaign.images.t_ns[0]))
    np.testing.assert_allclose(at.C_EK, found.C_EK, atol=1e-12)
    np.testing.assert_array_equal(at.turn_E, 0.0)
    assert np.all(np.diagonal(at.covariance_E) >= 0.999 * found.sigma_E**2)
