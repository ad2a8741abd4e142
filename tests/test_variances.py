"""Variance components: against dense matrices, against the textbook, and against campaigns that are not as stated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from problems import C_EK_TRUE, FRAME, truth
from starplumb.documents.from_calibration import result_document
from starplumb.estimators.gls import Gls
from starplumb.judge import calibrate as judge
from starplumb.judge.scatter.from_data import (
    SIGHTINGS,
    FromData,
    SourceFound,
    components,
    from_data,
    levels_of,
)
from starplumb.judge.scatter.rotations import ImageRotations, image_rotations
from starplumb.judge.scatter.sources import findings_of_sources
from starplumb.judge.scatter.variances import (
    Component,
    Projector,
    estimate,
    probabilities,
    satterthwaite,
)
from starplumb.judge.snooping import fit_at
from starplumb.report.calibration.page import summary
from starplumb.report.calibration.tables import alignment
from starplumb.table.campaign import SharedErrors
from starplumb.table.geometry import observe
from starplumb.table.sharing import with_shared
from starplumb.table.simulate import Errors, measure

M = 7


def some_components(rng):
    """Three sources of seven images: its own only, of both kinds, in common only."""
    own = [a @ a.mT for a in rng.normal(size=(2, M, 3, 3))]
    return (
        Component("a", own[0], np.zeros((M, 3, 0))),
        Component("b", own[1], rng.normal(size=(M, 3, 2))),
        Component("c", np.zeros((M, 3, 3)), rng.normal(size=(M, 3, 4)), 0.0),
    )


def dense(c):
    """V_s (3 m, 3 m)."""
    V, Z = np.zeros((3 * M, 3 * M)), c.common.reshape(3 * M, -1)
    for i in range(M):
        V[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = c.own[i]
    return V + Z @ Z.T


def dense_projector(components, f):
    V = sum(x * dense(c) for x, c in zip(f, components, strict=True))
    X, inverse = np.tile(np.eye(3), (M, 1)), np.linalg.inv(V)
    C = np.linalg.inv(X.T @ inverse @ X)
    return inverse - inverse @ X @ C @ X.T @ inverse, C @ X.T @ inverse


def test_moments_are_those_of_dense_matrices(rng):
    components, d, f = some_components(rng), rng.normal(size=(M, 3)), np.array([1.2, 0.7, 0.3])
    P, gain = dense_projector(components, f)
    q, trace, pairs = Projector(components, f).moments(d)
    V, y = [dense(c) for c in components], P @ d.reshape(-1)
    np.testing.assert_allclose(q, [y @ v @ y for v in V])
    np.testing.assert_allclose(trace, [np.trace(P @ v) for v in V])
    np.testing.assert_allclose(pairs, [[np.trace(P @ a @ P @ b) for a in V] for b in V])
    np.testing.assert_allclose(np.concatenate(list(Projector(components, f).gain), axis=1), gain)
    for c, v in zip(components, V, strict=True):
        np.testing.assert_allclose(c.spread(Projector(components, f).gain), gain @ v @ gain.T)


def test_the_estimate_maximises_the_restricted_likelihood(rng):
    """Against the likelihood itself, written down densely: no factor near the answer is more likely."""
    components, d = some_components(rng), 3.0 * rng.normal(size=(M, 3))
    components = (replace(components[0], squares=40.0, degrees=30), *components[1:])
    found = estimate(d, components)

    def log_likelihood(f):
        V = sum(x * dense(c) for x, c in zip(f, components, strict=True))
        X = np.tile(np.eye(3), (M, 1))
        P, _ = dense_projector(components, f)
        y = d.reshape(-1)
        both = np.linalg.slogdet(V)[1] + np.linalg.slogdet(X.T @ np.linalg.solve(V, X))[1] + y @ P @ y
        return -0.5 * (both + 30 * np.log(f[0]) + 40.0 / f[0])

    best = log_likelihood(found.f)
    for k in range(3):
        for factor in (0.97, 1.03):
            f = found.f.copy()
            f[k] = factor * f[k] if f[k] > 0.0 else (factor - 0.97) / 10.0
            assert log_likelihood(f) <= best + 1e-6


def test_the_probability_is_that_of_chi_square_for_one_source(rng):
    """Equal images of one source: exactly a chi-square of 3 (m - 1); further squares add theirs."""
    d = rng.normal(size=(M, 3))
    squares = np.sum((d - d.mean(axis=0)) ** 2)
    one = Component("a", np.tile(np.eye(3), (M, 1, 1)), np.zeros((M, 3, 0)))
    assert probabilities(d, (one,))[0] == pytest.approx(stats.chi2.sf(squares, 3 * (M - 1)))
    more = replace(one, squares=11.0, degrees=9)
    assert probabilities(d, (more,))[0] == pytest.approx(stats.chi2.sf(squares + 11.0, 3 * (M - 1) + 9))


# ---------------------------------------------------------------- rotations of images

SIGMA = np.array([1.0, 1.0, 2.0])


def rotations(d, attitude=SIGMA):
    """Images of equal attitude sigma (3,), all but exact sightings, exact positions."""
    m = len(d)
    nothing, none = np.zeros((m, 3, 3)), np.zeros((m, 3, 0))
    own = np.tile(np.diag(np.square(attitude)), (m, 1, 1))
    exact = nothing + 1e-6 * np.eye(3)
    return ImageRotations(np.arange(m), d, exact, own, nothing, none, none, 0.0 * d, (), 100.0, 100, 0.1)


def test_equal_passes_give_the_textbook_s_variance_between(rng):
    """Forty passes of three images: the mean's variance is that of the means of the passes, which knows no model."""
    group = np.repeat(np.arange(40), 3)
    d = rng.normal(size=(120, 3)) * SIGMA + (rng.normal(size=(40, 3)) * 2.0 * SIGMA)[group]
    found = from_data(rotations(d), np.eye(3), SIGMA / np.sqrt(120), {"pass": group})
    means = d.reshape(40, 3, 3).mean(axis=1)
    pooled = np.sqrt(np.mean(np.var(means / SIGMA, axis=0, ddof=1)) / 40)
    assert np.sqrt(np.mean((found.sigma_E / SIGMA) ** 2)) == pytest.approx(pooled, rel=0.02)
    (source,) = (s for s in found.sources if s.kind == "pass")
    assert source.stated == 0.0
    assert source.p < 1e-10
    # the jackknife over passes is exactly the standard error of their means
    assert found.left == "pass"
    np.testing.assert_allclose(found.jackknife_E, np.std(means, axis=0, ddof=1) / np.sqrt(40), rtol=1e-6)


