"""Normal equations of cameras that see one landmark in one moment: they say what the adjustment says."""

from __future__ import annotations

import numpy as np
import pytest

from rigs import BAND, rig_truth, with_tie_points
from starplumb.documents.normals import NormalsDocument, joined, normals_document
from starplumb.judge.calibrate import calibrate
from starplumb.mission.joint import Equations, Known, summed
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC
from test_ties import JOINTLY, delivered


@pytest.mark.parametrize("ties", [0, 8])
def test_equations_of_bands_that_see_one_landmark_are_those_of_the_adjustment(rng, ties):
    campaign = with_tie_points(rig_truth((BAND,), images=4, markers=5), ties, rng)
    found = calibrate(delivered(campaign, rng), JOINTLY)
    document = NormalsDocument.from_json(
        NormalsDocument.of(normals_document(found)).to_json(), "normals.json"
    )
    for image in document.images:
        assert len(set(image.unknowns)) == len(image.unknowns)
    one = joined([document])
    np.testing.assert_allclose(
        np.sqrt(np.diagonal(one.covariance_E)) / ARCSEC,
        np.sqrt(np.diagonal(found.estimate.covariance_E)) / ARCSEC,
        rtol=1e-3,
    )
    assert one.chi2 == pytest.approx(float(found.estimate.chi2), rel=1e-3)
    assert one.degrees == int(found.estimate.degrees_of_freedom)


def test_a_block_that_stands_twice_in_an_image_is_added_twice():
    """As in files that name a landmark once for each camera of the moment."""
    blocks = {"mounting": Known(np.zeros(3), np.zeros(3), None), "a": Known(np.zeros(1), np.zeros(1), None)}
    J = np.array([[1.0, 0.0, 0.0, 2.0, 5.0], [0.0, 1.0, 0.0, 7.0, 3.0]])
    r = np.array([0.5, -1.5])
    both = np.column_stack([J[:, :3], J[:, 3] + J[:, 4]])
    whole = summed(np.eye(3), blocks, [(("mounting", "a", "a"), J.T @ J, J.T @ r, float(r @ r), 2)])
    np.testing.assert_allclose(whole.information, both.T @ both)
    np.testing.assert_allclose(whole.vector, both.T @ r)


def test_turns_of_cameras_do_not_commute(rng):
    """Mountings 40 arcsec off, turned a little further: what equations about others have as unknowns, the turn of the
    first and how far the second is turned against it, to the second order of the turns."""
    C = [so3.exp(v) for v in rng.normal(0.0, 1.0, (2, 3))]
    off, x = rng.normal(0.0, 40.0, (2, 3)), rng.normal(0.0, 0.1, (2, 3))
    there = [so3.exp(ARCSEC * v) @ C_c for v, C_c in zip(off, C, strict=True)]  # what the equations are about
    zero = np.zeros(3)
    known = {
        "mounting": Known(zero, zero, None),
        "mounting[B]": Known(so3.log(there[1]) / ARCSEC, zero, None),
    }
    A, z = rng.normal(size=(9, 6)), rng.normal(size=9)
    part = Equations(there[0], known, A.T @ A, A.T @ z, float(z @ z), 9)
    moved = part.about(C[0], {"mounting[B]": so3.log(C[1]) / ARCSEC}, off[0], exactly=True)

    def square(x):
        """Of the residuals z + A (u, u + w)."""
        now = [so3.exp(ARCSEC * v) @ C_c for v, C_c in zip(x, C, strict=True)]
        u = so3.log(now[0] @ there[0].T)
        w = so3.log(so3.exp(-u) @ now[1] @ there[1].T)
        r = z + A @ np.concatenate([u, u + w]) / ARCSEC
        return float(r @ r)

    flat = x.reshape(-1)
    gained = 2.0 * float(moved.vector @ flat) + float(flat @ moved.information @ flat)
    wanted = square(x) - square(0.0 * x)
    plain = part.about(C[0], {"mounting[B]": so3.log(C[1]) / ARCSEC}, off[0])
    off_by = 2.0 * float(plain.vector @ flat) + float(flat @ plain.information @ flat) - wanted
    assert gained == pytest.approx(wanted, abs=1e-3 * abs(off_by))
    assert abs(off_by) > 1e-6 * abs(wanted)
