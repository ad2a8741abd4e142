"""Monte Carlo: reproducible to the bit, resumable, right about right models and loud about wrong ones."""

from __future__ import annotations

import json
import logging
import os
import random
import signal
import subprocess
import sys
import time
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from starplumb.disk.publish import publish
from starplumb.estimators.gls import Gls
from starplumb.estimators.protocol import AlignmentEstimate, Status
from starplumb.estimators.wahba import Wahba
from starplumb.io.results.samples import choose as choose_samples
from starplumb.io.results.samples import sample_files
from starplumb.io.scenario.read import find_scenario, load_scenario
from starplumb.physics import so3
from starplumb.physics.errors import InputError
from starplumb.plan import bound
from starplumb.plan.bound import Linear, bound_E
from starplumb.study.monte_carlo import Study, Tally
from starplumb.study.run import Dask, Processes, Serial, choose, run
from starplumb.study.store import Store
from starplumb.study.summary import found_of, summarise
from starplumb.study.threads import ONE_THREAD
from starplumb.table.error_sources import Distribution


@pytest.fixture(scope="module")
def two_images():
    return load_scenario(find_scenario("two-images"))


@pytest.fixture
def summary(tmp_path):
    """Run a study in a folder of its own and return its summary."""

    def of(scenario, trials=1500, methods=None, scheduler=None, folder="run", **options):
        study = Study(scenario, methods or {"gls": Gls()}, 5, trials, **({"chunk": 256} | options))
        store = Store.open(tmp_path / folder, study)
        run(store, scheduler or Serial())
        return summarise(store)

    return of


def test_work_within_a_chunk_is_told_as_it_is_done(two_images, summary, monkeypatch):
    """What finishes of a chunk, batch by batch; and a bar that hears both counts each trial once."""
    from starplumb.cli.simulate import _Trials

    monkeypatch.setattr("starplumb.study.monte_carlo.SIGHTINGS_AT_ONCE", 40 * two_images.truth.n)
    shown = []
    bar = _Trials(shown.append)
    study = Study(two_images, {"gls": Gls()}, 5, 250, chunk=100)
    for c, _ in Serial(bar.works).results(study, range(study.chunks)):
        bar(study.count(c))
    assert shown == [40, 80, 100, 100, 140, 180, 200, 200, 240, 250, 250]
    assert bar.kept == 250


@dataclass(frozen=True)
class Broken:
    """Fails in every third run, once without any estimate."""

    def __call__(self, observations, C_EK):
        found = Wahba()(observations, C_EK)
        status = np.where(np.arange(len(found.status)) % 3 == 0, int(Status.NOT_CONVERGED), 0)
        C = found.C_EK.copy()
        C[0] = np.nan
        return AlignmentEstimate(C, None, status, found.iterations)


# -- reproducible -----------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_chunk_is_the_same_alone_and_in_any_order(two_images):
    study = Study(two_images, {"gls": Gls()}, 7, 600, chunk=200, keep_samples=True)
    forward = [study.run(c) for c in range(3)]
    for c in (2, 0):
        again = study.run(c)
        assert all(np.array_equal(again[name], forward[c][name], equal_nan=True) for name in again)
    assert not np.array_equal(forward[0]["gls/samples/theta_E"], forward[1]["gls/samples/theta_E"])
    other = replace(study, seed=8).run(0)
    assert not np.array_equal(other["gls/samples/theta_E"], forward[0]["gls/samples/theta_E"])


def test_estimators_share_their_draws_and_do_not_change_them(two_images):
    alone = Study(two_images, {"gls": Gls()}, 7, 100).samples(0)["gls"]
    beside = Study(two_images, {"wahba": Wahba(), "gls": Gls()}, 7, 100).samples(0)["gls"]
    assert np.array_equal(alone.theta_E, beside.theta_E)


