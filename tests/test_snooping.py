"""Reliability against the dense adjustment it abbreviates, and rejections against errors planted by hand."""

from __future__ import annotations

import tracemalloc
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import chi2 as chi2_distribution

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators.fit import Unknowns
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Verdict
from starplumb.estimators.robust import Robust
from starplumb.io.results.residual_table import residual_columns, residual_names
from starplumb.io.text.write import csv_text
from starplumb.judge.calibrate import calibrate
from starplumb.judge.residuals import residuals
from starplumb.judge.snooping import fit_at, rejections, snoop
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.solve import chunks, schur
from starplumb.solve.adjustment import solve
from starplumb.solve.problem import Problem
from starplumb.solve.reliability import Reliability
from starplumb.table.equation import linearise
from starplumb.table.geometry import observe
from starplumb.table.parameters import Optics
from starplumb.table.simulate import Errors, measure

SCENES = {
    "own markers": lambda: observe(truth(FRAME, 3, 5)),
    "one site": lambda: observe(truth(FRAME, 5, 6, shared_site=True)),
    "line": lambda: observe(truth(LINE, 3, 5)),
}


def dense(o, model):
    """Covariance (2 n, 2 n) px^2 of the residuals of all sightings, written down error by error."""
    V = block_diag(*(o.sigma_px[:, None, None] ** 2 * np.eye(2)))
    for shared, design, index in (
        (o.cov_attitude_E, model.H, o.image),
        (o.cov_position_J, model.R, o.image),
        (o.cov_landmark_J, model.R, o.landmark),
    ):
        shared = np.broadcast_to(shared, (shared.shape[-3], 3, 3))
        for member in range(shared.shape[0]):
            J = np.where((index == member)[:, None, None], design, 0.0).reshape(-1, 3)
            V += J @ shared[member] @ J.T
    return V


def problem(o, C_EK):
    """The adjustment of the alignment alone, with nothing known beforehand."""
    return Problem(o, (), C_EK, np.zeros(0), (np.zeros((3, 3)), np.zeros(3)))


def snooped(o, weight):
    o = replace(o, weight=weight)
    estimate = Gls()(o, C_EK_TRUE)
    fit = fit_at(Unknowns(), o, C_EK_TRUE, estimate, weight > 0.0)
    return fit, snoop(fit, estimate)


