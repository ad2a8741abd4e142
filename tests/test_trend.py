"""The trend of a mission: filters against a dense regression, coverage of what is foretold, changes and their size."""

from __future__ import annotations

import json

import numpy as np
import pytest

import starplumb as sp
from command import starplumb
from missions import mission
from starplumb.mission import bank as banks
from starplumb.mission.advice import altitude_m
from starplumb.mission.bank import Bank
from starplumb.mission.changes import changes
from starplumb.mission.points import Points, scatter
from starplumb.mission.policies import Mission, compared
from starplumb.mission.trend import YEAR_NS, trend
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC
from starplumb.report import trend as trend_page
from starplumb.session.mission.fleet_document import satellites
from test_archive import archive_of, saved

SIGMA = np.array([1.0, 1.0, 3.0]) * ARCSEC


def flown(rng, turn_arcsec, gap_days=30.0, common=None):
    """Points of campaigns of a mounting that turns so (m, 3), and their times."""
    m = len(turn_arcsec)
    value = turn_arcsec * ARCSEC + SIGMA * rng.standard_normal((m, 3))
    shared = np.zeros((m, 3, 0)) if common is None else np.broadcast_to(common, (m, 3, 3))
    if common is not None:
        value = value + common @ rng.standard_normal(3)
    t_ns = (np.arange(m) * gap_days * 86400e9).astype(np.int64)
    return t_ns, Points(np.eye(3), value, np.broadcast_to(np.diag(SIGMA**2), (m, 3, 3)).copy(), shared)


def walked(rng, m, step_arcsec):
    return np.cumsum(step_arcsec * rng.standard_normal((m, 3)), axis=0)


def test_a_member_is_the_dense_regression_of_its_model(rng, monkeypatch):
    """A walk with a season, no jumps: the last level and its covariance by one Gaussian regression of all campaigns."""
    monkeypatch.setattr(banks, "WALKS", (0.7,))
    monkeypatch.setattr(banks, "SLOPES", (0.4,))
    monkeypatch.setattr(banks, "SEASONS", (2.0,))
    t = np.sort(rng.uniform(0.0, 3.0, 12))
    y, R = rng.standard_normal((12, 1)), 0.5 + rng.random(12)
    bank = Bank.start(1.0, 0.25, 1, 0.0)
    for k in range(12):
        bank, _ = bank.at(t[k]).observed(y[k], R[k] * np.eye(1), chance=1e-300)
    value, P = bank.at(3.5).mounting
    at = np.append(t, 3.5)
    q = 0.7**2 / 0.25
    K = q * np.minimum(at[:, None], at) + (1e4) ** 2 + 0.4**2 * at[:, None] * at
    K += 2.0**2 * np.cos(2.0 * np.pi * (at[:, None] - at))
    gain = np.linalg.solve(K[:12, :12] + np.diag(R), K[:12, 12])
    assert value[0] == pytest.approx(gain @ y[:, 0], abs=1e-5)
    assert P[0, 0] == pytest.approx(K[12, 12] - gain @ K[:12, 12], rel=1e-5)


@pytest.mark.slow
def test_the_evidence_is_that_of_the_innovations(rng, monkeypatch):
    """The ratio of two members' weights is the ratio of the densities of all campaigns."""
    from scipy.stats import multivariate_normal

    monkeypatch.setattr(banks, "WALKS", (0.0, 1.0))
    monkeypatch.setattr(banks, "SLOPES", (0.0,))
    monkeypatch.setattr(banks, "SEASONS", (0.0,))
    monkeypatch.setattr(banks, "FLAT", 10.0)
    y, t = rng.standard_normal(8), np.arange(8) / 12.0
    bank = Bank.start(1.0, 1.0 / 12.0, 1, 0.0)
    before = bank.log.copy()
    for k in range(8):
        bank, _ = bank.at(t[k]).observed(y[k : k + 1], np.eye(1), chance=1e-300)
    gained = bank.log - before
    covariances = [np.eye(8) + 100.0 + q * np.minimum(t[:, None], t) for q in (0.0, 12.0)]
    wanted = [multivariate_normal(np.zeros(8), V).logpdf(y) for V in covariances]
    assert gained[1] - gained[0] == pytest.approx(wanted[1] - wanted[0], abs=1e-9)


