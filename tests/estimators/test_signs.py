"""Signs by hand: a scene written down without any of the package's geometry, turned about one axis at a time."""

from __future__ import annotations

import numpy as np
import pytest
from harness import CONVERGED, ONE_STEP

from by_hand import by_hand
from starplumb.estimators import METHODS
from starplumb.physics.units import ARCSEC
from starplumb.table.observations import Observations


def turned(axis: int, angle: float) -> np.ndarray:
    """Matrix of a right-handed turn about x, y or z, written out."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array(
        [
            [[1, 0, 0], [0, c, -s], [0, s, c]],
            [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        ][axis]
    )


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("name", {**METHODS, **CONVERGED})
def test_a_mounting_turned_about_one_axis_is_turned_back(name, axis):
    """The model is the truth turned by +40 arcsec, so the correction is -40 arcsec about that axis and no other."""
    estimator = ({**METHODS, **CONVERGED})[name]()
    estimate = estimator(by_hand(), turned(axis, 40.0 * ARCSEC))
    # the whole of the model's turn undone: the true mounting is the identity
    small = estimate.C_EK - np.eye(3)
    found = np.array([small[2, 1], small[0, 2], small[1, 0]]) / ARCSEC
    # the observer settles the weak angle over its cycles to a few parts in a hundred
    np.testing.assert_allclose(found, 0.0, atol=2.0 if name == "observer" else 0.01)


@pytest.mark.parametrize("axis", range(3))
def test_theta_of_each_source_has_its_own_sign(axis):
    """Camera truly turned from E by +a about the source's axis (x, -y, -z of ours).

    Algorithms 2 and 3 write the turn from E to the camera as E + Phi(theta), algorithm 4 as E - Phi(theta); the paper
    writes the model C* = (E + Phi(theta)) C, so a model at the identity is off by minus the camera's own turn.
    """
    from starplumb.estimators.published.linear_steps import Normal

    a = 20.0 * ARCSEC
    D = np.diag([1.0, -1.0, -1.0])
    o = by_hand()
    # v_camera = (E + Phi(a)) v_E in the source's axes; our C_EK is its inverse in ours
    C_source = turned(axis, a)
    camera = o.e_E @ (D @ C_source @ D).T
    seen = Observations(**{**o.__dict__, "xy_K": camera[:, :2] / camera[:, 2:]})
    theta = {
        name: Normal.of(kind().equations(seen, np.eye(3)), o.weight).solve()[0] / ARCSEC
        for name, kind in ONE_STEP.items()
    }
    unit = 20.0 * np.eye(3)[axis]
    np.testing.assert_allclose(theta["image-plane"], unit, atol=0.01)
    np.testing.assert_allclose(theta["ground-plane"], unit, atol=0.01)
    np.testing.assert_allclose(D @ theta["cross-product"], -unit, atol=0.01)
    # C_EK_true = exp(-a) in the source's axes and C* = E = exp(theta_E) C_EK_true
    np.testing.assert_allclose(D @ theta["least-squares"], unit, atol=0.01)
