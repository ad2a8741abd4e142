"""Plans of images: what is chosen from, what each image tells, the choice, its bound, and the command."""

from __future__ import annotations

import itertools
import json
import re
import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import starplumb as sp
from command import starplumb
from starplumb.documents.mission.plan import PlanDocument
from starplumb.io.scenario.candidates import (
    agility,
    candidate_information,
    chosen_scenario,
    home_site,
    stage,
)
from starplumb.io.scenario.read import find_scenario, read_scenario
from starplumb.io.scenario.tied import tied_scenario
from starplumb.physics import so3
from starplumb.physics.earth import C_JT, itrf_to_geodetic
from starplumb.physics.errors import InputError
from starplumb.physics.units import ARCSEC, DEG
from starplumb.plan.bound import bound_E
from starplumb.plan.choice.certificate import Room, certificate
from starplumb.plan.choice.ground import ground_weight
from starplumb.plan.choice.information import Information
from starplumb.plan.choice.kinds import TIES, USUAL, kinds
from starplumb.plan.choice.pick import Design, Limits, State, best_first, exchange, greedy
from starplumb.plan.choice.views import Sites, limits, slots, views
from starplumb.report.text import counted
from starplumb.session.planning.choice import covariance, picked

P0 = np.eye(3) * DEG**2


def mission(days=30.0, **truth):
    """The shipped 6U mission, its views over two sites, and how it may look."""
    read = read_scenario("cubesat-6u")
    config = read.config
    if truth:
        changed = {name: config.truth[name].model_copy(update=update) for name, update in truth.items()}
        config = config.model_copy(update={"truth": config.truth | changed})
    flown = stage(config, read.folder)
    home = home_site(config)
    far = Sites(("far",), -23.6 * np.ones(1) * DEG, 15.12 * np.ones(1) * DEG, np.array([510.0]), np.ones(1))
    able = agility(config, flown.camera.scans)
    sites = home.and_(far)
    span = (0.0, days * 86400.0)
    return flown, sites, able, views(flown.orbit, flown.orientation, flown.epoch_ns, span, sites, able)


@pytest.fixture(scope="module")
def small():
    return mission()


@pytest.fixture(scope="module")
def told(small):
    flown, sites, _, found = small
    return candidate_information(flown, found, sites, P0)


