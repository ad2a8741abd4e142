"""Least-squares matching: against closed forms, SciPy's solver and the Cramer-Rao bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from blobs import Blobs, grid
from scipy.optimize import least_squares as scipy_least_squares
from scipy.optimize import minimize

from starplumb.imagery.matching.contrast import Contrast
from starplumb.imagery.matching.least_squares import best_known, carried_on, match
from starplumb.imagery.matching.likeness import Layers, look_of
from starplumb.imagery.matching.rounds import SHAPE
from starplumb.imagery.matching.sandwich import inverted, long_run
from starplumb.imagery.matching.template import Template
from starplumb.imagery.matching.whitening import Whitener

N = 48
STEP = 0.5
UNBENT = np.zeros((2, 2))


def template_of(ground, margin=12):
    return Template(ground.on(2 * (N + 2 * margin) - 1, STEP), STEP)


def window_of(ground, place, B=UNBENT, gain=1.0, offset=0.0, blur_px=0.0):
    """A window in which the ground's origin lies at ``place`` from its centre."""
    x, y = grid(N)
    u, v = x - place[0], y - place[1]
    at = (1.0 + B[0, 0]) * u + B[0, 1] * v, B[1, 0] * u + (1.0 + B[1, 1]) * v
    return gain * ground.at(*at, blur_px) + offset


CENTRE = 0.5 * (N - 1.0) * np.ones(2)


def off(found, place, B=UNBENT):
    """How far a match lies from where the point it tells is, in a window made by :func:`window_of`."""
    return found.place_px - CENTRE - place - np.linalg.solve(np.eye(2) + B, found.point_px)


def test_a_template_goes_through_its_samples_and_its_slopes_are_those_of_the_ground(rng):
    ground = Blobs.draw(rng)
    template = template_of(ground)
    x, y = rng.uniform(-20.0, 20.0, (2, 200))
    at = x + template.centre[0], y + template.centre[1]
    np.testing.assert_allclose(template.at(*at), ground.at(x, y), atol=2e-3)
    for ours, true in zip(template.slopes_at(*at), ground.slopes(x, y), strict=True):
        np.testing.assert_allclose(ours, true, atol=0.02)
    rows, columns = np.mgrid[:5, :7].astype(float)
    np.testing.assert_allclose(template.at(STEP * columns, STEP * rows), template.samples[:5, :7], atol=1e-12)


@pytest.mark.parametrize(
    ("place", "B", "gain", "offset"),
    [
        ((0.0, 0.0), np.zeros((2, 2)), 1.0, 0.0),
        ((0.37, -0.81), np.zeros((2, 2)), 1.0, 0.0),
        ((-0.6, 0.2), np.array([[0.01, 0.02], [-0.015, -0.008]]), 3.0, 40.0),
        ((0.3, 0.3), np.zeros((2, 2)), -0.5, 2.0),
    ],
    ids=["nothing", "shift", "affine and radiometry", "contrast reversed"],
)
def test_a_window_without_noise_is_found_where_it_is(rng, place, B, gain, offset):
    ground = Blobs.draw(rng)
    found = match(template_of(ground), window_of(ground, place, B, gain, offset), CENTRE)
    np.testing.assert_allclose(off(found, place, B), 0.0, atol=1e-3)
    np.testing.assert_allclose(found.shape, B, atol=2e-4)
    assert found.gain == pytest.approx(gain, rel=2e-3)
    assert found.agreement == pytest.approx(np.sign(gain), abs=1e-3)


def test_the_search_may_begin_two_pixels_away(rng):
    ground = Blobs.draw(rng)
    found = match(template_of(ground), window_of(ground, (0.2, 0.1)), CENTRE + np.array([1.6, -1.3]))
    np.testing.assert_allclose(off(found, (0.2, 0.1)), 0.0, atol=1e-3)


def test_with_noise_the_place_is_that_of_scipys_least_squares_on_the_ground_itself(rng):
    ground, place = Blobs.draw(rng), np.array([0.4, -0.2])
    window = window_of(ground, place, gain=2.0) + rng.normal(0.0, 0.05, (N, N))
    found = match(template_of(ground), window, CENTRE)

    def left(p):
        model = window_of(ground, p[:2], p[2:6].reshape(2, 2), p[6], p[7])
        return np.concatenate([((window - model) / 0.05).ravel(), p[2:6] / SHAPE])

    best = scipy_least_squares(left, [0.0] * 6 + [1.0, 0.0], x_scale=[0.1, 0.1, *[0.01] * 4, 1.0, 1.0])
    apart = off(found, best.x[:2], best.x[2:6].reshape(2, 2))
    # Tukey's weights lose 5 % of efficiency: a fifth of a sigma
    assert np.all(np.abs(apart) < 0.7 * np.sqrt(np.diag(found.covariance_px2)))
    J = best.jac
    # a pixel x from the place moves by B x when B is changed, as it does when the place moves by -B x
    x = found.place_px - CENTRE - best.x[:2]
    at = np.concatenate([np.eye(2), -np.kron(np.eye(2), x)], axis=1)
    exact = np.sqrt(np.diag(at @ np.linalg.inv(J.T @ J)[:6, :6] @ at.T))
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance_px2)), exact, rtol=0.35)


