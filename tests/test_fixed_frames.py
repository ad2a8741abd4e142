"""Fixed rotations between named frames: the axes in which sigmas hold, and mountings to another frame than the
attitude's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from helpers import CAMPAIGN, FILES, write_good_campaign
from independent import Case, write
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.io.campaign.read import LoadedCampaign, load_campaign
from starplumb.io.campaign.write import write_campaign
from starplumb.judge.calibrate import calibrate
from starplumb.physics.errors import InputError
from starplumb.physics.trackers import FusedAttitude
from starplumb.physics.units import ARCSEC
from starplumb.table.geometry import observe
from test_trackers import FUSION, STR_2, several

SIGMAS = "sigma_arcsec = [5.0, 5.0, 12.0]"
HEAD = Rotation.from_euler("ZYX", [35.0, -50.0, 110.0], degrees=True)
"""Takes coordinates in the star tracker's own axes, its boresight z, from those in the frame of the attitude."""
FRAMES = f'[frames]\nhead = {{ from = "star_tracker", quaternion_xyzw = {HEAD.as_quat().tolist()} }}\n'
TURNED = HEAD.as_matrix().T @ np.diag([36.0, 36.0, 1600.0]) @ HEAD.as_matrix()
"""Covariance, arcsec^2, in the frame of the attitude, of errors of 6, 6, 40 about the axes of the head."""


def load(folder: Path, *changes: tuple[str, str], attitude: str = FILES["attitude.csv"]) -> LoadedCampaign:
    """The good campaign with texts of campaign.toml exchanged and [frames]."""
    toml = CAMPAIGN
    for old, new in changes:
        assert old in toml, old
        toml = toml.replace(old, new)
    return load_campaign(write_good_campaign(folder, campaign=toml + FRAMES, attitude=attitude))


def covariance(loaded: LoadedCampaign) -> np.ndarray:
    return loaded.campaign.cov_attitude_E / ARCSEC**2


# The axes of the sigmas ----------------------------------------------------------------------------------------


def test_a_boresight_along_x_by_hand(tmp_path):
    """The tracker's z is the attitude's x: 40 arcsec about x, 6 about y and z."""
    frames = '[frames]\nhead = { from = "star_tracker", matrix = [[0, 0, -1], [0, 1, 0], [1, 0, 0]] }\n'
    stated = 'sigma_arcsec = [6.0, 6.0, 40.0]\nsigma_frame = "head"'
    toml = CAMPAIGN.replace(SIGMAS, stated) + frames
    loaded = load_campaign(write_good_campaign(tmp_path, campaign=toml))
    np.testing.assert_allclose(covariance(loaded), np.diag([1600.0, 36.0, 36.0]), rtol=1e-12)


@pytest.mark.parametrize(
    "stated",
    [
        'sigma_arcsec = [6.0, 6.0, 40.0]\nsigma_frame = "head"',
        'covariance_arcsec2 = [[36.0, 0, 0], [0, 36, 0], [0, 0, 1600]]\nsigma_frame = "head"',
        f"covariance_arcsec2 = {TURNED.tolist()}",
        f'covariance_arcsec2 = {TURNED.round(3).tolist()}\nsigma_frame = "star_tracker"',
    ],
    ids=["sigmas", "covariance", "own axes", "few digits"],
)
def test_sigmas_about_other_axes_are_turned(tmp_path, stated):
    np.testing.assert_allclose(covariance(load(tmp_path, (SIGMAS, stated))), TURNED, atol=1e-3)


def test_sigmas_of_the_table_are_about_those_axes_too(tmp_path):
    table = (
        "time,qx,qy,qz,qw,sigma_x_arcsec,sigma_y_arcsec,sigma_z_arcsec\n"
        "2020-01-01T00:00:01.500,0.5,0.5,-0.5,0.5,6,6,40\n"
        "2020-01-01T00:00:02.500,0.5,0.5,-0.5,0.5,3,3,10\n"
    )
    loaded = load(tmp_path, (SIGMAS, 'sigma_frame = "head"'), attitude=table)
    head = HEAD.as_matrix()
    wanted = [head.T @ np.diag(np.square(s)) @ head for s in ([6.0, 6.0, 40.0], [3.0, 3.0, 10.0])]
    np.testing.assert_allclose(covariance(loaded), wanted, atol=1e-9)


