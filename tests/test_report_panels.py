"""The panels of a calibration's report: sites on a map, own residuals, the camera's axes, against hand calculation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from problems import truth
from starplumb.documents.from_calibration import result_document
from starplumb.estimators.gls import Gls
from starplumb.estimators.wahba import Wahba
from starplumb.judge.calibrate import calibrate
from starplumb.judge.snooping import Rejection
from starplumb.physics.camera import FrameCamera
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan.demo import demo
from starplumb.report.calibration.facts import camera_words, facts, in_the_camera, pixel_rad
from starplumb.report.calibration.fit_figures import image_panels, normality, own_over_the_field, standardised
from starplumb.report.calibration.sites import site_map, site_table, sites
from starplumb.report.calibration.summary import summary_sentences
from starplumb.report.charts.chart import Arrows, Boxes, Dots, Line
from starplumb.report.land import LEAST_DEG, coast, coastlines


@pytest.fixture(scope="module")
def done():
    return calibrate(demo("frame", 4, 7)[0], Gls())


def value(cell):
    return float(cell.replace("−", "-"))


def on_land(longitude, latitude):
    """Whether a place is within an odd number of the polygons: a ray to the north crosses them."""
    x, y = coastlines().T
    x1, y1, x2, y2 = x[:-1], y[:-1], x[1:], y[1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        crossed = ((x1 > longitude) != (x2 > longitude)) & np.isfinite(x1 + x2)
        at = y1 + (longitude - x1) * (y2 - y1) / (x2 - x1)
    return bool(np.sum(crossed & (at > latitude)) % 2)


@pytest.mark.parametrize(
    ("place", "land"),
    [((-3.7, 40.4), True), ((37.6, 55.8), True), ((-47.9, -15.8), True), ((133.0, -25.0), True),
     ((-30.0, 30.0), False), ((80.0, -20.0), False), ((-150.0, 0.0), False), ((10.3, -85.0), True)],
)  # fmt: skip
def test_cities_lie_on_the_land_and_oceans_do_not(place, land):
    assert on_land(*place) is land


def test_no_coast_leaps_around_the_earth():
    assert np.nanmax(np.abs(np.diff(coastlines()[:, 0]))) < 20.0


def test_a_region_has_the_coast_that_crosses_it_and_no_other():
    for west in (-6.0, 354.0):  # Spain, and the same counted on
        (line,) = [one for one in coast(west, west + 10.0, 35.0, 45.0) if one.x.size > 5]
        inside = (line.x >= west) & (line.x <= west + 10.0) & (line.y >= 35.0) & (line.y <= 45.0)
        assert np.sum(inside) > 10
        beside = np.isfinite(line.x) & ~inside
        assert np.sum(beside) < 0.7 * np.sum(inside)
    assert coast(-40.0, -30.0, 25.0, 35.0) == ()


def test_images_of_one_place_are_one_site_and_its_mean_is_that_of_its_sightings(done):
    found = sites(done)
    assert sum(site.images for site in found) == 4
    assert sum(site.rows.size for site in found) == int(done.residuals.used.sum())
    together = calibrate(truth(images=3, markers=5, shared_site=True), Gls())
    (one,) = sites(together)
    assert (one.images, one.rows.size) == (3, 15)
    assert site_table(together, (one,)) == ()
    (table,) = site_table(done, found)
    for site, row in zip(found, table.rows, strict=True):
        east, north = done.residuals.after_m[site.rows].mean(axis=0)
        assert value(row[3]) == pytest.approx(east, rel=5e-3)
        assert value(row[4]) == pytest.approx(north, rel=5e-3)
    (figure,) = site_map(done, found)
    (chart,) = figure.charts
    assert chart.y.high - chart.y.low >= LEAST_DEG - 1e-9
    narrow = np.cos(0.5 * (chart.y.high + chart.y.low) * DEG)
    assert (chart.x.high - chart.x.low) * narrow > chart.y.high - chart.y.low
    kinds = [type(mark) for mark in chart.marks]
    assert kinds.count(Arrows) == kinds.count(Dots) == 1
    assert Line in kinds


def test_turns_in_the_camera_are_those_of_the_tracker_by_hand():
    """A turn of (30, -20, 10) arcsec about the camera's axes: C_EK = C_EK_model exp(d_K)."""
    done = calibrate(truth(images=3, markers=6, shared_site=True), Gls())
    model, covariance = done.campaign.C_EK, np.diag(np.array([1.0, 2.0, 3.0]) * ARCSEC) ** 2
    known = replace(
        done.estimate, C_EK=model @ _turned(np.array([30.0, -20.0, 10.0]) * ARCSEC), covariance_E=covariance
    )
    (table,) = in_the_camera(replace(done, estimate=known))
    cells = np.array([[value(cell) for cell in row[1:]] for row in table.rows]).T
    np.testing.assert_allclose(cells[0], [30.0, -20.0, 10.0], rtol=2e-3)
    np.testing.assert_allclose(
        cells[1] ** 2, np.diagonal(model.T @ np.diag([1.0, 4.0, 9.0]) @ model), rtol=2e-2
    )
    camera, o = done.campaign.camera, done.observations
    to_px = 4.84814e-6 * camera.focal_length / camera.pitch
    np.testing.assert_allclose(cells[2][:2], [30.0 * to_px, -20.0 * to_px], rtol=2e-3)
    far = float(np.mean(np.linalg.norm(o.p_J - o.r_J, axis=-1)))
    np.testing.assert_allclose(cells[4][:2], [30.0 * 4.84814e-6 * far, -20.0 * 4.84814e-6 * far], rtol=2e-3)
    corner = np.max(np.hypot(*o.xy_K.T))
    np.testing.assert_allclose(cells[4][2], 10.0 * 4.84814e-6 * far * corner, rtol=2e-3)