@pytest.mark.parametrize("own", [0.0, 0.1, 1.0])
def test_one_draw_that_all_images_share_confirms_no_sigma(rng, own):
    """Its factor stays as stated and is none of those told; each image's own draw tells one."""
    images = rotations(SIGMA * (rng.normal(size=3) + own * rng.normal(size=(8, 3))), own * SIGMA)
    one = (1.0 - own) * np.tile(np.diag(SIGMA), (8, 1, 1))
    images = replace(images, common=one, common_of=("attitude shared",) * 3)
    found = from_data(images, np.eye(3), SIGMA)
    told = " ".join(finding.sentence for finding in findings_of_sources(found, 8))
    assert (found.sigma_E is None) == (found.half_95_E is None) == (own < 1.0)
    assert [s.kind for s in found.sources if s.kind != SIGHTINGS] == (
        ["about", "across"] if own == 1.0 else []
    )
    assert ("nothing here confirms the stated sigmas of attitude" in told) == (own < 1.0)
    held = components(images, np.eye(3), {})
    assert all(c.single == (own < 1.0) for c in held if c.name != SIGHTINGS)


def test_ratio_and_interval_of_a_source(rng):
    """Attitude across stated a third: the textbook's interval of a variance with 2 (m - 1) degrees of freedom."""
    m = 30
    d = rng.normal(size=(m, 3)) * [3.0, 3.0, 2.0]
    found = from_data(rotations(d), np.eye(3), SIGMA / np.sqrt(m))
    across = next(s for s in found.sources if s.kind == "across")
    squares = np.sum((d - d.mean(axis=0))[:, :2] ** 2)
    dof = 2 * (m - 1)
    assert across.ratio == pytest.approx(np.sqrt(squares / dof), rel=1e-3)
    expected = np.sqrt(squares / stats.chi2.ppf([0.975, 0.025], dof))
    np.testing.assert_allclose(across.interval, expected, rtol=1e-3)
    assert across.p < 1e-6
    about = next(s for s in found.sources if s.kind == "about")
    assert 1e-3 < about.p < 1.0 - 1e-3
    assert about.stated * 4.848136811095360e-06 == pytest.approx(2.0)