def test_a_chain_of_frames_is_followed_either_way(tmp_path):
    """The attitude's frame is itself written from another, and the tracker's from that one."""
    own, other = Rotation.from_rotvec([0.3, 0.1, -2.0]), Rotation.from_rotvec([-1.0, 0.4, 0.2])
    chain = (
        f'[frames]\nstar_tracker = {{ from = "bench", quaternion_xyzw = {own.as_quat().tolist()} }}\n'
        f'head = {{ from = "bench", quaternion_xyzw = {other.as_quat().tolist()} }}\n'
    )
    toml = CAMPAIGN.replace(SIGMAS, 'sigma_arcsec = [6.0, 6.0, 40.0]\nsigma_frame = "head"') + chain
    loaded = load_campaign(write_good_campaign(tmp_path, campaign=toml))
    turn = (own * other.inv()).as_matrix()
    np.testing.assert_allclose(covariance(loaded), turn @ np.diag([36.0, 36.0, 1600.0]) @ turn.T, atol=1e-9)


@pytest.mark.slow
def test_errors_over_sigma_are_one_by_axis_where_they_were_five(tmp_path, rng):
    """Files of a simulator apart; errors of 6, 6, 40 arcsec drawn about the axes of the tracker's own head."""
    trials = 200
    true = write(tmp_path, Case(), rng)
    text = (tmp_path / "campaign.toml").read_text().replace("sigma_m = 3.0", "sigma_m = 0.1")
    # what is not drawn is stated as next to nothing
    for name, old, new in (("obs.csv", ",0.2\n", ",0.002\n"), ("lm.csv", ",1.0\n", ",0.01\n")):
        table = (tmp_path / name).read_text()
        assert old in table
        (tmp_path / name).write_text(table.replace(old, new))
    stated = 'sigma_arcsec = [6.0, 6.0, 40.0], sigma_frame = "head"'
    campaigns = {}
    for name, words in (("right", stated), ("about the body", "sigma_arcsec = [6.0, 6.0, 40.0]")):
        path = tmp_path / f"{name}.toml"
        path.write_text(text.replace(SIGMAS, words) + FRAMES.replace('"star_tracker"', '"st"'))
        campaigns[name] = load_campaign(path).campaign
    q = campaigns["right"].one_attitude.q_EF
    error: dict[str, list[np.ndarray]] = {name: [] for name in campaigns}
    for _ in range(trials):
        drawn = HEAD.inv().apply(rng.standard_normal((5, 3)) * [6.0, 6.0, 40.0] * ARCSEC)
        turned = (Rotation.from_rotvec(np.repeat(drawn, 17, axis=0)) * Rotation.from_quat(q)).as_quat()
        for name, campaign in campaigns.items():
            measured = campaign.with_attitude(lambda series, q=turned: replace(series, q_EF=q))
            found = Gls()(observe(measured), campaign.C_EK)
            assert found.status == Status.OK
            off = Rotation.from_matrix(found.C_EK @ true.T).as_rotvec()
            error[name].append(off / np.sqrt(np.diagonal(found.covariance_E)))
    square = {name: np.mean(np.square(errors), axis=0) for name, errors in error.items()}
    np.testing.assert_allclose(square["right"], 1.0, atol=3.5 * np.sqrt(2 / trials))
    assert np.sqrt(np.max(square["about the body"])) > 3.5


# The frames of the mounting ------------------------------------------------------------------------------------


