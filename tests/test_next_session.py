"""The mounting at a further session: against textbook intervals and a truncated inverse gamma."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from problems import C_EK_TRUE, FRAME, truth
from starplumb.documents.from_calibration import result_document
from starplumb.documents.prediction import predicted
from starplumb.documents.result import ResultDocument
from starplumb.estimators.gls import Gls
from starplumb.judge.calibrate import calibrate
from starplumb.judge.scatter.from_data import FromData, from_data
from starplumb.judge.scatter.next_session import NextSession, factors, half_95
from starplumb.judge.scatter.rotations import ImageRotations
from starplumb.judge.scatter.sources import findings_of_sources
from starplumb.judge.scatter.variances import Component
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from starplumb.plan import scene
from starplumb.report.calibration.tables import alignment
from starplumb.table.campaign import SharedErrors
from starplumb.table.geometry import observe
from starplumb.table.simulate import Errors

SIGMA = np.array([1.0, 1.0, 2.0])


def rotations(d, own):
    """Images that differ by what their passes share, and by ``own`` of the attitude's sigma besides."""
    m = len(d)
    nothing, none = np.zeros((m, 3, 3)), np.zeros((m, 3, 0))
    attitude = np.tile(np.diag(np.square(own * SIGMA)), (m, 1, 1))
    exact = nothing + 1e-12 * np.eye(3)
    return ImageRotations(np.arange(m), d, exact, attitude, nothing, none, none, 0.0 * d, (), 100.0, 100, 0.1)


def test_a_variance_alone_gives_student_s_t():
    degrees = np.array([3.0, 7.0, 30.0])
    expected = 2.0 * stats.t.ppf(0.975, degrees)
    np.testing.assert_allclose(half_95(np.full(3, 4.0), degrees, []), expected, rtol=2e-3)


@pytest.mark.parametrize("squares", [0.3, 5.0])
def test_factors_have_an_inverse_gamma_cut_off_at_none(rng, squares):
    """Sessions of one image with own variance 1 about one mean: with Jeffreys' prior 1 + f is an inverse gamma."""
    J = 5
    d = rng.normal(size=(J, 3))
    d = d - d.mean(axis=0)
    d *= np.sqrt(squares * 3 * (J - 1) / np.sum(d**2))
    Z = np.zeros((J, 3, J, 3))
    Z[np.arange(J), :, np.arange(J)] = np.eye(3)
    own = Component("own", np.tile(np.eye(3), (J, 1, 1)), np.zeros((J, 3, 0)))
    level = Component("pass", np.zeros((J, 3, 3)), Z.reshape(J, 3, -1), 0.0, drawn_anew=True)
    found = factors(d, (own, level), np.array([1.0, 0.7]), 1)
    gamma = stats.invgamma(1.5 * (J - 1), scale=0.5 * np.sum(d**2))
    p = np.array([0.1, 0.5, 0.9])
    expected = gamma.ppf(gamma.cdf(1.0) + p * gamma.sf(1.0)) - 1.0
    np.testing.assert_allclose(np.quantile(found, p), expected, rtol=0.03)


@pytest.mark.parametrize(("J", "together"), [(5, [[0, 1, 2]]), (6, [[0, 1], [2]])])
def test_of_exact_images_it_is_the_textbook_s_prediction_interval(rng, J, together):
    """Mean of J passes and a further one: Student's t times the root of (1 + 1 / J) times their variance, of all axes
    together or, from six passes on, of the weak one by itself."""
    group = np.repeat(np.arange(J), 3)
    passes = rng.normal(size=(J, 3)) * SIGMA
    d = passes[group] + 1e-3 * rng.normal(size=(3 * J, 3)) * SIGMA
    found = from_data(rotations(d, 1e-3), np.eye(3), 1e-3 * SIGMA / np.sqrt(3 * J), {"pass": group})
    further = found.next_session
    assert (further.of, further.groups) == ("pass", J)
    squares = np.sum(((passes - passes.mean(axis=0)) / SIGMA) ** 2, axis=0)
    for axes in together:
        degrees = len(axes) * (J - 1)
        variance = (1.0 + 1.0 / J) * np.sum(squares[axes]) / degrees
        expected = stats.t.ppf(0.975, degrees) * np.sqrt(variance) * SIGMA[axes]
        np.testing.assert_allclose(further.half_95_E[axes], expected, rtol=0.03)


def test_a_session_error_that_is_not_found_is_not_taken_for_none(rng):
    """Two passes whose means agree: the next one may differ by more than the mounting's interval."""
    d = rng.normal(size=(8, 3)) * SIGMA
    d[4:] += d[:4].mean(axis=0) - d[4:].mean(axis=0)
    found = from_data(rotations(d, 1.0), np.eye(3), SIGMA / np.sqrt(8), {"pass": np.repeat([0, 1], 4)})
    (own,) = (source for source in found.sources if source.kind == "pass")
    assert own.found == 0.0
    assert np.all(found.next_session.half_95_E > 1.5 * found.half_95_E)


@pytest.mark.parametrize(("groups", "said"), [(4, True), (5, False)])
def test_few_passes_are_said_to_tell_little_of_the_next(groups, said):
    found = FromData(20, None, None, (), next_session=NextSession("pass", groups, SIGMA))
    told = [finding.sentence for finding in findings_of_sources(found, 20)]
    assert any("what a further pass adds is hardly told by 4" in sentence for sentence in told) is said


@pytest.mark.parametrize("passes", [None, tuple("aaaabbbb")])
def test_result_and_report_have_it_where_there_are_passes(rng, passes):
    campaign = truth(FRAME, 8, 6)
    measured = scene.measured(campaign, Errors.draw(observe(campaign), rng), so3.exp(np.zeros(3)) @ C_EK_TRUE)
    own = SharedErrors("image")
    measured = replace(measured, attitude_errors=own, position_errors=own)
    done = calibrate(replace(measured, images=replace(measured.images, passes=passes)), Gls())
    document = result_document(done, "gls", ("camera", "st"), {}, {})
    rows = [row[0] for row in alignment(done, document)[0].rows]
    assert (
        "95 % interval at the next pass, ±" in rows or "95 % interval at the next session, ±" in rows
    ) is (passes is not None)
    if passes is None:
        assert document["next_session"] is None
        return
    half = np.array(document["next_session"]["interval_95_arcsec"])
    assert document["next_session"]["groups"] == 2
    assert np.all(half >= done.interval_95_E / ARCSEC * (1.0 - 1e-9))


def test_a_prediction_outside_the_span_holds_what_a_further_session_adds(rng):
    """Just after the last image nothing else has grown: the variance is that of the interval of the next session."""
    campaign = truth(FRAME, 8, 6)
    measured = scene.measured(campaign, Errors.draw(observe(campaign), rng), C_EK_TRUE)
    own, images = SharedErrors("image"), replace(measured.images, passes=tuple("aaaabbbb"))
    done = calibrate(replace(measured, attitude_errors=own, position_errors=own, images=images), Gls())
    document = ResultDocument.of(result_document(done, "gls", ("camera", "st"), {}, {}))
    last = int(images.t_ns[-1])
    inside, outside = predicted(document, last), predicted(document, last + 10_000)
    np.testing.assert_allclose(inside.covariance_E, done.covariance_E, rtol=1e-6)
    half = ARCSEC * np.array(document.next_session.interval_95_arcsec)
    np.testing.assert_allclose(1.96 * np.sqrt(np.diagonal(outside.covariance_E)), half, rtol=1e-6)
