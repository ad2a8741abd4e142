"""The report: what it says is what was found, it is safe, complete in itself, readable by all, and always the same."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from base64 import b64encode
from dataclasses import replace
from hashlib import sha256
from html import unescape
from html.parser import HTMLParser
from importlib.resources import files
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from problems import C_EK_TRUE, truth
from starplumb.cli.app import app
from starplumb.documents.from_calibration import result_document
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import Status
from starplumb.estimators.wahba import Wahba
from starplumb.ground import intersection
from starplumb.ground.intersection import Intersections, intersect
from starplumb.judge.calibrate import calibrate
from starplumb.judge.error_shares import PRIOR, shares
from starplumb.physics import so3
from starplumb.physics.earth import C_JT, itrf_to_geodetic
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan.demo import demo
from starplumb.report.budget import budget_page
from starplumb.report.calibration import tables
from starplumb.report.calibration.page import calibration_page
from starplumb.report.calibration.tables import _intersection_row
from starplumb.report.plots import Ellipse, outline, thinned
from starplumb.report.simulation import simulation_page
from starplumb.report.text import beside, coefficient, euler_zyx, interval, length, listed, measured, number
from starplumb.table.campaign import some_of
from starplumb.table.parameter_names import parameters

OURS = [(files("starplumb.report") / "templates" / "page.js").read_text(encoding="utf-8")]
"""The texts of a page's scripts."""
HOSTILE = "<script>alert('x')</script>"


class Seen(HTMLParser):
    """Elements and attributes of a page, as a browser would read them."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.attributes, self.text, self.scripts, self.closed = [], [], [], [], True
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.closed = False
        self.attributes += [(tag, name, value or "") for name, value in attrs]

    def handle_data(self, data):
        (self.scripts if self.tags[-1:] == ["script"] and not self.closed else self.text).append(data)

    def handle_endtag(self, tag):
        self.closed = True

    def values(self, attribute):
        return [value for _, name, value in self.attributes if name == attribute]


def page_of(campaign, inputs=None, estimator=None, **extra):
    done = calibrate(campaign, estimator or Gls())
    provenance = {"corrections": {"aberration": True}, "notices": [], "earth_orientation": None}
    names = ("camera", "star_tracker")
    document = result_document(done, "gls", names, inputs or {"campaign.toml": "sha256:00"}, provenance)
    return calibration_page(done, document | extra), done


@pytest.fixture(scope="module")
def campaign():
    return demo("frame", 4, 7)[0]


@pytest.fixture(scope="module")
def page(campaign):
    return page_of(campaign)[0]


@pytest.mark.slow
def test_the_summary_states_the_number_and_its_sigma(campaign):
    page, done = page_of(campaign)
    text = " ".join("".join(Seen(page).text).split())
    for value, sigma in zip(done.correction_E / ARCSEC, done.estimate.sigma_E / ARCSEC, strict=True):
        stated = re.findall(r"(−?[\d.]+) ± ([\d.]+)", text)
        assert any(
            abs(float(v.replace("−", "-")) - value) < 0.06 * sigma and abs(float(s) - sigma) < 0.06 * sigma
            for v, s in stated
        ), (value, sigma, stated)
    assert "48 sightings" not in text
    assert "40 sightings in 4 images" in text


@pytest.mark.slow
def test_the_page_needs_nothing_from_outside(page):
    seen = Seen(page)
    assert not {"link", "img", "iframe", "object"} & set(seen.tags)
    for name in ("src", "href", "xlink:href"):
        assert all(value.startswith("#") for value in seen.values(name)), seen.values(name)
    assert not re.search(r"url\((?!#)|@import", page)


def test_the_only_script_a_page_runs_is_ours(page):
    """Its digest is in the page's policy, which refuses every other; and it asks for nothing from outside."""
    (script,) = Seen(page).scripts
    digest = b64encode(sha256(script.encode()).digest()).decode()
    (policy,) = (value for value in Seen(page).values("content") if "default-src" in value)
    assert policy == f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"
    assert not re.search(r"https?:|fetch|import|XMLHttp|innerHTML|eval|insertAdjacent", script)