def test_two_images_tell_no_sigma(rng):
    found = from_data(rotations(rng.normal(size=(2, 3)) * SIGMA), np.eye(3), SIGMA)
    assert found.sigma_E is None
    assert found.half_95_E is None
    (told,) = findings_of_sources(found, 2)
    assert told.sentence.startswith("nothing here confirms the stated sigmas")
    assert not told.weakens


def test_levels_part_images_into_groups_of_several():
    images = rotations(np.zeros((4, 3)))
    groups = [
        ("a", np.array([0, 0, 1, 1])),
        ("b", np.array([5, 5, 7, 7])),
        ("c", np.arange(4)),
        ("d", np.zeros(4, int)),
    ]
    assert {name: g.tolist() for name, g in levels_of(images, groups).items()} == {"a": [0, 0, 1, 1]}


def source(kind, stated, ratio, p):
    interval = None if ratio is None else (0.8 * ratio, 1.3 * ratio)
    return SourceFound(kind, f"the {kind}", "arcsec", stated, 3.0, ratio, interval, p)


@pytest.mark.parametrize(
    ("kind", "stated", "ratio", "p", "told"),
    [
        (
            "across",
            5.0,
            2.0,
            0.9e-3,
            (True, "the images disagree: the across is 2 (1.6 to 2.6) times the stated 5"),
        ),
        ("across", 5.0, 2.0, 1.1e-3, None),
        ("sightings", 5.0, 1.5, 0.9e-3, (True, "the sightings is 1.5 (1.2 to 2) times the stated 5")),
        ("sightings", 5.0, 1.019, 0.9e-3, (False, "the sightings is 1")),
        ("pass", 0.0, None, 0.9e-3, (True, "the pass is not stated: 3 arcsec")),
        ("pass", 0.0, None, 1.0, None),
        (
            "across",
            5.0,
            0.5,
            1.0 - 0.9e-4,
            (False, "the across is 0.5 (0.4 to 0.65) times the stated 5 arcsec, less"),
        ),
        ("across", 5.0, 0.5, 1.0 - 1.1e-4, None),
        ("sightings", 5.0, 0.5, 1.0 - 0.9e-4, (False, "the sightings is 0.5")),
    ],
)
def test_what_is_said_of_a_source(kind, stated, ratio, p, told):
    found = findings_of_sources(FromData(20, None, None, (source(kind, stated, ratio, p),)), 20)
    assert len(found) == (told is not None)
    if told is not None:
        assert found[0].weakens is told[0]
        assert found[0].sentence.startswith(told[1])
        assert ("do not lower it" in found[0].sentence) == (kind == "across" and ratio == 0.5)


@pytest.mark.parametrize(("ratio", "refutes"), [(12.4, False), (12.6, True)])
def test_images_that_surely_scatter_ten_times_as_stated_refute(ratio, refutes):
    """The lower end of the interval decides, here 0.8 times the ratio."""
    (found,) = findings_of_sources(FromData(20, None, None, (source("across", 5.0, ratio, 1e-9),)), 20)
    assert (found.weakens, found.refutes) == (True, refutes)
    assert ("starplumb diagnose" in found.sentence) is refutes


