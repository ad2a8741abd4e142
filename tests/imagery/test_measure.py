"""``starplumb measure`` on files: what it writes, whether the answer holds, and what it says of bad input."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
from on_disk import write_world
from PIL import Image

import starplumb as sp
from command import starplumb
from starplumb.documents.imagery.measure import MeasureDocument
from starplumb.imagery.verdicts import Candidate, Verdict
from starplumb.io.campaign.read import load_images
from starplumb.io.imagery.config import ImageryConfig
from starplumb.io.imagery.scene import raw_paths
from starplumb.physics import so3
from starplumb.physics.units import ARCSEC


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("world")
    write_world(place, np.random.default_rng(11))
    return place


@pytest.fixture
def copy(folder, tmp_path):
    """A copy of the world that may be spoilt."""
    place = tmp_path / "world"
    shutil.copytree(folder, place)
    return place


def changed(folder, old, new):
    path = folder / "campaign.toml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@pytest.mark.parametrize("name", ["../../x", "/etc/x", "a/../../x"])
def test_an_image_id_leads_out_of_no_folder(folder, name):
    campaign = load_images(folder / "campaign.toml").campaign
    named = replace(campaign, images=replace(campaign.images, ids=(name,)))
    imagery = ImageryConfig(files="raw/{image_id}.png")
    with pytest.raises(sp.InputError, match="wanted ids that lead out of no folder"):
        raw_paths(named, folder, imagery)


@pytest.mark.slow
def test_a_line_scanners_image_is_measured_from_its_files(tmp_path, rng):
    write_world(tmp_path, rng, "line-scan")
    measured = sp.measure(tmp_path / "campaign.toml")
    assert measured.usable
    assert len(measured.images[0].used) >= 12
    np.testing.assert_allclose(np.abs(measured.document["images"][0]["offset_px"]), (20.0, 15.0), atol=4.0)


@pytest.mark.slow
def test_a_campaign_of_images_is_calibrated_and_its_sigma_holds(tmp_path, rng):
    _, rotations = write_world(tmp_path, rng)
    done = starplumb("measure", tmp_path / "campaign.toml", "--calibrate", "--out", tmp_path / "out")
    assert done.status == 0, done.err
    document = json.loads((tmp_path / "out" / "measure.json").read_text())
    MeasureDocument.of(document)
    assert document["status"] == "ok"
    assert {c["verdict"] for c in document["candidates"]} <= {"used", "changed", "no match", "outlier"}
    assert document["images"][0]["used"] >= 12
    # the image was taken about 20 columns and -15 rows from where the model has it
    np.testing.assert_allclose(np.abs(document["images"][0]["offset_px"]), (20.0, 15.0), atol=4.0)
    roles = [c["role"] for c in document["candidates"]]
    assert 2 <= roles.count("check") <= 4
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    C_EK = np.array(result["mounting"]["matrix"])
    off = so3.log(C_EK @ rotations[0].T) / ARCSEC
    covariance = np.array(result["covariance_arcsec2"])
    assert off @ np.linalg.solve(covariance, off) < 11.3
    assert (tmp_path / "out" / "mounting.tf").exists()
    page = (tmp_path / "out" / "measure.html").read_text(encoding="utf-8")
    assert page.count('<article class="card') == len(document["candidates"])  # each piece is shown
    assert all(f"<h3>{c['landmark_id']} " in page for c in document["candidates"])
    again = sp.read_campaign(tmp_path / "out" / "campaign.toml")
    assert len(again.landmarks) == document["images"][0]["used"]
    assert again.loaded.campaign.sightings.ellipse is not None
    assert again.loaded.campaign.landmarks.correlation_length == 300.0


@pytest.mark.slow
def test_an_image_of_noise_is_left_out_and_nothing_but_the_document_written(copy, rng):
    (raw,) = (copy / "raw").iterdir()
    Image.fromarray(rng.integers(0, 4000, (240, 240)).astype(np.uint16)).save(raw)
    done = starplumb("measure", copy / "campaign.toml", "--calibrate")
    assert done.status == 3
    assert "0 of 1 image could be measured" in done.err
    assert sorted(path.name for path in (copy / "measured").iterdir()) == ["measure.html", "measure.json"]
    document = json.loads((copy / "measured" / "measure.json").read_text())
    assert document["status"] == "failed"
    assert "no place of the search stands out" in document["images"][0]["reason"]


@pytest.mark.slow
def test_ground_that_the_reference_does_not_cover_is_unknown_and_full_pixels_are_refused(copy):
    (copy / "ortho_0.png").unlink()
    (raw,) = (copy / "raw").iterdir()
    values = np.array(Image.open(raw)).astype(np.uint16)
    values[150:] = 4095
    Image.fromarray(values).save(raw)
    measured = sp.measure(copy / "campaign.toml")
    verdicts = [c["verdict"] for c in measured.document["candidates"]]
    assert measured.usable
    assert {"no reference", "saturated", "used"} <= set(verdicts)


def test_a_campaign_without_marks_is_read_up_to_them(folder):
    loaded = load_images(folder / "campaign.toml")
    assert len(loaded.campaign.images.ids) == 1
    assert not loaded.campaign.sightings.image.size
    done = starplumb("calibrate", folder / "campaign.toml")
    assert done.status == 2
    assert "measure" in done.err


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("sigma_arcsec = [16", "# sigma_arcsec = [16", "mounting.sigma_arcsec: missing"),
        (
            "raw/{image_id}.png",
            "raw/{image_id}.tif",
            r"campaign\.toml: imagery\.files: .*image01\.tif: found",
        ),
        ("raw/{image_id}.png", "raw/image.png", "imagery.files"),
        ("saturation_dn = 4095", "band = 2", "found 1 band, wanted band 2"),
        ("ortho_*.png", "nothing_*.png", "reference.files: found no file"),
        ('crs = "EPSG:4326"\n', "", "reference.crs"),
        ("dem.asc", "dam.asc", r"campaign\.toml: reference\.dem: .dam\.asc.: found no such file"),
        (
            'files = ["ortho_*',
            'files = ["ortho.png", "ortho_*',
            r"campaign\.toml: reference\.files: .ortho\.png",
        ),
        (
            'heights = "ellipsoidal"',
            'heights = "geoid"\ngeoid = "egm.tif"',
            r"campaign\.toml: reference\.geoid: .egm\.tif",
        ),
        ('heights = "ellipsoidal"\n', "", "reference.heights: missing"),
        ("[imagery]", "[images2]", "images2"),
        ("grid = [4, 4]", "chip_px = 5", "measure.chip_px: found 5"),
        (
            "image_size_px = [240, 240]",
            "image_size_px = [240, 250]",
            "found 240 x 240 pixels, wanted 240 x 250",
        ),
    ],
)
def test_bad_input_is_one_sentence_and_nothing_is_written(copy, old, new, said):
    changed(copy, old, new)
    done = starplumb("measure", copy / "campaign.toml")
    assert done.status == 2
    assert re.search(said, done.err), done.err
    assert len(done.err.strip().splitlines()) == 1
    assert not (copy / "measured").exists()


def test_a_transposed_image_is_told_by_its_size(copy):
    changed(copy, "image_size_px = [240, 240]", "image_size_px = [240, 200]")
    (raw,) = (copy / "raw").iterdir()
    Image.fromarray(np.zeros((240, 200), np.uint16)).save(raw)
    done = starplumb("measure", copy / "campaign.toml")
    assert done.status == 2
    assert "is it transposed?" in done.err


def test_the_campaigns_own_folder_is_not_written_into(copy):
    before = (copy / "campaign.toml").read_text()
    done = starplumb("measure", copy / "campaign.toml", "--out", copy)
    assert done.status == 2
    assert "campaign.toml" in done.err
    assert (copy / "campaign.toml").read_text() == before
    assert not (copy / "measure.json").exists()


def test_a_chip_of_other_ground_has_another_name():
    """Images of two campaigns may bear one name, and chips of one number: an archive would take them for one marker."""
    at = np.array([4.6e6, 4.0e5, 4.4e6])
    here, again, there, lost = (
        Candidate(0, 3, np.zeros(2), np.zeros(2), Verdict.USED, p_J=p_J)
        for p_J in (at, at + 1e-5, at + np.array([0.0, 0.01, 0.0]), None)
    )
    names = [one.landmark_id("image01") for one in (here, again, there, lost)]
    assert names[0] == names[1] != names[2]
    assert all(re.fullmatch("image01-003-[0-9a-f]{6}", name) for name in names[:3])
    assert names[3] == "image01-003"
    assert replace(here, landmark="L7").landmark_id("image01") == "L7"
