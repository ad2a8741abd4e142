"""Every path of the solver gives the same answer: whole, in chunks, sparse, in a batch, in any order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, truth
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.solve import chunks, schur
from starplumb.solve.problem import Problem
from starplumb.table.geometry import observe
from starplumb.table.parameters import Optics, TimeOffset, TrackerMounting
from starplumb.table.seen import ImageErrors
from starplumb.table.simulate import Errors, measure

FREE = np.inf
IMAGES = 12


@pytest.fixture(params=["own", "few again", "many again"])
def problem(request, rng):
    """Two trackers, a lens and a clock; images of uneven size, weights of 0, errors in common, a prior; landmarks of
    one image each, or seen again here and there (within an image too), or most of them in several images."""
    o = observe(truth(FRAME, IMAGES, 9))
    o = o.select(rng.permutation(np.flatnonzero(rng.random(o.n) < rng.uniform(0.3, 1.0, IMAGES)[o.image])))
    share = {"own": 0.0, "few again": 0.2, "many again": 0.9}[request.param]
    landmark = np.where(rng.random(o.n) < share, rng.integers(20, size=o.n), o.landmark)
    if request.param == "few again":
        landmark[0] = landmark[np.flatnonzero(o.image == o.image[0])[-1]]
    spread = rng.standard_normal((3, IMAGES, 3, 3)) * np.array([5.0 * ARCSEC, 3.0, 1.0])[:, None, None, None]
    slanted = rng.standard_normal((o.n_landmarks, 3, 3))
    o = measure(replace(o, landmark=landmark), C_EK_TRUE, Errors.draw(o, rng))
    o = replace(
        o,
        cov_attitude_E=spread[0] @ spread[0].mT,
        cov_position_J=spread[1] @ spread[1].mT,
        cov_landmark_J=slanted @ slanted.mT,
        sigma_px=rng.uniform(0.2, 0.5, o.n),
        weight=(rng.random(o.n) > 0.1).astype(float),
        common_px=rng.standard_normal((o.n, 2, 2)),
    )
    parameters = (
        TimeOffset(("time_offset",), (0.1,)),
        Optics(FRAME, ("k1", "focal_length"), (FREE, 1e-3)),
        TrackerMounting("B", rng.random(IMAGES) > 0.5),
    )
    values = np.array([0.01, 0.2, 1e-4, *(20.0 * ARCSEC * rng.standard_normal(3))])
    sigma = np.array([20.0 * ARCSEC] * 3 + [0.1, 10.0, 1e-3] + [60.0 * ARCSEC] * 3 + [1.0, 1.0])
    known = np.diag(sigma**-2.0), 0.3 * sigma * rng.standard_normal(sigma.size)
    C_EK = so3.exp(10.0 * ARCSEC * rng.standard_normal(3)) @ C_EK_TRUE
    own = ImageErrors(
        20.0 * ARCSEC * rng.standard_normal((IMAGES, 3)), 5.0 * rng.standard_normal((IMAGES, 3))
    )
    return Problem(o, parameters, C_EK, values, known, errors=own)


def large(monkeypatch, **limits):
    """Sizes at which a small table is a large one, of many chunks, windows and blocks."""
    for module, name, value in (
        (chunks, "LARGE", 0),
        (chunks, "CHUNK", 5),
        (schur, "WINDOW", 60),
        (schur, "BLOCK", 1),
    ):
        monkeypatch.setattr(module, name, limits.get(name, value))


def check_same(found, expected):
    sigma = np.sqrt(np.diag(expected.covariance))
    unit = sigma[:, None] * sigma
    np.testing.assert_allclose(found.x / sigma, expected.x / sigma, atol=1e-7)
    np.testing.assert_allclose(found.information * unit, expected.information * unit, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(found.covariance / unit, expected.covariance / unit, atol=1e-7)
    assert float(found.chi2) == pytest.approx(float(expected.chi2), rel=1e-8)


def check_same_tests(found, expected):
    for name in ("sightings", "images", "landmarks"):
        for one, other in zip(getattr(found, name), getattr(expected, name), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-8)


def check_same_errors(found, expected):
    for name, scale in (("alpha_E", ARCSEC), ("rho_J", 1.0), ("pi_J", 1.0)):
        np.testing.assert_allclose(
            getattr(found, name) / scale, getattr(expected, name) / scale, rtol=1e-6, atol=1e-7
        )


def test_chunks_are_the_whole(problem, monkeypatch):
    expected, errors, tested = problem.solution, problem.shared_errors(), problem.tested()
    large(monkeypatch)
    chunked = replace(problem)
    assert chunked.in_chunks
    assert len(list(chunked.pieces())) > 10
    check_same(chunked.solution, expected)
    check_same_errors(chunked.shared_errors(), errors)
    check_same_tests(chunked.tested(), tested)


def test_the_schur_complement_need_not_be_formed(problem, monkeypatch):
    """Conjugate gradients give the same step; they have no tests of single observations."""
    expected, again = problem.solution, np.any(np.bincount(problem.table.landmark) > 1)
    large(monkeypatch)
    monkeypatch.setattr(schur, "MOST_STORED", 0)
    chunked = replace(problem)
    check_same(chunked.solution, expected)
    assert (chunked.tested() is None) == again


@pytest.mark.parametrize("chunked", [False, True])
def test_order_does_not_matter(problem, chunked, rng, monkeypatch):
    expected, tested = problem.solution, problem.tested()
    if chunked:
        large(monkeypatch, CHUNK=17)
    order = rng.permutation(problem.table.n)
    permuted = replace(problem, table=problem.table.select(order))
    check_same(permuted.solution, expected)
    found = permuted.tested()
    np.testing.assert_allclose(found.sightings[0], tested.sightings[0][order], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found.images[0], tested.images[0], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("chunked", [False, True])
def test_weight_zero_is_absence(problem, chunked, monkeypatch):
    expected = replace(problem, table=problem.table.select(problem.table.weight > 0.0)).solution
    if chunked:
        large(monkeypatch)
    check_same(replace(problem).solution, expected)


@pytest.mark.parametrize("batch", [(1,), (3,), (2, 3), (2, 1)])
def test_a_batch_is_its_runs(problem, batch, rng):
    """Of tables, mountings and values, each with the axes given."""
    o, k = problem.table, problem.values.size
    xy = o.xy_K + 1e-6 * rng.standard_normal((*batch, o.n, 2))
    weight = (rng.random((*batch, o.n)) > 0.1).astype(float)
    C_EK = so3.exp(10.0 * ARCSEC * rng.standard_normal((*batch, 3))) @ problem.C_EK
    values = problem.values * rng.uniform(0.5, 1.5, (*batch, k))
    together = replace(problem, table=replace(o, xy_K=xy, weight=weight), C_EK=C_EK, values=values)
    solution, errors = together.solution, together.shared_errors(together.solution.x)
    for run in np.ndindex(batch):
        table = replace(o, xy_K=xy[run], weight=weight[run])
        alone = replace(problem, table=table, C_EK=C_EK[run], values=values[run])
        check_same(
            replace(solution, **{name: getattr(solution, name)[run] for name in vars(solution)}),
            alone.solution,
        )
        own = alone.shared_errors(alone.solution.x)
        check_same_errors(replace(own, **{name: getattr(errors, name)[run] for name in vars(own)}), own)
