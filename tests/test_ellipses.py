"""Sightings whose noise is an ellipse: another sigma of the column than of the row, and a correlation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import oracles
from helpers import OBSERVATIONS, write_good_campaign
from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators import METHODS
from starplumb.estimators.consensus import own_covariance
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.io.results.residual_table import residual_columns, residual_names
from starplumb.io.scenario.read import load_scenario
from starplumb.judge.calibrate import calibrate
from starplumb.judge.error_shares import shares
from starplumb.judge.files.image_errors import OwnErrors, _noise
from starplumb.physics import so3
from starplumb.physics.covariance import ellipse_of, ellipse_parts
from starplumb.physics.errors import InputError
from starplumb.plan.bound import bound_E
from starplumb.report.calibration.figures import by_ellipse
from starplumb.solve import chunks, design_rows
from starplumb.solve.adjustment import solve
from starplumb.solve.normals import image_normals
from starplumb.solve.problem import Problem
from starplumb.table.campaign import Sightings
from starplumb.table.equation import linearise
from starplumb.table.error_sources import as_stated, state, stated_sources
from starplumb.table.geometry import observe
from starplumb.table.observations import Observations
from starplumb.table.simulate import Errors, measure


def elongated(o: Observations, rng: np.random.Generator, ratio: float = 10.0) -> Observations:
    """Long ellipses in every direction: 0.3 px along, less by ``ratio`` across."""
    angle = rng.uniform(0.0, np.pi, o.n)
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    across = np.stack([-np.sin(angle), np.cos(angle)], axis=-1)
    V = 0.09 * along[:, :, None] * along[:, None, :]
    V = V + (0.3 / ratio) ** 2 * across[:, :, None] * across[:, None, :]
    column, row = np.sqrt(V[:, 0, 0]), np.sqrt(V[:, 1, 1])
    sigma_px, ellipse = ellipse_of(column, row, V[:, 0, 1] / (column * row))
    return replace(o, sigma_px=sigma_px, ellipse=ellipse)


def marked(header: str, noise: str) -> str:
    """The observations of the campaign by hand with other columns of noise."""
    lines = OBSERVATIONS.replace("sigma_px", header).strip().split("\n")
    return "\n".join([lines[0], *(line.rsplit(",", 1)[0] + "," + noise for line in lines[1:])]) + "\n"


THREE = "sigma_column_px,sigma_row_px,correlation"


def test_three_columns_are_a_covariance_by_hand(tmp_path: Path) -> None:
    """0.3 and 0.4 px correlated by -0.5: [[0.09, -0.06], [-0.06, 0.16]]."""
    loaded = load_campaign(write_good_campaign(tmp_path, observations=marked(THREE, "0.3,0.4,-0.5")))
    o = observe(loaded.campaign)
    expected = np.array([[0.09, -0.06], [-0.06, 0.16]])
    np.testing.assert_allclose(o.noise_px, np.broadcast_to(expected, (o.n, 2, 2)), rtol=1e-12)
    np.testing.assert_allclose(o.noise_root_px @ o.noise_root_px.mT, o.noise_px, rtol=1e-12)
    assert not any("ignored" in notice for notice in loaded.notices)


@pytest.mark.parametrize(
    ("header", "noise", "words"),
    [
        ("sigma_px," + THREE, "0.3,0.3,0.4,0.1", "sigma_px and sigma_column_px, wanted only one of the two"),
        ("sigma_column_px,sigma_row_px", "0.3,0.4", "wanted the column correlation too"),
        ("noise", "0.3", "wanted the column sigma_px too"),
        (THREE, "0.3,0.0,0.1", "row 2, column sigma_row_px: found 0, wanted a positive number"),
        (THREE, "0.3,0.4,1.0", "row 2, column correlation: found 1, wanted a correlation"),
    ],
)
def test_what_is_no_covariance_is_named(tmp_path: Path, header: str, noise: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load_campaign(write_good_campaign(tmp_path, observations=marked(header, noise)))


def test_a_correlation_of_something_else_stays_ignored(tmp_path: Path) -> None:
    """A column of that name beside sigma_px is a matcher's score, and not even a number where it failed."""
    table = marked("sigma_px,correlation", "0.2,none")
    loaded = load_campaign(write_good_campaign(tmp_path, observations=table))
    assert any("ignored the column correlation" in notice for notice in loaded.notices)


def test_one_sigma_for_all_beside_ellipses_is_refused(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path, observations=marked(THREE, "0.3,0.4,-0.5"))
    path.write_text(
        path.read_text().replace('file = "observations.csv"', 'file = "observations.csv"\nsigma_px = 0.2')
    )
    with pytest.raises(InputError, match=r"sigma_column_px beside observations.sigma_px"):
        load_campaign(path)


