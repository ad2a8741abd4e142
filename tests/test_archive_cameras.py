"""Campaigns of several cameras add up: their sum is one campaign of all images, of each camera and of each against
another."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

import starplumb as sp
from command import starplumb
from rigs import AFT, FORE, rig_truth
from starplumb.io.campaign.write import write_campaign
from starplumb.mission.cameras import about_camera
from starplumb.mission.joint import Equations, Known, joint
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC
from starplumb.session.mission.kernel import frame_of, kernel_of
from starplumb.table.campaign import some_of
from test_cameras import delivered

MOMENTS = 6


def written(folder, given, name, chosen, cameras=(0, 1, 2)):
    """The result of a campaign of some moments by some cameras; of a single camera under its name."""
    rig, s, images = given.rig, given.sightings, given.images
    kept = np.flatnonzero(
        np.isin(rig.of_image, cameras) & np.isin(np.arange(len(images.ids)) % MOMENTS, chosen)
    )
    seen = some_of(s, np.isin(s.image, kept))
    few = replace(
        images,
        ids=tuple(images.ids[i] for i in kept),
        t_ns=images.t_ns[kept],
        camera=tuple(images.camera[i] for i in kept),
    )
    part = replace(
        given, name=name, images=few, sightings=replace(seen, image=np.searchsorted(kept, seen.image))
    )
    if len(cameras) == 1:
        k = cameras[0]
        alone = replace(
            rig,
            names=(rig.names[k],),
            cameras=(rig.cameras[k],),
            C_KC=np.eye(3)[None],
            of_image=np.zeros(kept.size, dtype=np.int64),
        )
        part = replace(part, C_EK=given.C_EK @ rig.C_KC[k], camera=rig.cameras[k], rig=alone)
    else:
        part = replace(part, rig=replace(rig, of_image=rig.of_image[kept]))
    path = write_campaign(folder / name, part)
    sp.calibrate(sp.read_campaign(path), method="gls").save(folder / name / "result", report=False)
    return folder / name / "result"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    given = delivered(rig_truth((FORE, AFT), images=MOMENTS, markers=6), np.random.default_rng(1616))
    later = given.rig.of_image[given.sightings.image] == 1
    late = given.sightings.image % MOMENTS >= 3
    mixed = replace(given, sightings=some_of(given.sightings, ~late | later))
    written(folder, given, "all", range(MOMENTS))
    written(folder, given, "one", [0, 1])
    written(folder, given, "two", [2, 3, 4, 5])
    written(folder, mixed, "mixed", range(MOMENTS))
    written(folder, given, "before", [0, 1, 2])
    written(folder, given, "B only", [3, 4, 5], (1,))
    written(folder, given, "A only", [3, 4, 5], (0,))
    return folder


def archive_of(tmp_path, made, *names):
    found = sp.open_archive(tmp_path / "mission.db", create=True)
    found.add([made / name / "result" for name in names])
    return found


def same(found, wanted, part=1e-3):
    """One mounting as another: turned by less than a part of its sigmas, which are the same to that part."""
    sigma = np.array(wanted["sigma_arcsec"])
    away = so3.log(np.array(found["matrix"]) @ np.array(wanted["matrix"]).T) / ARCSEC
    np.testing.assert_array_less(np.abs(away), part * sigma)
    np.testing.assert_allclose(found["sigma_arcsec"], sigma, rtol=part)


def drawn(rng, C_EK, mounted):
    """Equations of a campaign over a first camera's mounting, ``mounted`` ones' and a landmark."""
    zero = np.zeros(3)
    blocks = {"mounting": Known(zero, zero, None)}
    for name, C in mounted.items():
        v = so3.log(C) / ARCSEC
        blocks[f"mounting[{name}]"] = Known(v, v, 1e10 * np.eye(3))
    blocks["landmark[m]"] = Known(zero, zero, np.eye(3))
    n = 3 * len(blocks)
    A = rng.normal(size=(4 * n, n))
    return Equations(C_EK, blocks, A.T @ A, rng.normal(size=n), 10.0 * n, 4 * n)


def test_the_joint_solution_is_the_same_from_every_camera(rng):
    """Rigs with another first camera, their mountings some arc seconds apart, and one camera alone."""
    C = {name: so3.exp(rng.normal(0.0, 1.0, 3)) for name in "AB"}

    def near(name):
        return so3.exp(rng.normal(0.0, 3.0, 3) * ARCSEC) @ C[name]

    parts = [
        ("A", drawn(rng, near("A"), {"B": near("B")})),
        ("B", drawn(rng, near("B"), {"A": near("A")})),
        ("B", drawn(rng, near("B"), {})),
    ]
    found = {name: joint([about_camera(part, first, name, 1.0) for first, part in parts]) for name in "AB"}
    a, b = found["A"], found["B"]
    assert (a.cameras, b.cameras) == (("B",), ("A",))
    for one, other in ((a.C_EK, b.C_EC[0]), (a.C_EC[0], b.C_EK)):
        np.testing.assert_allclose(so3.log(one @ other.T) / ARCSEC, 0.0, atol=1e-8)
    turned = np.r_[3:6, 0:3]
    np.testing.assert_allclose(
        a.covariance_all_E, b.covariance_all_E[np.ix_(turned, turned)], rtol=1e-6, atol=1e-16
    )
    assert (a.degrees, a.count) == (b.degrees, b.count) == (90, 96)  # 9 unknowns, 3 of them surveyed
    assert a.chi2 == pytest.approx(b.chi2)


@pytest.mark.slow
def test_the_sum_of_rigs_is_one_campaign_of_all_images(tmp_path, made):
    one = json.loads((made / "all" / "result" / "result.json").read_text())
    found = archive_of(tmp_path, made, "one", "two").show().document
    assert [m["camera"] for m in found["mountings"]] == ["A", "B", "C"]
    for mine, wanted in zip(found["mountings"], one["mountings"], strict=True):
        same(mine, wanted)
        if wanted["against_first"] is not None:  # ten times surer
            E = np.array(one["mounting"]["matrix"])
            a, b = (np.array(m["against_first"]["matrix"]) for m in (mine, wanted))
            away = E @ so3.log(a @ b.T) / ARCSEC
            assert np.all(np.abs(away) < 1e-3 * np.array(wanted["against_first"]["sigma_arcsec"]))
            np.testing.assert_allclose(
                mine["against_first"]["sigma_arcsec"], wanted["against_first"]["sigma_arcsec"], rtol=1e-3
            )
    np.testing.assert_allclose(
        found["mountings_covariance_arcsec2"], one["mountings_covariance_arcsec2"], rtol=2e-3, atol=2e-3
    )
    assert found["fit"]["chi2"] == pytest.approx(one["fit"]["chi2"], rel=1e-3)
    assert found["fit"]["degrees_of_freedom"] == one["fit"]["degrees_of_freedom"]


@pytest.mark.slow
def test_campaigns_of_one_camera_add_to_those_of_all(tmp_path, made):
    """Images of three moments by all, and of three by the second alone, under its own name."""
    archive = archive_of(tmp_path, made, "before", "B only")
    one = json.loads((made / "mixed" / "result" / "result.json").read_text())
    for camera, wanted in zip("ABC", one["mountings"], strict=True):
        found = archive.show(camera=camera).document
        same(found, wanted)
        assert found["from"] == camera
        listed = {m["camera"]: m for m in found["mountings"]}
        assert listed.keys() == set("ABC")
        same(listed["B"], one["mountings"][1])
    assert archive.show().document["from"] == "A"  # the first of the campaign that has both
    archive.withdraw("before", "a test")
    with pytest.raises(InputError, match="found several mountings"):
        archive.show()


def test_issued_frames_are_those_of_a_calibration_of_all():
    """1400001, then from 1400003 on: 1400002 is the tracker. A camera that is alone is CAMERA."""
    rigs = [("B",), ("A", "B"), ("A", "C")]
    assert [frame_of(camera, rigs) for camera in "ABC"] == [("A", 1400001), ("B", 1400003), ("C", 1400004)]
    assert frame_of("pan", [("pan",)] * 3) == ("camera", 1400001)


@pytest.mark.slow
def test_what_is_known_of_a_further_camera_is_issued_and_foretold(tmp_path, made):
    archive = archive_of(tmp_path, made, "one", "two")
    shown = archive.show(camera="C").document
    trend = archive.trend(camera="C").document
    assert (trend["from"], len(trend["points"])) == ("C", 2)
    issued = archive.issue("first light", camera="C")
    for text in (kernel_of(issued), (made / "one" / "result" / "mounting.tf").read_text()):
        assert "FRAME_C = 1400004" in text
    done = starplumb("predict", archive.path, "--at", issued["from"], "--camera", "C", "--json")
    assert done.status == 0, done.err
    foretold = json.loads(done.out)
    assert foretold["from"] == "C"
    away = so3.log(np.array(foretold["matrix"]) @ np.array(shown["matrix"]).T) / ARCSEC
    assert np.all(np.abs(away) < 2.0 * np.array(shown["sigma_arcsec"]))


@pytest.mark.slow
def test_sightings_of_a_camera_in_a_rig_count_once(tmp_path, made):
    """Its images are not the first of their moments, and its campaign is another instrument's."""
    archive = archive_of(tmp_path, made, "two")
    with pytest.raises(InputError, match="would count twice"):
        archive.add(made / "B only" / "result")
    other = sp.open_archive(tmp_path / "other.db", create=True)
    other.add(made / "B only" / "result")
    with pytest.raises(InputError, match="would count twice"):
        other.merge(archive.path)


