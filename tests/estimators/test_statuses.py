"""When an answer may be used: the same rule for every method, from the estimators down to the command's exit status."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from command import demo, starplumb
from problems import C_EK_TRUE, FRAME, truth
from starplumb.estimators import BEARS, METHODS, methods
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.estimators.published.image_plane import ImagePlane
from starplumb.estimators.published.projective import Projective
from starplumb.estimators.robust import Robust
from starplumb.estimators.sequential import Sequential
from starplumb.estimators.usable import determined, fits, status_of
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC, DEG
from starplumb.table.geometry import observe
from starplumb.table.parameters import TimeOffset
from starplumb.table.simulate import Errors, measure

LATE = TimeOffset(("time_offset",), (0.01,))
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def good(rng, **options):
    o = observe(truth(FRAME, 6, 6, tilt_deg=20.0, yaw_deg=50.0, **options))
    return measure(o, C_EK_TRUE, Errors.draw(o, rng))


def one_image_half_a_turn_off(rng, axis):
    """The attitude of the third image turned by 180 deg about an axis of E."""
    o = good(rng)
    wrong = (o.image == 2)[:, None, None]
    turned = np.where(wrong, so3.exp(np.pi * np.array(AXES[axis])) @ o.C_EJ, o.C_EJ)
    return o.with_geometry(C_EJ=turned)


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("name", [name for name in METHODS if name not in ("default", "robust")])
def test_markers_behind_the_camera_leave_no_method_an_answer(name, axis, rng):
    """A turn by half about an axis across the boresight puts the image's markers behind the camera."""
    assert METHODS[name]()(one_image_half_a_turn_off(rng, axis), C_EK_TRUE).status == Status.NOT_CONVERGED


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(
    "estimator",
    [
        *(methods()[name]() for name in METHODS if name not in ("default", "robust")),
        *(Gls((LATE,)), Sequential(passes=1), Sequential(start="model"), Projective()),
    ],
    ids=[
        *(name for name in METHODS if name not in ("default", "robust")),
        *("clock", "one pass", "sequential from the model", "projective from the model"),
    ],
)
def test_an_image_half_a_turn_off_about_any_axis_is_no_answer(estimator, axis, rng):
    """About the boresight all markers stay in front; the answers of the images then contradict each other."""
    table = one_image_half_a_turn_off(rng, axis)
    assert estimator(table, C_EK_TRUE).status == Status.NOT_CONVERGED
    left = table.select(table.image != 2)
    assert estimator(left, C_EK_TRUE).status == Status.OK


@pytest.mark.parametrize("gls", [Gls(), Gls((LATE,))], ids=["alignment", "clock"])
def test_robust_leaves_the_image_out_and_answers(gls, rng):
    found = Robust(gls)(one_image_half_a_turn_off(rng, "x"), C_EK_TRUE)
    assert found.status == Status.OK
    assert np.abs(so3.log(found.C_EK @ C_EK_TRUE.mT) / found.sigma_E).max() < 4.5


@pytest.mark.parametrize("estimate", [(), ("--estimate", "time_offset=10ms")], ids=["alignment", "clock"])
def test_the_command_does_not_let_such_an_answer_be_used(estimate, tmp_path):
    """The demo with the third image's attitude turned by half about E's x: exit 3 and no kernel."""
    path = demo(tmp_path / "demo")
    with (path.parent / "attitude.csv").open(newline="") as file:
        head, *rows = csv.reader(file)
    for row in rows[2 * 17 : 3 * 17]:  # 17 samples an image
        x, y, z, w = map(float, row[1:5])
        row[1:5] = map(repr, (w, -z, y, -x))  # the quaternion of the half turn times that of the sample
    with (path.parent / "attitude.csv").open("w", newline="") as file:
        csv.writer(file).writerows([head, *rows])
    done = starplumb("calibrate", path, "--method", "gls", *estimate, "--out", tmp_path / "result")
    assert done.status == 3
    shown = [line for line in done.out.splitlines() if "correction" in line or "sigma" in line]
    assert [line.count("not valid") for line in shown[:2]] == [3, 3]
    assert "error / sigma" not in done.out
    assert json.loads((tmp_path / "result" / "result.json").read_text())["status"] == "not_converged"
    assert not (tmp_path / "result" / "mounting.tf").exists()


