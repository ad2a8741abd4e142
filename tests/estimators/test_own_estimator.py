"""What an estimator of a user's own may give, and what becomes of it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import starplumb as sp
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import AlignmentEstimate


class Changed:
    """Least squares with some fields of its estimate replaced."""

    def __init__(self, **fields):
        self.fields = fields

    def __call__(self, observations, C_EK):
        found = Gls()(observations, C_EK)
        plain = AlignmentEstimate(found.C_EK, found.covariance_E, found.status, found.iterations)
        return replace(plain, **{name: change(getattr(plain, name)) for name, change in self.fields.items()})


class Nothing:
    def __call__(self, observations, C_EK):
        return None


@pytest.mark.parametrize(
    ("estimator", "words"),
    [
        (Nothing(), "Nothing gives NoneType, wanted an AlignmentEstimate"),
        (Changed(C_EK=lambda C: C[None]), r"C_EK of shape \(1, 3, 3\) and a covariance of shape \(3, 3\)"),
        (Changed(covariance_E=np.diagonal), r"a covariance of shape \(3,\), wanted \(3, 3\)"),
        (Changed(C_EK=lambda C: 2.0 * C), "a C_EK that is no rotation"),
        (Changed(C_EK=lambda C: -C), "a C_EK that is no rotation"),
        (Changed(covariance_E=lambda P: -P), "without negative eigenvalues"),
        (
            Changed(covariance_E=lambda P: P + [[0, 1, 0], [0, 0, 0], [0, 0, 0]] * P),
            "wanted a symmetric matrix",
        ),
    ],
    ids=["nothing", "batch", "variances", "scaled", "mirrored", "negative", "not symmetric"],
)
def test_what_is_no_answer_is_refused_in_a_sentence(estimator, words):
    with pytest.raises(sp.InputError, match=words):
        sp.calibrate(sp.demo(images=3), method=estimator)


@pytest.mark.parametrize("field", ["C_EK", "covariance_E"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_what_is_no_number_is_not_used(field, wrong, tmp_path):
    found = sp.calibrate(sp.demo(images=3), method=Changed(**{field: lambda x: np.full((3, 3), wrong)}))
    assert found.status == "not_converged"
    assert not found.usable
    found.save(tmp_path, report=False)
    assert not (tmp_path / "mounting.tf").exists()
    assert json.loads((tmp_path / "result.json").read_text())["status"] == "not_converged"


def test_an_answer_with_a_sigma_far_too_small_has_an_interval_that_holds_the_truth():
    """The model mounting for the answer, 1600 arcsec off, with a sigma of 0.002 arcsec."""
    campaign = sp.demo(images=3)

    class Liar:
        def __call__(self, observations, C_EK):
            return AlignmentEstimate(C_EK, 1e-16 * np.eye(3), np.array(0), np.array(1))

    found = sp.calibrate(campaign, method=Liar())
    right = sp.calibrate(campaign)
    apart = np.abs(right.correction_arcsec - found.correction_arcsec)
    assert found.status == "weak"
    assert np.all(found.interval_95_arcsec > apart)


def test_the_answer_of_least_squares_by_another_class_is_judged_alike():
    campaign = sp.demo(images=3)
    found, right = sp.calibrate(campaign, method=Changed()), sp.calibrate(campaign, method="gls")
    assert found.status == right.status
    np.testing.assert_allclose(found.interval_95_arcsec, right.interval_95_arcsec, rtol=1e-6)