def errors_in(rng, trials, spoil):
    """Errors (t, 2) and covariances (t, 2, 2) of windows, and the bound for white noise of 0.1 (t, 2, 2)."""
    errors, covariances, bounds = [], [], []
    x, y = grid(N)
    for _ in range(trials):
        ground, place = Blobs.draw(rng), rng.uniform(-0.5, 0.5, 2)
        T = ground.on(N, 1.0, place)
        found = match(template_of(ground), spoil(T), CENTRE)
        errors.append(off(found, place))
        covariances.append(found.covariance_px2)
        gx, gy = (
            -(ground.on(N, 1.0, place + h) - ground.on(N, 1.0, place - h)) / 2e-3 for h in 1e-3 * np.eye(2)
        )
        J = np.stack([gx, gy, gx * x, gx * y, gy * x, gy * y, T, np.ones((N, N))], axis=-1).reshape(-1, 8)
        prior = np.diag([0.0, 0.0, *[SHAPE**-2] * 4, 0.0, 0.0])
        at = np.concatenate([np.eye(2), np.kron(np.eye(2), found.place_px - CENTRE)], axis=1)
        bounds.append(at @ np.linalg.inv(J.T @ J / 0.1**2 + prior)[:6, :6] @ at.T)
    return np.array(errors), np.array(covariances), np.array(bounds)


def whitened_rms(errors, covariances):
    L = np.linalg.cholesky(covariances)
    return float(np.sqrt(np.mean(np.linalg.solve(L, errors[..., None]) ** 2)))


@pytest.mark.slow
def test_under_white_noise_the_errors_reach_the_bound_and_the_sigmas_are_honest(rng):
    errors, covariances, bounds = errors_in(rng, 120, lambda z: z + rng.normal(0.0, 0.1, z.shape))
    # 240 numbers: their rms is known to 5 %
    assert whitened_rms(errors, bounds) < 1.15
    assert 0.9 < whitened_rms(errors, covariances) < 1.1
    assert np.abs(np.mean(errors, axis=0)).max() < 4.0 * np.std(errors) / np.sqrt(len(errors))


def broad_noise(rng, n):
    """Noise of 0.2 that hardly changes over 3 px, and a little white noise, (n, n)."""
    from scipy.ndimage import gaussian_filter

    broad = gaussian_filter(rng.normal(size=(3 * n, 3 * n)), 3.0)[n:-n, n:-n]
    return 0.2 * broad * 2.0 * np.sqrt(np.pi) * 3.0 + rng.normal(0.0, 0.02, (n, n))


@pytest.mark.slow
def test_broad_noise_is_whitened_which_halves_the_errors_and_the_sigmas_are_honest(rng, monkeypatch):
    seeds = np.random.default_rng(7), np.random.default_rng(7)
    errors, covariances, _ = errors_in(seeds[0], 50, lambda z: z + broad_noise(seeds[0], N))
    # 100 numbers: their rms is known to 7 %
    assert 0.8 < whitened_rms(errors, covariances) < 1.2
    monkeypatch.setattr(Whitener, "of", classmethod(lambda cls, *_: cls.none()))
    plain, _, _ = errors_in(seeds[1], 50, lambda z: z + broad_noise(seeds[1], N))
    assert np.std(errors) < 0.5 * np.std(plain)


def test_what_lies_in_masked_pixels_does_not_matter(rng):
    ground = Blobs.draw(rng)
    window = window_of(ground, (0.3, 0.1)) + rng.normal(0.0, 0.02, (N, N))
    use = np.ones((N, N), bool)
    use[:, :15] = False
    first, second = window.copy(), window.copy()
    first[:, :15], second[:, :15] = 100.0, np.nan
    one, other = (match(template_of(ground), each, CENTRE, use) for each in (first, second))
    np.testing.assert_array_equal(one.place_px, other.place_px)
    np.testing.assert_allclose(off(one, (0.3, 0.1)), 0.0, atol=0.01)
    assert one.kept == pytest.approx(33 / 48, abs=0.05)


def test_the_place_that_is_known_best_is_where_the_variance_of_what_is_told_is_least(rng):
    root = rng.normal(size=(6, 6))
    covariance = root @ root.T

    def variance(x):
        at = np.concatenate([np.eye(2), np.kron(np.eye(2), x)], axis=1)
        return np.trace(at @ covariance @ at.T)

    best = minimize(variance, np.zeros(2), tol=1e-10).x
    np.testing.assert_allclose(best_known(covariance, np.full(2, 100.0)), best, atol=1e-5)
    assert np.abs(best_known(covariance, np.full(2, 0.01))).max() == pytest.approx(0.01)