@pytest.mark.parametrize("name", SCENES)
def test_statistics_are_those_of_the_dense_adjustment(name, rng):
    """Baarda's w, the mean-shift test, the detectable error and its effect, from V, A and nothing else."""
    o = SCENES[name]()
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    fit, found = snooped(o, np.ones(o.n))
    model = fit.whole.model
    P, A = np.linalg.inv(dense(o, model)), model.H.reshape(-1, 3)
    N = np.linalg.inv(A.T @ P @ A)
    M = P - P @ A @ N @ A.T @ P  # P Q_vv P
    z = model.z_px.reshape(-1)
    w = (M @ z) / np.sqrt(np.diag(M))
    np.testing.assert_allclose(found.w.reshape(-1), w, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(found.detectable_px.reshape(-1), 4.132 / np.sqrt(np.diag(M)), rtol=1e-3)
    effect = np.linalg.norm(N @ A.T @ P, axis=0) * 4.132 / np.sqrt(np.diag(M))
    np.testing.assert_allclose(found.effect_E, effect.reshape(-1, 2).max(axis=1), rtol=1e-3)
    T = [
        (M @ z)[2 * i :][:2] @ np.linalg.solve(M[2 * i :, 2 * i :][:2, :2], (M @ z)[2 * i :][:2])
        for i in range(o.n)
    ]
    np.testing.assert_allclose(found.statistic**2, T, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("name", SCENES)
def test_redundancies_sum_to_the_degrees_of_freedom(name, rng):
    """Sightings, images and landmarks together: 2 n - 3."""
    o = SCENES[name]()
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    adjusted = problem(o, Gls()(o, C_EK_TRUE).C_EK)
    (part,) = adjusted.tested_parts()
    images = np.sum(6.0 - np.trace(adjusted.statistics.image_cofactor, axis1=1, axis2=2))
    landmarks = np.sum(3.0 - np.trace(adjusted.statistics.landmark_cofactor, axis1=1, axis2=2))
    redundancy = 2.0 * np.sum(part.tested.redundancy)
    assert redundancy + images + landmarks == pytest.approx(2 * o.n - 3, rel=1e-9)


@pytest.mark.parametrize("name", SCENES)
def test_a_sighting_left_out_has_the_statistic_it_had(name, rng):
    """Whether it is in the solution or predicted by it: the fall of chi-square, up to second order."""
    o = SCENES[name]()
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    weight = np.ones(o.n)
    _, inside = snooped(o, weight)
    weight[4] = 0.0
    fit, outside = snooped(o, weight)
    for field in ("statistic", "redundancy", "effect_E", "w", "detectable_px"):
        np.testing.assert_allclose(
            getattr(outside, field)[4], getattr(inside, field)[4], rtol=2e-3, atol=2e-4
        )
    fall = Gls()(o, C_EK_TRUE).chi2 - Gls()(fit.whole.observations, C_EK_TRUE).chi2
    assert outside.statistic[4] ** 2 == pytest.approx(fall, rel=1e-3)


@pytest.mark.slow
def test_the_statistics_have_the_distribution_they_are_tested_with(rng):
    """Over runs: chi-square of a sighting, an image and a landmark by their own degrees of freedom, and w normal."""
    o = SCENES["one site"]()
    T = {"sightings": [], "images": [], "landmarks": []}
    w = []
    for _ in range(150):
        table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
        _, found = snooped(table, np.ones(o.n))
        w.append(found.w)
        for kind, p in T.items():
            statistic, dof = getattr(found.tested, kind)
            p.append(chi2_distribution.sf(statistic, dof))
    assert np.std(w) == pytest.approx(1.0, abs=0.03)
    for kind, p in T.items():
        assert np.mean(p) == pytest.approx(0.5, abs=0.03), kind
        assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.02), kind


def test_the_image_statistic_is_that_of_freeing_the_image(rng):
    """Chi-square falls by T when an image's attitude and position are no longer held by their stated sigmas."""
    o = SCENES["own markers"]()
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    C = Gls()(o, C_EK_TRUE).C_EK
    model, tested = linearise(o, C), problem(o, C).tested()
    free = np.array(np.broadcast_to(o.cov_attitude_E, (3, 3, 3)))
    free[1] *= 1e6  # three of the six numbers show: the attitude alone takes nearly all of them up
    freed = solve(replace(o, cov_attitude_E=free), model, model.H)
    held = solve(o, model, model.H)
    assert tested.images[1][1] == 3
    assert tested.images[0][1] == pytest.approx(held.chi2 - freed.chi2, rel=0.1)


def uneven(rng):
    """Twenty images of two to thirty sightings, one of sixty and one of none, in no order; a tenth left out."""
    o = observe(truth(FRAME, 22, 60))
    most = np.append(np.arange(2, 40)[::2][:19], [31, 60, 0])
    o = o.select(rng.permutation(np.flatnonzero(np.arange(o.n) % 60 < most[o.image])))
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    used = rng.random(o.n) > 0.1
    used[o.image == 5] = False
    return o, used


def judged(calibration, o, estimate, used):
    """All that is said after an estimate: of sightings, of what was left out, and how it was gone through."""
    fit = fit_at(calibration.unknowns, o, C_EK_TRUE, estimate, used)
    verdict = np.where(used, 0, np.where(o.image == 5, int(Verdict.IMAGE), int(Verdict.SIGHTING)))
    found = snoop(fit, estimate)
    return found, residuals(fit, used), rejections(fit, found, verdict, fit.table.image), fit


def check_same(parts, whole):
    for name in ("statistic", "w", "tau", "redundancy", "detectable_px", "effect_E"):
        np.testing.assert_allclose(getattr(parts[0], name), getattr(whole[0], name), rtol=1e-6, atol=1e-9)
    for name in ("images", "landmarks"):
        np.testing.assert_allclose(
            getattr(parts[0].tested, name), getattr(whole[0].tested, name), rtol=1e-6, atol=1e-9
        )
    for name, part in whole[0].spread.parts.items():
        np.testing.assert_allclose(parts[0].spread.parts[name], part, rtol=1e-6, atol=1e-9 * np.max(part))
    for field in fields(whole[1]):
        np.testing.assert_allclose(
            getattr(parts[1], field.name), getattr(whole[1], field.name), rtol=1e-6, atol=1e-9
        )
    assert [(r.image, r.reason) for r in parts[2]] == [(r.image, r.reason) for r in whole[2]]
    np.testing.assert_allclose(
        [r.statistic for r in parts[2]], [r.statistic for r in whole[2]], rtol=1e-6, atol=1e-6
    )


@pytest.mark.slow
def test_parts_say_what_the_whole_says(monkeypatch, rng):
    """Of a large table that is never held whole: statistics, residuals and error budget are those of the dense one."""
    o, used = uneven(rng)
    calibration = Gls((Optics(FRAME, ("focal_length", "k1"), (np.inf, 1.0)),))
    estimate = calibration(o.select(used), C_EK_TRUE)
    whole = judged(calibration, o, estimate, used)
    for name, value in (("LARGE", 50), ("CHUNK", 40)):
        monkeypatch.setattr(chunks, name, value)
    parts = judged(calibration, o, estimate, used)
    assert len(list(whole[3].tested_parts())) == 1
    assert len(list(parts[3].tested_parts())) > 15
    check_same(parts, whole)


@pytest.mark.slow
@pytest.mark.parametrize("images_first", [True, False])
def test_repeated_landmarks_are_judged_by_blocks_of_a_sparse_inverse(images_first, monkeypatch, rng):
    """A chain of images that share landmarks, some seen once, one twice in an image; either side eliminated."""
    o = observe(truth(FRAME, 14, 12))
    landmark = np.where(rng.random(o.n) < 0.2, o.landmark, 4 * o.image + rng.integers(9, size=o.n))
    landmark[0] = landmark[1]
    p_J = o.p_J.copy()
    o = measure(replace(o, landmark=landmark), C_EK_TRUE, Errors.draw(o, rng))
    o = replace(o.with_geometry(p_J=p_J), xy_K=o.xy_K)
    used = rng.random(o.n) > 0.1
    used[o.image == 5] = False
    calibration = Gls((Optics(FRAME, ("focal_length", "k1"), (np.inf, 1.0)),))
    estimate = calibration(o.select(used), C_EK_TRUE)
    whole = judged(calibration, o, estimate, used)
    for module, name, value in (
        (chunks, "LARGE", 0),
        (chunks, "CHUNK", 7),
        (schur, "WINDOW", 100),
        (schur, "SPARSE", 0.0 if images_first else np.inf),
        (schur, "BLOCK", 1),
    ):
        monkeypatch.setattr(module, name, value)
    first, work = (6, 3) if images_first else (3, 6), schur.Plan.work.fget
    monkeypatch.setattr(schur.Plan, "work", property(lambda p: work(p) if p.sizes == first else np.inf))
    parts = judged(calibration, o, estimate, used)
    assert len(list(parts[3].tested_parts())) > 5
    check_same(parts, whole)


@pytest.mark.slow
def test_what_follows_the_estimate_is_bounded_in_memory(rng):
    """Forty thousand sightings: little more than the columns that are written out."""
    o = observe(truth(FRAME, 400, 100))
    o = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    estimate, used = Gls()(o, C_EK_TRUE), np.ones(o.n, dtype=bool)
    fit = fit_at(Unknowns(), o, C_EK_TRUE, estimate, used)
    tracemalloc.start()
    found = snoop(fit, estimate), residuals(fit, used)
    written, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found[0] is not None
    assert written < 25 * 8 * o.n
    assert peak - written < 20e6


@pytest.mark.slow
def test_what_cannot_be_tested_in_reasonable_time_is_said(monkeypatch):
    """The estimate stands; its sightings have no statistics, and the calibration says why."""
    campaign = truth(FRAME, 6, 9, shared_site=True)
    whole = calibrate(campaign, Gls())
    assert whole.snooping is not None
    assert not any("not tested one by one" in sentence for sentence in whole.sentences)
    monkeypatch.setattr(chunks, "LARGE", 0)
    monkeypatch.setattr(schur, "MOST_STORED", 0)
    for estimator in (Gls(), Robust()):
        found = calibrate(campaign, estimator)
        assert found.snooping is None
        assert any("not tested one by one" in sentence for sentence in found.sentences)
        np.testing.assert_allclose(found.estimate.covariance_E, whole.estimate.covariance_E, rtol=1e-7)


def test_every_rejection_says_why(rng):
    """A sighting, a landmark surveyed 60 m off and an image half a second late, each found as what it is."""
    o = observe(truth(FRAME, 8, 9, shared_site=True))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    xy, p_J, C_EJ, r_J = (np.array(v) for v in (table.xy_K, table.p_J, table.C_EJ, table.r_J))
    late = o.image == 5
    C_EJ[late] = so3.exp(0.5 * o.omega_E[late]) @ C_EJ[late]
    r_J[late] += 0.5 * o.v_J[late]
    p_J[o.landmark == 7] += [0.0, 0.0, 60.0]
    table = replace(table.with_geometry(p_J=p_J, C_EJ=C_EJ, r_J=r_J))
    row = int(np.flatnonzero((o.image == 2) & (o.landmark == 3))[0])
    xy[row] += np.array([40.0, -25.0]) * 9e-6 / 2.2
    table = replace(table, xy_K=xy)
    estimate = Robust()(table, C_EK_TRUE)
    verdict = estimate.verdict
    assert verdict[row] == Verdict.SIGHTING
    assert np.all(verdict[late] == Verdict.IMAGE)
    assert np.all(verdict[(o.landmark == 7) & ~late] == Verdict.LANDMARK)
    fit = fit_at(Unknowns(), table, C_EK_TRUE, estimate, verdict == Verdict.USED)
    found = {
        (r.image, r.landmark): r for r in rejections(fit, snoop(fit, estimate), verdict, fit.table.image)
    }
    # predicted minus measured is minus what was planted
    assert "-40." in found[2, 3].reason or "-39." in found[2, 3].reason
    assert "epoch -0.5" in found[5, 0].reason or "epoch -0.49" in found[5, 0].reason
    assert "another place" in found[0, 7].reason
    assert all(r.statistic > 3.7 for r in found.values())


def test_one_marker_controls_nothing():
    """Two sightings and a prior of nothing: no redundancy but that of the shared errors' own sigmas."""
    o = observe(truth(FRAME, 1, 2))
    _, found = snooped(o, np.ones(2))
    assert np.all(found.redundancy < 0.51)
    assert np.all(found.effect_E > 1.0 * ARCSEC)


def test_what_nothing_would_show_is_an_empty_cell():
    """Of a sighting without control the largest hidden error is infinite, and so is what it does."""
    done = calibrate(truth(FRAME, 2, 3), Gls())
    snooping = done.snooping
    snooping.detectable_px[1, 0] = snooping.effect_E[1] = np.inf
    rows = csv_text(residual_names(done), residual_columns(done, 0.0)).splitlines()
    cells = [dict(zip(rows[0].split(","), row.split(","), strict=True)) for row in rows[1:]]
    assert (cells[1]["detectable_column_px"], cells[1]["effect_arcsec"]) == ("", "")
    assert float(cells[1]["detectable_row_px"]) == pytest.approx(snooping.detectable_px[1, 1])
    assert float(cells[0]["detectable_column_px"]) == pytest.approx(snooping.detectable_px[0, 0])


def test_a_sighting_controlled_along_one_direction_is_tested_along_it(rng):
    """Control of rank one, l u u^T: of the residual only what lies along u is judged, (u^T v)^2 / l."""
    angle, strength = rng.uniform(0.0, np.pi, 20), rng.uniform(0.1, 1.0, 20)
    u, v = np.stack([np.cos(angle), np.sin(angle)], axis=-1), rng.standard_normal((20, 2))
    control = strength[:, None, None] * u[:, :, None] * u[:, None, :]
    tested = Reliability(
        used=np.ones(20, dtype=bool),
        v=v,
        hat=np.eye(2) - control,
        per_px=np.zeros((20, 2, 2)),
        effect=np.zeros((20, 3, 2)),
    )
    T, dof = tested.sightings
    np.testing.assert_array_equal(dof, 1)
    np.testing.assert_allclose(T, np.sum(u * v, axis=-1) ** 2 / strength, rtol=1e-9)