@pytest.mark.parametrize(("images", "refutes"), [(5, True), (6, False)])
def test_of_few_images_the_ratio_itself_decides(images, refutes):
    """12 times, at least 9.6 times: five images cannot tell how surely."""
    found, *_ = findings_of_sources(
        FromData(images, None, None, (source("across", 5.0, 12.0, 1e-9),)), images
    )
    assert (found.weakens, found.refutes) == (True, refutes)


@pytest.mark.parametrize("images", [5, 6])
def test_few_images_confirm_nothing_and_that_is_said(images):
    found = findings_of_sources(FromData(images, None, None, ()), images)
    assert [f.weakens for f in found] == ([False] if images == 5 else [])


def test_errors_in_common_are_read_from_the_table(rng):
    """One draw a pass for attitude: its two responses are minus the square root of the stated covariance."""
    campaign = truth(FRAME, 4, 8)
    o = observe(campaign)
    images = replace(campaign.images, passes=("p", "p", "q", "q"))
    stated = with_shared(replace(campaign, images=images, attitude_errors=SharedErrors("pass")), o, C_EK_TRUE)
    table = measure(stated, C_EK_TRUE, Errors.draw(o, rng))
    whole = Gls()(table, C_EK_TRUE)
    found = image_rotations(fit_at(whole.unknowns, table, C_EK_TRUE, whole, np.ones(table.n, dtype=bool)))
    root = np.sqrt(o.cov_attitude_E[0])
    expected = np.zeros((4, 3, 2, 3))
    expected[np.arange(4), :, [0, 0, 1, 1]] = root
    np.testing.assert_allclose(np.abs(found.common), expected.reshape(4, 3, 6), atol=1e-3 * root.max())
    np.testing.assert_array_equal(found.attitude_E, 0.0)


def test_landmarks_seen_again_are_shared_between_images(rng):
    """Rotations of two images of one site, by exact attitudes: their covariance over many draws of the survey."""
    o = observe(truth(FRAME, 3, 9, shared_site=True))
    o = replace(o, sigma_px=np.full(o.n, 0.01), cov_landmark_J=25.0 * o.cov_landmark_J)
    whole = Gls()(o, C_EK_TRUE)
    every = np.ones(o.n, dtype=bool)
    found = image_rotations(fit_at(whole.unknowns, o, C_EK_TRUE, whole, every))
    between = found.landmarks[0] @ found.landmarks[1].T
    drawn = []
    for _ in range(300):
        errors = Errors.draw(o, rng)
        table = measure(o, C_EK_TRUE, errors.only("pi_J"))
        one = image_rotations(fit_at(whole.unknowns, table, C_EK_TRUE, whole, every))
        drawn.append(np.outer(one.d_E[0], one.d_E[1]))
    scale = np.sqrt(np.outer(np.diag(between), np.diag(between)))
    np.testing.assert_allclose(np.mean(drawn, axis=0) / scale, between / scale, atol=4 * np.sqrt(2 / 300))


def calibrated(monkeypatch, campaign, table):
    monkeypatch.setattr(judge, "table_of", lambda _: table)
    monkeypatch.setattr(judge, "_evidence", lambda *_: ())
    return judge.calibrate(campaign, Gls())


@pytest.mark.parametrize(("factor", "status"), [(0.25, "WEAK"), (1.0, "OK")])
def test_attitude_stated_half_is_named(monkeypatch, rng, factor, status):
    campaign = truth(FRAME, 20, 8)
    o = observe(campaign)
    table = replace(measure(o, C_EK_TRUE, Errors.draw(o, rng)), cov_attitude_E=factor * o.cov_attitude_E)
    found = calibrated(monkeypatch, campaign, table)
    assert found.status.name == status
    if status == "WEAK":
        assert "the images disagree: attitude" in found.message
        across = next(s for s in found.from_data.sources if s.kind == "across")
        assert across.interval[0] < 2.0 < across.interval[1]
    assert np.all(found.interval_95_E >= 1.959 * found.sigma_E)


