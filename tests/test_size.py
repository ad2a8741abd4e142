"""Large tables: the adjustment in chunks is the whole one, in memory that does not grow."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators.fit import State, Unknowns
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.physics import so3
from starplumb.physics.camera import Distortion
from starplumb.physics.covariance import ellipse_of
from starplumb.physics.units import ARCSEC, DEG
from starplumb.solve import chunks
from starplumb.solve.adjustment import solve
from starplumb.solve.problem import Problem
from starplumb.table.equation import linearise
from starplumb.table.geometry import observe
from starplumb.table.parameters import OPTICS, LookAngles, Optics, TimeOffset, TrackerMounting
from starplumb.table.simulate import Errors, measure

FREE = np.inf
BENT = replace(FRAME, distortion=Distortion((0.3, 20.0, 0.0), (1e-3, -2e-3)))
LENS = Optics(BENT, OPTICS, (FREE,) * 8)
SECOND = TrackerMounting("B", np.arange(20) % 3 == 1)
PROBLEMS = {
    "mounting": (FRAME, (), []),
    "lens": (BENT, (LENS,), [5e-3, 3.0, -2.0, 0.2, 30.0, 1e4, 1e-3, 1e-3]),
    "some of the lens": (BENT, (Optics(BENT, ("k1", "focal_length"), (FREE, 1e-3)),), [0.2, 5e-3]),
    "clock, lens, tracker": (
        FRAME,
        (TimeOffset(("time_offset",), (FREE,)), Optics(FRAME, ("k1",), (FREE,)), SECOND),
        [0.01, 0.2, 1e-3, -2e-3, 1e-3],
    ),
    "look angles": (LINE, (LookAngles(LINE, ("look_x_1", "look_y_3"), (FREE, FREE)),), [1e-5, 3e-5]),
}


@pytest.fixture
def small_limits(monkeypatch):
    """Chunks and samples of a size at which the whole adjustment can stand beside them."""
    monkeypatch.setattr(chunks, "LARGE", 50)
    monkeypatch.setattr(chunks, "CHUNK", 40)
    monkeypatch.setattr(chunks, "SAMPLE", 60)


def uneven(rng, camera=FRAME, markers=50):
    """Images of 0 to 49 sightings, in no order, some of no weight, landmarks with errors of their own in J."""
    o = observe(truth(camera, 20, markers))
    o = o.select(rng.permutation(np.flatnonzero(np.arange(o.n) % markers < 5 * (o.image // 2))))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    slanted = rng.standard_normal((o.n_landmarks, 3, 3))
    _, ellipse = ellipse_of(*rng.uniform(0.2, 0.5, (2, o.n)), rng.uniform(-0.9, 0.9, o.n))
    return replace(
        table,
        weight=(rng.random(o.n) > 0.1).astype(float),
        sigma_px=rng.uniform(0.2, 0.5, o.n),
        ellipse=ellipse,
        cov_landmark_J=slanted @ slanted.mT,
    )


def test_blocks_are_the_table(small_limits, rng):
    """Every sighting once, with equally many others of its image; two images longer than a chunk in pieces."""
    o = uneven(rng)
    seen = []
    for images, pieces in chunks.blocks(o):
        rows = [np.arange(o.n)[piece] for piece in pieces]
        assert all(part.size <= 40 for part in rows)
        assert len(pieces) == 1 or images.size == 1
        together = np.concatenate(rows)
        np.testing.assert_array_equal(o.image[together], np.repeat(images, together.size // images.size))
        seen.append(together)
    np.testing.assert_array_equal(np.sort(np.concatenate(seen)), np.arange(o.n))
    assert sum(len(pieces) > 1 for _, pieces in chunks.blocks(o)) == 2


def test_blocks_of_a_table_in_order_are_slices(small_limits):
    """Nothing is gathered where rows stand together already."""
    o = observe(truth(FRAME, 20, 10))
    blocks = list(chunks.blocks(o))
    assert [pieces for _, pieces in blocks] == [[slice(at, at + 40)] for at in range(0, 200, 40)]


@pytest.mark.slow
@pytest.mark.parametrize("name", PROBLEMS)
def test_the_sum_of_chunks_is_the_whole_step(small_limits, rng, name):
    """With errors in common, a prior, and parameters of every kind."""
    camera, parameters, value = PROBLEMS[name]
    o = replace(uneven(rng, camera), prior_E=np.eye(3) * (20.0 * ARCSEC) ** 2)
    o = replace(o, common_px=rng.standard_normal((o.n, 2, 2)))
    state = State(so3.exp(np.array([1e-5, -2e-5, 3e-5])) @ C_EK_TRUE, np.array(value))
    problem = Unknowns(parameters).problem(o, state, C_EK_TRUE)
    whole = solve(problem.observations, problem.model, problem.A, *problem.prior)
    assert problem.in_chunks
    chunked = replace(problem).solution
    sigma = np.sqrt(np.diag(whole.covariance))
    np.testing.assert_allclose(chunked.x / sigma, whole.x / sigma, atol=1e-7)
    unit = sigma[:, None] * sigma
    np.testing.assert_allclose(chunked.information * unit, whole.information * unit, rtol=1e-9, atol=1e-9)
    assert float(chunked.chi2) == pytest.approx(float(whole.chi2), rel=1e-9)


def test_an_attitude_hardly_known_keeps_its_digits(small_limits, rng):
    """An error of a degree, ten thousand times the noise, and an exact position."""
    o = uneven(rng)
    o = replace(
        o,
        cov_attitude_E=np.broadcast_to(np.eye(3) * DEG**2, (20, 3, 3)),
        cov_position_J=np.zeros((20, 3, 3)),
    )
    prior = np.zeros((3, 3)), np.zeros(3)
    whole = solve(o, linearise(o, C_EK_TRUE), linearise(o, C_EK_TRUE).H)
    chunked = Problem(o, (), C_EK_TRUE, np.zeros(0), prior).solution
    largest = np.abs(whole.covariance).max()
    np.testing.assert_allclose(chunked.covariance, whole.covariance, rtol=1e-6, atol=1e-8 * largest)
    np.testing.assert_allclose(chunked.x, whole.x, atol=1e-5 * np.sqrt(np.diag(whole.covariance)).min())


def test_a_sample_knows_its_images(small_limits, rng):
    """By their numbers in the whole table, as the mounting of a star tracker asks for them."""
    o = uneven(rng)
    few = chunks.sample(o)
    assert 0 < few.n < o.n
    turned = SECOND.moves(few, np.zeros(3)).turn_E
    np.testing.assert_array_equal(np.any(turned != 0.0, axis=(1, 2)), few.image % 3 == 1)
    np.testing.assert_array_equal(np.unique(few.image), np.unique(o.image[np.isin(o.image, few.image)]))


def test_a_large_estimate_is_the_small_one(monkeypatch, rng):
    """With a lens to estimate, from a degree off, by way of a sample."""
    table = uneven(rng)
    calibration = Gls((Optics(FRAME, ("focal_length", "k1"), (FREE, FREE)),))
    model = so3.exp(np.array([0.5, -0.3, 0.4]) * DEG) @ C_EK_TRUE
    whole = calibration(table, model)
    for name, value in (("LARGE", 50), ("CHUNK", 40), ("SAMPLE", 60)):
        monkeypatch.setattr(chunks, name, value)
    assert chunks.sampled(table)
    chunked = calibration(table, model)
    assert chunked.status == Status.OK
    assert np.abs(so3.log(chunked.C_EK @ whole.C_EK.mT) / whole.sigma_E).max() < 2e-3
    sigma = np.sqrt(np.diag(whole.parameters.covariance))
    unit = sigma[:, None] * sigma
    np.testing.assert_allclose(
        chunked.parameters.covariance / unit, whole.parameters.covariance / unit, atol=2e-3
    )
    assert chunked.chi2 == pytest.approx(float(whole.chi2), rel=1e-5)
    assert chunked.degrees_of_freedom == whole.degrees_of_freedom


def test_large_generalised_least_squares_is_the_small_one(monkeypatch, rng):
    """With a prior on the mounting and errors in common beside it."""
    o = replace(uneven(rng), prior_E=np.eye(3) * (20.0 * ARCSEC) ** 2)
    o = replace(o, common_px=rng.standard_normal((o.n, 2, 2)))
    whole = Gls()(o, C_EK_TRUE)
    for name, value in (("LARGE", 50), ("CHUNK", 40)):
        monkeypatch.setattr(chunks, name, value)
    chunked = Gls()(o, C_EK_TRUE)
    assert np.abs(so3.log(chunked.C_EK @ whole.C_EK.mT) / whole.sigma_E).max() < 1e-7
    np.testing.assert_allclose(chunked.covariance_E, whole.covariance_E, rtol=1e-9, atol=1e-24)
    assert chunked.chi2 == pytest.approx(float(whole.chi2), rel=1e-9)


@pytest.mark.parametrize("shared", [False, True])
def test_a_large_table_takes_several_model_mountings(small_limits, monkeypatch, rng, shared):
    """Chunks are of one mounting; with batch axes of mountings each run is what it is alone."""
    monkeypatch.setattr(chunks, "MANY", 5)
    true = observe(truth(FRAME, 20, 10, shared_site=shared))
    table = replace(measure(true, C_EK_TRUE, Errors.draw(true, rng)), prior_E=np.eye(3) * ARCSEC**2)
    models = so3.exp(np.array([[20.0, 0.0, 0.0], [0.0, -30.0, 5.0]]) * ARCSEC) @ C_EK_TRUE
    assert chunks.sampled(table) is not shared
    assert chunks.in_chunks(table)
    together = Gls()(table, models)
    for i, model in enumerate(models):
        alone = Gls()(table, model)
        assert np.abs(so3.log(together.C_EK[i] @ alone.C_EK.mT) / alone.sigma_E).max() < 2e-3
        np.testing.assert_allclose(together.covariance_E[i], alone.covariance_E, rtol=1e-6, atol=1e-18)
        assert together.chi2[i] == pytest.approx(float(alone.chi2), rel=1e-5)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_table(rng):
    """Forty thousand sightings in less than 20 MB above their own table."""
    true = observe(truth(FRAME, 40, 1000))
    table = measure(true, C_EK_TRUE, Errors.draw(true, rng))
    calibration = Gls((Optics(FRAME, ("focal_length",), (FREE,)),))
    tracemalloc.start()
    estimate = calibration(table, C_EK_TRUE)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert estimate.status == Status.OK
    assert peak < 20e6