def test_a_chip_half_under_cloud_is_told_where_it_is_seen_and_there_its_sigma_is_smaller(rng):
    ground, B = Blobs.draw(rng), np.array([[0.01, 0.012], [-0.015, -0.01]])
    window = window_of(ground, (0.3, 0.1), B) + rng.normal(0.0, 0.1, (N, N))
    use = np.ones((N, N), bool)
    use[:, 22:] = False
    found = match(template_of(ground), window, CENTRE, use)
    assert -18.0 < found.place_px[0] - CENTRE[0] < -8.0
    assert np.all(np.abs(off(found, (0.3, 0.1), B)) < 4.0 * np.sqrt(np.diag(found.covariance_px2)))
    # what it would say of its middle: B is known to some 0.3 %, which comes to 0.04 px there
    x, y = grid(N)
    gx, gy = (s[use] for s in ground.slopes(x - 0.3, y - 0.1))
    J = np.stack([gx, gy, gx * x[use], gx * y[use], gy * x[use], gy * y[use]], axis=-1) / 0.1
    middle = np.linalg.inv(J.T @ J + np.diag([0.0, 0.0, *[SHAPE**-2] * 4]))[:2, :2]
    assert np.trace(found.covariance_px2) < 0.5 * np.trace(middle)


def test_changed_ground_loses_its_weight(rng):
    ground = Blobs.draw(rng)
    window = window_of(ground, (0.3, 0.1)) + rng.normal(0.0, 0.02, (N, N))
    window[10:20, 20:34] = 4.0 + rng.normal(0.0, 0.1, (10, 14))
    found = match(template_of(ground), window, CENTRE)
    assert np.abs(off(found, (0.3, 0.1))).max() < 5.0 * np.sqrt(np.diag(found.covariance_px2)).max()
    assert np.median(found.weight[10:20, 20:34]) == 0.0


def test_a_flat_window_gives_no_place(rng):
    ground = Blobs.draw(rng)
    assert match(template_of(ground), np.full((N, N), 7.0), CENTRE) is None
    assert match(template_of(ground), np.full((N, N), np.nan), CENTRE) is None


@pytest.mark.parametrize("width", [0.0, 0.6, 0.9])
@pytest.mark.parametrize("gain", [1.0, -2.0])
def test_a_template_is_made_like_a_blurred_window_of_another_contrast(rng, width, gain):
    ground = Blobs.draw(rng)
    layers, (x, y) = Layers(template_of(ground)), grid(N)
    window = window_of(ground, (0.0, 0.0), gain=gain, offset=7.0, blur_px=width)
    seen = window + rng.normal(0.0, 0.005, (N, N))
    # a tenth of the pixels show something else
    seen[:5] = 40.0
    places = x + layers.template.centre[0], y + layers.template.centre[1]
    look = look_of(layers.at(*places), seen, np.ones((N, N)))
    like = layers.like(look).at(*places)
    assert np.std(like - window) < 0.02 * np.std(window)
    assert look.gains[0] == pytest.approx(gain, rel=0.02)
    assert np.median(look.weight[:5]) == 0.0
    if gain > 0.0:
        assert look.blur_px == pytest.approx(width, abs=0.12)


def test_local_contrast_and_brightness_are_those_of_the_halves_of_a_window(rng):
    template = rng.normal(size=(N, N))
    left = grid(N)[0] < 0.0
    window = np.where(left, 2.0 * template + 5.0, -0.5 * template - 3.0)
    window += np.where(left, 0.6, 0.15) * rng.normal(size=(N, N))
    contrast = Contrast.of(template, window, np.ones((N, N)))
    # far from the border between them
    np.testing.assert_allclose(contrast.gain[:, :6], 2.0, atol=0.15)
    np.testing.assert_allclose(contrast.gain[:, -6:], -0.5, atol=0.15)
    assert np.std(contrast(template - window)[:, :6]) == pytest.approx(1.0 / 0.6, rel=0.25)
    flat = Contrast.of(np.ones((N, N)), window, np.ones((N, N)))
    np.testing.assert_allclose(flat.gain, 0.0, atol=1e-3)


def test_half_a_window_of_reversed_contrast_moves_nothing(rng):
    ground, place = Blobs.draw(rng), np.array([0.3, -0.2])
    window = window_of(ground, place)
    shadowed = np.where(grid(N)[0] + 0.5 * grid(N)[1] < 4.0, window, 1.0 - 0.6 * window)
    found = match(template_of(ground), shadowed + rng.normal(0.0, 0.02, (N, N)), CENTRE)
    error = off(found, place)
    assert np.abs(error).max() < 0.2
    assert np.all(np.abs(error) < 4.0 * np.sqrt(np.diag(found.covariance_px2)))