@pytest.mark.slow
def test_intervals_of_what_is_foretold_hold(rng):
    """Walks of 0.5 arcsec a month with a season of 2: the mounting a month ahead, 95 % and 68 %, about each axis."""
    inside = []
    for _ in range(40):
        m = 30
        season = 2.0 * np.sin(2.0 * np.pi * (np.arange(m + 1)[:, None] / 12.175 + rng.random(3)))
        turn = walked(rng, m + 1, 0.5) + season
        t_ns, points = flown(rng, turn[:m], 30.0)
        found = trend(t_ns, points)
        value, P = found.at(int(t_ns[-1] + 30 * 86400e9))
        z = (value / ARCSEC - turn[m]) / (np.sqrt(np.diagonal(P)) / ARCSEC)
        inside.append(np.abs(z))
    assert 0.90 <= np.mean(np.array(inside) < 1.96) <= 0.99
    assert 0.58 <= np.mean(np.array(inside) < 0.9945) <= 0.80


def test_campaigns_of_one_day_foretell_no_faster_motion_than_those_of_two(rng):
    """A minute apart, their scatter is none that goes on: a month ahead they are at most as uncertain as two a day
    apart, not a thousand arcsec."""
    a_month = int(30 * 86400e9)
    sigma = []
    for gap in (1.0 / 1440.0, 1.0):
        t_ns, points = flown(rng, np.zeros((2, 3)), gap)
        sigma.append(np.sqrt(np.diagonal(trend(t_ns, points).at(int(t_ns[-1]) + a_month)[1])) / ARCSEC)
    assert np.all(sigma[0] < 2.0 * sigma[1])
    assert np.all(sigma[0] < 30.0)


def test_a_survey_error_is_in_what_is_foretold_and_in_no_change(rng):
    common = np.diag([5.0, 4.0, 3.0]) * ARCSEC
    t_ns, points = flown(rng, np.zeros((24, 3)), common=common)
    found = trend(t_ns, points)
    _, P = found.at(int(t_ns[-1]))
    assert np.all(np.sqrt(np.diagonal(P)) / ARCSEC > [5.0, 4.0, 3.0])
    steady = next(change for change in changes(found) if change.kind == "trend")
    assert np.all(np.sqrt(np.diagonal(steady.covariance_E)) / ARCSEC < [2.0, 2.0, 5.0])