@pytest.mark.slow
def test_ids_of_the_user_stay_text(campaign):
    landmarks = replace(campaign.landmarks, ids=(*campaign.landmarks.ids[:-2], HOSTILE, "$\\frac{$"))
    images = replace(
        campaign.images, ids=('"><img src=x onerror=alert(1)>', "$\\alpha{", *campaign.images.ids[2:])
    )
    hostile = replace(campaign, name=HOSTILE, landmarks=landmarks, images=images)
    page, _ = page_of(hostile, {"</style><script>": "sha256:00"}, notices=["a & b <b>"])
    seen = Seen(page)
    assert seen.scripts == OURS
    assert "img" not in seen.tags
    assert not any(name.startswith("on") for _, name, _ in seen.attributes)
    text = "".join(seen.text)
    assert HOSTILE in text
    assert "$\\frac{$" in text
    assert "a & b <b>" in text


def test_every_figure_has_words_and_every_id_is_its_own(page):
    seen = Seen(page)
    images = [value for tag, name, value in seen.attributes if (tag, name) == ("div", "aria-label") and value]
    assert len(images) >= seen.tags.count("svg") > 8
    ids = seen.values("id")
    assert len(ids) == len(set(ids))
    targets = {value[1:] for value in seen.values("href") if value.startswith("#")}
    assert targets <= set(ids)
    assert seen.values("lang") == ["en"]
    assert seen.tags.count("h1") == 1


def test_drawings_follow_the_page_into_the_dark(page):
    drawn = "".join(re.findall(r"<svg.*?</svg>", page, flags=re.DOTALL))
    colours = set(re.findall(r"(?:fill|stroke|color): (#[0-9a-f]{6})", drawn))
    assert not colours, "a colour of its own would not change with the page"
    assert "var(--ink)" in drawn