def _turned(d):
    """exp(d) to first order: the angles are of 1e-4."""
    x, y, z = d
    return np.eye(3) + np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def test_the_facts_are_those_of_the_campaign(done):
    rows = dict(facts(done, result_document(done, "gls", ("camera", "star_tracker"), {}, {})).rows)
    assert rows["images"] == "4 in 1 pass"
    assert rows["sightings"] == "40 in the solution, 8 to check it, 0 rejected"
    assert rows["acquired"].startswith("2025-06-21T10:30:00 to 2025-06-21T10:3")
    camera = FrameCamera(2.2, 9e-6, (0.0, 0.0), (12000.0, 12000.0))
    # 9e-6 / 2.2 rad = 4.0909e-6 rad = 0.8438 arcsec
    assert camera_words(camera).endswith(
        "focal length 2.200 m, pitch 9.00 µm, 12000 x 12000 px, 0.844 arcsec a pixel"
    )
    assert pixel_rad(camera) == pytest.approx(4.0909e-6, rel=1e-4)


def test_standardised_residuals_are_those_of_the_solution(done):
    z = standardised(done)
    assert z.size == 80
    assert 0.7 < np.sqrt(np.mean(z**2)) < 1.3
    simple = calibrate(done.campaign, Wahba())
    simple = replace(simple, snooping=None)
    expected = simple.residuals.fit_px[simple.residuals.used] / 0.3
    np.testing.assert_allclose(standardised(simple), expected.ravel(), rtol=1e-9)
    bars, quantiles = normality(done)
    (boxes,) = [mark for mark in bars.charts[0].marks if isinstance(mark, Boxes)]
    width = boxes.right - boxes.left
    assert np.sum(boxes.high * width) == pytest.approx(1.0)
    (dots,) = [mark for mark in quantiles.charts[0].marks if isinstance(mark, Dots)]
    assert np.all(np.diff(dots.x) > 0.0)
    np.testing.assert_allclose(dots.y, np.sort(z))


def test_a_lens_that_was_forgotten_shows_in_the_means_over_the_field(done):
    """Own residuals grow with the square of the column: the means follow it, far beyond their errors."""
    column = done.campaign.sightings.column_px
    bent = 3.0 * ((column - 6000.0) / 6000.0) ** 2
    px = np.stack([bent, np.zeros_like(bent)], axis=-1)
    s = done.campaign.sightings
    tile = {
        name: np.tile(getattr(s, name), 20)
        for name in ("image", "landmark", "column_px", "row_px", "sigma_px", "check")
    }
    many = replace(done.campaign, sightings=replace(s, **tile))
    left = replace(done.residuals, fit_px=np.tile(px, (20, 1)), used=np.tile(done.residuals.used, 20))
    _, means = own_over_the_field(replace(done, campaign=many, residuals=left))
    (arrows,) = means.charts[0].marks
    assert np.all(np.abs(arrows.up) < 1e-12)
    outer = np.abs(arrows.x - 6000.0) > 4000.0
    inner = np.abs(arrows.x - 6000.0) < 2000.0
    assert arrows.right[outer].min() > arrows.right[inner].max()


def test_kinds_of_rejections_are_told_where_there_are_several(done):
    alone, image = (Rejection(0, 0, 9.0, reason) for reason in ("sighting: off", "image as a whole: off"))
    last = summary_sentences(replace(done, rejected=(alone, image, image)))[-1]
    assert last == "rejected 3 sightings (1 alone, 2 with an image): see result.json"
    last = summary_sentences(replace(done, rejected=(alone,)))[-1]
    assert last == "rejected 1 sighting: see result.json"


def test_the_worst_images_have_panels_to_one_scale(done):
    panels = image_panels(done)
    assert [panel.name for panel in panels] == ["image-0", "image-1", "image-2", "image-3"]
    assert len({panel.charts[0].key for panel in panels}) == 1
    assert all(panel.charts[0].width == 230.0 for panel in panels)
    assert sum(mark.x.size for panel in panels for mark in panel.charts[0].marks) == 48


def test_panels_have_the_colours_of_the_figure_above(done):
    of_role = {mark.name: mark.role for mark in own_over_the_field(done)[0].charts[0].marks}
    assert list(of_role) == ["control", "check"]
    used = done.residuals.used.copy()
    used[np.flatnonzero(used)[0]] = False  # as if it were rejected
    spoilt = replace(done, residuals=replace(done.residuals, used=used))
    above = {mark.name: mark.role for mark in own_over_the_field(spoilt)[0].charts[0].marks if mark.name}
    drawn = [mark for mark in image_panels(spoilt)[0].charts[0].marks if isinstance(mark, Arrows)]
    assert [mark.role for mark in drawn] == [above[role] for role in ("control", "check", "rejected")]
    assert drawn[-1].x.size <= 1
    assert not any(mark.name for mark in drawn)