@pytest.mark.parametrize("noted", [True, False])
def test_a_jump_is_found_with_its_size(rng, noted):
    turn = np.where(np.arange(30)[:, None] >= 17, [6.0, -4.0, 0.0], 0.0)
    t_ns, points = flown(rng, turn)
    event = [int((t_ns[16] + t_ns[17]) // 2)] if noted else []
    found = trend(t_ns, points, event)
    assert found.jumps == [17]
    jump = next(change for change in changes(found) if change.kind == "jump")
    assert jump.between == (16, 17)
    assert jump.p < 1e-4
    off = (jump.size_E / ARCSEC - [6.0, -4.0, 0.0]) / (np.sqrt(np.diagonal(jump.covariance_E)) / ARCSEC)
    assert np.all(np.abs(off) < 3.5)
    value, _ = found.at(int(t_ns[-1]))
    np.testing.assert_allclose(value[:2] / ARCSEC, [6.0, -4.0], atol=1.5)


def test_nothing_is_found_where_nothing_happens(rng):
    counts = 0
    for _ in range(10):
        t_ns, points = flown(rng, np.zeros((24, 3)))
        found = trend(t_ns, points)
        counts += sum(change.p < 0.01 for change in changes(found)) + len(found.jumps)
    assert counts <= 2


def test_a_year_is_found_with_its_amplitude(rng):
    """Of four years; eight months tell none."""
    t_ns, points = flown(rng, 4.0 * np.sin(2.0 * np.pi * np.arange(49)[:, None] * 30.0 / 365.25 + np.ones(3)))
    season = changes(trend(t_ns, points))[0]
    assert season.kind == "season"
    np.testing.assert_allclose(season.size_E, 4.0 * ARCSEC, atol=4.0 * SIGMA.max() / np.sqrt(49 / 2))
    short = flown(rng, np.zeros((20, 3)), gap_days=13.0)
    assert "season" not in {change.kind for change in changes(trend(*short))}


@pytest.mark.parametrize("m", [2, 3])
def test_two_campaigns_tell_no_scatter(rng, m):
    sigma, degrees = scatter(flown(rng, np.zeros((m, 3)))[1])
    assert (sigma is None) == (m == 2)
    assert degrees == m - 1


def test_changes_are_least_squares_of_all_columns(rng):
    """Of a mounting at rest by its evidence: the same coefficients as by NumPy's least squares."""
    t_ns, points = flown(rng, np.linspace(0.0, 1.0, 12)[:, None] * [3.0, 0.0, 0.0], 20.0)
    temperature = rng.normal(10.0, 3.0, 12)
    found = trend(t_ns, points)
    listed = {change.kind: change for change in changes(found, {"lens": temperature})}
    assert set(listed) == {"trend", "temperature:lens"}
    tau = np.linspace(-0.5, 0.5, 12)
    F = np.column_stack([np.ones(12), tau, (temperature - temperature.mean()) / (np.ptp(temperature) / 2.0)])
    t = t_ns / YEAR_NS
    V = np.eye(12) * SIGMA[0] ** 2 + float(found.bank.wander) * np.minimum(t[:, None], t)
    L = np.linalg.inv(np.linalg.cholesky(V))
    wanted = np.linalg.lstsq(L @ F, L @ points.value_E[:, 0])[0]
    assert listed["trend"].size_E[0] == pytest.approx(wanted[1], rel=1e-9)
    assert listed["temperature:lens"].size_E[0] == pytest.approx(wanted[2], rel=1e-9)


@pytest.mark.slow
def test_the_foretold_mounting_beats_the_other_rules(rng):
    """Rows of the table of benchmarks/policies.py in which the mounting moves."""
    for kind in (Mission(1.0, 0.3, 0.0, 0), Mission(1.0, 0.3, 1.5, 1), Mission(0.5, 0.5, 3.0, 2)):
        found = dict(compared(kind, rng, 30))
        issued = found.pop("issued")
        assert all(issued < other for other in found.values()), (kind, issued, found)


def test_an_orbit_of_96_minutes_is_569_km_high():
    """Kepler's third law by hand: a = (3.986004418e14 (5760 / 2 pi)^2)^(1/3) = 6 945 033 m."""
    assert altitude_m(5760.0) == pytest.approx(6_945_033.0 - 6_378_137.0, abs=300.0)


@pytest.fixture(scope="module")
def moved(tmp_path_factory):
    """Ten campaigns a month apart; after the sixth the mounting is 60 arcsec off about x."""
    folder = tmp_path_factory.mktemp("moved")
    turn = np.where(np.arange(10)[:, None] >= 6, [60.0, 0.0, 0.0], 0.0)
    rng = np.random.default_rng(7)
    paths = mission(rng, folder, [30.0 * k for k in range(10)], turn)
    archive = archive_of(folder, *map(saved, paths))
    archive.event("2000-06-15T00:00:00", "safe mode", "two minutes")
    return archive


def test_the_trend_of_an_archive_follows_the_mounting(moved):
    d = json.loads(starplumb("archive", "trend", moved.path, "--json").out)
    x = np.array([p["value_arcsec"][0] for p in d["points"]])
    sigma = np.array([p["sigma_arcsec"][0] for p in d["points"]])
    assert np.mean(x[6:]) - np.mean(x[:6]) == pytest.approx(60.0, abs=5.0 * sigma.max())
    jump = next(change for change in d["changes"] if change["kind"] == "jump")
    assert jump["significant"]
    assert jump["words"].endswith("(safe mode)")
    assert jump["ground_m"] > 100.0
    assert d["recommendation"]["action"] == "issue"
    assert sum(model["weight"] for model in d["models"]) == pytest.approx(1.0)
    assert [p["jumped"] > 0.5 for p in d["points"]].index(True) == 6


def test_what_is_issued_is_what_predict_gives(moved, tmp_path):
    done = starplumb(
        "archive", "issue", moved.path, "--reason", "a test", "--out", tmp_path / "out", "--json"
    )
    assert done.status == 0
    issued = json.loads(done.out)
    kernel = (tmp_path / "out" / "mounting.tf").read_text()
    assert "issued because: a test" in kernel
    there = sp.predict(moved.path, issued["from"])
    np.testing.assert_allclose(there.C_EK, issued["matrix"], atol=1e-12)
    np.testing.assert_allclose(there.covariance_arcsec2, issued["covariance_arcsec2"], rtol=1e-9)
    assert "as issued at" in there.notices[0]
    later = sp.predict(moved.path, "2001-06-01T00:00:00")
    assert np.all(np.diagonal(later.covariance_arcsec2) > np.diagonal(there.covariance_arcsec2))
    kept = moved.trend(at=issued["from"])
    assert kept.document["recommendation"]["action"] in ("keep", "calibrate")
    assert kept.document["recommendation"]["rms_in_use_m"] > 0.0
    assert kept.document["issued"][0]["reason"] == "a test"


def test_before_anything_was_issued_predict_gives_the_trend(moved):
    found = sp.predict(moved.path, "2000-03-20T00:00:00")
    assert "nothing was issued for this time" in found.notices[0]
    first = np.array(moved.trend().document["points"][2]["value_arcsec"])
    assert np.all(np.abs(found.document["correction_arcsec"] - first) < 25.0)


@pytest.mark.slow
def test_the_page_stands_alone(moved, tmp_path):
    done = starplumb("archive", "trend", moved.path, "--out", tmp_path)
    assert done.status == 0
    page = (tmp_path / "trend.html").read_text()
    assert "safe mode" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert page.count("<svg") >= 3
    assert starplumb("archive", "trend", moved.path, "--out", tmp_path / "b").status == 0
    assert (tmp_path / "b" / "trend.html").read_text() == page


def test_the_page_takes_an_event_in_a_leap_second():
    """47 years of 365 days and 12 leap days after 1970-01-01."""
    found = trend_page._dates(["2016-12-31T23:59:60.000000", "2017-01-01T12:00:00.000000"])
    assert found.tolist() == [17167.0, 17167.5]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("event", "yesterday", "x"), ": TIME: "),
        (("trend", "--at", "never"), "--at: "),
        (
            ("trend", "--at", "1999-01-01"),
            "--at: found 1999-01-01, wanted a time from the last campaign on (20",
        ),
        (
            ("trend", "--at", "2000-02-01"),
            "--at: found 2000-02-01, wanted a time from the last campaign on (20",
        ),
        (("withdraw", "zzz", "--reason", "x"), ": CAMPAIGN: found no such campaign under 'zzz'"),
        (("trend", "--horizon-days", "-3"), "--horizon-days: found -3.0, wanted a positive number"),
        (
            ("trend", "--horizon-days", "110000"),  # 301 years: an int64 of nanoseconds has 292
            "--horizon-days: found 110000 days after 2000-",
        ),
        (("issue", "--reason", " "), "--reason: found ' ', wanted some words"),
        (
            ("issue", "--reason", "so\x1b[31m"),
            "--reason: found 'so\\x1b[31m', wanted text without control characters",
        ),
        (
            ("event", "2000-06-15T00:00:00", "saf\x1b"),
            "KIND: found 'saf\\x1b', wanted text without control characters",
        ),
        (
            ("issue", "--reason", "x", "--start", "2000-03-01T00:00:00"),
            "wanted a time from the last campaign on",
        ),
        (("issue", "--reason", "x", "--end", "1999-01-01T00:00:00"), "which is not after the start"),
    ],
)
def test_mistakes_are_said_in_a_sentence(moved, arguments, sentence):
    verb, *rest = arguments
    done = starplumb("archive", verb, moved.path, *rest)
    assert (done.status, done.out) == (2, "")
    assert sentence in done.err
    assert done.err.count("\n") == 1