def test_the_larger_sigma_leads(monkeypatch, rng):
    """Attitude stated half: the sigma from the data stands above the stated one, in table and report."""
    campaign = truth(FRAME, 12, 8)
    o = observe(campaign)
    table = replace(measure(o, C_EK_TRUE, Errors.draw(o, rng)), cov_attitude_E=0.25 * o.cov_attitude_E)
    found = calibrated(monkeypatch, campaign, table)
    data, stated = found.from_data.sigma_E, found.sigma_E
    np.testing.assert_array_equal(found.leading_sigma_E, np.maximum(data, stated))
    assert np.all(data[:2] > stated[:2])
    document = result_document(found, "gls", ("camera", "st"), {}, {})
    (first, *_) = alignment(found, document)
    assert [row[0] for row in first.rows[:4]] == [
        "correction",
        "sigma from the data",
        "sigma",
        "the same by leaving out one image each",
    ]
    assert f"{data[0] / 4.848136811095360e-06:.1f}"[:3] in summary(found, document)
    sources = {s["name"]: s for s in document["sources"]}
    assert sources["attitude across its weak axis"]["ratio"] > 1.3
    assert document["span"]["first"] < document["span"]["last"]
    assert {image["pass"] for image in document["images"]} == {"1"}


def of_one(kind, ratio, p):
    """What is found of a source that is stated as 5 arcsec."""
    return SourceFound(kind, kind, "arcsec", 5.0, 5.0 * ratio, ratio, (0.8 * ratio, 1.5 * ratio), p)


@pytest.mark.parametrize(
    ("attitude", "sightings", "words"),
    [
        # the marker's errors explain the scatter of the images too: only they are larger than stated
        ((0.03, 1e-18), (3.7, 1e-40), ["sightings is 3.7"]),
        ((1.1, 1e-18), (3.7, 1e-40), ["sightings is 3.7"]),
        ((1.1, 1e-18), (1.0, 0.4), ["attitude is 1.1 "]),
        ((2.0, 1e-18), (3.7, 1e-40), ["attitude is 2 ", "sightings is 3.7"]),
        # nothing that is stated explains it
        ((0.03, 1e-18), (1.0, 0.4), ["no variance of what is stated explains it"]),
        # smaller than stated is a hint, whatever the others are
        ((0.3, 1.0 - 1e-6), (3.7, 1e-40), ["attitude is 0.3 ", "sightings is 3.7"]),
    ],
)
def test_what_another_source_explains_is_not_called_larger_than_stated(attitude, sightings, words):
    sources = (of_one("attitude", *attitude), of_one(SIGHTINGS, *sightings))
    said = [finding.sentence for finding in findings_of_sources(FromData(20, None, None, sources), 20)]
    assert len(said) == len(words)
    assert all(word in sentence for word, sentence in zip(words, said, strict=True))


def test_the_same_groups_under_other_names_are_one_level():
    images = rotations(np.zeros((6, 3)))
    groups = [("session", np.array([0, 0, 1, 1, 2, 2])), ("pass", np.array([7, 7, 3, 3, 5, 5]))]
    assert {name: g.tolist() for name, g in levels_of(images, groups).items()} == {
        "session": [0, 0, 1, 1, 2, 2]
    }


