"""The commands ``simulate`` and ``budget`` as a user meets them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from command import starplumb
from starplumb.cli.app import app
from starplumb.estimators import METHODS
from starplumb.estimators.protocol import Status
from starplumb.estimators.wahba import Wahba
from starplumb.physics.errors import AlignmentFailed, InputError

SIMULATE = ["simulate", "two-images", "--seed", "3", "--workers", "1", "--methods", "gls"]


def call(*arguments):
    """Standard output of a command that ends well; a user's mistake is raised."""
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.stdout


@pytest.mark.slow
def test_json_is_a_document_and_the_summary_beside_it_the_same(tmp_path):
    printed = call(*SIMULATE, "--trials", "300", "--samples", "none", "--json", "--out", str(tmp_path))
    document = json.loads(printed)
    written = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert set(written.pop("files")) == {path.name for path in tmp_path.glob("*.[hs][tv]*")}
    assert document == written
    assert document["schema"] == "starplumb-simulation/1"
    assert document["trials"] == 300
    assert document["methods"]["gls"]["axes"]["z"]["sigma_arcsec"]["value"] == pytest.approx(40.6, rel=0.15)
    assert not list(tmp_path.rglob(".*"))


def test_table_and_verdict_are_printed_for_a_person():
    printed = call(*SIMULATE, "--trials", "500")
    for part in (
        "gls in two-images, 500 trials",
        "error / stated",
        "Cramer-Rao",
        "the stated covariance is right",
        "CE90",
    ):
        assert part in " ".join(printed.split())


def test_precision_chooses_the_trials():
    """t = 3: n = 9 / (2 eps^2)."""
    assert json.loads(call(*SIMULATE, "--precision", "0.1", "--json"))["trials"] == 450


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--trials", "10", "--precision", "0.1"], "precision: found beside trials"),
        (["--trials", "10", "--methods", "glss"], "did you mean gls"),
        (["--trials", "10", "--methods", ","], "methods: found none"),
        (["--trials", "10", "--samples", "csv", "--out", "x"], "samples: found 'csv'"),
        (["--trials", "10", "--samples", "netcdf", "--out", "x"], "no longer written, wanted parquet"),
        (["--trials", "10", "--seed", str(2**64)], "seed: found"),
    ],
)
def test_a_mistake_is_one_sentence(arguments, said):
    with pytest.raises(InputError, match=said):
        call("simulate", "two-images", *arguments)


@pytest.mark.slow
def test_budget_prints_contributions_and_writes_its_document(tmp_path):
    printed = call("budget", "two-images", "--target", "2.4", "--out", str(tmp_path))
    for part in (
        "gls in two-images",
        "tracker 1 z",
        "sigma it has",
        "badly determined",
        "for 2.4 arcsec",
        "not enough alone",
    ):
        assert part in " ".join(printed.split())
    document = json.loads((tmp_path / "budget.json").read_text(encoding="utf-8"))
    assert document["schema"] == "starplumb-budget/1"
    assert set(document.pop("files")) == {"report.html"}
    assert document == json.loads(call("budget", "two-images", "--target", "2.4", "--json"))


def test_a_method_that_fails_in_every_run_ends_with_its_own_exit_code(monkeypatch, tmp_path):
    """Everything is written and printed first; a method that works beside it does not hide it."""
    monkeypatch.setitem(METHODS, "hopeless", lambda: Hopeless())
    arguments = ["simulate", "two-images", "--trials", "20", "--workers", "1", "--samples", "none"]
    with pytest.raises(AlignmentFailed, match="hopeless failed in all 20 runs"):
        call(*arguments, "--methods", "wahba,hopeless", "--out", str(tmp_path))
    document = json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert document["methods"]["hopeless"]["failed"] == 20
    assert document["methods"]["hopeless"]["verdict"][0].startswith("all of 20 runs failed")
    assert document["methods"]["wahba"]["failed"] == 0


class Hopeless(Wahba):
    """Never converges."""

    def __call__(self, observations, C_EK):
        found = super().__call__(observations, C_EK)
        return replace(found, status=np.full_like(found.status, Status.NOT_CONVERGED))


def test_the_exit_status_is_3_only_where_every_run_failed(monkeypatch):
    """One run of twenty with an answer is enough for figures, of which the verdict then says what they are worth."""
    arguments = ["simulate", "two-images", "--trials", "20", "--workers", "1", "--quiet", "--methods"]
    monkeypatch.setitem(METHODS, "hopeless", lambda: Hopeless())
    monkeypatch.setitem(METHODS, "once", lambda: Once())
    assert starplumb(*arguments, "once").status == 0
    done = starplumb(*arguments, "once,hopeless")
    assert (done.status, done.out) == (3, "")
    assert done.err.startswith("starplumb: two-images: hopeless failed in all 20 runs")


class Once(Hopeless):
    """Converges in the first run only."""

    def __call__(self, observations, C_EK):
        found = super().__call__(observations, C_EK)
        return replace(found, status=np.where(np.arange(found.status.size) == 0, Status.OK, found.status))


def test_a_study_that_never_finished_a_chunk_leaves_nothing(monkeypatch, tmp_path):
    def full(*_):
        raise InputError("chunk: found no way to write there")

    monkeypatch.setattr("starplumb.study.store.write_arrays", full)
    told = starplumb(*SIMULATE, "--trials", "300", "--out", tmp_path / "s")
    assert (told.status, told.err) == (2, "starplumb: chunk: found no way to write there\n")
    assert not (tmp_path / "s").exists()