def luminance(colour):
    channel = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    linear = np.where(channel <= 0.04045, channel / 12.92, ((channel + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("theme", [0, 1, 2], ids=["light", "dark", "print"])
def test_contrast_is_that_of_wcag_aa(theme):
    css = (files("starplumb.report") / "templates" / "style.css").read_text()
    colours = dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", css.split(":root {")[theme + 1].split("}")[0]))
    for name in ("ink", "muted", "one", "two", "three", "four", "good", "fair", "bad"):
        for ground in ("page", "raised", "marked") if name == "ink" else ("page",):
            light, dark = sorted((luminance(colours[name]), luminance(colours[ground])), reverse=True)
            assert (light + 0.05) / (dark + 0.05) >= 4.5, (name, ground)


PROGRAM = """
import hashlib
from starplumb.estimators.gls import Gls
from starplumb.documents.from_calibration import result_document
from starplumb.judge.calibrate import calibrate
from starplumb.plan.demo import demo
from starplumb.report.calibration.page import calibration_page
done = calibrate(demo("line-scan", 2, 3)[0], Gls())
document = result_document(done, "gls", ("camera", "tracker"), {}, {})
print(hashlib.sha256(calibration_page(done, document).encode()).hexdigest())
"""


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes():
    digests = set()
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed, "SOURCE_DATE_EPOCH": seed}
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
        )
        digests.add(done.stdout)
    assert len(digests) == 1


@pytest.mark.slow
def test_a_singular_campaign_has_a_report_that_forbids_its_use(campaign):
    s = campaign.sightings
    one = np.zeros(s.image.size, dtype=bool)
    one[3] = True
    sightings = some_of(s, one)
    page, done = page_of(replace(campaign, sightings=replace(sightings, check=np.array([False]))))
    assert not done.status.usable
    assert "must not be used" in page
    assert "No alignment can be given" in page


@pytest.mark.slow
def test_a_budget_shows_where_there_is_one(campaign):
    rows = [
        {"source": "star tracker", "sigma_arcsec": [3.0, 3.0, 6.0]},
        {"source": "pixels", "sigma_arcsec": [4.0, 4.0, 8.0]},
    ]
    with_budget, _ = page_of(campaign, budget=rows)
    assert 'id="budget"' in with_budget
    without, _ = page_of(campaign, estimator=Wahba())
    assert 'id="budget"' not in without
    assert "the method states no sigma" in without
    text = "".join(Seen(with_budget).text)
    assert re.search(r"all together\s+5.00\s+5.00\s+10.0", text)  # 3, 4, 5 and 6, 8, 10


def test_euler_angles_are_those_of_scipy(rng):
    for C in (*so3.exp(rng.normal(0.0, 1.0, (50, 3))), so3.exp(np.array([0.0, np.pi / 2.0, 0.0]))):
        a, b, c = euler_zyx(C)
        np.testing.assert_allclose(Rotation.from_euler("ZYX", [a, b, c]).as_matrix(), C, atol=1e-9)


def test_an_ellipse_holds_what_it_says(rng):
    covariance = np.array([[4.0, 1.5], [1.5, 1.0]])
    edge = outline(Ellipse("", np.array([3.0, -2.0]), covariance, 0.9)) - [3.0, -2.0]
    distance = np.sum(edge * np.linalg.solve(covariance, edge.T).T, axis=1)
    np.testing.assert_allclose(
        distance, 4.605170186, rtol=1e-9
    )  # chi-square quantile of 2 degrees of freedom
    draws = rng.multivariate_normal(np.zeros(2), covariance, 40_000)
    inside = np.sum(draws * np.linalg.solve(covariance, draws.T).T, axis=1) < distance[0]
    assert abs(np.mean(inside) - 0.9) < 0.006


def test_of_many_points_the_largest_are_drawn():
    size = np.arange(10_000) % 5003
    chosen, remark = thinned(size.astype(float))
    assert chosen.size <= 600
    assert set(np.flatnonzero(size >= 4998)) <= set(chosen)
    assert "of 10000 are drawn" in remark


@pytest.mark.parametrize(
    ("value", "sigma", "text"),
    [(-699.0131, 1.797, "−699.0 ± 1.8"), (12.3, 0.0456, "12.300 ± 0.046"), (5234.0, 210.0, "5234 ± 210")],
)
def test_values_are_rounded_to_their_sigma(value, sigma, text):
    assert measured(value, sigma) == text


def test_numbers_in_words():
    assert number(0.0) == "0"
    assert number(float("nan")) == "–"
    assert number(12.3456, 4) == "12.35"
    assert number(-1.5e-9) == "−1.50e−09"
    assert length(4922.6) == "4923 m"
    assert length(48_230.0) == "48.2 km"
    assert length(None) == "not known"
    assert length(9999.0) == "9999 m"
    assert length(-1e4) == "−10.0 km"
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"]) == "a, b and c"
    assert [coefficient(r) for r in (-0.001, 0.001, -0.514, 1.0)] == ["0.00", "0.00", "−0.51", "1.00"]
    assert interval(None) == "–"
    assert interval({"value": 3.0, "low": 2.88, "high": 3.12}) == "3.00 ± 0.12"


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (1.23e-4, 3, "0.000123"),
        (9.87e-5, 3, "9.87e−05"),
        (1234567.0, 3, "1234567"),
        (12345678.0, 3, "1.23e+07"),
        (-99.87, 3, "−99.9"),
        (7.0, 2, "7.0"),
    ],
)
def test_numbers_are_plain_where_that_is_short(value, digits, text):
    assert number(value, digits) == text


@pytest.mark.parametrize("sigma", [None, 0.0, float("nan")])
def test_a_value_without_a_sigma_stands_alone(sigma):
    assert measured(12.3456, sigma) == "12.35"


def test_lines_of_several_images_meet_at_the_marker_and_find_a_wrong_height():
    scene = truth(images=4, markers=6, tilt_deg=20.0, shared_site=True)
    every = np.ones(scene.sightings.image.size, dtype=bool)
    found = intersect(scene, C_EK_TRUE, every)
    assert found.landmark.size == 6
    assert np.abs(found.error_T).max() < 1e-3
    latitude, longitude, _ = itrf_to_geodetic(scene.landmarks.r_J)
    shift_T = np.array([2.0, -3.0, 7.0])
    moved = replace(scene.landmarks, r_J=scene.landmarks.r_J + C_JT(latitude, longitude) @ shift_T)
    found = intersect(replace(scene, landmarks=moved), C_EK_TRUE, every)
    np.testing.assert_allclose(found.error_T, np.tile(-shift_T, (6, 1)), atol=2e-3)
    assert abs(found.le90 - 7.0) < 2e-3
    assert abs(found.ce90 - np.hypot(2.0, 3.0)) < 2e-3


