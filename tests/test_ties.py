"""Tie points: places nobody surveyed, in tables, against dense matrices, by statistics and with blunders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

import starplumb as sp
from helpers import LANDMARKS, write_good_campaign
from problems import C_EK_TRUE
from rigs import BAND, rig_truth, with_tie_points
from starplumb.estimators.cameras.jointly import Jointly
from starplumb.estimators.cameras.ties import Tied, placed
from starplumb.estimators.default import Default
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.io.campaign.marks.landmarks import TIE_M
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.judge.calibrate import calibrate
from starplumb.judge.mountings import mountings
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC
from starplumb.plan.scene import measured
from starplumb.table.cameras.mounting import CameraMounting
from starplumb.table.campaign import some_of
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

JOINTLY = Jointly(("A", "B"), Default, Gls())


def delivered(campaign, rng, off_arcsec=300.0):
    """What is delivered of a true campaign: measured, mountings off, tie points anywhere."""
    tie = campaign.landmarks.tie
    o = observe(campaign)
    drawn = Errors.draw(o, rng, ())
    drawn = replace(drawn, pi_J=np.where(tie[:, None], 2e4, drawn.pi_J))
    given = measured(campaign, drawn, so3.exp(np.full(3, off_arcsec) * ARCSEC) @ C_EK_TRUE)
    covariance = np.where(tie[:, None, None], TIE_M**2 * np.eye(3), given.landmarks.covariance_J)
    C_KC = np.stack([np.eye(3), BAND @ so3.exp(np.full(3, -off_arcsec) * ARCSEC)])
    return replace(
        given,
        landmarks=replace(given.landmarks, covariance_J=covariance),
        rig=replace(campaign.rig, C_KC=C_KC),
    )


def against_first(found, campaign):
    """Error (3,) of the second mounting against the first about E, and its covariance."""
    errors = so3.log(found.C_EC @ (C_EK_TRUE @ campaign.rig.C_KC).mT)
    return errors[1] - errors[0], found.covariance_against_first(1)


def test_what_they_add_is_what_dense_matrices_say(rng):
    """The places of tie points as free unknowns of one dense least squares, with no prior: to 2e-6 of a sigma."""
    campaign = with_tie_points(rig_truth((BAND,), images=3, markers=4), 6, rng)
    o = observe(campaign)
    second = CameraMounting(1, "B")
    at = Gls((second,)).unknowns.problem(o, Gls((second,)).start(o, C_EK_TRUE), C_EK_TRUE)
    model, tie = at.model, campaign.landmarks.tie
    G = [np.zeros((2 * o.n, 3 * k)) for k in (o.n_images, o.n_images, o.n_landmarks)]
    for i in range(o.n):
        moved = (o.image[i], model.H[i]), (o.image[i], model.R[i]), (o.landmark[i], model.R[i])
        for block, (k, M) in zip(G, moved, strict=True):
            block[2 * i : 2 * i + 2, 3 * k : 3 * k + 3] = M
    known = np.where(tie[:, None, None], 0.0, o.cov_landmark_J)
    V = block_diag(*o.noise_px) + sum(
        g @ block_diag(*P) @ g.T for g, P in zip(G, (o.cov_attitude_E, o.cov_position_J, known), strict=True)
    )
    own = at.A.reshape(2 * o.n, -1)
    places = G[2].reshape(2 * o.n, -1, 3)[:, tie].reshape(2 * o.n, -1)
    N = np.hstack([own, places]).T @ np.linalg.solve(V, np.hstack([own, places]))
    # along the rays of one station a place is open: what it takes with it is nothing
    left = N[:6, :6] - N[:6, 6:] @ np.linalg.pinv(N[6:, 6:], rcond=1e-10, hermitian=True) @ N[6:, :6]
    expected = np.sqrt(np.diagonal(np.linalg.inv(left)))
    found = Gls((second,)).estimate(o, C_EK_TRUE, Gls((second,)).start(o, C_EK_TRUE))
    np.testing.assert_allclose(np.sqrt(np.diagonal(found.parameters.covariance)), expected, rtol=2e-6)


def test_cameras_know_each_other_better_by_them(rng):
    campaign = with_tie_points(rig_truth((BAND,)), 20, rng)
    given = delivered(campaign, rng)
    found = calibrate(given, JOINTLY)
    assert found.status is Status.OK
    error, P = against_first(mountings(found), campaign)
    assert error @ np.linalg.solve(P, error) < 21.1  # chi-square of 3, once in 10 000
    surveyed = ~given.landmarks.tie
    some = some_of(given.sightings, surveyed[given.sightings.landmark])
    without = calibrate(replace(given, sightings=some), JOINTLY)
    _, P_without = against_first(mountings(without), campaign)
    assert np.all(np.diagonal(P)[:2] < 0.6**2 * np.diagonal(P_without)[:2])
    assert without.estimate.degrees_of_freedom < found.estimate.degrees_of_freedom
    assert found.accuracy(after=True).n == np.sum(surveyed[given.sightings.landmark])


def test_a_wrong_tie_point_is_left_out(rng):
    campaign = with_tie_points(rig_truth((BAND,)), 12, rng)
    given = delivered(campaign, rng)
    s, tied = given.sightings, np.flatnonzero(given.landmarks.tie[given.sightings.landmark])
    column = s.column_px.copy()
    column[tied[[0, 7]]] += 15.0
    found = calibrate(replace(given, sightings=replace(s, column_px=column)), JOINTLY)
    out = {given.landmarks.ids[r.landmark] for r in found.rejected}
    assert out == {given.landmarks.ids[s.landmark[row]] for row in tied[[0, 7]]}
    error, P = against_first(mountings(found), campaign)
    assert error @ np.linalg.solve(P, error) < 21.1


def test_a_camera_with_tie_points_only_is_known(rng):
    campaign = with_tie_points(rig_truth((BAND,)), 12, rng)
    s = campaign.sightings
    mine = campaign.rig.of_image[s.image] == 1
    some = some_of(s, ~mine | campaign.landmarks.tie[s.landmark])
    campaign = replace(campaign, sightings=some)
    found = mountings(calibrate(delivered(campaign, rng), JOINTLY))
    error, P = against_first(found, campaign)
    assert error @ np.linalg.solve(P, error) < 21.1
    assert np.all(np.sqrt(np.diagonal(P))[:2] < 0.2 * ARCSEC)


@pytest.mark.slow
def test_errors_over_sigmas_and_chi_square(rng):
    """60 campaigns: the error of the relative mounting over its sigma, and chi-square by its degrees of freedom."""
    campaign = with_tie_points(rig_truth((BAND,), images=3, markers=5), 6, rng)
    o, tie = observe(campaign), campaign.landmarks.tie
    score, ratio = [], []
    for _ in range(60):
        drawn = Errors.draw(o, rng, ())
        table = measure(o, C_EK_TRUE, replace(drawn, pi_J=np.where(tie[:, None], 0.0, drawn.pi_J)))
        found = Tied(Jointly(("A", "B"), lambda gls: gls, Gls()), tie)(table, C_EK_TRUE)
        score.append(found.parameters.values / np.sqrt(np.diagonal(found.parameters.covariance))[3:])
        ratio.append(found.chi2 / found.degrees_of_freedom)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(score), axis=0)), 1.0, atol=0.28)  # 3 sigma of 60
    spread = np.sqrt(2.0 / found.degrees_of_freedom / 60)
    assert abs(np.mean(ratio) - 1.0) < 4.0 * spread


def test_without_a_surveyed_landmark_there_is_no_answer(rng):
    campaign = with_tie_points(rig_truth((BAND,), images=2, markers=2), 6, rng)
    some = some_of(campaign.sightings, campaign.landmarks.tie[campaign.sightings.landmark])
    with pytest.raises(InputError, match="tie points alone leave the alignment open"):
        placed(replace(campaign, sightings=some), JOINTLY)


def test_they_are_read_as_they_were_written(tmp_path, rng):
    given = delivered(with_tie_points(rig_truth((BAND,)), 8, rng), rng)
    path = write_campaign(tmp_path, given)
    assert "tie0,,,,inf,inf,inf" in (tmp_path / "landmarks.csv").read_text()
    back = load_campaign(path).campaign
    np.testing.assert_array_equal(back.landmarks.tie, given.landmarks.tie)
    one, two = (mountings(calibrate(each, JOINTLY)) for each in (given, back))
    np.testing.assert_allclose(so3.log(one.C_EC @ two.C_EC.mT), 0.0, atol=1e-3 * ARCSEC)


def test_one_camera_reads_them_too_and_they_say_nothing_seen_once(tmp_path):
    ties = LANDMARKS + "T1,,,,inf\n"
    path = write_good_campaign(tmp_path / "with", landmarks=ties)
    with (tmp_path / "with" / "observations.csv").open("a") as table:
        table.write("I1,T1,6000.0,6000.0,0.2\n")
    a, b = (
        sp.calibrate(sp.read_campaign(each)) for each in (path, write_good_campaign(tmp_path / "without"))
    )
    np.testing.assert_allclose(a.sigma_arcsec, b.sigma_arcsec, rtol=1e-6)
    np.testing.assert_allclose(a.correction_arcsec, b.correction_arcsec, atol=1e-4)
    assert a.document["fit"]["degrees_of_freedom"] == b.document["fit"]["degrees_of_freedom"]


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("T1,,,,0.5", "row 5, column latitude_deg: found an empty cell, wanted a finite number"),
        ("T1,0.01,0.01,5.0,inf", "row 5, column sigma_m: found inf, wanted a finite number"),
        ("T1,0.01,,5.0,0.5", "row 5, column longitude_deg: found an empty cell"),
    ],
)
def test_half_a_tie_point_is_refused(tmp_path, row, said):
    path = write_good_campaign(tmp_path, landmarks=f"{LANDMARKS}{row}\n")
    with pytest.raises(InputError) as caught:
        load_campaign(path)
    assert said in str(caught.value).replace('"', "")


def test_other_methods_say_that_they_cannot(tmp_path):
    path = write_good_campaign(tmp_path, landmarks=LANDMARKS + "T1,,,,inf\n")
    with (tmp_path / "observations.csv").open("a") as table:
        table.write("I1,T1,6000.0,6000.0,0.2\n")
    with pytest.raises(InputError, match="wanted the method default, gls or robust"):
        sp.calibrate(sp.read_campaign(path), method="wahba")
