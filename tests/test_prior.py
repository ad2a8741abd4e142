"""The result of one campaign as what another one knows: the whole covariance, not three sigmas."""

from __future__ import annotations

import json

import numpy as np
import pytest

import starplumb as sp
from command import demo as written_demo
from command import starplumb
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC


def test_two_campaigns_one_after_the_other_are_their_information_summed(tmp_path):
    """Two demos of one mounting: the informations add up, and so do the pulls."""
    first = sp.calibrate(sp.demo(images=8, seed=1), method="gls")
    alone = sp.calibrate(sp.demo(images=8, seed=2), method="gls")
    first.save(tmp_path, report=False)
    for prior in (first, tmp_path / "result.json"):
        found = sp.calibrate(sp.demo(images=8, seed=2), method="gls", prior=prior)
        N = [np.linalg.inv(one.covariance_arcsec2) for one in (first, alone)]
        covariance = np.linalg.inv(N[0] + N[1])
        np.testing.assert_allclose(found.covariance_arcsec2, covariance, rtol=2e-3, atol=1e-3)
        apart = so3.log(alone.C_EK @ first.C_EK.T) / ARCSEC
        np.testing.assert_allclose(found.correction_arcsec, covariance @ N[1] @ apart, atol=0.02)


def test_the_command_takes_a_prior_and_records_it(tmp_path):
    first, second = (written_demo(tmp_path / name, "--images", 3, "--seed", k) for k, name in enumerate("ab"))
    assert starplumb("calibrate", first, "--no-report").status == 0
    prior = first.parent / "result" / "result.json"
    done = starplumb("calibrate", second, "--no-report", "--prior", prior)
    assert done.status == 0
    document = json.loads((second.parent / "result" / "result.json").read_text())
    assert str(prior) in document["inputs"]
    before = json.loads(prior.read_text())
    assert all(a < b for a, b in zip(document["sigma_arcsec"], before["sigma_arcsec"], strict=True))


def test_a_prior_beside_a_stated_sigma_is_refused(tmp_path):
    path = written_demo(tmp_path / "a", "--images", 3)
    first = sp.calibrate(sp.read_campaign(path))
    path.write_text(path.read_text().replace("[mounting]\n", "[mounting]\nsigma_arcsec = 100.0\n"))
    with pytest.raises(InputError, match=r"mounting\.sigma_arcsec: found beside the prior"):
        sp.calibrate(sp.read_campaign(path), prior=first)
