"""Several star trackers fused: by hand, by group laws, by statistics through the estimator, and from files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from bad_cases import swap
from command import starplumb
from helpers import ATTITUDE, CAMPAIGN, write_good_campaign
from problems import C_EK_TRUE, FRAME, LINE, UniformEarth, truth
from starplumb.estimators.gls import Gls
from starplumb.io.campaign.read import load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.physics import so3
from starplumb.physics.errors import EpochError, InputError
from starplumb.physics.series import Attitude
from starplumb.physics.trackers import FusedAttitude, TrackerSeries, fusion_weights, mean_rotation
from starplumb.physics.units import ARCSEC, DEG
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors, measure

Array = NDArray[np.float64]

S = 1_000_000_000
T_NS = S * np.arange(5)
CONE = 25.0 * DEG
SIGMA_A = np.array([5.0, 5.0, 12.0]) * ARCSEC


def cone(angle: float) -> Array:
    """C_EA (3, 3, 3) of three trackers whose boresights stand evenly on a cone about E's z."""
    axes = [np.array([-np.sin(a), np.cos(a), 0.0]) for a in 2.0 * np.pi * np.arange(3) / 3.0]
    return np.stack([so3.exp(angle * axis) for axis in axes])


def turning(t_ns: Array, turn: Array | None = None) -> Array:
    """True C_EJ (n, 3, 3): 0.05 deg/s about an oblique axis, turned by ``turn`` (3, 3)."""
    C = so3.exp(1e-9 * np.asarray(t_ns)[:, None] * np.array([0.03, -0.02, 0.035]) * DEG)
    return C if turn is None else turn @ C


def tracker(
    name: str, C_EA: Array, offset: Array, t_ns: Array = T_NS, sigma: Array = SIGMA_A
) -> TrackerSeries:
    """A series whose reading in E is off by the rotation vector ``offset`` (3,) about E's axes."""
    C_AJ = C_EA.mT @ so3.exp(offset) @ turning(t_ns)
    attitude = Attitude(t_ns, so3.to_quaternion(C_AJ), "ITRF", name=f"{name}.csv")
    return TrackerSeries(name, attitude, C_EA, sigma)