def test_a_mounting_to_a_frame_that_is_joined_with_the_attitudes(tmp_path):
    """The mounting leads to the head: it is E, attitude and answer are in it, and the sight of the camera stays."""
    plain = load(tmp_path / "plain").campaign
    model = HEAD.as_quat().tolist()
    loaded = load(
        tmp_path / "head",
        (
            'to = "star_tracker"\nquaternion_xyzw = [0.0, 0.0, 0.0, 1.0]',
            f'to = "head"\nquaternion_xyzw = {model}',
        ),
        (SIGMAS, SIGMAS + '\nsigma_frame = "star_tracker"'),
    )
    assert loaded.config.tracker == "head"
    t_ns = plain.images.t_ns
    for a, b in zip(loaded.campaign.attitude.at(t_ns), plain.attitude.at(t_ns), strict=True):
        np.testing.assert_allclose(a, HEAD.as_matrix() @ b if b.ndim == 3 else HEAD.apply(b), atol=1e-14)
    turn = HEAD.as_matrix()
    np.testing.assert_allclose(covariance(loaded), turn @ np.diag([25, 25, 144.0]) @ turn.T, atol=1e-9)
    ours, theirs = calibrate(loaded.campaign, Gls()), calibrate(plain, Gls())
    np.testing.assert_allclose(ours.estimate.C_EK, turn @ theirs.estimate.C_EK, atol=1e-9)
    np.testing.assert_allclose(ours.correction_E, HEAD.apply(theirs.correction_E), atol=1e-9)
    rotated = turn @ theirs.estimate.covariance_E @ turn.T
    np.testing.assert_allclose(ours.estimate.covariance_E, rotated, rtol=1e-6, atol=1e-16)


def test_equal_sigmas_need_no_axes(tmp_path):
    change = ('to = "star_tracker"\nquaternion', 'to = "head"\nquaternion')
    loaded = load(tmp_path, change, (SIGMAS, "sigma_arcsec = 5.0"))
    np.testing.assert_allclose(covariance(loaded), 25.0 * np.eye(3), atol=1e-9)


def test_a_mounting_from_a_frame_that_is_joined_with_the_camera(tmp_path):
    """A vendor's camera with x down and y to the left of ours."""
    frames = '[frames]\nvendor = { from = "camera", matrix = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] }\n'
    turn = Rotation.from_rotvec([0.1, -0.2, 0.5])
    change = f'from = "vendor"\nto = "star_tracker"\nquaternion_xyzw = {turn.as_quat().tolist()}'
    toml = CAMPAIGN.replace(
        CAMPAIGN[CAMPAIGN.index('from = "camera"') : CAMPAIGN.index("\n\n[ephem")], change
    )
    loaded = load_campaign(write_good_campaign(tmp_path, campaign=toml + frames))
    assert loaded.config.tracker == "star_tracker"
    x, y, z = turn.as_matrix().T
    # our x axis is the vendor's -y, our y axis is its x
    np.testing.assert_allclose(loaded.campaign.C_EK, np.stack([-y, x, z], axis=1), atol=1e-14)


def test_a_tracker_is_joined_with_the_others_by_frames(tmp_path):
    """[frames] says what the tracker's own mounting said, and its sigmas may be about another tracker's axes."""
    mounting = next(line for line in STR_2.splitlines() if line.startswith("mounting"))
    frames = FUSION + '[frames]\nstr_2 = { from = "body", rotation_vector_deg = [0.0, 90.0, 0.0] }\n'
    plain = load_campaign(several(tmp_path / "a"))
    loaded = load_campaign(several(tmp_path / "b", (mounting, ""), (FUSION, frames)))
    np.testing.assert_allclose(covariance(loaded), covariance(plain), atol=1e-9)
    alike = load_campaign(several(tmp_path / "c", (mounting, 'sigma_frame = "str_1"'), (FUSION, frames)))
    np.testing.assert_allclose(covariance(alike), [np.diag([12.5, 12.5, 72.0])] * 2, atol=1e-9)
    again = load_campaign(write_campaign(tmp_path / "d", alike.campaign, tracker="body"))
    assert isinstance(again.campaign.attitude, FusedAttitude)
    np.testing.assert_allclose(covariance(again), covariance(alike), atol=1e-9)


def test_a_covariance_is_written_and_read_again(tmp_path):
    loaded = load(tmp_path / "a", (SIGMAS, f"covariance_arcsec2 = {TURNED.tolist()}"))
    again = load_campaign(write_campaign(tmp_path / "b", loaded.campaign))
    np.testing.assert_allclose(covariance(again), covariance(loaded), rtol=1e-12)


# What is refused -----------------------------------------------------------------------------------------------