def test_an_archive_without_campaigns_has_no_trend(tmp_path):
    empty = sp.open_archive(tmp_path / "empty.db", create=True)
    with pytest.raises(InputError, match="found no campaign"):
        empty.trend()


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """One campaign of each of two satellites, 200 days apart."""
    folder = tmp_path_factory.mktemp("two")
    paths = mission(np.random.default_rng(8), folder, [0.0, 200.0])
    archive = sp.open_archive(folder / "fleet.db", create=True)
    for path, name in zip(paths, ("OLD", "NEW"), strict=True):
        archive.add(saved(path), satellite=name)
    return archive


def test_a_fleet_is_seen_from_one_time(two):
    """The rows are the trends at the time of the latest campaign, and the old one is the first."""
    rows = satellites(two)
    at = two.trend("NEW").document["at"]
    assert [row["satellite"] for row in rows] == ["OLD", "NEW"]
    assert [row["age_days"] for row in rows] == pytest.approx([200.0, 0.0], abs=0.1)
    for row in rows:
        trend_there = two.trend(row["satellite"], at=at).document
        wanted = trend_there["recommendation"]
        assert (row["loss_m"], row["loss_arcsec"]) == pytest.approx(
            (wanted["rms_if_issued_m"], wanted["rms_if_issued_arcsec"]), rel=1e-6
        )
        assert (row["action"], row["calibrate_by"]) == (wanted["action"], wanted["calibrate_by"])
        assert row["sigma_arcsec"] == pytest.approx(trend_there["forecast"][0]["sigma_arcsec"])
    assert rows[0]["loss_m"] > 1.5 * rows[1]["loss_m"]