@pytest.mark.parametrize(("times", "counted"), [(0.99, True), (1.01, False)])
def test_lines_nearer_to_each_other_than_the_least_angle_give_no_height(times, counted, monkeypatch):
    scene = truth(images=2, markers=1, tilt_deg=0.0, shared_site=True)
    look = intersection._lines(scene, C_EK_TRUE, np.arange(2))[1]
    between = np.arccos(look[0] @ look[1])
    assert between > 5.0 * DEG
    monkeypatch.setattr(intersection, "LEAST_ANGLE", times * between)
    assert intersect(scene, C_EK_TRUE, np.ones(2, dtype=bool)).landmark.tolist() == ([0] if counted else [])


def test_markers_seen_once_have_no_height(campaign):
    assert (
        intersect(campaign, campaign.C_EK, np.ones(campaign.sightings.image.size, dtype=bool)).landmark.size
        == 0
    )


@pytest.mark.slow
def test_a_page_of_stereo_images_has_le90():
    scene = truth(images=3, markers=5, tilt_deg=20.0, shared_site=True)
    page, _ = page_of(scene)
    assert "LE90 is that of heights where the lines of sight of several images meet" in page


@pytest.mark.parametrize("prior", [None, np.full(3, 2.0 * ARCSEC)], ids=["no prior", "prior"])
def test_the_budget_adds_up_and_follows_each_source(prior):
    """A part is the derivative of the covariance by that source's variance: an optimal gain adds nothing."""
    scene = replace(truth(images=3, markers=5, shared_site=True), sigma_mounting=prior)
    done = calibrate(scene, Gls())
    found = shares(done)
    np.testing.assert_allclose(sum(found.values()), done.estimate.covariance_E, rtol=1e-5, atol=1e-18)
    assert (PRIOR in found) == (prior is not None)
    o = done.observations
    fields = {
        "star tracker": "cov_attitude_E",
        "satellite position": "cov_position_J",
        "marker survey": "cov_landmark_J",
        "image measurement": "sigma_px",
    }
    for name, field in fields.items():
        power = 0.5 if field == "sigma_px" else 1.0
        more, less = (
            Gls()(replace(o, **{field: getattr(o, field) * (1.0 + h) ** power}), scene.C_EK).covariance_E
            for h in (1e-3, -1e-3)
        )
        np.testing.assert_allclose(
            found[name], (more - less) / 2e-3, rtol=1e-4, atol=1e-5 * np.abs(found[name]).max(), err_msg=name
        )


def test_the_budget_adds_up_beside_other_parameters():
    campaign, _ = demo("frame", 6, 2)
    done = calibrate(campaign, Gls(parameters(["focal_length", "time_offset=10ms"], campaign)))
    found = shares(done)
    total = done.estimate.covariance_E
    np.testing.assert_allclose(sum(found.values()), total, atol=2e-3 * np.abs(total).max())
    assert all(np.linalg.eigvalsh(part)[0] > -1e-15 for part in found.values())
    assert PRIOR in found


@pytest.mark.slow
def test_a_study_and_a_budget_have_their_pages(tmp_path):
    for command in (
        ["simulate", "two-images", "--trials", "60", "--workers", "1"],
        ["budget", "two-images", "--target", "5"],
    ):
        folder = tmp_path / command[0]
        result = CliRunner().invoke(app, [*command, "--out", str(folder), "--quiet"])
        assert result.exit_code == 0, result.output
        page = (folder / "report.html").read_text(encoding="utf-8")
        seen = Seen(page)
        assert seen.scripts == OURS
        assert seen.tags.count("svg") >= 1
        ids = seen.values("id")
        assert len(ids) == len(set(ids))
        assert "two-images" in "".join(seen.text)


