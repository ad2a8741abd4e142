"""Many campaigns at once: none stops the rest, what is done stays done, and every satellite has its row."""

from __future__ import annotations

import json
import shutil

import pytest

import starplumb as sp
from command import demo, starplumb
from starplumb.report.fleet import fleet_page
from starplumb.session.mission.fleet import names_of


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Three small campaigns."""
    folder = tmp_path_factory.mktemp("fleet")
    for k, name in enumerate("abc", start=1):
        demo(folder / name, "--images", 3, "--seed", k)
    return folder


@pytest.fixture
def fleet(made, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(made, tmp_path / "fleet")
    return [tmp_path / "fleet" / name / "campaign.toml" for name in "abc"]


def run(fleet, *options):
    done = starplumb("calibrate", *fleet, "--jobs", 1, "--json", *options)
    return done, json.loads(done.out)


def test_one_failure_stops_no_other(fleet, tmp_path):
    (fleet[1].parent / "images.csv").write_text("no table\n")
    done, document = run(fleet, "--archive", tmp_path / "f.db")
    assert done.status == 3
    assert done.err.count("\n") == 1
    assert f"1 of 3 campaigns have no answer that can be used: {fleet[1]} (unusable input: " in done.err
    assert [one["status"] for one in document["campaigns"]] == ["ok", "unusable input", "ok"]
    assert [one["archived"] for one in document["campaigns"]] == [True, None, True]
    assert (fleet[2].parent / "result" / "result.json").is_file()
    assert str(fleet[1]) in (tmp_path / "fleet.html").read_text()
    assert len(sp.open_archive(tmp_path / "f.db").entries) == 2


@pytest.mark.slow
def test_it_goes_on_where_it_stopped(fleet, tmp_path):
    options = ("--archive", tmp_path / "f.db", "--out", tmp_path / "out")
    run(fleet[:2], *options)
    written = (tmp_path / "out" / "a" / "result.json").stat().st_mtime_ns
    _, document = run(fleet, *options)
    assert [one["resumed"] for one in document["campaigns"]] == [True, True, False]
    assert (tmp_path / "out" / "a" / "result.json").stat().st_mtime_ns == written
    table = fleet[0].parent / "observations.csv"
    table.write_text("\n".join(table.read_text().splitlines()[:-1]) + "\n")
    _, document = run(fleet, *options)
    assert [one["resumed"] for one in document["campaigns"]] == [False, True, True]
    # what was seen before would count twice in the archive
    assert document["campaigns"][0]["archived"] is False
    assert "would count twice" in document["campaigns"][0]["message"]


@pytest.mark.slow
def test_another_question_is_asked_anew(fleet):
    run(fleet[:2])
    _, document = run(fleet[:2], "--method", "gls")
    assert not any(one["resumed"] for one in document["campaigns"])


@pytest.mark.slow
def test_workers_give_the_same_results(fleet, tmp_path):
    run(fleet, "--out", tmp_path / "one")
    done = starplumb("calibrate", *fleet, "--jobs", 2, "--quiet", "--out", tmp_path / "two")
    assert done.status == 0
    for name in "abc":
        one, two = ((tmp_path / folder / name / "result.json").read_bytes() for folder in ("one", "two"))
        assert one == two


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_results(fleet, tmp_path):
    distributed = pytest.importorskip("distributed")
    run(fleet, "--out", tmp_path / "one")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        address = cluster.scheduler_address
        done = starplumb(
            "calibrate",
            *fleet,
            "--scheduler",
            address,
            "--quiet",
            "--out",
            tmp_path / "two",
            "--archive",
            "d.db",
        )
    assert done.status == 0, done.err
    for name in "abc":
        one, two = ((tmp_path / folder / name / "result.json").read_bytes() for folder in ("one", "two"))
        assert one == two
    assert len(sp.open_archive("d.db").entries) == 3


@pytest.mark.slow
def test_satellites_are_those_that_campaigns_name(fleet, tmp_path):
    for path in fleet[:2]:
        text = path.read_text().replace("[campaign]\n", '[campaign]\nsatellite = "SAT-7"\n')
        path.write_text(text)
    _, document = run([fleet[0], fleet[2]], "--archive", tmp_path / "f.db")
    assert {row["satellite"] for row in document["satellites"]} == {"SAT-7", "c"}
    losses = [row["loss_m"] for row in document["satellites"]]
    assert losses == sorted(losses, reverse=True)
    # the demo's landmarks have the same ids elsewhere
    done, document = run(fleet, "--archive", tmp_path / "f.db")
    assert done.status == 3
    assert document["campaigns"][1]["archived"] is False
    assert "wanted one place under one id" in document["campaigns"][1]["message"]


def test_a_campaign_named_twice_is_refused(fleet):
    for again in (fleet[0], fleet[0].parent / ".." / "a" / "campaign.toml"):
        done = starplumb("calibrate", fleet[0], again)
        assert done.status == 2
        assert "found twice among the campaigns" in done.err


def test_names_do_not_collide(tmp_path):
    paths = [
        tmp_path / "x" / "a" / "campaign.toml",
        tmp_path / "y" / "a" / "campaign.toml",
        tmp_path / "a.toml",
    ]
    assert len(set(names_of(paths))) == 3


def test_the_page_of_500_satellites_has_a_row_for_each():
    row = {
        "satellite": "S",
        "from": "camera",
        "to": "tracker",
        "campaigns": 3,
        "last": "2026-01-01T00:00:00",
        "age_days": 3.0,
        "loss_m": 2.0,
        "loss_arcsec": 1.0,
        "issued": True,
        "sigma_arcsec": [1.0, 1.0, 3.0],
        "change": "trend",
        "change_p": 0.5,
        "action": "keep",
        "calibrate_by": None,
        "recent_arcsec": [0.0, 1.0, 0.5],
    }
    rows = [row | {"satellite": f"S{k}"} for k in range(500)]
    page = fleet_page({"campaigns": [], "satellites": rows})
    assert all(f'<th scope="row">S{k}</th>' in page for k in range(500))
    assert "▁█▅" in page
    assert len(page) < 500_000


def test_a_result_that_cannot_be_written_is_no_fault_of_the_input(fleet):
    (fleet[1].parent / "result").write_text("a file in the way\n")
    document = run(fleet)[1]
    assert [one["status"] for one in document["campaigns"]] == ["ok", "not written", "ok"]