def test_an_event_is_of_a_satellite_that_there_is(two, tmp_path):
    when = "2000-06-15T00:00:00"
    done = starplumb("archive", "event", two.path, when, "safe mode")
    assert done.status == 2
    assert "--satellite: found several satellites in" in done.err
    assert "wanted one of: 'NEW', 'OLD'" in done.err
    with pytest.raises(InputError, match=r"found 'OLDD' in .*wanted one of: .*\(did you mean OLD\?\)"):
        two.event(when, "safe mode", satellite="OLDD")
    assert two.event(when, "safe mode", satellite="OLD")["satellite"] == "OLD"
    only = sp.open_archive(tmp_path / "one.db", create=True)
    assert only.event(when, "to come", satellite="S")["satellite"] == "S"
    only.add(two.path.parent / "c0" / "result", satellite="S1")
    assert only.event(when, "safe mode")["satellite"] == "S1"
    assert [e["kind"] for e in only.trend().document["events"]] == ["safe mode"]


def test_a_campaign_that_is_there_keeps_its_satellite(two):
    done = starplumb("archive", "add", two.path, two.path.parent / "c0" / "result", "--satellite", "NEW")
    assert done.status == 0
    assert "there already as one of 'OLD', which stays so: --satellite NEW changes nothing" in done.out


def test_an_event_that_is_taken_back_counts_no_more_and_stays(two, tmp_path):
    """Both rows stay, also where two archives are united in either order."""
    archive = sp.open_archive(tmp_path / "one.db", create=True)
    archive.add(two.path.parent / "c0" / "result")
    noted = archive.event("2000-06-15", "safe mode")
    assert noted["time"] == "2000-06-15T00:00:00.000000"
    other = sp.open_archive(tmp_path / "other.db", create=True)
    other.merge(archive.path)
    done = starplumb("archive", "withdraw", archive.path, noted["id"][:8], "--reason", "another satellite")
    assert done.status == 0, done.err
    assert "safe mode" in done.out
    assert archive.trend().document["events"] == []
    merged = other.merge(archive.path)
    assert (merged["events"], merged["withdrawn"]) == (0, 1)
    assert other.trend().document["events"] == []
    assert other.verify()["faults"] == []
    with pytest.raises(InputError, match=r"withdrawn already \(another satellite\)"):
        archive.withdraw(noted["id"][:8], "twice")
    again = starplumb("archive", "event", archive.path, "2000-06-15", "safe mode")
    assert (again.status, again.out) == (2, "")
    assert "--note: found this event withdrawn (another satellite)" in again.err
    archive.event("2000-06-15", "safe mode", "after all")
    assert [e["note"] for e in archive.trend().document["events"]] == ["after all"]
    with pytest.raises(InputError, match="archive withdraw takes an event back"):
        archive.event("2000-06-15", f"withdraws {noted['id']}")