def test_a_chunk_never_holds_more_sightings_at_once_than_it_says(monkeypatch, two_images):
    monkeypatch.setattr("starplumb.study.monte_carlo.SIGHTINGS_AT_ONCE", 4 * 30)
    batches = []

    class Recorder(Wahba):
        def __call__(self, observations, C_EK):
            batches.append(observations.batch)
            return super().__call__(observations, C_EK)

    found = Study(two_images, {"wahba": Recorder()}, 7, 100).samples(0)["wahba"]
    assert batches == [(30,), (30,), (30,), (10,)]
    assert found.theta_E.shape == (100, 3)


@pytest.mark.slow
def test_summary_is_the_same_for_one_and_two_workers(two_images, summary):
    one = summary(two_images, folder="one")
    heard = []
    two = summary(two_images, folder="two", scheduler=Processes(2, heard.append))
    assert sum(heard) == 1500
    assert json.dumps(one) == json.dumps(two)


@pytest.mark.slow
def test_summary_is_the_same_on_a_dask_cluster(two_images, summary):
    distributed = pytest.importorskip("distributed")
    here = summary(two_images, folder="here")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        there = summary(two_images, folder="there", scheduler=Dask(cluster.scheduler_address))
    assert json.dumps(here) == json.dumps(there)


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(two_images, summary, monkeypatch):
    wanted = summary(two_images, folder="whole")
    killed = []

    class Victim(Processes):
        def results(self, study, chunks):
            for c, arrays in super().results(study, chunks):
                if not killed:
                    children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children")
                    if not children.exists():
                        pytest.skip("the children of a process are found in /proc only")
                    workers = [pid for pid in map(int, children.read_text().split()) if _is_worker(pid)]
                    os.kill(workers[0], signal.SIGKILL)
                    killed.append(workers[0])
                yield c, arrays

    found = summary(two_images, folder="killed", scheduler=Victim(2))
    assert killed
    assert json.dumps(found) == json.dumps(wanted)


def _is_worker(pid):
    return b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()


# -- resumable --------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_only_missing_and_damaged_chunks_are_run_again(two_images, tmp_path):
    study = Study(two_images, {"gls": Gls()}, 5, 1000, chunk=100)
    store = Store.open(tmp_path, study)
    run(store, Serial())
    assert store.missing() == []
    store.path(3).unlink()
    store.path(5).write_bytes(store.path(5).read_bytes()[:500])
    assert store.missing() == [3, 5]
    heard = []
    run(Store.open(tmp_path, study), Serial(), heard.append)
    assert heard == [800, 100, 100]
    assert Store.open(tmp_path, replace(study, trials=1150)).missing() == [10, 11]
    assert Store.open(tmp_path, replace(study, trials=950)).missing() == [9]


@pytest.mark.parametrize(
    "change", [{"seed": 6}, {"chunk": 50}, {"methods": {"wahba": Wahba()}}, {"keep_samples": True}]
)
def test_chunks_of_another_study_are_refused(two_images, tmp_path, change):
    study = Study(two_images, {"gls": Gls()}, 5, 1000, chunk=100)
    Store.open(tmp_path, study)
    with pytest.raises(InputError, match="found chunks of another study"):
        Store.open(tmp_path, replace(study, **change))
    with pytest.raises(InputError, match="scenario = two-images"):
        Store.open(
            tmp_path, replace(study, scenario=replace(two_images, stated_sources=two_images.sources[1:]))
        )