def test_a_wrong_stated_sigma_is_written_on_the_badge():
    interval = {"value": 1.4, "low": 1.35, "high": 1.45, "band_low": 0.95, "band_high": 1.05, "wrong": True}
    axis = dict.fromkeys(("mean_arcsec", "sigma_arcsec", "rms_arcsec", "rmse_over_bound"), interval) | {
        "max_arcsec": 9.0,
        "stated_sigma_arcsec": 1.0,
        "kurtosis": 3.0,
        "error_over_stated": interval,
        "histogram": None,
        "quantiles_arcsec": {"0.5": interval},
    }
    curve = {"trials": [10], **{f"sigma_{k}_arcsec": [1.4] for k in "xyz"}}
    method = {
        "axes": dict.fromkeys("xyz", axis),
        "nees": interval,
        "ground": {"ce90_m": None},
        "failed": 0,
        "status": {"ok": 10},
        "verdict": [HOSTILE],
        "convergence": curve,
    }
    document = {
        "scenario": HOSTILE,
        "description": "",
        "trials": 10,
        "seed": 1,
        "chunk": 10,
        "sightings": 4,
        "images": 2,
        "fingerprint": {},
        "cramer_rao_arcsec": None,
        "sources": [],
        "methods": {"gls": method},
    }
    page = simulation_page(document)
    assert "the stated sigma does not hold: gls" in page
    assert Seen(page).scripts == OURS
    fine = {
        **method,
        "nees": interval | {"wrong": False},
        "axes": dict.fromkeys("xyz", axis | {"error_over_stated": None}),
    }
    assert "the stated sigmas hold" in simulation_page(document | {"methods": {"gls": fine}})


@pytest.mark.parametrize(
    ("value", "scale", "text"),
    [(1.04e-18, 1.0, "0"), (-2e-10, 1.0, "0"), (2e-9, 1.0, "2.00e−9"), (1.04e-18, 1e-12, "1.04e−18")],
)
def test_what_rounding_leaves_of_nothing_is_shown_as_nothing(value, scale, text):
    assert beside(value, scale).replace("e−09", "e−9") == text
    assert (interval({"value": value, "low": value, "high": value}, scale) == "0") is (text == "0")


def test_the_page_of_a_budget_says_what_it_was_made_with_and_shows_no_rounding():
    import starplumb as sp

    found = sp.budget(sp.scenario("vhr-0.3m"), ["gls", "wahba"])
    shares = found.document["methods"]["gls"]["sources"]
    assert min(x for share in shares for x in share["contribution_arcsec"]) < 1e-9  # or nothing is tested
    text = " ".join("".join(Seen(budget_page(found.document)).text).split())
    assert re.search(r"e−1\d", text) is None
    assert found.document["fingerprint"]["scenario"] in text
    assert budget_page({**found.document, "fingerprint": None})  # of an older budget


@pytest.mark.slow
def test_of_very_many_images_and_landmarks_the_worst_are_listed(campaign, monkeypatch):
    done = calibrate(campaign, Gls())
    names = ("camera", "star_tracker")
    provenance = {"corrections": {}, "notices": [], "earth_orientation": None}
    full = result_document(done, "gls", names, {}, provenance)
    assert "not_listed" not in full
    monkeypatch.setattr("starplumb.documents.from_calibration.LISTED_AT_MOST", 2)
    monkeypatch.setattr("starplumb.report.calibration.lists.IMAGES_AT_MOST", 1)
    monkeypatch.setattr("starplumb.report.calibration.lists.LISTED_AT_MOST", 1)
    short = result_document(done, "gls", names, {}, provenance)
    for kind, key in (("images", "rms_px"), ("landmarks", "rms_own_px")):
        worst = sorted(full[kind], key=lambda row: -row[key])[:2]
        assert short[kind] == [row for row in full[kind] if row in worst]
        assert short["not_listed"][kind] == len(full[kind]) - 2
    text = " ".join("".join(Seen(calibration_page(done, short)).text).split())
    assert f"The worst first; {len(full['images']) - 1} more are left out here." in text
    assert f"The worst first; {len(full['landmarks']) - 1} more are in residuals.csv." in text


@pytest.mark.slow
def test_of_very_many_rejections_the_largest_are_shown(campaign):
    rejected = [
        {
            "image_id": "i",
            "landmark_id": f"mark{k:05d}",
            "statistic": 4.0 + k % 997 + k * 1e-5,
            "reason": "sighting",
        }
        for k in range(5000)
    ]
    page, _ = page_of(campaign, rejected=rejected)
    text = " ".join("".join(Seen(page).text).split())
    assert f"The largest statistic first; {5000 - 200} more are in result.json." in text
    largest = max(rejected, key=lambda r: r["statistic"])["landmark_id"]
    assert largest in text
    assert text.count("mark0") == 200