def test_names_of_ones_own(tmp_path: Path) -> None:
    path = write_good_campaign(tmp_path, observations=marked("sc,sr,rho", "0.3,0.4,-0.5"))
    names = 'columns = { sigma_column_px = "sc", sigma_row_px = "sr", correlation = "rho" }'
    path.write_text(
        path.read_text().replace('file = "observations.csv"', f'file = "observations.csv"\n{names}')
    )
    s = load_campaign(path).campaign.sightings
    np.testing.assert_allclose(
        np.stack(ellipse_parts(s.sigma_px, s.ellipse))[:, 0], [0.3, 0.4, -0.5], rtol=1e-12
    )


def test_written_is_read_back(tmp_path: Path, rng: np.random.Generator) -> None:
    campaign = truth(FRAME, 2, 4)
    o = elongated(observe(campaign), rng)
    sightings = replace(campaign.sightings, sigma_px=o.sigma_px, ellipse=o.ellipse)
    write_campaign(tmp_path, replace(campaign, sightings=sightings))
    again = load_campaign(tmp_path / "campaign.toml").campaign.sightings
    np.testing.assert_allclose(again.sigma_px, sightings.sigma_px, rtol=1e-12)
    np.testing.assert_allclose(again.ellipse, sightings.ellipse, rtol=1e-9, atol=1e-12)


def test_joined_and_blurred_by_hand() -> None:
    """A circle among ellipses stays one; a rounding of 0.3 px adds 0.09 to both variances."""
    zero, one = np.zeros(1, dtype=np.int64), np.ones(1)
    circle = Sightings(zero, zero, one, one, 0.5 * one, np.zeros(1, dtype=np.bool_))
    sigma_px, ellipse = ellipse_of(0.3 * one, 0.4 * one, -0.5 * one)
    both = Sightings.joined([circle, replace(circle, sigma_px=sigma_px, ellipse=ellipse)])
    V = (both.sigma_px**2)[:, None, None] * both.ellipse
    np.testing.assert_allclose(V, [[[0.25, 0.0], [0.0, 0.25]], [[0.09, -0.06], [-0.06, 0.16]]], atol=1e-15)
    blurred = both.blurred(0.3)
    np.testing.assert_allclose(
        (blurred.sigma_px**2)[:, None, None] * blurred.ellipse, V + 0.09 * np.eye(2), atol=1e-15
    )


@pytest.mark.slow
@pytest.mark.parametrize("shared_site", [False, True])
def test_the_estimate_is_dense_least_squares_with_whole_covariances(shared_site, rng):
    """By SciPy, with one covariance of all observations and derivatives by differences."""
    o = elongated(observe(truth(FRAME, 2, 4, shared_site=shared_site)), rng)
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    found = Gls()(table, C_EK_TRUE)
    C_EK, chi2 = oracles.dense_gls(table, C_EK_TRUE)
    sigma = found.sigma_E
    assert np.abs(so3.log(found.C_EK @ C_EK.T) / sigma).max() < 1e-3
    assert float(found.chi2) == pytest.approx(chi2, rel=1e-4)
    bound = oracles.cramer_rao(table, C_EK_TRUE)
    unit = np.outer(sigma, sigma)
    np.testing.assert_allclose(found.covariance_E / unit, bound / unit, atol=1e-3)
    # the circle of the same mean square is another answer
    circle = Gls()(replace(table, ellipse=None), C_EK_TRUE)
    assert np.abs(so3.log(circle.C_EK @ found.C_EK.mT) / sigma).max() > 0.05


def test_chunks_are_the_whole(monkeypatch, rng):
    monkeypatch.setattr(chunks, "LARGE", 20)
    monkeypatch.setattr(chunks, "CHUNK", 10)
    o = elongated(observe(truth(LINE, 5, 8)), rng)
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    model = linearise(o, C_EK_TRUE)
    prior = np.zeros((3, 3)), np.zeros(3)
    whole = solve(o, model, model.H)
    chunked = Problem(o, (), C_EK_TRUE, np.zeros(0), prior)
    assert chunked.in_chunks
    sigma = np.sqrt(np.diag(whole.covariance))
    np.testing.assert_allclose(chunked.solution.x / sigma, whole.x / sigma, atol=1e-7)
    np.testing.assert_allclose(chunked.solution.covariance, whole.covariance, rtol=1e-8, atol=0.0)
    assert float(chunked.solution.chi2) == pytest.approx(float(whole.chi2), rel=1e-9)