@pytest.mark.slow
def test_a_camera_that_no_campaign_has_is_refused(tmp_path, made):
    archive = archive_of(tmp_path, made, "one")
    done = starplumb("archive", "show", archive.path, "--camera", "D")
    assert done.status == 2
    assert "A to star_tracker; B to star_tracker; C to star_tracker" in done.err


@pytest.mark.slow
def test_equations_about_the_cameras_survive_their_file(tmp_path, made):
    """A moment names the images that share its errors, and only the cameras that took them."""
    shutil.copytree(made / "mixed", tmp_path / "mixed")
    document = json.loads((tmp_path / "mixed" / "result" / "normals.json").read_text())
    early, late = document["images"][0], document["images"][-1]
    assert set(early["also"]) == {"B-image01", "C-image01"}
    assert {"mounting", "mounting[B]", "mounting[C]"} < set(early["unknowns"])
    assert late["also"] == {}
    assert [name for name in late["unknowns"] if name.startswith("mounting")] == ["mounting[B]"]


@pytest.mark.slow
def test_one_moment_in_two_campaigns_is_said_to_count_twice(tmp_path, made):
    """The first camera's images of three moments in one campaign, the second's of the same moments in another."""
    archive = archive_of(tmp_path, made, "before", "B only")
    assert archive.show(camera="A").document["status"] == "ok"
    archive.add(made / "A only" / "result")
    found = archive.show(camera="A").document
    assert found["status"] == "weak"
    assert "3 moments at which images were taken occur in several campaigns" in found["message"]