def test_listed_residuals_are_those_of_the_sightings(campaign):
    done = calibrate(campaign, Gls())
    document = result_document(done, "gls", ("camera", "star_tracker"), {}, {})
    o, r = done.observations, done.residuals
    for kind, index in (("images", o.image), ("landmarks", o.landmark)):
        for i, row in enumerate(document[kind]):
            mine = r.used & (index == i)
            assert row["observations"] == np.sum(mine)
            for key, px in (("rms_px", r.after_px), ("rms_own_px", r.fit_px)):
                expected = np.sqrt(np.mean(px[mine] ** 2)) if np.any(mine) else 0.0
                assert row[key] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("C", "angles_deg"),
    [
        # R_z(30) R_y(90): the columns are where x, y, z go: down, then (-sin, cos, 0), then (cos, sin, 0)
        ([[0, -0.5, np.sqrt(0.75)], [0, np.sqrt(0.75), 0.5], [-1, 0, 0]], (30.0, 90.0, 0.0)),
        # R_z(30) R_y(-90)
        ([[0, -0.5, -np.sqrt(0.75)], [0, np.sqrt(0.75), -0.5], [1, 0, 0]], (30.0, -90.0, 0.0)),
        ([[0, 1, 0], [0, 0, 1], [-1 * -1, 0, 0]], (-90.0, -90.0, 0.0)),
    ],
)
def test_euler_angles_at_a_right_angle_by_hand(C, angles_deg):
    np.testing.assert_allclose(np.rad2deg(euler_zyx(np.array(C, dtype=float))), angles_deg, atol=1e-7)


def test_a_row_of_intersections_by_hand():
    error_T = np.array([[3.0, 4.0, 12.0], [-3.0, -4.0, -12.0], [4.0, 3.0, 12.0]])
    (row,) = _intersection_row("control points", "after", Intersections(np.arange(3), error_T))
    assert row == ("control points", "after", "3", "5.00 m", "5.00 m", "12.0 m")
    assert _intersection_row("none", "after", Intersections(np.empty(0, dtype=int), np.empty((0, 3)))) == []


def cells_below(page, caption):
    """The rows of the table with a caption, as text."""
    table = page[page.index(f"<caption>{caption}") :].split("</table>")[0].split("<tbody>")[1]
    rows = re.findall(r"<tr.*?</tr>", table, flags=re.DOTALL)
    return [[unescape(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)] for row in rows]


@pytest.mark.slow
def test_the_report_of_a_self_calibration_lists_its_parameters(campaign):
    done = calibrate(campaign, Gls(parameters(["focal_length=1mm", "time_offset"], campaign)))
    document = result_document(done, "gls", ("camera", "star_tracker"), {}, {})
    document["parameters"][1] |= {"known": False, "correction": None}
    shown = cells_below(calibration_page(done, document), "Estimated beside the alignment")
    assert [row[:2] for row in shown] == [["focal_length", "mm"], ["time_offset", "ms"]]
    for row, wanted in zip(shown, document["parameters"], strict=True):
        assert float(row[3]) == pytest.approx(wanted["sigma"], rel=5e-3)
    assert float(shown[0][2].replace("−", "-")) == pytest.approx(
        document["parameters"][0]["correction"], rel=5e-5
    )
    assert shown[1][2] == "not determined by the data"
    assert [row[4] for row in shown] == ["1.00", "–"]


def test_the_table_of_the_correction_by_hand():
    """The truth beside it where it is known; correlations of x with y 0.5, of y with z -0.25, where it may be used."""
    sigma = np.array([1.0, 2.0, 4.0]) * ARCSEC
    R = np.array([[1.0, 0.5, 0.0], [0.5, 1.0, -0.25], [0.0, -0.25, 1.0]])
    c = SimpleNamespace(covariance_E=R * np.outer(sigma, sigma), status=Status.WEAK)
    document = {
        "mounting": {"to": "ST"},
        "correction_arcsec": [10.0, -20.0, 30.0],
        "sigma_arcsec": [1.0, 2.0, 4.0],
        "interval_95_arcsec": None,
    }
    correction, correlation = tables.alignment(c, document)
    assert correction.caption.endswith("about the axes of ST")
    assert correction.rows == [
        ("correction", "10.0000", "−20.0000", "30.0000"),
        ("sigma", "1.00", "2.00", "4.00"),
    ]
    assert correlation.rows == [
        ("x", "1.00", "0.50", "0.00"),
        ("y", "0.50", "1.00", "−0.25"),
        ("z", "0.00", "−0.25", "1.00"),
    ]
    known = {
        "correction_arcsec": [11.0, -20.0, 30.0],
        "error_arcsec": [-1.0, 0.0, 0.0],
        "error_over_sigma": [-1.0, 0.0, 0.0],
    }
    with_truth = tables.alignment(c, document | {"truth": known})[0]
    assert with_truth.rows[2:] == [
        ("true correction", "11.0000", "−20.0000", "30.0000"),
        ("error", "−1.00", "0", "0"),
        ("error / sigma", "−1.0", "0", "0"),
    ]
    c.status = Status.SINGULAR
    assert len(tables.alignment(c, document)) == 1
    c.status, c.covariance_E = Status.OK, None
    (without,) = tables.alignment(c, document | {"sigma_arcsec": None})
    assert without.rows[1] == ("sigma", *["not stated"] * 3)