def test_one_whitening_for_pixels_alone(rng):
    """Without any other error the rows of a large table are whitened by a root of the ellipse itself."""
    o = elongated(observe(truth(FRAME, 2, 5)), rng)
    o = replace(o, cov_landmark_J=np.zeros_like(o.cov_landmark_J))
    W = np.zeros((design_rows.ROWS, o.n))
    design_rows.load(W, o, slice(None))
    design_rows.fill(W, tuple(C_EK_TRUE.reshape(-1).tolist()), design_rows.NO_LENS)
    p, q, r = W[design_rows.WHITENING : design_rows.WHITENING + 3]
    root = np.zeros((o.n, 2, 2))
    root[:, 0, 0], root[:, 1, 0], root[:, 1, 1] = p, q, r
    np.testing.assert_allclose(
        root.mT @ root @ o.noise_px, np.broadcast_to(np.eye(2), (o.n, 2, 2)), atol=1e-9
    )


def test_drawn_errors_have_the_covariance(rng):
    o = elongated(observe(truth(FRAME, 1, 4)), rng, ratio=4.0)
    pixel = Errors.draw(o, rng, (20_000,)).pixel
    found = np.einsum("rni,rnj->nij", pixel, pixel) / len(pixel)
    scale = o.sigma_px[:, None, None] ** 2
    np.testing.assert_allclose(found / scale, o.noise_px / scale, atol=0.05)


def test_a_source_that_is_an_ellipse_is_stated_as_one(rng):
    """And not as so many errors in common; two sources add up."""
    o = elongated(observe(truth(FRAME, 2, 4)), rng)
    model = linearise(o, C_EK_TRUE)
    wide = as_stated("wide", "pixel", np.tile(np.diag([0.2, 0.0]), (o.n, 1, 1)), np.arange(o.n))
    stated = state(replace(o, ellipse=None), (*stated_sources(o), wide), model)
    assert stated.common_px is None
    np.testing.assert_allclose(stated.noise_px, o.noise_px + np.diag([0.04, 0.0]), rtol=1e-9, atol=1e-15)


SCENARIO = """\
[scenario]
name = "edges"
epoch = "2026-03-20T10:00:00"
[orbit]
model = "circular"
altitude_km = 500.0
inclination_deg = 97.4
[site]
latitude_deg = 43.5
longitude_deg = 4.9
[camera]
model = "frame"
focal_length_mm = 400.0
pixel_pitch_um = 4.5
image_size_px = [4096, 4096]
principal_point_px = [2047.5, 2047.5]
[[passes]]
pitch_deg = [10.0, 0.0, -10.0]
[markers]
layout = "grid"
count = [3, 2]
extent_km = [12.0, 10.0]
[truth.edges]
error = "pixel"
sigma_column_px = 0.4
sigma_row_px = 0.1
correlation = 0.8
"""


def test_a_scenario_draws_and_states_ellipses(tmp_path, rng):
    """0.4 and 0.1 px correlated by 0.8: [[0.16, 0.032], [0.032, 0.01]], in draws, table and bound."""
    path = tmp_path / "edges.toml"
    path.write_text(SCENARIO)
    scenario = load_scenario(path)
    by_hand = np.array([[0.16, 0.032], [0.032, 0.01]])
    np.testing.assert_allclose(
        scenario.stated.noise_px, np.broadcast_to(by_hand, (scenario.truth.n, 2, 2)), rtol=1e-9
    )
    drawn = scenario.sources[0].draw(rng, (3000,)).reshape(-1, 2)
    np.testing.assert_allclose(np.cov(drawn.T), by_hand, rtol=0.05)
    bound = bound_E(scenario)
    sigma = np.sqrt(np.diag(bound))
    found = Gls()(scenario.stated, scenario.C_EK_true).covariance_E
    np.testing.assert_allclose(found / sigma / sigma[:, None], bound / sigma / sigma[:, None], atol=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            ("correlation = 0.8", "correlation = 1.0"),
            "truth.edges.correlation: found 1.0, wanted a number between",
        ),
        (("correlation = 0.8", ""), "truth.edges.correlation: missing"),
        (("correlation = 0.8", "correlation = 0.8\nsigma_px = 0.3"), "truth.edges.sigma_px: found 0.3"),
    ],
)
def test_a_scenario_with_half_an_ellipse_is_refused(tmp_path, change, words):
    path = tmp_path / "edges.toml"
    path.write_text(SCENARIO.replace(*change))
    with pytest.raises(InputError, match=words):
        load_scenario(path)


def statistics(o, rng, name, runs):
    """Errors over sigma of many campaigns by a method, its own starts included."""
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (runs,)))
    found = METHODS[name]()(table, C_EK_TRUE)
    assert np.all(found.status == int(Status.OK))
    return so3.log(found.C_EK @ C_EK_TRUE.mT) / found.sigma_E, found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gls", "sequential", "image-plane", "ground-plane", "cross-product"])