@pytest.mark.slow
def test_a_prior_of_several_cameras_is_their_sum(made):
    """One campaign after the other: the whole covariance of all mountings passes on, to a thousandth of a sigma."""
    one = json.loads((made / "all" / "result" / "result.json").read_text())
    first, campaign = (sp.read_campaign(made / name / "campaign.toml") for name in ("one", "two"))
    for prior in (made / "one" / "result" / "result.json", sp.calibrate(first, method="gls")):
        found = sp.calibrate(campaign, method="gls", prior=prior)
        assert found.status == "ok", found.message
        for mine, wanted in zip(found.document["mountings"], one["mountings"], strict=True):
            same(mine, wanted, 2e-3)
        np.testing.assert_allclose(
            found.document["mountings_covariance_arcsec2"],
            one["mountings_covariance_arcsec2"],
            rtol=4e-3,
            atol=5e-3,
        )
        assert found.document["fit"]["degrees_of_freedom"] == 2 * found.document["fit"]["observations"]


@pytest.mark.slow
def test_equations_with_a_prior_of_several_cameras_have_all_of_it(tmp_path, made):
    """Alone in an archive the second campaign says what it said with the first one's mountings as its prior; beside the
    first, these are left out."""
    before = made / "one" / "result" / "result.json"
    found = sp.calibrate(sp.read_campaign(made / "two" / "campaign.toml"), method="gls", prior=before)
    found.save(tmp_path / "after", report=False)
    alone = archive_of(tmp_path, made)
    alone.add(tmp_path / "after")
    assert alone.verify()["faults"] == []
    for camera in "AC":
        shown = alone.show(camera=camera).document
        listed = {m["camera"]: m for m in shown["mountings"]}
        for wanted in found.document["mountings"]:
            same(listed[wanted["camera"]], wanted)
        wanted = found.document["mountings"][2]["against_first"]["sigma_arcsec"]
        if camera == "A":
            np.testing.assert_allclose(listed["C"]["against_first"]["sigma_arcsec"], wanted, rtol=1e-3)
        assert shown["fit"]["degrees_of_freedom"] == found.document["fit"]["degrees_of_freedom"]
    alone.add(made / "one" / "result")
    both, one = alone.show().document, json.loads((made / "all" / "result" / "result.json").read_text())
    assert "what campaigns state of the mounting beforehand is left out" in both["message"]
    for mine, wanted in zip(both["mountings"], one["mountings"], strict=True):
        same(mine, wanted, 2e-3)


@pytest.mark.slow
def test_a_prior_of_another_mounting_against_the_first_is_contradicted(tmp_path, made):
    """The third camera turned by a minute since, the first one not."""
    shutil.copytree(made / "one", tmp_path / "one")
    path = tmp_path / "one" / "result" / "result.json"
    document = json.loads(path.read_text())
    turned = so3.exp(np.array([60.0, 0.0, 0.0]) * ARCSEC) @ np.array(document["mountings"][2]["matrix"])
    document["mountings"][2] |= {
        "matrix": turned.tolist(),
        "quaternion_xyzw": so3.to_quaternion(turned).tolist(),
    }
    path.write_text(json.dumps(document))
    found = sp.calibrate(sp.read_campaign(made / "two" / "campaign.toml"), method="gls", prior=path)
    assert found.status in ("weak", "refuted")
    assert f"the data contradict the prior {path}" in found.message


@pytest.mark.slow
def test_one_camera_takes_its_part_of_a_prior_of_several(made):
    only = made / "B only" / "campaign.toml"
    prior = made / "one" / "result" / "result.json"
    alone, found = (sp.calibrate(sp.read_campaign(only), method="gls", prior=p) for p in (None, prior))
    before = json.loads(prior.read_text())["mountings"][1]
    N = [np.linalg.inv(one) for one in (alone.covariance_arcsec2, before["covariance_arcsec2"])]
    np.testing.assert_allclose(found.covariance_arcsec2, np.linalg.inv(N[0] + N[1]), rtol=5e-3, atol=1e-3)