def drawn(rng, n, passes=6, sites=3):
    """Candidates whose information is drawn: a mounting, two draws of the campaign, two a pass, three a site."""
    scale = np.array([3e4, 2e4, 1e4, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    factor = scale[:, None] * rng.standard_normal((n, 10, 4))
    return Information(
        factor,
        5,
        2,
        3,
        rng.integers(0, passes, n),
        rng.integers(0, sites, n),
        ("", "", "", "clock", "clock", "gps", "gps", *["survey"] * 3),
    )


def dense(design, picks):
    """The covariance of the mounting by one matrix over all unknowns, every pass and site with its own."""
    i = design.information
    passes, sites = int(i.pass_of.max()) + 1, int(i.site_of.max()) + 1
    size = i.common + passes * i.of_pass + sites * i.of_site
    N = np.eye(size)
    N[:3, :3] = np.linalg.inv(design.P_theta)
    for j in picks:
        a = i.common + i.of_pass * i.pass_of[j]
        b = i.common + i.of_pass * passes + i.of_site * i.site_of[j]
        at = [*range(i.common), *range(a, a + i.of_pass), *range(b, b + i.of_site)]
        N[np.ix_(at, at)] += i.factor[j] @ i.factor[j].T
    return np.linalg.inv(N)[:3, :3]


def free(i):
    none = np.zeros(0, dtype=np.int64)
    return Limits(none, none, i.pass_of, 10**6)


W = np.diag([1.0, 2.0, 0.1]) * 5e5**2


def test_gains_are_what_adding_and_taking_away_an_image_does(rng):
    design = Design(drawn(rng, 30), P0, W)
    state = State(design)
    for j in (3, 8, 4, 21):
        state.change(j)
    state.change(8, -1.0)
    np.testing.assert_allclose(state.P[:3, :3], dense(design, [3, 4, 21]), rtol=1e-6)
    wanted = [
        design.value(dense(design, [3, 4, 21])) - design.value(dense(design, [3, 4, 21, j]))
        for j in range(30)
    ]
    np.testing.assert_allclose(state.gains(), wanted, rtol=1e-5)


@pytest.mark.slow
def test_the_choice_is_within_a_percent_of_the_best_of_all_and_the_bound_below_it(rng, told):
    """Of real views, and of drawn ones, which are harder."""
    for case in range(6):
        i = told.only(np.sort(rng.choice(told.n, 11, replace=False))) if case < 3 else drawn(rng, 11)
        names = (np.unique(of, return_inverse=True)[1] for of in (i.pass_of, i.site_of))
        i = replace(i, **dict(zip(("pass_of", "site_of"), names, strict=True)))
        design = Design(i, P0, W)
        best = min(design.value(dense(design, some)) for some in itertools.combinations(range(11), 4))
        picks = picked(design, free(i), 4)
        start = np.zeros(11)
        start[picks] = 1.0
        bound = certificate(design, Room(4, np.arange(11), i.pass_of, 10**6), start).bound
        assert bound <= best * (1.0 + 1e-9)
        assert np.sqrt(design.value(dense(design, picks)) / best) < 1.01


def test_an_exchange_finds_what_one_after_another_misses():
    """The best single image (both axes badly) is in no best pair (each axis well)."""
    factor = np.zeros((3, 3, 2))
    factor[0, 0, 0] = factor[0, 1, 1] = 2.2e4
    factor[1, 0, 0] = factor[2, 1, 1] = 8.0e4
    none = np.zeros(3, dtype=np.int64)
    design = Design(Information(factor, 3, 0, 0, none, none, ("", "", "")), P0 * 1e-5, np.eye(3))
    state = State(design)
    first = greedy(state, free(design.information), 2)
    assert 0 in first
    assert sorted(exchange(state, free(design.information), first, 5)) == [1, 2]


def test_the_bound_of_the_relaxed_problem_closes(rng):
    design = Design(drawn(rng, 50, passes=8), P0, W)
    picks = picked(design, free(design.information), 8)
    start = np.zeros(50)
    start[picks] = 1.0
    found = certificate(design, Room(8, np.arange(50), design.information.pass_of, 10**6), start)
    value = design.value(dense(design, picks))
    assert found.bound <= found.relaxed <= value * (1.0 + 1e-9)
    assert found.relaxed / found.bound < 1.005


def test_a_bound_with_fewer_allowed_is_higher(rng):
    design = Design(drawn(rng, 60), P0, W)
    start, slot = np.zeros(60), np.arange(60) // 3
    start[:5] = 0.5
    loose = certificate(design, Room(8, np.arange(60), design.information.pass_of, 10**6), start).bound
    tight = certificate(design, Room(8, slot, design.information.pass_of, 2), start).bound
    assert tight >= loose


def test_room_takes_the_largest_gains_that_its_limits_allow():
    room = Room(3, np.array([0, 0, 1, 2, 3]), np.array([0, 0, 0, 0, 1]), 2)
    gain = np.array([9.0, 8.0, 7.0, 6.0, 1.0])
    np.testing.assert_array_equal(room.largest(gain), [1, 0, 1, 0, 1])


def test_chosen_images_keep_the_limits(small):
    flown, _, able, found = small
    clash = limits(found, replace(able, per_pass=2), flown.exposed_s)
    rng = np.random.default_rng(3)
    design = Design(drawn(rng, found.n), P0, W)
    design = replace(design, information=replace(design.information, pass_of=found.pass_of))
    picks = picked(design, clash, 12)
    assert np.max(np.bincount(found.pass_of[picks])) <= 2
    for j in picks:
        assert not set(clash.with_(j).tolist()) & set(picks)
    slot = slots(found, able, flown.exposed_s)
    assert np.unique(slot[picks]).size == len(picks)


def test_views_look_at_their_sites_at_their_angles_in_the_light(small):
    """Pitch, roll and the height of the Sun against a direction computed from the orbit's position alone."""
    flown, sites, able, found = small
    assert found.n > 60
    r_I, v_I = flown.orbit.at(found.time_s)
    t_ns = flown.epoch_ns + np.rint(1e9 * found.time_s).astype(np.int64)
    C_IJ = flown.orientation.C_IJ(t_ns)
    p_I = (C_IJ @ sites.r_J[found.site][..., None])[..., 0]
    down = -r_I / np.linalg.norm(r_I, axis=-1, keepdims=True)
    left = np.cross(r_I, v_I)
    left = left / np.linalg.norm(left, axis=-1, keepdims=True)
    ahead = np.cross(left, -down)
    d = p_I - r_I
    x, y, z = (np.vecdot(d, axis) for axis in (ahead, left, down))
    np.testing.assert_allclose(np.arctan2(x, z), found.pitch, atol=1e-7)
    np.testing.assert_allclose(np.arctan2(y, z), found.roll, atol=1e-7)
    assert np.all(found.look <= able.look + 1e-9)
    assert np.all(found.sun >= able.sun)
    assert np.all(np.diff(found.time_s) >= 0.0)


def test_the_sun_stands_where_erfa_has_it(small):
    """Against ERFA's heliocentric Earth, in true time, to 0.1 deg."""
    import erfa

    flown, sites, _, found = small
    t_ns = flown.epoch_ns + np.rint(1e9 * found.time_s).astype(np.int64)
    tt = 2451545.0 + (t_ns * 1e-9 + 32.184) / 86400.0
    sun_I = -erfa.epv00(tt, 0.0)[0]["p"]
    sun_J = (flown.orientation.C_IJ(t_ns).mT @ sun_I[..., None])[..., 0]
    up = C_JT(*itrf_to_geodetic(sites.r_J)[:2])[..., 2][found.site]
    height = np.arcsin(np.vecdot(up, sun_J) / np.linalg.norm(sun_J, axis=-1))
    np.testing.assert_allclose(found.sun, height, atol=0.1 * DEG)


def test_information_agrees_with_the_dense_bound_of_the_whole_noise_model(small, told):
    """One image, one pass, two passes, two sites: clocks, drift, survey in common, correlated orbit errors."""
    flown, sites, _, found = small
    home, far = np.flatnonzero(found.site == 0), np.flatnonzero(found.site == 1)
    first = home[found.pass_of[home] == found.pass_of[home[0]]]
    design = Design(told, P0, W)
    for picks in (
        [home[0]],
        [first[0], first[-1]],
        [first[0], home[-1]],
        [first[0], first[-1], far[0], far[-1]],
    ):
        exact = bound_E(chosen_scenario(flown, found, sites, np.array(picks)))
        have = covariance(design, [int(j) for j in picks])
        np.testing.assert_allclose(np.sqrt(np.diag(have)), np.sqrt(np.diag(exact)), rtol=0.02)


def test_a_survey_in_common_lowers_the_worth_of_more_of_the_same(small, told):
    """Ten times the survey's error of the site: another site is worth more, and independent markers would hide that."""
    _, _, _, found = small
    blind = replace(told, site_of=np.arange(told.n))
    picks = [int(j) for j in np.flatnonzero((found.site == 0) & (found.yaw == 0.0))[:8]]
    real = covariance(Design(told, P0, W), picks)
    hopeful = covariance(Design(blind, P0, W), picks)
    assert np.sqrt(real[0, 0] / hopeful[0, 0]) > 1.1


def test_ground_weight_is_what_locating_pixels_gives():
    """Against differences of located pixels of a nadir view; the ground is curved, the field is narrow."""
    found = sp.scenario("cubesat-6u").data
    campaign = found.campaign
    nadir = int(np.argmin([np.linalg.norm(np.cross(a, b)) for a, b in zip(*_sight(campaign), strict=True)]))
    G = found.ground_m[nadir]
    weight = ground_weight(campaign.camera, found.C_EK_true, 500e3)
    centre = np.trace(G.T @ G) / np.trace(weight)
    assert centre == pytest.approx(1.0, rel=0.1)


def _sight(campaign):
    t_ns = campaign.images.t_ns
    r_J, _ = campaign.ephemeris.at(t_ns)
    C_EJ, _ = campaign.one_attitude.at(t_ns)
    look = (C_EJ.mT @ campaign.C_EK)[..., 2]
    return look, -r_J / np.linalg.norm(r_J, axis=-1, keepdims=True)


def test_kinds_part_the_views(small):
    _, _, _, found = small
    masks = kinds(found)
    assert np.all(np.sum(list(masks.values()), axis=0) <= 1)
    usual = masks[USUAL]
    assert np.all(found.site[usual] == 0)
    assert np.all(found.pitch[usual] == 0.0)
    assert np.all(found.yaw[usual] == 0.0)


def test_tie_points_add_what_the_adjustment_says(small, monkeypatch):
    """By the dense covariance and by elimination, which share nothing; seen in one image of a site they add nothing."""
    flown, sites, _, found = small
    home, far = np.flatnonzero(found.site == 0), np.flatnonzero(found.site == 1)
    once = [np.array([home[0], far[0]])]
    alone, tied = (
        bound_E(chosen_scenario(flown, found, sites, *once)),
        bound_E(tied_scenario(flown, found, sites, *once)),
    )
    np.testing.assert_allclose(tied, alone, rtol=1e-4, atol=1e-16)
    scenario = tied_scenario(flown, found, sites, home[:4])
    dense_E = bound_E(scenario)
    monkeypatch.setattr("starplumb.plan.bound.MOST_SIGHTINGS", 0)
    np.testing.assert_allclose(bound_E(scenario), dense_E, rtol=1e-5, atol=1e-16)


@pytest.mark.slow
def test_tie_points_cure_where_each_image_has_few_markers(tmp_path):
    """One marker at the site says nothing of a turn about it: what ties the images together does."""
    text = find_scenario("cubesat-6u").read_text(encoding="utf-8")
    assert "count = [3, 3]" in text
    path = tmp_path / "one.toml"
    path.write_text(text.replace("count = [3, 3]", "count = [1, 1]"), encoding="utf-8")
    found = sp.plan_images(sp.scenario(path), 8)
    document = found.document
    assert document["tie_points"]["rms_m"] < 0.5 * document["images"][-1]["rms_m"]
    assert TIES in [kind["kind"] for kind in document["kinds"]]
    assert any("with 25 tie points at each site the same images leave" in line for line in found.sentences)
    PlanDocument.of(document)


def test_best_first_is_the_greedy_order_of_the_same_images(rng):
    design = Design(drawn(rng, 20), P0, W)
    order, known = best_first(design, [2, 7, 11, 15])
    assert sorted(order) == [2, 7, 11, 15]
    values = [design.value(P) for P in known]
    assert values == sorted(values, reverse=True)
    alone = [design.value(dense(design, [j])) for j in (2, 7, 11, 15)]
    assert values[0] == pytest.approx(min(alone), rel=1e-6)


SITES = """\
site,latitude_deg,longitude_deg,height_m,clear_probability
Gobabeb,-23.6,15.12,510,0.8
Dunhuang,40.13,94.33,1220,0.5
"""


@pytest.mark.slow
def test_the_command_writes_a_plan_and_says_what_limits(tmp_path):
    sites = tmp_path / "sites.csv"
    sites.write_text(SITES, encoding="utf-8")
    out = tmp_path / "next"
    done = starplumb("plan", "cubesat-6u", "-n", 6, "--sites", sites, "--target", 1, "--out", out)
    assert done.status == 0
    assert "badly determined" in done.out
    assert "1 arcsec about each axis is not reached with 6 images" in done.out
    assert {path.name for path in out.iterdir()} == {"plan.json", "plan.csv", "plan.html"}
    document = PlanDocument.from_json((out / "plan.json").read_text(encoding="utf-8"), "plan.json")
    assert len(document.images) == 6
    assert document.bound.rms_m <= document.images[-1].rms_m
    assert document.checked.rms_m == pytest.approx(document.checked.chosen_by_rms_m, rel=0.02)
    rows = (out / "plan.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 7
    assert rows[0].startswith("order,time,site")


def mounted(name, C_EK):
    """A shipped scenario with another true mounting."""
    config = tomllib.loads(find_scenario(name).read_text(encoding="utf-8"))
    turn = (so3.log(C_EK) / DEG).tolist()
    return config | {"mounting": {"from": "camera", "to": "star_tracker", "rotation_vector_deg": turn}}


def test_the_mounting_of_another_camera_is_refused():
    """Its covariance is about other axes: 4 deg away it is this camera's, 6 deg away another's."""
    result = sp.calibrate(sp.demo(images=3))
    for away, fits in ((4.0, True), (6.0, False)):
        C_EK = so3.exp(np.array([away, 0.0, 0.0]) * DEG) @ result.C_EK
        scenario = sp.scenario(mounted("cubesat-6u", C_EK))
        asked = partial(sp.plan_images, scenario, 1, given=result, start="2026-05-10T09:40:00", days=10.0)
        if fits:
            assert asked().document["before"]["given"] == "the result"
        else:
            with pytest.raises(InputError, match=f"found a mounting {away:g} deg from the scenario's "):
                asked()


def test_one_is_no_plural():
    assert [counted(1, "pass", "passes"), counted(2, "pass", "passes"), counted(0, "view")] == [
        "1 pass",
        "2 passes",
        "0 views",
    ]
    said = starplumb("plan", "cubesat-6u", "--images", "1", "--days", "10").out
    assert not re.search(r"\b1 (views|passes|images)\b", said)


@pytest.mark.slow
def test_an_archive_of_several_satellites_is_asked_for_one(tmp_path):
    archive = sp.open_archive(tmp_path / "fleet.db", create=True)
    for name, seed in (("S1", 1), ("S2", 2)):
        archive.add(sp.calibrate(sp.demo(images=3, seed=seed)), satellite=name)
    text = find_scenario("cubesat-6u").read_text(encoding="utf-8")
    turn = (so3.log(sp.demo(images=3).C_EK_true) / DEG).tolist()
    scenario = tmp_path / "scenario.toml"
    scenario.write_text(text.replace("[0.0, -110.0, 0.0]", str(turn)), encoding="utf-8")
    asked = (
        "plan",
        scenario,
        "-n",
        1,
        "--days",
        10,
        "--given",
        archive.path,
        "--start",
        "2026-03-20T00:00:00",
    )
    done = starplumb(*asked)
    assert done.status == 2
    assert "--satellite: found several mountings" in done.err
    found = json.loads(starplumb(*asked, "--satellite", "S2", "--json").out)
    known = sp.predict(archive.path, "2026-03-20T00:00:00", satellite="S2").covariance_arcsec2
    np.testing.assert_allclose(found["before"]["sigma_arcsec"], np.sqrt(np.diagonal(known)), rtol=1e-6)


@pytest.mark.slow
def test_a_target_stops_the_plan(tmp_path):
    whole = json.loads(starplumb("plan", "vhr-0.3m", "-n", 12, "--json").out)
    wanted = 1.0001 * max(whole["images"][3]["sigma_arcsec"])
    stopped = json.loads(starplumb("plan", "vhr-0.3m", "-n", 12, "--target", wanted, "--json").out)
    assert stopped["target"]["reached"]
    assert len(stopped["images"]) <= 5


@pytest.mark.slow
def test_what_is_known_already_is_taken_whole(tmp_path):
    """Against the sum of informations: what was given and what the images tell are of different sightings."""
    campaign = sp.demo(images=3)
    result = sp.calibrate(campaign)
    found = sp.plan_images(
        sp.scenario(mounted("vhr-0.3m", result.C_EK)), 2, given=result, start="2026-05-10T09:40:00"
    )
    given = found.document["before"]
    assert given["given"] == "the result"
    later = sp.predict(result, "2026-05-10T09:40:00").covariance_arcsec2
    np.testing.assert_allclose(given["sigma_arcsec"], np.sqrt(np.diag(later)), rtol=1e-9)
    assert found.document["images"][0]["gain_m"] > 0.0
    assert any("taken for others" in notice for notice in found.notices)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("wide-swath",), "found neither [site] nor a table of sites"),
        (("cubesat-6u", "--start", "soon"), "--start: "),
        (("cubesat-6u", "--start", "2026-03-21T00:00:00", "--days", "0.1"), "found no view of home"),
        (("cubesat-6u", "--days", "3000"), "the span of the plan"),
        (("cubesat-6u", "--days", "1e6"), "--days: found 1000000.0, wanted days above 0, at most 3653"),
        (("cubesat-6u", "--images", "0"), "--images: "),
        (("cubesat-6u", "--sites", "none.csv"), "none.csv: "),
    ],
)
def test_what_cannot_be_planned_is_said_in_a_line(tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    refused = starplumb("plan", *arguments)
    assert refused.status == 2
    assert refused.err.count("\n") == 1
    assert said in refused.err


@pytest.mark.parametrize(
    ("row", "said"),
    [
        ("A,91,0,0,1", "latitude_deg"),
        ("A,40,0,0,0", "a probability above 0"),
        ("A,40,0,0,1\nA,41,0,0,1", "each site once"),
    ],
)
def test_a_table_of_sites_is_checked(tmp_path, row, said):
    path = Path(tmp_path / "sites.csv")
    path.write_text(SITES.splitlines()[0] + "\n" + row + "\n", encoding="utf-8")
    refused = starplumb("plan", "cubesat-6u", "--sites", path)
    assert refused.status == 2
    assert said in refused.err


def test_sigmas_are_in_arcsec(small, told):
    _, _, _, found = small
    P = covariance(Design(told, P0, W), [0])
    assert 1.0 < float(np.sqrt(P[0, 0])) / ARCSEC < 200.0
    assert found.n == told.n


def test_a_target_met_before_the_first_image_is_said():
    done = starplumb("plan", "cubesat-6u", "--images", "2", "--days", "3", "--target", "1e7")
    assert done.status == 2
    assert "found a target of 1e+07 arcsec that is met before the first image" in done.err