@pytest.mark.parametrize(
    ("turn_deg", "best", "worst"),
    [
        (0.0, "its x (along a row)", "its boresight z"),
        (0.9, "its x (along a row)", "its boresight z"),
        (1.5, "an axis 1.5 deg from its x (along a row)", "an axis 1.5 deg from its boresight z"),
    ],
)
def test_the_best_and_worst_known_axes_by_hand(turn_deg, best, worst):
    """Sigmas of 2, 5 and 8 arcsec about axes turned from the camera's about its y, seen from E where x_E is y_K."""
    C_EK = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    own_K = so3.exp(np.array([0.0, turn_deg, 0.0]) * DEG)
    covariance_K = own_K @ np.diag((np.array([2.0, 5.0, 8.0]) * ARCSEC) ** 2) @ own_K.T
    (sentence,) = tables.knowledge(C_EK, C_EK @ covariance_K @ C_EK.T)
    assert f"about {best} is known best, to 2.00 arcsec" in sentence
    assert f"about {worst} worst, to 8.00 arcsec: 4.0 times less well" in sentence


def metres(cell):
    return float(cell.removesuffix(" m").replace("−", "-"))


def test_geolocation_before_and_after_by_hand():
    """A mounting 100 arcsec off sees the ground some 335 m off at 690 km, check points too; put right, it does not."""
    scene = truth(images=3, markers=4, tilt_deg=0.0, shared_site=True)
    s = scene.sightings
    aside = replace(s, check=s.landmark == 3)
    wrong = so3.exp(100.0 * ARCSEC * C_EK_TRUE[:, 0]) @ C_EK_TRUE
    done = calibrate(replace(scene, C_EK=wrong, sightings=aside), Gls())
    (table,) = tables.geolocation(done)
    rows = {row[:2]: row[2:] for row in table.rows}
    for name, sightings, landmarks in (("control points", "9", "3"), ("check points", "3", "1")):
        before, after = (rows[name, when] for when in ("before", "after"))
        assert before[0] == after[0] == sightings
        assert before[3] == after[3] == "–"
        assert metres(before[1]) == pytest.approx(100.0 * ARCSEC * 690e3, rel=0.1)
        assert metres(after[1]) < 0.1
        before, after = (rows[f"{name}, several images", when] for when in ("before", "after"))
        assert before[0] == after[0] == landmarks
        assert metres(before[1]) > 100.0
        assert metres(after[3]) < 0.1
    assert len(rows) == 8
    (unusable,) = tables.geolocation(replace(done, status=Status.NOT_CONVERGED))
    assert [row[1] for row in unusable.rows] == ["before"] * 4


def test_what_the_report_was_made_from_by_hand():
    document = {
        "software": {"starplumb": "1"},
        "inputs": {"a.csv": "sha256:00"},
        "corrections": {"light_time": True, "aberration": False},
        "notices": ["one"],
        "earth_orientation": {"source": "finals.data", "predicted": True},
    }
    inputs, made = tables.provenance(document)
    assert inputs.rows == [("a.csv", "sha256:00")]
    assert made.rows == [
        ("starplumb", "1"),
        ("Earth orientation", "finals.data, predicted values"),
        ("corrections", "light time on and aberration off"),
        ("notice", "one"),
    ]
    _, old = tables.provenance(document | {"earth_orientation": {"source": "eopc04", "predicted": False}})
    assert old.rows[1] == ("Earth orientation", "eopc04, measured values")
    _, fixed = tables.provenance({"software": {}, "inputs": {}})
    assert fixed.rows == [("Earth orientation", "not needed: all frames are Earth-fixed")]