def test_error_over_sigma_is_one(name, rng):
    """Pixel noise of ten to one governs: attitude and survey are small beside it."""
    o = elongated(observe(truth(FRAME, 4, 5, tilt_deg=20.0, yaw_deg=60.0)), rng)
    o = replace(
        o,
        cov_attitude_E=1e-4 * o.cov_attitude_E,
        cov_position_J=1e-4 * o.cov_position_J,
        cov_landmark_J=0.01 * o.cov_landmark_J,
    )
    score, found = statistics(o, rng, name, 1000)
    np.testing.assert_allclose(np.std(score, axis=0), 1.0, atol=4.0 / np.sqrt(2000))
    np.testing.assert_allclose(np.mean(score, axis=0), 0.0, atol=4.0 / np.sqrt(1000))
    if name == "gls":
        dof = int(found.degrees_of_freedom[0])
        assert np.mean(found.chi2) == pytest.approx(dof, abs=4 * np.sqrt(2 * dof / 1000))


def dense(o: Observations) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives (2 n, 3) by the mounting, and the covariance (2 n, 2 n) of all residuals."""
    sens = oracles.sensitivities(o, C_EK_TRUE)
    return sens.mounting, oracles.covariance_of_observations(o, sens)


def test_what_a_sighting_has_for_itself_is_written_out(rng):
    """R S R^T and the ellipse, in the three places that need it alone; a rounding adds to both variances."""
    o = elongated(observe(truth(FRAME, 1, 3)), rng)
    model = linearise(o, C_EK_TRUE)
    by_hand = np.array(
        [
            model.R[j] @ o.cov_landmark_J[o.landmark[j]] @ model.R[j].T + o.sigma_px[j] ** 2 * o.ellipse[j]
            for j in range(o.n)
        ]
    )
    np.testing.assert_allclose(own_covariance(o, model), by_hand, rtol=1e-12)
    rounded = _noise(o, model, OwnErrors(pixel=0.25))
    np.testing.assert_allclose(rounded, by_hand + 0.25 * np.eye(2), rtol=1e-12)


def test_normal_equations_of_images_sum_to_the_whole(rng):
    o = elongated(observe(truth(FRAME, 3, 4)), rng)
    problem = Problem(o, (), C_EK_TRUE, np.zeros(0), (np.zeros((3, 3)), np.zeros(3)))
    total = sum(one.information for one in image_normals(problem, np.zeros(0, dtype=np.int64)))
    H, V = dense(o)
    whole = H.T @ np.linalg.solve(V, H)
    scale = np.sqrt(np.diag(whole))
    np.testing.assert_allclose(total / np.outer(scale, scale), whole / np.outer(scale, scale), atol=1e-4)


def test_the_share_of_the_pixels_is_that_of_dense_least_squares(rng):
    campaign = truth(FRAME, 3, 6)
    o = elongated(observe(campaign), rng)
    column, row = Errors.draw(o, rng).pixel.T
    s = campaign.sightings
    sightings = replace(
        s, sigma_px=o.sigma_px, ellipse=o.ellipse, column_px=s.column_px + column, row_px=s.row_px + row
    )
    found = shares(calibrate(replace(campaign, sightings=sightings), Gls()))["image measurement"]
    H, V = dense(o)
    gain = np.linalg.solve(H.T @ np.linalg.solve(V, H), np.linalg.solve(V, H).T)
    by_hand = gain @ oracles.noise_of_pixels(o) @ gain.T
    scale = np.sqrt(np.diag(by_hand))
    np.testing.assert_allclose(found / np.outer(scale, scale), by_hand / np.outer(scale, scale), atol=1e-3)


def test_residuals_and_shares_know_the_ellipse(rng):
    """A residual along a long ellipse weighs less than one across; the shares of the errors sum to the covariance."""
    campaign = truth(FRAME, 3, 6)
    o = elongated(observe(campaign), rng)
    sightings = replace(campaign.sightings, sigma_px=o.sigma_px, ellipse=o.ellipse)
    error = Errors.draw(o, rng).pixel
    sightings = replace(
        sightings, column_px=sightings.column_px + error[:, 0], row_px=sightings.row_px + error[:, 1]
    )
    done = calibrate(replace(campaign, sightings=sightings), Gls())
    r = done.residuals
    inverse = np.linalg.inv((o.sigma_px**2)[:, None, None] * o.ellipse)
    expected = np.sqrt(np.einsum("ni,nij,nj->n", r.fit_px, inverse, r.fit_px))
    np.testing.assert_allclose(r.normalised, expected, rtol=1e-9)
    table = dict(zip(residual_names(done), residual_columns(done, 0.0), strict=True))
    np.testing.assert_allclose(
        [table[name] for name in THREE.split(",")], ellipse_parts(o.sigma_px, o.ellipse), rtol=1e-12
    )
    shares_E = sum(shares(done).values())
    np.testing.assert_allclose(
        shares_E, done.covariance_E, rtol=1e-6, atol=1e-9 * np.trace(done.covariance_E)
    )
    (figure,) = by_ellipse(done)
    assert "ellipses" in figure.alt
