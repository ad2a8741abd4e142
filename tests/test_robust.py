"""Blunders of every kind, planted in campaigns whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import C_EK_TRUE, FRAME, LINE, truth
from starplumb.estimators import robust as robust_module
from starplumb.estimators.consensus import Consensus, _largest, cluster, consensus, pair_rotation
from starplumb.estimators.fit import State
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status, Verdict
from starplumb.estimators.robust import Robust
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.solve import chunks
from starplumb.table.geometry import observe
from starplumb.table.parameters import Optics
from starplumb.table.simulate import Errors, measure

PIXEL = 9e-6 / 2.2


def exchanged(o, share, rng):
    """A share of the labels exchanged within their image; also which sightings are wrong."""
    xy, wrong = o.xy_K.copy(), np.zeros(o.n, dtype=bool)
    chosen = rng.permutation(o.n)[: round(share * o.n)]
    for image in range(o.n_images):
        mine = chosen[o.image[chosen] == image]
        xy[mine] = xy[np.roll(mine, 1)]
        wrong[mine] = mine.size > 1
    return replace(o, xy_K=xy), wrong


def moved(o, share, within_px, rng):
    """A share of the measurements moved by up to so many pixels."""
    xy, wrong = o.xy_K.copy(), np.zeros(o.n, dtype=bool)
    wrong[rng.permutation(o.n)[: round(share * o.n)]] = True
    xy[wrong] += PIXEL * within_px * rng.uniform(-1.0, 1.0, (int(wrong.sum()), 2))
    return replace(o, xy_K=xy), wrong


def normalised(estimate):
    return so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E


SPOIL = {
    "labels": lambda o, rng: exchanged(o, 0.4, rng),
    "pixels": lambda o, rng: moved(o, 0.4, 50.0, rng),
    "most labels": lambda o, rng: exchanged(o, 0.6, rng),
    "most pixels": lambda o, rng: moved(o, 0.6, 300.0, rng),
}


@pytest.mark.slow
@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line"])
@pytest.mark.parametrize("kind", SPOIL)
def test_the_truth_within_its_sigma(kind, camera, rng):
    """From a mounting a degree off; no wrong sighting above 10 sigma of its own is kept, hardly a good one is lost."""
    o = observe(truth(camera, 20, 20))
    errors = []
    for _ in range(8):
        table, wrong = SPOIL[kind](measure(o, C_EK_TRUE, Errors.draw(o, rng)), rng)
        estimate = Robust()(table, so3.exp(DEG * rng.standard_normal(3)) @ C_EK_TRUE)
        assert estimate.status == Status.OK
        kept = estimate.verdict == Verdict.USED
        assert np.sum(kept & wrong) <= 4
        assert np.sum(~kept & ~wrong) <= 4
        errors.append(normalised(estimate))
    assert np.abs(errors).max() < 4.0
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(1.0, abs=0.5)


@pytest.mark.slow
def test_clean_data_lose_two_percent_at_most(rng):
    """Against least squares of the same data: the variance about it, in units of its own."""
    o = observe(truth(FRAME, 12, 10))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (30,)))
    plain, robust = Gls()(table, C_EK_TRUE), Robust()(table, C_EK_TRUE)
    apart = so3.log(robust.C_EK @ plain.C_EK.mT) / plain.sigma_E
    assert np.mean(apart**2) < 0.02
    assert np.mean(robust.verdict != Verdict.USED) < 0.003
    assert np.all(robust.sigma_E < 1.03 * plain.sigma_E)


def test_nothing_wrong_and_nothing_rejected_is_least_squares(rng):
    o = observe(truth(FRAME, 3, 5))
    estimate = Robust()(o, C_EK_TRUE)
    plain = Gls()(o, C_EK_TRUE)
    assert np.abs(so3.log(estimate.C_EK @ plain.C_EK.mT)).max() < 1e-6 * ARCSEC
    np.testing.assert_allclose(estimate.covariance_E, plain.covariance_E, rtol=1e-6)
    assert estimate.degrees_of_freedom == plain.degrees_of_freedom


@pytest.mark.parametrize("error", ["40 arcsec", "10 arcmin", "20 ms", "1 s"])
def test_a_bad_image_is_found_as_one(error, rng):
    """Attitude glitch or wrong epoch: the whole image goes, and no other."""
    o = observe(truth(FRAME, 10, 12))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    bad = o.image == 4
    C_EJ, r_J = table.C_EJ.copy(), table.r_J.copy()
    late = {"20 ms": 0.02, "1 s": 1.0}.get(error, 0.0)
    turn = {"40 arcsec": 40.0, "10 arcmin": 600.0}.get(error, 0.0) * ARCSEC
    C_EJ[bad] = so3.exp(late * o.omega_E[bad] + turn * np.array([0.8, -0.6, 0.2])) @ C_EJ[bad]
    r_J[bad] += late * o.v_J[bad]
    table, _ = exchanged(table.with_geometry(C_EJ=C_EJ, r_J=r_J), 0.2, rng)
    estimate = Robust()(table, C_EK_TRUE)
    assert np.mean(estimate.verdict[bad] == Verdict.IMAGE) == 1.0
    assert not np.any(estimate.verdict[~bad] == Verdict.IMAGE)
    assert np.abs(normalised(estimate)).max() < 4.0


def test_two_images_that_contradict_each_other_are_refused(rng):
    """Nothing says which of the two is wrong."""
    o = observe(truth(FRAME, 2, 10))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    C_EJ = table.C_EJ.copy()
    C_EJ[o.image == 1] = so3.exp(np.array([300.0, 0.0, 0.0]) * ARCSEC) @ C_EJ[o.image == 1]
    assert Robust()(table.with_geometry(C_EJ=C_EJ), C_EK_TRUE).status == Status.REFUTED


def test_labels_without_any_truth_in_them_are_refused(rng):
    o = observe(truth(FRAME, 6, 10))
    table = replace(o, xy_K=rng.uniform(-0.024, 0.024, (o.n, 2)))
    assert Robust()(table, C_EK_TRUE).status == Status.NOT_CONVERGED


def test_each_run_of_a_batch_is_as_if_alone(rng):
    o = observe(truth(FRAME, 4, 6))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng, (3,)))
    together = Robust()(table, C_EK_TRUE)
    assert together.C_EK.shape == (3, 3, 3)
    assert together.verdict.shape == (3, o.n)
    for i in range(3):
        np.testing.assert_array_equal(together.C_EK[i], Robust()(table.run((i,)), C_EK_TRUE).C_EK)


def test_two_directions_fix_the_rotation(rng):
    """Exact for exact directions, any rotation."""
    C = so3.exp(rng.standard_normal((50, 3)))
    e_K = rng.standard_normal((2, 50, 3))
    e_K /= np.linalg.norm(e_K, axis=-1, keepdims=True)
    a, b = ((C @ e[..., None])[..., 0] for e in e_K)
    np.testing.assert_allclose(pair_rotation(a, b, *e_K), C, atol=1e-13)


@pytest.mark.parametrize("turn_deg", [0.0, 2.0, 179.0])
def test_consensus_does_not_need_a_good_start(turn_deg, rng):
    """The mounting itself does not enter; images of one marker are joined across images."""
    for markers in (1, 6):
        o = observe(truth(FRAME, 8, markers))
        table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
        xy = table.xy_K.copy()
        xy[0] += 0.01
        turn = so3.exp(np.array([0.0, 0.0, turn_deg * DEG]))
        turned = table.with_geometry(
            C_EJ=turn @ table.C_EJ, omega_E=(turn @ table.omega_E[..., None])[..., 0]
        )
        found = consensus(replace(turned, xy_K=xy), rng)
        assert found.convincing
        assert not found.agree[0]
        off = so3.log(found.C_EK @ (turn @ C_EK_TRUE).mT)
        assert np.abs(off).max() < (600.0 if markers == 1 else 120.0) * ARCSEC


@pytest.mark.slow
def test_a_large_table_is_judged_like_a_small_one(monkeypatch, rng):
    """In portions, with a lens to estimate, a bad image, and images larger than a portion."""
    o = observe(truth(FRAME, 12, 50))
    table, _ = moved(measure(o, C_EK_TRUE, Errors.draw(o, rng)), 0.1, 60.0, rng)
    C_EJ = table.C_EJ.copy()
    C_EJ[o.image == 4] = so3.exp(np.array([200.0, 100.0, 0.0]) * ARCSEC) @ C_EJ[o.image == 4]
    table = table.with_geometry(C_EJ=C_EJ)
    robust = Robust(Gls((Optics(FRAME, ("focal_length",), (np.inf,)),)))
    whole = robust(table, C_EK_TRUE)
    for name, value in (("LARGE", 50), ("CHUNK", 40)):
        monkeypatch.setattr(chunks, name, value)
    parts = robust(table, C_EK_TRUE)
    assert np.any(whole.verdict == Verdict.IMAGE)
    np.testing.assert_array_equal(parts.verdict, whole.verdict)
    assert np.max(np.abs(so3.log(parts.C_EK @ whole.C_EK.mT) / whole.sigma_E)) < 1e-3


def test_clusters_hold_the_rows_they_are_made_of(monkeypatch, rng):
    """A table in no order, in many portions: each wrong pixel stands out of its image's cluster, hardly a good one."""
    o = observe(truth(FRAME, 8, 30))
    o = o.select(rng.permutation(o.n))
    table, wrong = moved(measure(o, C_EK_TRUE, Errors.draw(o, rng)), 0.3, 60.0, rng)
    monkeypatch.setattr(chunks, "CHUNK", 40)
    search = robust_module._Search(Robust(), table, C_EK_TRUE)
    everything = Consensus(C_EK_TRUE, np.ones(table.n, dtype=bool), True)
    kept = search._agreed(State(C_EK_TRUE, np.zeros(0)), everything)[1]
    assert np.mean(kept[~wrong]) > 0.95
    assert np.mean(kept[wrong]) < 0.15


