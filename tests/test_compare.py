"""``starplumb compare``: every method beside gls, in numbers and in words."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from helpers import FILES, write_good_campaign
from starplumb.cli.app import app
from starplumb.estimators import METHODS, methods
from starplumb.io.campaign.read import load_campaign
from starplumb.judge.compare import compare
from starplumb.physics.errors import AlignmentFailed, InputError


def run(*arguments):
    result = CliRunner().invoke(app, ["compare", *map(str, arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare") / "demo"
    assert CliRunner().invoke(app, ["init", str(folder), "--quiet"]).exit_code == 0
    return folder / "campaign.toml"


@pytest.mark.slow
def test_every_method_stands_beside_gls(demo):
    campaign = load_campaign(demo).campaign
    answers = {a.method: a for a in compare(campaign)}
    assert set(answers) == set(METHODS)
    np.testing.assert_array_equal(answers["gls"].from_gls, 0.0)
    assert np.abs(answers["sequential"].from_gls).max() < 1e-6
    for a in answers.values():
        assert a.status.usable
        assert a.remarks
        assert a.seconds > 0.0
    # by hand from the numbers shown: (d - d_gls) / sigma_gls but for the curvature of the rotations
    linear, gls = answers["least-squares"], answers["gls"]
    by_hand = (linear.correction_E - gls.correction_E) / gls.sigma_E
    np.testing.assert_allclose(linear.from_gls, by_hand, atol=0.05)


@pytest.mark.slow
def test_the_remarks_carry_the_campaigns_own_figures(demo):
    campaign = load_campaign(demo).campaign
    answers = {a.method: a for a in compare(campaign, methods("model"))}
    # 1/2 theta_z (z x theta), theta the correction by gls taken back, z the boresight in E, here along z within 0.9 deg
    x, y, z = -answers["gls"].correction_E * 206264.806
    bias = 0.5 * abs(z) * np.hypot(x, y) / 206264.806
    words = " ".join(answers["image-plane"].remarks)
    said = float(words.split("biased by up to ")[1].split(" ")[0])
    assert said == pytest.approx(bias, rel=0.06)
    ratio = np.max(answers["projective"].sigma_E / answers["gls"].sigma_E)
    assert f"{ratio:.3g} times that of gls" in " ".join(answers["projective"].remarks)
    assert "uses no orbit" in " ".join(answers["projective"].remarks)
    assert "states no sigma" in " ".join(answers["wahba"].remarks)


@pytest.mark.slow
def test_check_points_stay_out(demo):
    """The answer is that of calibrate, which keeps them out too."""
    result = CliRunner().invoke(app, ["calibrate", str(demo), "--json", "--out", str(demo.parent / "result")])
    gls = next(a for a in compare(load_campaign(demo).campaign) if a.method == "gls")
    np.testing.assert_allclose(
        gls.correction_E * 206264.806247, json.loads(result.stdout)["correction_arcsec"], rtol=1e-9
    )


@pytest.mark.slow
def test_json_on_standard_output_is_the_file(demo, tmp_path):
    result = run(demo, "--json", "--out", tmp_path / "results")
    document = json.loads(result.stdout)
    assert document == json.loads((tmp_path / "results" / "compare.json").read_text())
    assert document["schema"] == "starplumb-compare/1"
    assert [m["method"] for m in document["methods"]] == list(METHODS)
    gls = document["methods"][0]
    assert gls["difference_from_gls_sigma"] == [0.0, 0.0, 0.0]
    # the demo knows its truth: errors are of the size of the stated sigma
    assert np.all(np.abs(gls["error_arcsec"]) < 4.0 * np.array(gls["sigma_arcsec"]))


@pytest.mark.slow
def test_a_table_for_people(demo):
    text = run(demo).stdout
    for name in METHODS:
        assert name in text
        assert f"\n{name}: " in text  # its remarks
    assert "sigmas off gls" in text


def test_a_method_that_cannot_be_used_says_why_beside_those_that_can(tmp_path):
    """Two and three markers an image: no projective map, everything else as ever."""
    path = write_good_campaign(tmp_path)
    answers = {a.method: a for a in compare(load_campaign(path).campaign)}
    assert answers["projective"].status.name == "SINGULAR"
    assert "four markers" in answers["projective"].remarks[0]
    assert answers["gls"].status.usable
    document = json.loads(run(path, "--json").stdout)
    entry = next(m for m in document["methods"] if m["method"] == "projective")
    assert entry["correction_arcsec"] is None
    assert entry["status"] == "singular"


def test_nothing_usable_is_said_and_ends_in_failure(tmp_path):
    head, *rows = FILES["observations.csv"].splitlines()
    path = write_good_campaign(tmp_path, observations="\n".join([head, rows[0]]) + "\n")
    with pytest.raises(AlignmentFailed, match="do not determine the alignment"):
        run(path, "--out", tmp_path / "out")
    methods = json.loads((tmp_path / "out" / "compare.json").read_text())["methods"]
    assert all(m["correction_arcsec"] is None for m in methods)


def test_only_check_points_is_the_users_mistake(tmp_path):
    head, *rows = FILES["observations.csv"].splitlines()
    text = "\n".join([head + ",role", *(row + ",check" for row in rows)]) + "\n"
    with pytest.raises(InputError, match="role control"):
        run(write_good_campaign(tmp_path, observations=text))


def test_the_prior_is_missed_where_a_method_has_no_use_for_it(tmp_path):
    stated = FILES["campaign.toml"].replace(
        "quaternion_xyzw = [0.0, 0.0, 0.0, 1.0]",
        "quaternion_xyzw = [0.0, 0.0, 0.0, 1.0]\nsigma_arcsec = [60.0, 60.0, 60.0]",
    )
    answers = {
        a.method: a for a in compare(load_campaign(write_good_campaign(tmp_path, campaign=stated)).campaign)
    }
    said = "does not use the prior knowledge of the mounting"
    assert said in answers["cross-product"].remarks
    assert said not in answers["gls"].remarks + answers["sequential"].remarks