def test_an_error_that_rounds_carry_on_is_the_sum_of_all_of_them(rng):
    ground = Blobs.draw(rng)
    told = match(template_of(ground), window_of(ground, (0.3, 0.1)) + rng.normal(0.0, 0.1, (N, N)), CENTRE)
    pull = np.array([[0.5, 0.2], [0.0, -0.25]])
    rounds = sum(np.linalg.matrix_power(pull, k) for k in range(60))
    expected = rounds @ told.covariance_px2 @ rounds.T
    assert told.agreement > 0.65
    np.testing.assert_allclose(carried_on(told, pull).covariance_px2, expected, rtol=1e-9)
    badly = carried_on(replace(told, agreement=-0.6), pull)
    np.testing.assert_allclose(badly.covariance_px2, 1.2**2 * expected, rtol=1e-9)
    assert carried_on(told, np.diag([0.9, 0.0])) is None
    assert carried_on(told, np.diag([np.nan, 0.0])) is None


@pytest.mark.slow
def test_where_hills_are_reversed_the_place_follows_where_it_was_held_and_sigmas_are_larger(rng, monkeypatch):
    larger = []
    for _ in range(8):
        ground = Blobs.draw(rng)
        seen = replace(ground, height=ground.height * np.where(rng.uniform(size=160) < 0.25, -1.0, 1.0))
        window = window_of(seen, (0.3, -0.2)) + rng.normal(0.0, 0.05, (N, N))
        sigmas = []
        for sure in (0.8, -1.0):
            monkeypatch.setattr("starplumb.imagery.matching.least_squares.SURE", sure)
            found = match(template_of(ground), window, CENTRE)
            sigmas.append(np.nan if found is None else np.sqrt(np.trace(found.covariance_px2)))
        larger.append(sigmas[0] / sigmas[1])
    # reversed edges push away from where they are
    assert np.nanmedian(larger) > 1.1


def test_the_long_run_covariance_is_the_tapered_sum_over_all_pairs(rng):
    scores = rng.normal(size=(6, 7, 2))
    expected = np.zeros((2, 2))
    for i, j in np.ndindex(6, 7):
        for k, m in np.ndindex(6, 7):
            taper = max(1.0 - abs(i - k) / 4.0, 0.0) * max(1.0 - abs(j - m) / 4.0, 0.0)
            expected += taper * np.outer(scores[i, j], scores[k, m])
    np.testing.assert_allclose(long_run(scores, 3), expected, rtol=1e-12)


def test_a_matrix_of_unlike_scales_is_inverted(rng):
    A = rng.normal(size=(4, 4))
    scale = np.array([1e-6, 1.0, 1e4, 1e-3])
    N4 = (A @ A.T + np.eye(4)) * scale[:, None] * scale
    expected = np.linalg.inv(A @ A.T + np.eye(4)) / scale[:, None] / scale
    np.testing.assert_allclose(inverted(N4), expected, rtol=1e-9)


def test_white_residuals_are_left_as_they_are_and_broad_ones_made_white(rng):
    good = np.ones((N, N), bool)
    assert not Whitener.of(rng.normal(size=(N, N)), good).acts
    broad = broad_noise(rng, N)

    def beside(q):
        return np.sum(q[:, 1:] * q[:, :-1]) / np.sum(q * q)

    whitener = Whitener.of(broad, good)
    inside = whitener(broad)[2:, 2:-2]
    assert beside(broad) > 0.9
    assert abs(beside(inside)) < 0.15
    assert np.std(inside) < 0.3 * np.std(broad)
    both = whitener(np.stack([broad, good.astype(float)], axis=-1))
    np.testing.assert_array_equal(both[..., 0], whitener(broad))


def test_a_prediction_of_known_coefficients_is_found_and_reaches_over_good_pixels_only(rng):
    e = rng.normal(size=(N, N))
    q = np.zeros((N, N))
    for i, j in np.ndindex(N, N):
        q[i, j] = e[i, j] + 0.5 * (q[i, j - 1] if j else 0.0) + 0.3 * (q[i - 1, j] if i else 0.0)
    good = np.ones((N, N), bool)
    good[20, 30] = False
    whitener = Whitener.of(q, good)
    np.testing.assert_allclose(whitener.coefficients[0], 0.5, atol=0.08)
    assert np.std(whitener(q)[4:, 4:-4]) == pytest.approx(np.std(e), rel=0.05)
    seen = whitener.reach(good)
    assert seen.sum() == (N - 2) * (N - 4) - 13
    assert not seen[20, 30:33].any()
    assert not seen[21:23, 28:33].any()
    assert seen[20, 29]