def test_the_rule_by_hand(rng):
    """Each of its reasons alone, and which of two prevails."""
    o = good(rng)
    behind = so3.exp(np.array([np.pi, 0.0, 0.0])) @ C_EK_TRUE
    lost = np.full((3, 3), np.nan)
    assert status_of(o, C_EK_TRUE, determined=np.array(True)) == Status.OK
    assert status_of(o, C_EK_TRUE, determined=np.array(False)) == Status.SINGULAR
    assert status_of(o, C_EK_TRUE, determined=np.array(True), converged=False) == Status.NOT_CONVERGED
    assert status_of(o, behind, determined=np.array(True)) == Status.NOT_CONVERGED
    assert status_of(o, lost, determined=np.array(True)) == Status.NOT_CONVERGED
    for chi2, status in ((3.0, Status.OK), (np.nan, Status.NOT_CONVERGED), (np.inf, Status.NOT_CONVERGED)):
        assert status_of(o, C_EK_TRUE, determined=np.array(True), chi2=np.array(chi2)) == status
    assert status_of(o, behind, determined=np.array(False), converged=False) == Status.SINGULAR


@pytest.mark.parametrize("unknown", [np.nan, np.inf])
def test_a_covariance_that_is_no_number_excuses_nothing(unknown, rng):
    """Three degrees off is no answer, whatever a covariance leaves open; 30 degrees stated would allow it."""
    o = good(rng)
    off = so3.exp(np.array([0.0, 0.05, 0.0])) @ C_EK_TRUE
    assert not fits(o, off, np.full((3, 3), unknown))
    assert not fits(o, off, np.diag([1e-12, 1e-12, 1e-12]))
    assert fits(o, off, np.diag([0.25, 0.25, 0.25]))


def test_a_marker_that_was_not_seen_may_lie_anywhere(rng):
    """Only sightings in the solution must lie before the camera."""
    o = good(rng)
    e_E = o.e_E.copy()
    e_E[4] *= -1.0
    hidden = replace(o, e_E=e_E, weight=np.where(np.arange(o.n) == 4, 0.0, 1.0))
    assert status_of(hidden, C_EK_TRUE, determined=np.array(True)) == Status.OK
    assert status_of(replace(o, e_E=e_E), C_EK_TRUE, determined=np.array(True)) == Status.NOT_CONVERGED


@pytest.mark.parametrize(
    ("sigma_deg", "known"),
    [((9.9, 0.1, 0.1), True), ((0.1, 10.1, 0.1), False), ((5.7, 5.7, 5.7), True), ((5.9, 5.9, 5.9), False)],
)
def test_known_to_ten_degrees_by_hand(sigma_deg, known):
    """The root sum of squares over the axes counts: 9.87 deg for three of 5.7, 10.2 for three of 5.9."""
    assert determined(np.diag((np.array(sigma_deg) * DEG) ** 2)) == known
    assert not determined(np.full((3, 3), np.inf))
    assert not determined(np.full((3, 3), np.nan))


@pytest.mark.parametrize(
    ("estimator", "start"),
    [(Gls(max_iterations=1), 0.0), (Gls((LATE,), max_iterations=1), 0.0), (Sequential(start="model"), 170.0)],
    ids=["gls", "clock", "sequential"],
)
def test_too_few_iterations_are_said(estimator, start, rng):
    """One step from the closed form cannot know that it is enough; nor two passes from the other side of the sphere."""
    assert estimator(good(rng), so3.exp([start * DEG, 0.0, 0.0]) @ C_EK_TRUE).status == Status.NOT_CONVERGED