HEAD_LINE = FRAMES.splitlines()[1]


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            [(SIGMAS, SIGMAS + '\nsigma_frame = "str_9"')],
            'attitude.sigma_frame: found "str_9", wanted "star_tracker" or what [frames] joins with it ("head")',
        ),
        (
            [(SIGMAS, SIGMAS + "\ncovariance_arcsec2 = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]")],
            "attitude.covariance_arcsec2: found beside sigma_arcsec, wanted only one of the two",
        ),
        (
            [(SIGMAS, "covariance_arcsec2 = [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]")],
            "a covariance matrix (this one is not symmetric)",
        ),
        (
            [(SIGMAS, "covariance_arcsec2 = [[1, 2, 0], [2, 1, 0], [0, 0, 1]]")],
            "a covariance matrix (along one direction the variance of this one is -1)",
        ),
        ([(SIGMAS, "covariance_arcsec2 = [1, 1, 1]")], "wanted three rows of three numbers"),
        (
            [('to = "star_tracker"\nquat', 'to = "head"\nquat')],
            'attitude.sigma_frame: missing, wanted "star_tracker" or "head": the attitude is that of the one',
        ),
        (
            [('to = "star_tracker"\nquat', 'to = "bench"\nquat')],
            'mounting.to: found "bench", wanted "star_tracker"',
        ),
        (
            [
                ('from = "star_tracker", quat', 'from = "camera", quat'),
                ('from = "ITRF"\nto = "star_tracker"', 'from = "ITRF"\nto = "head"'),
            ],
            'frames: found "camera" and "head" joined by fixed rotations, wanted that left to [mounting]',
        ),
        (
            [(HEAD_LINE, HEAD_LINE + '\nstar_tracker = { from = "head", quaternion_xyzw = [0, 0, 0, 1] }')],
            'frames.star_tracker.from: found "head", which other frames join with "star_tracker" already',
        ),
        (
            [("head = {", "GCRF = {")],
            'frames.GCRF: found "GCRF", wanted frames that are fixed to the satellite',
        ),
        (
            [("head = { from", "head = { form")],
            "frames.head.form: unknown key, the nearest known one is from",
        ),
        (
            [(", quaternion_xyzw = " + str(HEAD.as_quat().tolist()), "")],
            "frames.head.quaternion_xyzw: missing",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused_in_a_sentence(tmp_path, changes, says):
    toml = CAMPAIGN + FRAMES
    for old, new in changes:
        assert old in toml, old
        toml = toml.replace(old, new)
    with pytest.raises(InputError) as caught:
        load_campaign(write_good_campaign(tmp_path, campaign=toml))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_second_way_between_trackers_is_refused(tmp_path):
    frames = FUSION + '[frames]\nstr_2 = { from = "str_1", rotation_vector_deg = [0.0, 90.0, 0.0] }\n'
    with pytest.raises(
        InputError, match=r'trackers.1.mounting: found a second way between "body" and "str_2"'
    ):
        load_campaign(several(tmp_path, (FUSION, frames)))


def test_a_rounded_matrix_of_a_frame_is_made_a_rotation_and_told(tmp_path):
    rounded = f'[frames]\nhead = {{ from = "star_tracker", matrix = {HEAD.as_matrix().round(4).tolist()} }}\n'
    loaded = load_campaign(write_good_campaign(tmp_path, campaign=CAMPAIGN + rounded))
    assert [notice.split(": ")[1].split(" to ")[0] for notice in loaded.notices] == [
        "frames.head.matrix is orthonormal"
    ]


def test_further_errors_are_about_the_same_axes(tmp_path):
    wander = "wander = { sigma_arcsec = [2.0, 2.0, 3.0], correlation_time_s = 1.0 }"
    further = f"session_sigma_arcsec = [1.0, 1.0, 4.0]\n{wander}"
    stated = f'{SIGMAS}\nsigma_frame = "head"\n{further}'
    errors = load(tmp_path / "a", (SIGMAS, stated)).campaign.attitude_errors
    head = HEAD.as_matrix()
    for root, sigma in ((errors.session_sigma, [1.0, 1.0, 4.0]), (errors.wander_sigma, [2.0, 2.0, 3.0])):
        np.testing.assert_allclose(
            root @ root.T / ARCSEC**2, head.T @ np.diag(np.square(sigma)) @ head, atol=1e-9
        )
    own = load(tmp_path / "b", (SIGMAS, f"{SIGMAS}\n{further}")).campaign.attitude_errors
    np.testing.assert_allclose(own.session_sigma / ARCSEC, [1.0, 1.0, 4.0])
