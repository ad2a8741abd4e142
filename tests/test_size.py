"""Large tables: the chunked adjustment is the whole one, in memory that does not grow."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, truth
from starplumb import so3, streaming
from starplumb.adjustment import solve
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.estimators.selfcal import SelfCalibration
from starplumb.geometry import observe
from starplumb.model import linearise
from starplumb.parameters import Optics
from starplumb.simulate import Errors, measure
from starplumb.small import solve2
from starplumb.units import DEG


@pytest.fixture
def small_limits(monkeypatch):
    """Chunks and samples of a size at which the whole adjustment can stand beside them."""
    monkeypatch.setattr(streaming, "LARGE", 50)
    monkeypatch.setattr(streaming, "CHUNK", 40)
    monkeypatch.setattr(streaming, "SAMPLE", 60)


def uneven(rng):
    """Images of 0 to 29 sightings, in no order, some of no weight."""
    o = observe(truth(FRAME, 20, 29))
    o = o.select(rng.permutation(np.flatnonzero(np.arange(o.n) % 29 < 2 * o.image % 29)))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    return replace(table, weight=(rng.random(o.n) > 0.1).astype(float))


def test_chunks_are_the_table(small_limits, rng):
    """Every sighting once, with its own image's and landmark's covariance."""
    o = uneven(rng)
    parts = list(streaming.chunks(o))
    assert len(parts) > 3
    assert sum(part.n for part in parts) == o.n
    order = np.argsort(o.image, kind="stable")
    np.testing.assert_array_equal(np.concatenate([part.xy_K for part in parts]), o.xy_K[order])
    for part in parts:
        assert part.n_landmarks == part.n
        assert part.n <= 40 + 29
    joined = np.concatenate([part.cov_landmark_J[part.landmark] for part in parts])
    np.testing.assert_array_equal(joined, o.cov_landmark_J[o.landmark[order]])


def test_the_sum_of_chunks_is_the_whole_step(small_limits, rng):
    o = uneven(rng)
    C = so3.exp(np.array([1e-5, -2e-5, 3e-5])) @ C_EK_TRUE
    prior = np.eye(3) * 1e8, np.array([1e-5, 0.0, -2e-5])
    model = linearise(o, C)
    whole = solve(o, model, model.H, *prior)

    def linear(part):
        of_part = linearise(part, C)
        return part, of_part, of_part.H

    chunked = streaming.stream(o, linear, prior)
    np.testing.assert_allclose(chunked.x, whole.x, rtol=1e-9)
    np.testing.assert_allclose(chunked.information, whole.information, rtol=1e-10)
    assert float(chunked.chi2) == pytest.approx(float(whole.chi2), rel=1e-8)


def test_a_large_estimate_is_the_small_one(monkeypatch, rng):
    """With a lens to estimate, from a degree off, by way of a sample."""
    table = uneven(rng)
    calibration = SelfCalibration((Optics(FRAME, ("focal_length", "k1"), (np.inf, np.inf)),))
    model = so3.exp(np.array([0.5, -0.3, 0.4]) * DEG) @ C_EK_TRUE
    whole = calibration(table, model)
    for name, value in (("LARGE", 50), ("CHUNK", 40), ("SAMPLE", 60)):
        monkeypatch.setattr(streaming, name, value)
    assert streaming.sampled(table)
    chunked = calibration(table, model)
    assert chunked.status == Status.OK
    assert np.abs(so3.log(chunked.C_EK @ whole.C_EK.mT) / whole.sigma_E).max() < 0.02
    np.testing.assert_allclose(chunked.parameters.covariance, whole.parameters.covariance, rtol=2e-3)
    assert chunked.chi2 == pytest.approx(float(whole.chi2), rel=1e-4)
    assert chunked.degrees_of_freedom == whole.degrees_of_freedom


def test_repeated_landmarks_are_not_taken_in_chunks(small_limits):
    o = observe(truth(FRAME, 10, 9, shared_site=True))
    assert not streaming.streams(o)
    plain, ours = Gls()(o, C_EK_TRUE), SelfCalibration()(o, C_EK_TRUE)
    np.testing.assert_allclose(ours.covariance_E, plain.covariance_E, rtol=1e-9)


def test_memory_does_not_grow_with_the_table(rng):
    """Forty thousand sightings in less than 20 MB above their own table."""
    true = observe(truth(FRAME, 40, 1000))
    table = measure(true, C_EK_TRUE, Errors.draw(true, rng))
    calibration = SelfCalibration((Optics(FRAME, ("focal_length",), (np.inf,)),))
    tracemalloc.start()
    estimate = calibration(table, C_EK_TRUE)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert estimate.status == Status.OK
    assert peak < 20e6


def test_two_by_two_systems(rng):
    B, F = rng.standard_normal((50, 2, 2)) + 3.0 * np.eye(2), rng.standard_normal((50, 2, 3))
    np.testing.assert_allclose(solve2(B, F), np.linalg.solve(B, F), rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(solve2(B, np.eye(2)), np.linalg.inv(B), rtol=1e-10, atol=1e-12)