# By hand ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("fusion", "share", "variance"), [("weighted", 0.2, 0.8), ("mean", 0.5, 1.25)])
def test_one_axis_by_hand(fusion, share, variance):
    """Sigmas 1 and 2: weights 4/5 and 1/5, variance 1 / (1 + 1/4); plainly 1/2 and 1/2, (1 + 4) / 4."""
    off = np.array([100.0, 0.0, 0.0]) * ARCSEC
    pair = (
        tracker("good", np.eye(3), np.zeros(3), sigma=np.full(3, ARCSEC)),
        tracker("poor", np.eye(3), off, sigma=np.full(3, 2.0 * ARCSEC)),
    )
    fused = FusedAttitude(pair, fusion)
    found = so3.log(fused.at(T_NS[1:2])[0] @ turning(T_NS[1:2]).mT)[0]
    np.testing.assert_allclose(found / ARCSEC, [100.0 * share, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(fused.covariance_E(T_NS[1:2])[0], variance * ARCSEC**2 * np.eye(3), rtol=1e-12)
    np.testing.assert_allclose(fused.disagreement(T_NS[1:2]), 100.0**2 / 5.0, rtol=1e-9)


def test_covariance_on_a_cone_by_hand():
    """The boresights' n n^T add up to diag(3/2 sin^2, 3/2 sin^2, 3 cos^2) of the cone's angle."""
    spread = np.array([1.5 * np.sin(CONE) ** 2] * 2 + [3.0 * np.cos(CONE) ** 2])
    s2, r2 = 25.0, 144.0
    trackers = tuple(tracker(str(i), C, np.zeros(3)) for i, C in enumerate(cone(CONE)))
    mean, weighted = (FusedAttitude(trackers, f).covariance_E(T_NS[:1])[0] for f in ("mean", "weighted"))
    np.testing.assert_allclose(mean / ARCSEC**2, np.diag(3 * s2 + (r2 - s2) * spread) / 9.0, atol=1e-12)
    np.testing.assert_allclose(
        weighted / ARCSEC**2, np.diag(1.0 / (3 / s2 + (1 / r2 - 1 / s2) * spread)), atol=1e-12
    )


def test_the_gain_of_weights_over_the_plain_mean():
    """Perpendicular trackers of 5, 5, 12 arcsec: sqrt(11.50 / 21.56), 27 % less; on a cone of 25 deg 13, 13, 20 %."""
    gain = {}
    for name, C in {"perpendicular": cone(np.arctan(np.sqrt(2.0))), "cone": cone(CONE)}.items():
        trackers = tuple(tracker(str(i), C_EA, np.zeros(3)) for i, C_EA in enumerate(C))
        mean, weighted = (FusedAttitude(trackers, f).covariance_E(T_NS[:1])[0] for f in ("mean", "weighted"))
        gain[name] = 1.0 - np.sqrt(np.diagonal(weighted) / np.diagonal(mean))
    np.testing.assert_allclose(gain["perpendicular"], 0.27, atol=0.005)
    np.testing.assert_allclose(gain["cone"], [0.130, 0.130, 0.204], atol=0.0005)


# By structure -------------------------------------------------------------------------------------------------


def test_two_rotations_far_apart_average_along_the_geodesic(rng):
    a, b = Rotation.random(2, random_state=rng)
    for share in (0.5, 0.25):
        W = np.stack([(1.0 - share) * np.eye(3), share * np.eye(3)])
        C = np.stack([a.as_matrix(), b.as_matrix()])
        wanted = Slerp([0.0, 1.0], Rotation.concatenate([a, b]))([share]).as_matrix()[0]
        np.testing.assert_allclose(mean_rotation(C, W, C[0]), wanted, atol=1e-13)
        np.testing.assert_allclose(mean_rotation(C[::-1], W[::-1], C[1]), wanted, atol=1e-13)


@pytest.mark.parametrize("scale", [5.0 * ARCSEC, 1.0 * DEG, 20.0 * DEG])
def test_the_average_has_no_weighted_residual_and_turns_with_its_frames(scale, rng):
    C = so3.exp(scale * rng.standard_normal((3, 50, 3)))
    covariance = np.broadcast_to((cone(CONE) * SIGMA_A) @ (cone(CONE) * SIGMA_A).mT, (50, 3, 3, 3)).swapaxes(
        0, 1
    )
    W = fusion_weights(covariance, np.ones((3, 50), dtype=bool), "weighted")
    np.testing.assert_allclose(np.sum(W, axis=0), np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-13)
    M = mean_rotation(C, W, C[0])
    np.testing.assert_allclose(np.sum((W @ so3.log(C @ M.mT)[..., None])[..., 0], axis=0), 0.0, atol=1e-14)
    G, H = so3.exp(rng.standard_normal((2, 3)))
    np.testing.assert_allclose(mean_rotation(C @ H, W, C[1] @ H), M @ H, atol=1e-13)
    np.testing.assert_allclose(mean_rotation(G @ C, G @ W @ G.mT, G @ C[2]), G @ M, atol=1e-13)


def test_readings_at_random_have_no_average_to_speak_of(rng):
    C = Rotation.random(600, random_state=rng).as_matrix().reshape(3, 200, 3, 3)
    scaled = cone(np.pi / 2) * SIGMA_A
    W = fusion_weights(scaled @ scaled.mT, np.ones(3, dtype=bool), "weighted")[:, None]
    with pytest.raises(InputError, match="contradict"):
        mean_rotation(C, W, C[0])


@pytest.mark.parametrize(
    "exact", [np.zeros(3), np.array([0.0, 5.0, 5.0]) * ARCSEC], ids=["all axes", "one axis"]
)
def test_a_tracker_that_claims_to_be_exact_is_refused_where_weights_are_sought(exact):
    pair = (tracker("exact", np.eye(3), np.zeros(3), sigma=exact), tracker("other", np.eye(3), np.zeros(3)))
    with pytest.raises(InputError, match="sigma of 0 gives it all the weight"):
        FusedAttitude(pair).at(T_NS)
    np.testing.assert_allclose(FusedAttitude(pair, "mean").at(T_NS)[0], turning(T_NS), atol=1e-14)


def test_an_axis_a_hundred_thousand_times_better_is_weighed_and_not_refused():
    """Variances 1e10 apart within one tracker: by hand, its share about x is 1 - 1e-10 and about y a half."""
    off = np.array([100.0, 100.0, 0.0]) * ARCSEC
    pair = (
        tracker("good", np.eye(3), np.zeros(3), sigma=np.array([1e-4, 10.0, 10.0]) * ARCSEC),
        tracker("poor", np.eye(3), off, sigma=np.full(3, 10.0) * ARCSEC),
    )
    found = so3.log(FusedAttitude(pair).at(T_NS)[0] @ turning(T_NS).mT) / ARCSEC
    np.testing.assert_allclose(found[:, :2], np.tile([0.0, 50.0], (T_NS.size, 1)), atol=0.02)


def test_an_epoch_outside_the_earths_orientation_is_named_by_its_own_row():
    """The second tracker covers the epochs from 5 s on and no others; the table of the Earth ends among them."""

    class UntilSix(UniformEarth):
        def C_IJ(self, t_ns):
            late = np.asarray(t_ns) > 6 * S
            if late.any():
                raise EpochError("found an epoch after the table", int(np.argmax(late)))
            return super().C_IJ(t_ns)

    def inertial(name, t_ns):
        series = Attitude(t_ns, so3.to_quaternion(turning(t_ns)), "GCRF", UntilSix(), name=name)
        return TrackerSeries(name, series, np.eye(3), SIGMA_A)

    fused = FusedAttitude((inertial("short", T_NS), inertial("late", S * np.arange(5, 10))))
    with pytest.raises(EpochError, match="after the table") as caught:
        fused.at(np.array([3, 8, 2, 5, 9]) * S)
    assert caught.value.row == 1


def test_one_epoch_at_a_time_and_all_at_once(rng):
    trackers = tuple(
        tracker(str(i), C, ARCSEC * rng.standard_normal(3), S * np.arange(-i, 5 + i))
        for i, C in enumerate(cone(CONE))
    )
    fused = FusedAttitude(trackers)
    epochs = rng.integers(0, 4 * S, (2, 3))
    C_EJ, omega_E = fused.at(epochs)
    assert (C_EJ.shape, omega_E.shape) == ((2, 3, 3, 3), (2, 3, 3))
    for index in np.ndindex(2, 3):
        one, rate = fused.at(epochs[index])
        np.testing.assert_allclose(one, C_EJ[index], atol=1e-15)
        np.testing.assert_allclose(rate, omega_E[index], atol=1e-18)


def test_a_single_tracker_is_its_own_average(rng):
    alone = tracker("alone", cone(CONE)[1], ARCSEC * rng.standard_normal(3))
    epochs = rng.integers(0, 4 * S, 20)
    C_AJ, omega_A = alone.attitude.at(epochs)
    C_EJ, omega_E = FusedAttitude((alone,)).at(epochs)
    np.testing.assert_allclose(C_EJ, alone.C_EA @ C_AJ, atol=1e-15)
    np.testing.assert_allclose(omega_E, omega_A @ alone.C_EA.T, atol=1e-17)


def test_the_rate_is_the_derivative_of_the_attitude():
    trackers = tuple(tracker(str(i), C, 20.0 * ARCSEC * C[0]) for i, C in enumerate(cone(CONE)))
    fused = FusedAttitude(trackers)
    step = S // 100
    before, after = (fused.at(2 * S + sign * step)[0] for sign in (-1, 1))
    _, omega_E = fused.at(2 * S)
    np.testing.assert_allclose(so3.log(after @ before.mT) / 0.02, omega_E, rtol=2e-4)


# Coverage -----------------------------------------------------------------------------------------------------


def test_an_epoch_takes_the_trackers_that_cover_it():
    off = np.array([0.0, 30.0, 0.0]) * ARCSEC
    early, late = T_NS[:3], T_NS[2:]
    fused = FusedAttitude(
        (tracker("early", np.eye(3), np.zeros(3), early), tracker("late", np.eye(3), off, late))
    )
    np.testing.assert_array_equal(fused.used(T_NS), [[True] * 3 + [False] * 2, [False] * 2 + [True] * 3])
    found = so3.log(fused.at(T_NS)[0] @ turning(T_NS).mT) / ARCSEC
    np.testing.assert_allclose(found[:, 1], [0.0, 0.0, 15.0, 30.0, 30.0], atol=1e-9)
    variance = fused.covariance_E(T_NS)[:, 0, 0] / ARCSEC**2
    np.testing.assert_allclose(variance, [25.0, 25.0, 12.5, 25.0, 25.0])
    residual = fused.residuals(T_NS)[:, :, 1] / ARCSEC
    np.testing.assert_allclose(residual[0], [0.0, 0.0, -15.0, np.nan, np.nan], atol=1e-9)
    with pytest.raises(
        EpochError, match=r"outside early\.csv .* \(nor does any of late cover it\)"
    ) as caught:
        fused.at(np.array([1, 2, 9]) * S)
    assert caught.value.row == 2


def test_sigmas_that_vary_move_the_weights():
    """By hand at 1.5 s: sigmas 3 (between 2 and 4) and 1: the first has a tenth of the weight."""
    varying = np.array([1.0, 2.0, 4.0, 1.0, 1.0])[:, None] * np.ones(3) * ARCSEC
    a = tracker("a", np.eye(3), np.array([10.0, 0.0, 0.0]) * ARCSEC, sigma=varying)
    b = tracker("b", np.eye(3), np.zeros(3), sigma=np.full(3, ARCSEC))
    epoch = np.array([3 * S // 2])
    fused = FusedAttitude((a, b))
    np.testing.assert_allclose(so3.log(fused.at(epoch)[0] @ turning(epoch).mT)[0, 0] / ARCSEC, 1.0, atol=1e-8)
    np.testing.assert_allclose(fused.covariance_E(epoch)[0, 0, 0] / ARCSEC**2, 0.9)


# By statistics ------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("camera", [FRAME, LINE], ids=["frame", "line-scan"])
@pytest.mark.parametrize("fusion", ["weighted", "mean"])
def test_the_estimate_keeps_its_sigmas_with_three_trackers(camera, fusion, rng):
    """2000 campaigns whose attitude error is that of three noisy readings averaged on the group."""
    runs, images = 2000, 5
    campaign = truth(camera, images=images, markers=6)
    C_EA = cone(CONE)
    scaled = C_EA * SIGMA_A
    W = fusion_weights(scaled @ scaled.mT, np.ones(3, dtype=bool), fusion)[:, None, None]
    cov_E = np.sum(W[:, 0, 0] @ (scaled @ scaled.mT) @ W[:, 0, 0].mT, axis=0)
    o = observe(replace(campaign, cov_attitude_E=cov_E))
    alpha_A = SIGMA_A * rng.standard_normal((3, runs, images, 3))
    true_EJ = campaign.attitude.at(campaign.images.t_ns)[0]
    C = C_EA[:, None, None] @ so3.exp(alpha_A) @ C_EA[:, None, None].mT @ true_EJ
    alpha_E = so3.log(mean_rotation(C, W, C[0]) @ true_EJ.mT)
    root = np.linalg.inv(np.linalg.cholesky(cov_E))
    np.testing.assert_allclose(root @ np.cov(alpha_E.reshape(-1, 3).T) @ root.T, np.eye(3), atol=0.07)
    errors = replace(Errors.draw(o, rng, (runs,)), alpha_E=alpha_E)
    estimate = Gls()(measure(o, C_EK_TRUE, errors), C_EK_TRUE)
    ratio = so3.log(estimate.C_EK @ C_EK_TRUE.mT) / estimate.sigma_E
    np.testing.assert_allclose(ratio.std(axis=0), 1.0, atol=4.0 / np.sqrt(2 * runs))
    np.testing.assert_allclose(estimate.chi2.mean(), estimate.degrees_of_freedom, rtol=0.02)


@pytest.mark.slow
def test_disagreement_is_chi_square(rng):
    """Mean 3 (k - 1) and variance twice that, whatever the trackers share."""
    t_ns = S * np.arange(4000)
    shared = turning(t_ns, so3.exp(np.array([0.3, 0.2, -0.1])))
    trackers = []
    for C_EA in cone(CONE):
        C_AJ = so3.exp(SIGMA_A * rng.standard_normal((4000, 3))) @ C_EA.mT @ shared
        attitude = Attitude(t_ns, so3.to_quaternion(C_AJ), "ITRF")
        trackers.append(TrackerSeries("t", attitude, C_EA, SIGMA_A))
    for fusion in ("weighted", "mean"):
        chi2 = FusedAttitude(tuple(trackers), fusion).disagreement(t_ns)
        assert chi2.mean() == pytest.approx(6.0, abs=4 * np.sqrt(12.0 / 4000))
        assert chi2.var() == pytest.approx(12.0, rel=0.15)


# From files ---------------------------------------------------------------------------------------------------

STR_1 = """\
[[trackers]]
file = "attitude.csv"
from = "ITRF"
to = "str_1"
sigma_arcsec = [5.0, 5.0, 12.0]
mounting = { from = "str_1", to = "body", quaternion_xyzw = [0.0, 0.0, 0.0, 1.0] }
"""
STR_2 = """\
[[trackers]]
file = "second.csv"
from = "ITRF"
to = "str_2"
sigma_arcsec = [5.0, 5.0, 12.0]
mounting = { from = "body", to = "str_2", rotation_vector_deg = [0.0, 90.0, 0.0] }
"""
FUSION = '[fusion]\nframe = "body"\n'
SECOND = Rotation.from_rotvec([0.0, np.pi / 2, 0.0]) * Rotation.from_quat([0.5, 0.5, -0.5, 0.5])
"""The second tracker's reading where it agrees with the first: its mounting, then the attitude of ``helpers``."""


def second(offset_arcsec: float = 0.0, times: tuple[int, ...] = (0, 2, 4)) -> str:
    turn = Rotation.from_rotvec([offset_arcsec * ARCSEC, 0.0, 0.0])
    q = (turn * SECOND).as_quat().tolist()
    return "time,qx,qy,qz,qw\n" + "".join(f"2020-01-01T00:00:0{t},{','.join(map(repr, q))}\n" for t in times)


def several(folder: Path, *changes: tuple[str, str], second_csv: str | None = None) -> Path:
    """The good campaign with two trackers in place of [attitude], texts of campaign.toml exchanged."""
    before, _, after = CAMPAIGN.partition("[attitude]")
    toml = (
        before.replace("star_tracker", "body")
        + STR_1
        + STR_2
        + FUSION
        + "[landmarks]"
        + after.partition("[landmarks]")[2]
    )
    for old, new in changes:
        assert old in toml, old
        toml = toml.replace(old, new)
    path = write_good_campaign(folder, campaign=toml)
    (folder / "second.csv").write_text(second() if second_csv is None else second_csv)
    return path


def test_two_trackers_from_files(tmp_path):
    loaded = load_campaign(several(tmp_path))
    single = load_campaign(write_good_campaign(tmp_path / "single"))
    assert (loaded.config.tracker, loaded.notices) == ("body", ())
    assert {"attitude.csv", "second.csv"} <= set(loaded.inputs)
    t_ns = loaded.campaign.images.t_ns
    for found, wanted in zip(
        loaded.campaign.attitude.at(t_ns), single.campaign.attitude.at(t_ns), strict=True
    ):
        np.testing.assert_allclose(found, wanted, atol=1e-15)
    # across a quarter turn about y: 5 and 12 about x, 5 and 5 about y, 12 and 5 about z
    crossed = 1.0 / (1 / 25.0 + 1 / 144.0)
    np.testing.assert_allclose(
        loaded.campaign.cov_attitude_E / ARCSEC**2,
        np.tile(np.diag([crossed, 12.5, crossed]), (2, 1, 1)),
        atol=1e-9,
    )


def test_the_plain_mean_from_files(tmp_path):
    path = several(tmp_path, (FUSION, FUSION + 'method = "mean"\n'), second_csv=second(8.0))
    campaign = load_campaign(path).campaign
    single = load_campaign(write_good_campaign(tmp_path / "single")).campaign
    # 8 arcsec about the second tracker's x are 8 about E's -z
    turn = so3.log(
        campaign.attitude.at(campaign.images.t_ns)[0] @ single.attitude.at(campaign.images.t_ns)[0].mT
    )
    np.testing.assert_allclose(np.abs(turn) / ARCSEC, [[0.0, 0.0, 4.0]] * 2, atol=1e-9)
    np.testing.assert_allclose(
        np.diagonal(campaign.cov_attitude_E[0]) / ARCSEC**2, [169 / 4, 50 / 4, 169 / 4]
    )


@pytest.mark.slow
def test_the_command_calibrates_with_several_trackers_and_locates(tmp_path):
    path = several(tmp_path)
    spoken = starplumb("calibrate", path, "--no-report", "--quiet")
    assert (spoken.status, spoken.err) == (0, "")
    result = json.loads((tmp_path / "result" / "result.json").read_text())
    assert result["mounting"]["to"] == "body"
    kept = ["--result", tmp_path / "result" / "result.json", "--json"]
    single = write_good_campaign(tmp_path / "single")
    starplumb("calibrate", single, "--no-report", "--quiet")
    better = json.loads((tmp_path / "single" / "result" / "result.json").read_text())
    assert np.all(np.array(result["sigma_arcsec"]) < better["sigma_arcsec"])
    place = json.loads(starplumb("locate", path, 6000, 6000, "--image", "I1", *kept).out)
    assert max(place["sigma_east_north_up_m"]) > 1.0
    assert starplumb("diagnose", path, "--quiet").status == 0


@pytest.mark.parametrize("fusion", ["weighted", "mean"])
def test_written_and_read_again(fusion, tmp_path, rng):
    loaded = load_campaign(write_good_campaign(tmp_path / "first")).campaign
    t_ns = loaded.attitude.t_ns
    varying = ARCSEC * rng.uniform(3.0, 9.0, (t_ns.size, 3))
    trackers = []
    for i, C_EA in enumerate(cone(CONE)):
        C_AJ = (
            so3.exp(2 * ARCSEC * rng.standard_normal((t_ns.size, 3)))
            @ C_EA.mT
            @ so3.from_quaternion(loaded.attitude.q_EF)
        )
        attitude = Attitude(t_ns, so3.to_quaternion(C_AJ), "ITRF", gap_s=None if i else 3.5)
        trackers.append(TrackerSeries(f"str_{i}", attitude, C_EA, varying if i == 1 else SIGMA_A))
    trackers[2] = replace(trackers[2], name="star_tracker", C_EA=np.eye(3), attitude=loaded.attitude)
    fused = FusedAttitude(tuple(trackers), fusion)
    campaign = replace(loaded, attitude=fused, cov_attitude_E=fused.covariance_E(loaded.images.t_ns))
    again = load_campaign(write_campaign(tmp_path / "second", campaign)).campaign
    assert isinstance(again.attitude, FusedAttitude)
    assert again.attitude.fusion == fusion
    for a, b in zip(again.attitude.trackers, fused.trackers, strict=True):
        assert (a.name, a.attitude.gap_s) == (b.name, b.attitude.gap_s)
        np.testing.assert_allclose(a.C_EA, b.C_EA, atol=1e-15)
        np.testing.assert_allclose(a.attitude.q_EF, b.attitude.q_EF, atol=1e-15)
        np.testing.assert_allclose(a.sigma_S, b.sigma_S, rtol=1e-14)
    np.testing.assert_allclose(again.cov_attitude_E, campaign.cov_attitude_E, rtol=1e-9, atol=1e-24)


def test_a_tracker_that_misses_an_image_is_told(tmp_path):
    loaded = load_campaign(several(tmp_path, second_csv=second(times=(2, 4))))
    assert [notice.split("/")[-1] for notice in loaded.notices] == [
        "second.csv: found no attitude at I1; the attitude there is that of the other trackers"
    ]
    variance = np.diagonal(loaded.campaign.cov_attitude_E, axis1=1, axis2=2) / ARCSEC**2
    np.testing.assert_allclose(variance[0], [25.0, 25.0, 144.0])
    assert np.all(variance[1] < variance[0])


def test_a_tracker_must_not_come_and_go_within_an_image(tmp_path):
    """Rows of a line scanner: the second tracker begins between the first image's markers."""
    path = several(tmp_path, ('model = "frame"', 'model = "line-scan"'), second_csv=second(times=(2, 3, 4)))
    swap("images.csv", "image_id,time\n", "image_id,time,line_period_s\n")(tmp_path)
    swap("images.csv", "01.500\n", "01.500,0.0001\n")(tmp_path)
    swap("images.csv", "02.500\n", "02.500,0.0001\n")(tmp_path)
    with pytest.raises(
        InputError, match=r'"str_2" \(.*second\.csv\) to cover only a part of image "I1", wanted'
    ):
        load_campaign(path)


def test_trackers_that_disagree_are_told_or_refused(tmp_path):
    assert load_campaign(several(tmp_path / "fine", second_csv=second(10.0))).notices == ()
    (notice,) = load_campaign(several(tmp_path / "off", second_csv=second(200.0))).notices
    assert "the star trackers disagree" in notice
    assert "times what their sigmas allow" in notice
    for offset in (3600.0 * 3, 3600.0 * 170):
        with pytest.raises(
            InputError, match=r"campaign\.toml: .*(deg from the trackers' average, wanted|contradict)"
        ):
            load_campaign(several(tmp_path / "wrong", second_csv=second(offset)))


BAD = {
    "both": (
        (FUSION, FUSION + '[attitude]\nfile = "attitude.csv"\nfrom = "ITRF"\nto = "body"\n'),
        "trackers: found beside [attitude]",
    ),
    "no fusion": ((FUSION, ""), "fusion: missing, wanted the section [fusion]"),
    "fusion alone": (
        (STR_1 + STR_2, '[attitude]\nfile = "attitude.csv"\nfrom = "ITRF"\nto = "body"\n'),
        "fusion: found beside [attitude]",
    ),
    "no frame": (('frame = "body"\n', 'method = "mean"\n'), "fusion.frame: missing"),
    "method": (
        (FUSION, FUSION + 'method = "median"\n'),
        'fusion.method: found "median", wanted "weighted" or "mean"',
    ),
    "no trackers": ((STR_1 + STR_2, ""), "attitude: missing, wanted the section [attitude]"),
    "one section": ((STR_1 + STR_2, "[trackers]\nfile = 3\n"), "trackers: found "),
    "same name": (('"str_2"', '"str_1"'), 'trackers.1.to: found the tracker "str_1" again'),
    "camera": (('"str_2"', '"camera"'), 'trackers.1.to: found "camera", wanted another name'),
    "frame is camera": (('frame = "body"', 'frame = "camera"'), 'fusion.frame: found "camera"'),
    "no mounting": (
        (STR_2.splitlines()[-1], ""),
        'trackers.1.mounting: missing, wanted the rotation between "str_2" and "body"',
    ),
    "elsewhere": (
        ('to = "str_2", rot', 'to = "str_3", rot'),
        'trackers.1.mounting.to: found "str_3", wanted "str_2"',
    ),
    "other frame": (
        ('{ from = "body"', '{ from = "bus"'),
        'trackers.1.mounting.from: found "bus", wanted "body", the frame of [fusion]',
    ),
    "needless mounting": (
        ('frame = "body"', 'frame = "str_1"'),
        "trackers.0.mounting: found a mounting, wanted none",
    ),
    "no rotation": (
        (", rotation_vector_deg = [0.0, 90.0, 0.0]", ""),
        "trackers.1.mounting.quaternion_xyzw: missing",
    ),
    "camera's mounting": (
        ('frame = "body"', 'frame = "bus"'),
        'mounting.to: found "body", wanted "bus", the frame of [fusion]',
    ),
    "both sides": (('from = "ITRF"\nto = "str_2"', 'from = "ITRF"\nto = "GCRF"'), "trackers.1.from: found"),
    "file": (('"second.csv"', '"third.csv"'), "trackers.1.file:"),
    "ending": (('"second.csv"', '"second.txt"'), "second.txt: found no such file, wanted a readable file"),
    "sigma zero": ((STR_2, STR_2.replace("[5.0, 5.0, 12.0]", "0")), "trackers.1.sigma_arcsec: found 0"),
    "no sigma": (
        (STR_2, STR_2.replace("sigma_arcsec = [5.0, 5.0, 12.0]\n", "")),
        "trackers.1.sigma_arcsec: missing",
    ),
    "unknown": (
        (STR_2, STR_2 + "noise = 3\n"),
        "trackers.1.noise: unknown key, wanted one of ",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", list(BAD))
def test_wrong_sections_are_named(name, tmp_path):
    change, says = BAD[name]
    spoken = starplumb("calibrate", several(tmp_path / "c", change), "--out", tmp_path / "out")
    assert (spoken.status, spoken.out, spoken.err.count("\n")) == (2, "", 1)
    assert says in spoken.err
    assert not (tmp_path / "out").exists()


def test_an_image_that_no_tracker_covers_is_named(tmp_path):
    path = several(tmp_path, second_csv=second(times=(2, 3)))
    (tmp_path / "attitude.csv").write_text(ATTITUDE.replace("00:00.000", "00:01.900"))
    with pytest.raises(
        InputError, match=r"images\.csv, image 'I1': .*attitude\.csv .*nor does any of str_2 cover it"
    ):
        observe(load_campaign(path).campaign)