def test_many_bad_images_leave_together(monkeypatch, rng):
    """Twelve of sixty, each within the gate of the consensus, in as few passes as a large campaign can afford."""
    o = observe(truth(FRAME, 60, 8))
    table = measure(o, C_EK_TRUE, Errors.draw(o, rng))
    bad = rng.permutation(60)[:12]
    turn = np.zeros((60, 3))
    turn[bad, :2] = rng.choice([-1.0, 1.0], (12, 2)) * rng.uniform(28.0, 35.0, (12, 2)) * ARCSEC
    table = table.with_geometry(C_EJ=so3.exp(turn[o.image]) @ table.C_EJ)
    monkeypatch.setattr(robust_module, "AT_ONCE", 0.1)
    monkeypatch.setattr(robust_module, "PASSES", 10)
    estimate = Robust()(table, C_EK_TRUE)
    assert set(bad) <= set(o.image[estimate.verdict == Verdict.IMAGE])
    assert np.max(np.abs(normalised(estimate))) < 4.0


def test_the_largest_cluster_is_that_of_all_pairs(monkeypatch, rng):
    """Against the distances of all pairs solved one by one, and with anchors and rows taken by parts."""
    z = np.concatenate([rng.normal(0.0, 0.5, (60, 2)), rng.normal(6.0, 0.5, (40, 2))])
    root = rng.standard_normal((100, 2, 2))
    V, U = 0.1 * root @ root.mT + 0.3 * np.eye(2), 0.5 * rng.standard_normal((100, 2, 3))
    distance = np.empty((100, 100))
    for a, b in np.ndindex(100, 100):
        bend, d = U[a] - U[b], z[a] - z[b]
        distance[a, b] = d @ np.linalg.solve(V[a] + V[b] + bend @ bend.T, d)
    best = np.argmax(np.sum(np.maximum(0.0, 1.0 - distance / 16.0), axis=1))
    np.testing.assert_array_equal(cluster(z, V, U), distance[best] < 16.0)
    monkeypatch.setattr("starplumb.estimators.consensus.JUDGES", 7)
    np.testing.assert_array_equal(cluster(z, V, U), distance[best] < 16.0)


def test_largest_eigenvalues(rng):
    S = rng.standard_normal((200, 3, 3))
    S = np.concatenate([S @ S.mT, np.eye(3)[None], np.zeros((1, 3, 3)), np.diag([1.0, 1.0, 4.0])[None]])
    np.testing.assert_allclose(_largest(S), np.linalg.eigvalsh(S)[:, -1], rtol=1e-12, atol=1e-15)