@pytest.mark.slow
def test_killed_at_random_moments_and_resumed_the_summary_is_the_same_to_the_bit(tmp_path):
    """The command itself, killed without warning; every resumption must add to what is there."""

    def command(out):
        run_it = [sys.executable, "-c", "from starplumb.cli import main; main()", "simulate", "two-images"]
        options = ["--trials", "2000", "--chunk", "100", "--seed", "11", "--workers", "1", "--methods", "gls"]
        return [*run_it, *options, "--quiet", "--out", str(out)]

    subprocess.run(command(tmp_path / "whole"), check=True)
    assert (tmp_path / "whole" / "summary.json").exists()
    cut = tmp_path / "cut"

    def finished():
        return len(list(cut.glob("chunks/*.npz")))

    for pause in random.Random(4).choices(range(11), k=3):
        before = finished()
        process = subprocess.Popen(command(cut))
        while (
            finished() <= before
        ):  # however long a busy machine takes; a command that ends has failed the test
            assert process.poll() is None, "the command ended and had added nothing"
            time.sleep(0.01)
        time.sleep(0.01 * pause)  # the moment is any moment: nothing below depends on it
        process.kill()
        process.wait()
        assert finished() > before
    subprocess.run(command(cut), check=True)
    for name in ("summary.json", "samples.parquet"):
        if (tmp_path / "whole" / name).exists():
            assert (cut / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


# -- right ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_dense_least_squares_and_the_arrow_agree():
    """Two independent computations of the same covariance: all observations at once, and images eliminated."""
    for name in ("two-images", "cubesat-6u", "wide-swath", "cubesat-6u-drift-left-out"):
        scenario = load_scenario(find_scenario(name))
        arrow = Gls()(scenario.stated, scenario.C_EK_true).covariance_E
        dense = Linear(scenario, scenario.stated_sources).covariance_E
        np.testing.assert_allclose(dense, arrow, rtol=1e-5, atol=1e-7 * np.abs(arrow).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two-images", "cubesat-6u", "wide-swath"])
def test_gls_reaches_the_bound_and_states_its_error(summary, name):
    """In the 99.9 % bands at some thousand trials; the docs quote 45 000."""
    scenario, n = load_scenario(find_scenario(name)), 4000 if name == "two-images" else 1200
    found = summary(scenario, trials=n, chunk=n)["methods"]["gls"]
    assert found["failed"] == 0
    for axis in found["axes"].values():
        assert axis["rmse_over_bound"]["value"] == pytest.approx(1.0, abs=3.3 / np.sqrt(2.0 * n))
        assert axis["error_over_stated"]["value"] == pytest.approx(1.0, abs=3.3 / np.sqrt(2.0 * n))
    assert found["nees"]["value"] == pytest.approx(1.0, abs=3.3 * np.sqrt(2.0 / (3.0 * n)))
    assert found["verdict"][0].startswith("the stated covariance is right")


@pytest.mark.slow
@pytest.mark.parametrize("source", ["tracker", "gps", "thermal drift", "clock"])
def test_gls_states_the_error_of_each_source_alone(summary, source):
    scenario = load_scenario(find_scenario("cubesat-6u")).alone(source)
    found = summary(scenario, trials=800, chunk=800)["methods"]["gls"]
    for axis in found["axes"].values():
        assert axis["error_over_stated"]["value"] == pytest.approx(1.0, abs=3.3 / np.sqrt(1600.0))


@pytest.mark.slow
def test_very_high_resolution_case_is_as_good_as_promised():
    """0.187 arcsec about x and y and 0.403 about z, or better; the shape of the formula beside it by hand."""
    scenario = load_scenario(find_scenario("vhr-0.3m"))
    sigma = Gls()(scenario.stated, scenario.C_EK_true).sigma_E * 206264.806
    assert np.all(sigma <= [0.187, 0.187, 0.403])
    ground = (0.1 / 617e3 * 206264.806) ** 2
    pixel = (0.15 * 0.3 / 617e3 * 206264.806) ** 2
    across = np.sqrt((1.0 + ground) / 30.0 + (ground + pixel) / 900.0)
    about = np.sqrt(4.0 / 30.0 + (ground + pixel) / (900.0 * (5.0 / 617.0) ** 2))
    np.testing.assert_allclose(sigma, [across, across, about], rtol=0.02)


# -- loud -------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_drift_left_out_is_told_by_the_ratio_although_the_fit_is_good(summary):
    scenario = load_scenario(find_scenario("cubesat-6u-drift-left-out"))
    found = summary(scenario, trials=2000)["methods"]["gls"]
    first, second = found["verdict"][:2]
    assert first.startswith("the stated model is wrong")
    assert "about y" in first
    assert "the residuals do not show it" in second


@pytest.mark.slow
def test_shared_errors_left_out_are_told_by_ratio_and_chi_square(summary):
    scenario = load_scenario(find_scenario("cubesat-6u-shared-left-out"))
    found = summary(scenario, trials=500)["methods"]["gls"]
    assert found["verdict"][0].startswith("the stated model is wrong")
    assert "chi-square per degree of freedom" in found["verdict"][1]
    assert found["chi2_per_degree_of_freedom"]["value"] > 2.0


def test_failures_are_counted_and_not_dropped(two_images, summary):
    found = summary(two_images, trials=256, methods={"broken": Broken()}, chunk=256)["methods"]["broken"]
    assert found["status"] == {"ok": 170, "weak": 0, "singular": 0, "not_converged": 86, "refuted": 0}
    assert (found["failed"], found["without_estimate"]) == (86, 1)
    assert "86 of 256 runs failed" in found["verdict"][0]
    assert found["axes"]["x"]["error_over_stated"] is None


@pytest.mark.slow
def test_heavy_tails_are_said_to_need_more_trials(two_images, summary):
    tails = tuple(replace(s, distribution=Distribution("student", 3.0)) for s in two_images.sources)
    found = summary(replace(two_images, sources=tails), trials=4096, chunk=4096)["methods"]["gls"]
    assert found["axes"]["z"]["kurtosis"] > 4.0
    assert any("heavy tails" in sentence for sentence in found["verdict"])
    assert found["trials_for_1_percent"] > 45000
    assert not any("wrong" in sentence for sentence in found["verdict"])


@pytest.mark.slow
def test_the_bound_belongs_to_the_true_errors_not_the_stated_ones():
    wrong = load_scenario(find_scenario("cubesat-6u-drift-left-out"))
    right = load_scenario(find_scenario("cubesat-6u"))
    np.testing.assert_allclose(bound_E(wrong), bound_E(right), rtol=1e-12)


# -- kept -------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_samples_hold_every_trial_in_order(two_images, tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    study = Study(two_images, {"gls": Gls(), "wahba": Wahba()}, 5, 250, chunk=100, keep_samples=True)
    store = Store.open(tmp_path / "chunks", study)
    run(store, Serial())
    publish(tmp_path, sample_files(store, choose_samples("parquet")))
    table = pq.read_table(tmp_path / "samples.parquet").to_pydict()
    rows = [i for i, method in enumerate(table["method"]) if method == "gls"]
    error = np.array([[table[f"error_{a}_arcsec"][i] for a in "xyz"] for i in rows])
    assert [table["trial"][i] for i in rows] == list(range(250))
    wanted = np.concatenate([study.samples(c)["gls"].theta_E for c in range(3)]) * 206264.80624709636
    np.testing.assert_allclose(error, wanted, rtol=1e-12)


def test_quantiles_and_histogram_of_a_study_are_those_of_all_its_errors(two_images, summary):
    """NumPy on the errors of the same chunks; CE90 from the displacements of both images."""
    study = Study(two_images, {"wahba": Wahba()}, 5, 600, chunk=256)
    theta = np.concatenate([study.samples(c)["wahba"].theta_E for c in range(3)])
    found = summary(two_images, trials=600, methods={"wahba": Wahba()})["methods"]["wahba"]
    for axis, errors in zip("xyz", theta.T * 206264.80624709636, strict=True):
        given = found["axes"][axis]
        for q in (0.025, 0.5, 0.975):
            wanted = np.quantile(errors, q, method="inverted_cdf")
            assert given["quantiles_arcsec"][f"{q:g}"]["value"] == pytest.approx(wanted, rel=1e-12)
        assert sum(given["histogram"]["counts"]) == 600
        inside = np.histogram(errors, given["histogram"]["edges_arcsec"])[0]
        assert given["histogram"]["counts"][1:-1] == inside[1:-1].tolist()
    off = np.concatenate([np.hypot(*(two_images.ground_m[i] @ theta.T)) for i in (0, 1)])
    assert found["ground"]["ce90_m"]["value"] == pytest.approx(np.quantile(off, 0.9, method="inverted_cdf"))


def test_tally_of_parts_is_that_of_the_whole_and_survives_storage(two_images, tmp_path):
    whole = Study(two_images, {"gls": Gls()}, 5, 500, chunk=500).samples(0)["gls"]
    theta = whole.theta_E
    study = Study(two_images, {"gls": Gls()}, 5, 500, chunk=500)
    store = Store.open(tmp_path, study)
    run(store, Serial())
    found = found_of(store)["gls"].tally
    np.testing.assert_allclose(found.theta.mean, theta.mean(0), rtol=1e-12)
    np.testing.assert_allclose(found.theta.sigma, theta.std(0, ddof=1), rtol=1e-10)
    again = Tally.from_arrays(found.arrays("x/"), "x/")
    assert np.array_equal(again.nees.mean, found.nees.mean)


def test_schedulers_follow_the_options():
    assert isinstance(choose(1, None, 10), Serial)
    assert isinstance(choose(8, None, 1), Serial)
    assert choose(8, None, 5) == Processes(5)
    assert choose(None, "tcp://host:1", 5) == Dask("tcp://host:1")


def test_an_absent_cluster_is_one_sentence(two_images, tmp_path, monkeypatch):
    distributed = pytest.importorskip("distributed")

    def refuse(*args, **options):
        raise OSError("refused")

    monkeypatch.setattr(distributed, "Client", refuse)
    with pytest.raises(InputError, match=r"found no Dask scheduler at tcp://127\.0\.0\.1:9"):
        run(Store.open(tmp_path, Study(two_images, {"gls": Gls()}, 1, 10)), Dask("tcp://127.0.0.1:9"))


def test_errors_are_measured_about_the_axes_of_the_tracker(two_images):
    """theta of C_EK_estimate = exp(theta) C_EK_true, by hand for one run."""

    @dataclass(frozen=True)
    class Off:
        def __call__(self, observations, C_EK):
            C = so3.exp(np.array([1e-5, -2e-5, 3e-5])) @ two_images.C_EK_true
            return AlignmentEstimate(
                np.broadcast_to(C, C_EK.shape), None, np.zeros(len(C_EK), int), np.zeros(1, int)
            )

    np.testing.assert_allclose(
        Study(two_images, {"off": Off()}, 1, 5).samples(0)["off"].theta_E, [[1e-5, -2e-5, 3e-5]] * 5
    )


SPOILT = {
    "empty": lambda good, other: b"",
    "cut off": lambda good, other: good[: len(good) // 2],
    "foreign": lambda good, other: b"PK\x03\x04 nothing of ours",
    "of another number": lambda good, other: other,
    "one bit": lambda good, other: good[:2000] + bytes([good[2000] ^ 1]) + good[2001:],
}


@pytest.mark.parametrize("spoil", SPOILT.values(), ids=SPOILT)
def test_a_spoilt_chunk_is_computed_again_and_said(two_images, tmp_path, spoil):
    study = Study(two_images, {"gls": Gls()}, 5, 60, 20)
    store = Store.open(tmp_path, study)
    assert run(store, Serial()) == ()
    good, other = store.path(1).read_bytes(), store.path(0).read_bytes()
    store.path(1).write_bytes(spoil(good, other))
    (said,) = run(Store.open(tmp_path, study), Serial())
    assert said.endswith(
        "found 1 chunks that are damaged or of another study (00000001.npz); they were computed again"
    )
    assert store.path(1).read_bytes() == good
    assert run(Store.open(tmp_path, study), Serial()) == ()


def test_a_chunk_of_another_study_is_none_of_this(two_images, tmp_path):
    for seed, name in ((5, "one"), (6, "two")):
        run(Store.open(tmp_path / name, Study(two_images, {"gls": Gls()}, seed, 20, 20)), Serial())
    store = Store.open(tmp_path / "one", Study(two_images, {"gls": Gls()}, 5, 20, 20))
    store.path(0).write_bytes((tmp_path / "two" / store.path(0).name).read_bytes())
    assert store.missing() == [0]


@pytest.mark.parametrize("text", ["", "[]", "{", "3", "\ud800"])
def test_a_spoilt_manifest_is_refused(two_images, tmp_path, text):
    (tmp_path / "study.json").write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(InputError, match=r"study\.json: found it damaged"):
        Store.open(tmp_path, Study(two_images, {"gls": Gls()}, 5, 20, 20))


def test_a_scheduler_that_dies_is_one_sentence_and_chunks_are_kept(two_images, tmp_path, monkeypatch, caplog):
    logging.getLogger("distributed.client").setLevel(logging.WARNING)  # as Dask sets it

    class Dying:
        def __init__(self, address, timeout):
            self.left = 2

        def __enter__(self):
            return self

        def __exit__(self, *error):
            return None

        def scatter(self, study, broadcast):
            return study

        def nthreads(self):
            return {"one": 1}

        def submit(self, function, study, c, **keywords):
            self.left -= 1
            if self.left < 0:
                logging.getLogger("distributed.client").error("a traceback of its own")
                raise OSError("Timed out trying to connect")
            return Future(lambda: function(study, c))

    class Future:
        def __init__(self, result):
            self.result = result

    class Done(list):
        add = list.append

    cluster = SimpleNamespace(Client=Dying, as_completed=Done, CancelledError=CancelledError)
    monkeypatch.setattr("starplumb.study.run.import_module", lambda name: cluster)
    store = Store.open(tmp_path, Study(two_images, {"gls": Gls()}, 1, 100, 10))
    with pytest.raises(
        InputError, match="scheduler: found the one at tcp://gone gone before the study was finished"
    ):
        run(store, Dask("tcp://gone"))
    assert len(store.missing()) == 9
    assert caplog.text == ""


@pytest.mark.parametrize("shipped", ["cubesat-6u", "wide-swath"])
def test_elimination_has_the_gain_and_bound_of_dense_matrices(shipped, monkeypatch):
    """Landmarks seen again and by one image, errors that images share, and a prior."""
    scenario = load_scenario(find_scenario(shipped))
    scenario = replace(scenario, initial=replace(scenario.initial, stated=True))
    dense = Linear(scenario, scenario.sources)
    expected = dense.covariance_E, dense.gain
    monkeypatch.setattr(bound, "MOST_SIGHTINGS", 0)
    found = Linear(scenario, scenario.sources)
    np.testing.assert_allclose(found.covariance_E, expected[0], rtol=1e-8, atol=1e-9 * np.trace(expected[0]))
    np.testing.assert_allclose(found.gain, expected[1], rtol=0.0, atol=1e-8 * np.abs(expected[1]).max())


@pytest.mark.slow
def test_a_study_is_the_same_for_any_number_of_workers_and_threads(tmp_path):
    command = [
        sys.executable,
        "-m",
        "starplumb",
        "simulate",
        "cubesat-6u",
        "--trials",
        "800",
        "--chunk",
        "400",
    ]
    summaries = set()
    for number, (workers, threads) in enumerate([("1", "1"), ("1", "2"), ("2", "2")]):
        out = tmp_path / str(number)
        environment = os.environ | dict.fromkeys(ONE_THREAD, threads)
        arguments = ["--methods", "gls,wahba", "--workers", workers, "--out", str(out), "--quiet"]
        subprocess.run([*command, *arguments], env=environment, check=True, capture_output=True)
        summaries.add((out / "summary.json").read_bytes())
    assert len(summaries) == 1