@pytest.mark.parametrize("grown", [0.8, 2.0])
def test_a_level_of_one_image_each_changes_no_degree_of_freedom(rng, grown):
    """What each pass has is then what each image has: with the level or without, sigma and freedom are the same."""
    d = grown * rng.normal(size=(9, 3)) * SIGMA
    own = Component("own", np.tile(np.diag(SIGMA**2), (9, 1, 1)), np.zeros((9, 3, 0)))
    Z = np.zeros((9, 3, 9, 3))
    Z[np.arange(9), :, np.arange(9)] = np.diag(SIGMA)
    level = Component("pass", np.zeros((9, 3, 3)), Z.reshape(9, 3, 27), 0.0)
    slopes = np.array([SIGMA**2 / 9])
    alone = satterthwaite(slopes, estimate(d, (own,)))
    both = satterthwaite(np.repeat(slopes, 2, axis=0), estimate(d, (own, level)))
    np.testing.assert_allclose(both[0], alone[0], rtol=2e-3)
    np.testing.assert_allclose(both[1], alone[1], rtol=0.02)
    np.testing.assert_allclose(alone[1], 24.0, rtol=1e-6)


def test_a_source_that_is_not_seen_has_a_bounded_interval(rng):
    """Images that do not differ about one axis: the ratio is at its least, its upper end no number of 13 digits."""
    d = rng.normal(size=(8, 3)) * [1.0, 1.0, 0.0]
    found = from_data(rotations(d), np.eye(3), SIGMA / np.sqrt(8))
    about = next(s for s in found.sources if s.kind == "about")
    assert about.ratio == pytest.approx(np.sqrt(1e-3), rel=0.1)
    assert about.interval[0] < about.ratio < about.interval[1] < 100.0 * about.ratio


def test_the_sightings_have_the_unit_of_the_table(rng):
    found = from_data(rotations(rng.normal(size=(8, 3)) * SIGMA), np.eye(3), SIGMA / np.sqrt(8))
    own = next(s for s in found.sources if s.kind == SIGHTINGS)
    assert (own.unit, own.stated) == ("px", 0.1)


@pytest.mark.parametrize(("weak", "axis"), [(4.0, [0.0, 1.0, 0.0]), (1.2, [1.0, 0.0, 0.0])])
def test_the_weak_axis_is_the_tracker_s_not_the_camera_s(rng, weak, axis):
    """The tracker is worst about y and the camera looks along x: about y, unless y hardly stands out."""
    C_EK = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    images = rotations(rng.normal(size=(8, 3)) * SIGMA, np.sqrt([1.0, weak, 1.0]))
    about = next(c for c in components(images, C_EK, {}) if c.name == "about")
    variances_of = np.linalg.eigh(about.own[0])
    np.testing.assert_allclose(np.abs(variances_of[1][:, 2]), axis, atol=1e-9)


def test_many_columns_of_an_error_in_common_are_as_few_of_the_same_covariance(rng):
    """Six images by two hundred attitude samples: the factors found are those of as many columns as there are rows."""
    images = rotations(rng.normal(size=(6, 3)) * SIGMA)
    images = replace(
        images, attitude_E=0.0 * images.attitude_E, sightings_E=images.sightings_E + 0.1 * np.eye(3)
    )
    many = rng.normal(size=(6, 3, 200)) * SIGMA[:, None] / np.sqrt(200)
    rows = many.reshape(18, 200)
    few = np.linalg.cholesky(rows @ rows.T).reshape(6, 3, 18)
    found = []
    for columns in (many, few):
        some = replace(images, common=columns, common_of=("attitude",) * columns.shape[-1])
        assert all(c.common.shape[-1] <= 18 for c in components(some, np.eye(3), {}))
        found.append(from_data(some, np.eye(3), SIGMA / np.sqrt(6)))
    np.testing.assert_allclose(found[0].sigma_E, found[1].sigma_E, rtol=1e-6)
    assert [s.p for s in found[0].sources] == pytest.approx([s.p for s in found[1].sources], rel=1e-6)


@pytest.mark.parametrize(("dates", "factors"), [(5, 1), (6, 2)])
def test_of_six_dates_what_they_share_is_told_about_the_weak_axis_by_itself(rng, dates, factors):
    group = np.repeat(np.arange(dates), 3)
    images = rotations(rng.normal(size=(3 * dates, 3)) * SIGMA)
    found = [c for c in components(images, np.eye(3), {"pass": group}) if c.drawn_anew]
    assert len(found) == factors