@pytest.mark.parametrize("angle", [20.0, 90.0, 179.0])
@pytest.mark.parametrize("name", BEARS)
def test_no_start_is_too_far_from_the_closed_form(name, angle, rng):
    """The same answer as started at the truth."""
    table, axis = good(rng), rng.standard_normal(3)
    far = so3.exp(angle * DEG * axis / np.linalg.norm(axis)) @ C_EK_TRUE
    method = methods()[name]()
    found = method(table, far)
    assert found.status == Status.OK
    apart = so3.log(found.C_EK @ method(table, C_EK_TRUE).C_EK.mT)
    assert np.abs(apart).max() < 1e-4 * ARCSEC


@pytest.mark.parametrize("angle", [0.01, 0.3, 5.0, 20.0, 90.0, 179.0])
@pytest.mark.parametrize("name", BEARS)
def test_an_answer_that_a_far_model_spoils_is_not_used(name, angle, rng):
    """Started at the model it is that of a near start to within its sigma, or refused; and it says what it bears."""
    table, axis = good(rng), rng.standard_normal(3)
    far = so3.exp(angle * DEG * axis / np.linalg.norm(axis)) @ C_EK_TRUE
    method = methods("model")[name]()
    found, near = method(table, far), method(table, C_EK_TRUE)
    assert BEARS[name] in found.notes[-1]
    if Status(int(found.status)).usable:
        sigma_E = Gls()(table, C_EK_TRUE).sigma_E if near.sigma_E is None else near.sigma_E
        assert np.abs(so3.log(found.C_EK @ near.C_EK.mT) / sigma_E).max() < 2.0
    if angle < 0.1:
        assert Status(int(found.status)).usable


def test_a_linear_step_too_long_to_be_one_is_said(rng):
    """One step leaves half the product of two angles: 0.002 rad about the boresight, no sigma; 0.2 and 0.7, many."""
    o = good(rng)
    for turn, status in ((0.002, Status.OK), (0.2, Status.NOT_CONVERGED), (0.7, Status.NOT_CONVERGED)):
        found = ImagePlane()(o, so3.exp(turn * C_EK_TRUE[:, 2]) @ C_EK_TRUE)
        assert found.status == status


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["sequential", "observer", "least-squares"])
def test_what_is_not_a_number_is_not_an_answer(name, wrong, rng):
    """No exception, and no usable status, where a measured coordinate is no number."""
    o = good(rng)
    xy = o.xy_K.copy()
    xy[3, 0] = wrong
    with np.errstate(all="ignore"):
        found = METHODS[name]()(replace(o, xy_K=xy), C_EK_TRUE)
    assert not Status(int(found.status)).usable


def test_convergence_is_judged_by_the_alignment_and_its_parameters(rng):
    """A common error of many sigma is solved for anew in each step: it must not keep the steps from being short."""
    o = good(rng)
    pattern = np.zeros((o.n, 2, 1))
    pattern[:, 0, 0] = 0.5 * rng.standard_normal(o.n)
    xy = o.xy_K + np.einsum("nij,njc->nic", o.slope_K, 6.0 * pattern)[..., 0]
    table = replace(o, xy_K=xy, common_px=pattern)
    for estimator in (Gls(), Gls((LATE,)), Robust(Gls())):
        found = estimator(table, C_EK_TRUE)
        assert found.status == Status.OK
        assert found.iterations <= 4


def test_a_batch_keeps_the_status_of_each_run(rng):
    """The middle run has an image half a turn off; its neighbours are what they are alone."""
    bad = one_image_half_a_turn_off(rng, "x")
    o = good(rng)
    e_E = np.stack([o.e_E, bad.e_E, o.e_E])
    together = Gls((LATE,))(replace(o, e_E=e_E), C_EK_TRUE)
    assert list(together.status) == [Status.OK, Status.NOT_CONVERGED, Status.OK]
    alone = Gls((LATE,))(o, C_EK_TRUE)
    assert np.abs(so3.log(together.C_EK[0] @ alone.C_EK.mT)).max() < 1e-9 * ARCSEC
