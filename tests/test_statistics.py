"""Mergeable statistics against NumPy and SciPy on the whole sample."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from starplumb.study.statistics import Moments, chi2_band, quantile, trials_for
from starplumb.study.verdict import verdict


@pytest.mark.parametrize("cuts", [[1000], [1, 999], [10, 400, 77, 513], [0, 1000]])
def test_merged_moments_are_those_of_the_whole_sample(rng, cuts):
    x = rng.standard_gamma(2.0, (1000, 3)) * [1e-6, 1.0, 1e6] + [1.0, -3.0, 0.0]
    merged = Moments.of(x[:0])
    for part in np.split(x, np.cumsum(cuts)[:-1]):
        merged = merged.merge(Moments.of(part))
    assert int(merged.n) == 1000
    np.testing.assert_allclose(merged.mean, x.mean(0), rtol=1e-12)
    np.testing.assert_allclose(merged.sigma, x.std(0, ddof=1), rtol=1e-9)
    np.testing.assert_allclose(merged.rms, np.sqrt(np.mean(x**2, 0)), rtol=1e-12)
    np.testing.assert_allclose(merged.kurtosis[1:], stats.kurtosis(x, fisher=False)[1:], rtol=1e-9)
    np.testing.assert_allclose(merged.largest, np.abs(x).max(0))


@pytest.mark.slow
def test_interval_of_sigma_covers_for_heavy_tails_too(rng):
    """95 % of intervals hold the true sigma: of a Gaussian, and of a Student with kurtosis 4.5."""
    for draw, sigma in (
        (rng.standard_normal, 1.0),
        (lambda size: rng.standard_t(8.0, size), np.sqrt(8.0 / 6.0)),
    ):
        parts = [Moments.of(draw((2000, 1))) for _ in range(600)]
        hits = [abs(float(m.sigma[0]) - sigma) < 1.96 * float(m.sigma_error[0]) for m in parts]
        assert 0.91 < np.mean(hits) < 0.98


def test_standard_errors_are_the_scatter_of_repeated_samples(rng):
    parts = [Moments.of(rng.standard_normal((500, 1)) + 0.7) for _ in range(800)]
    for value, error in (("mean", "mean_error"), ("sigma", "sigma_error"), ("rms", "rms_error")):
        scatter = np.std([getattr(m, value)[0] for m in parts])
        assert np.mean([getattr(m, error)[0] for m in parts]) == pytest.approx(scatter, rel=0.1)


def test_quantiles_are_those_of_the_sample(rng):
    x = rng.standard_normal(20000) * 3e-6
    for q in (0.001, 0.025, 0.3, 0.5, 0.84, 0.999):
        assert quantile(x, q)[0] == np.quantile(x, q, method="inverted_cdf")


def test_quantile_of_few_draws_by_hand():
    """Of 1 .. 9 the median is 5; 1.96 sqrt(9/4) = 2.94, so its interval's ends have ranks 1.56 and 7.44 from 0."""
    assert quantile(np.arange(9.0, 0.0, -1.0), 0.5) == (5.0, 2.0, 9.0)
    assert quantile(np.array([3.0]), 0.9) == (3.0, 3.0, 3.0)
    assert np.isnan(quantile(np.zeros(0), 0.5)).all()


def test_quantile_interval_covers(rng):
    """Distribution-free: the true 90 % point of an exponential lies within 95 % of the intervals."""
    hits = []
    for _ in range(500):
        _, low, high = quantile(rng.exponential(1.0, 1000), 0.9)
        hits.append(low <= np.log(10.0) <= high)
    assert 0.92 < np.mean(hits) < 0.98


def test_chi_square_band_and_sample_size_rule():
    low, high = chi2_band(300.0)
    assert stats.chi2.cdf(300.0 * low, 300) == pytest.approx(0.025)
    assert stats.chi2.sf(300.0 * high, 300) == pytest.approx(0.025)
    assert trials_for(0.01) == 45000  # the figure of Lebedev and Tkachenko (2012)
    assert trials_for(0.1) == 450
    assert trials_for(0.01, kurtosis=8.0) == 157500


def ratio(value=1.0, wrong=False, low=0.99):
    return {"value": value, "low": low, "high": 2.0, "band_low": 0.98, "band_high": 1.02, "wrong": wrong}


def document(kurtosis=3.0, stated=None, nees=None, fit=None, bound=None, failed=0, lost=0):
    """What a study of a hundred trials found of one method; all is well unless said otherwise, of z alone."""
    axes = {
        axis: {"kurtosis": k, "error_over_stated": r, "rmse_over_bound": b}
        for axis, k, r, b in zip(
            "xyz",
            (3.0, 3.0, kurtosis),
            (ratio(), ratio(), stated or ratio()),
            (ratio(), ratio(), bound),
            strict=True,
        )
    }
    return {
        "failed": failed,
        "without_estimate": lost,
        "status": {"ok": 100 - failed, "weak": 0, "not_converged": failed},
        "axes": axes,
        "nees": nees or ratio(),
        "chi2_per_degree_of_freedom": fit,
        "trials_for_1_percent": 9,
    }


RIGHT = "the stated covariance is right: error over stated sigma 1.000, 1.000, 1.000 about x, y, z"


@pytest.mark.parametrize(
    ("found", "said"),
    [
        ({}, [RIGHT]),
        ({"kurtosis": 3.9}, [RIGHT]),
        ({"kurtosis": 4.1}, [RIGHT, "the errors have heavy tails (kurtosis 4.1 about z; 3 for a Gaussian)"]),
        ({"bound": ratio(1.05, low=1.019)}, [RIGHT]),
        (
            {"bound": ratio(1.05, low=1.021)},
            [
                RIGHT,
                "the Cramer-Rao bound is not reached: RMSE over bound 1 about x, 1 about y, 1.05 about z",
            ],
        ),
        (
            {"failed": 1},
            ["1 of 100 runs failed (99 ok, 1 not converged); their errors are in every figure", RIGHT],
        ),
        (
            {"failed": 100, "lost": 2},
            [
                "all of 100 runs failed (100 not converged); their errors are in every figure, "
                "except 2 without any estimate",
                RIGHT,
            ],
        ),
        (
            {"stated": ratio(1.4, wrong=True)},
            ["the stated model is wrong: the error is 1.4 times its stated sigma about z (1 wanted)"],
        ),
        (
            {"stated": ratio(1.4, wrong=True), "fit": ratio()},
            ["the stated model is wrong", "the residuals do not show it (chi-square as stated)"],
        ),
        (
            {"stated": ratio(1.4, wrong=True), "fit": ratio(1.3, wrong=True)},
            [
                "the stated model is wrong",
                "the residuals say so too: chi-square per degree of freedom is 1.3, more than the stated errors allow",
            ],
        ),
        (
            {"stated": ratio(0.7, wrong=True), "fit": ratio(0.8, wrong=True)},
            [
                "the stated model is wrong: the error is 0.7 times",
                "the residuals say so too: chi-square per degree of freedom is 0.8, less than the stated errors lead",
            ],
        ),
        ({"nees": ratio(1.3, wrong=True)}, ["the stated correlations are wrong: NEES 1.3 (1 wanted)"]),
    ],
)
def test_what_is_said_of_a_study(found, said):
    sentences = list(verdict(100, document(**found)))
    assert len(sentences) == len(said) + (found.get("stated") is not None and "fit" not in found)
    for sentence, start in zip(sentences, said, strict=False):
        assert sentence.startswith(start)
